"""The compared strategies. Each line of STRATEGIES is one of them; an ablation is a line, not a class.

`paper.csv` holds what Tables 2 and 3 of Zhang et al. 2021 print. Graph-STNN's e differs between the two, so a value
is keyed by its table.
"""

from __future__ import annotations

import csv
from collections import defaultdict
from pathlib import Path

from explore_bench.strategy import Entry, Published


def _published() -> dict[str, Published]:
    values: dict[str, Published] = defaultdict(dict)
    with Path(__file__).with_name("paper.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            values[row["strategy"]][row["table"], float(row["size"]), row["metric"]] = float(row["value"])
    return values


_PAPER = _published()
_BOTH, _TABLE2, _TABLE3, _LAYERS = ("table2", "table3"), ("table2",), ("table3",), ("layers",)

STRATEGIES: dict[str, Entry] = {
    name: Entry(factory, label, color, tables=tables, published=_PAPER[name], reference=name == "clairvoyant")
    for name, factory, label, color, tables in (
        ("graph-stnn", None, "Graph-STNN", "#d62728", (*_BOTH, *_LAYERS)),
        ("graph-stnn-1-layer", None, "Graph-STNN, 1 GCN layer", "#ff9896", _LAYERS),
        ("graph-stnn-3-layers", None, "Graph-STNN, 3 GCN layers", "#98df8a", _LAYERS),
        ("gcn-no-obs", None, "GCN-no_obs", "#6baed6", _TABLE2),
        ("gcn-obs", None, "GCN-obs", "#1f77b4", _TABLE2),
        ("no-state", None, "no state", "#9467bd", _TABLE3),
        ("no-temporal", None, "no temporal", "#e377c2", _TABLE3),
        ("no-spatial", None, "no spatial", "#8c564b", _TABLE3),
        ("no-temporal-state", None, "no temporal and state", "#bcbd22", _TABLE3),
        ("no-spatial-state", None, "no spatial and state", "#17becf", _TABLE3),
        ("no-spatial-temporal", None, "no spatial and temporal", "#aec7e8", _TABLE3),
        ("entropy", "baselines.entropy:Entropy", "Entropy", "#e69f00", _BOTH),
        ("uncertainty", "baselines.uncertainty:Uncertainty", "Uncertainty", "#009e73", _BOTH),
        ("random", "baselines.random_walk:Random", "Random", "#7f7f7f", _BOTH),
        ("nearest", "baselines.nearest:Nearest", "Nearest", "#b07aa1", _BOTH),
        ("clairvoyant", "baselines.clairvoyant:Clairvoyant", "Clairvoyant", "#000000", _BOTH),
    )
}
