"""The compared strategies with label, tables and weights, and in `colors.py` their colours.

An ablation is a line, not a class.

`paper.csv` holds what Tables 2 and 3 of Zhang et al. 2021 print. Graph-STNN's e differs between the two, so a value
is keyed by its table. `weights/` holds what `explore-bench train` made: NAME-SEED.safetensors, each with a card.
"""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

from baselines.colors import COLORS
from explore_bench import Entry, Published

WEIGHTS = Path(__file__).with_name("weights")


def _published() -> dict[str, Published]:
    values: dict[str, Published] = defaultdict(dict)
    with Path(__file__).with_name("paper.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            values[row["strategy"]][row["table"], float(row["size"]), row["metric"]] = float(row["value"])
    return values


def _weights() -> dict[str, dict[int, str]]:
    found: dict[str, dict[int, str]] = defaultdict(dict)
    for file in sorted(WEIGHTS.glob("*.safetensors")):
        if parts := re.fullmatch(r"(.+)-(\d+)", file.stem):
            found[parts[1]][int(parts[2])] = f"{WEIGHTS.parent.name}:{WEIGHTS.name}/{file.name}"
    return found


_PAPER, _SHIPPED = _published(), _weights()
_TABLE2, _TABLE3, _LAYERS, _CELLS = ("table2",), ("table3",), ("layers",), ("cells",)
_PLANS, _FIGURE16 = ("plans",), ("figure16",)
_STNN, _GCN, _TRAINER = (
    "baselines.learned.graph_stnn:strategy",
    "baselines.learned.gcn:strategy",
    "baselines.training.train:train",
)

ENTROPY_WEIGHT = 0.1
"""w [bit per m] of `entropy-path`, tuned on calibration worlds: docs/path-weights.md."""

STRATEGIES: dict[str, Entry] = {}


def _add(name: str, factory: str, label: str, tables: tuple[str, ...], **options: Any) -> None:
    STRATEGIES[name] = Entry(factory, label, COLORS[name], tables=tables, published=_PAPER[name], **options)


def _learned(name: str, factory: str, label: str, tables: tuple[str, ...], **options: Any) -> None:
    _add(name, factory, label, tables, trainer=_TRAINER, weights=_SHIPPED[name], **options)


_learned("graph-stnn", _STNN, "Graph-STNN", (*_TABLE2, *_TABLE3, *_LAYERS), suites=(*_PLANS, *_FIGURE16))
_learned(
    "belief-attention",
    "baselines.learned.belief_attention:strategy",
    "Belief attention (ours)",
    _TABLE2,
    suites=_PLANS,
    formerly=("graph-stnn-plus",),
)
_learned("graph-stnn-path", _STNN, "Graph-STNN, path length", _TABLE2, parameters={"distance": "path"})
_learned("graph-stnn-1-layer", _STNN, "Graph-STNN, 1 GCN layer", _LAYERS, parameters={"layers": 1})
_learned("graph-stnn-3-layers", _STNN, "Graph-STNN, 3 GCN layers", _LAYERS, parameters={"layers": 3})
_learned(
    "gcn-no-obs",
    _GCN,
    "GCN-no_obs",
    _TABLE2,
    parameters={"obstacles": False},
    training={"obstacle_count": 0},
)
_learned("gcn-obs", _GCN, "GCN-obs", _TABLE2)
_learned("gcn-obs-blind", _GCN, "GCN-obs, blind", _TABLE2, parameters={"obstacles": False})
_learned("graph-stnn-cell", _STNN, "Graph-STNN, entropy of the cell", _CELLS, parameters={"entropy": "cell"})
for _name, _off in (
    ("no-state", ("state",)),
    ("no-temporal", ("temporal",)),
    ("no-spatial", ("spatial",)),
    ("no-temporal-state", ("temporal", "state")),
    ("no-spatial-state", ("spatial", "state")),
    ("no-spatial-temporal", ("spatial", "temporal")),
):
    _label, _switches = f"no {' and '.join(_off)}", dict.fromkeys(_off, False)
    _learned(_name, _STNN, _label, _TABLE3, parameters=_switches)
    _learned(
        f"{_name}-cell", _STNN, f"{_label}, entropy of the cell", _CELLS, parameters={**_switches, "entropy": "cell"}
    )
_add("entropy", "baselines.entropy:Entropy", "Entropy", _TABLE2, suites=_PLANS)
_add(
    "entropy-path",
    "baselines.entropy:Entropy",
    "Entropy, path weight (ours)",
    _TABLE2,
    parameters={"weight": ENTROPY_WEIGHT},
)
_add("entropy-per-metre", "baselines.entropy_per_metre:EntropyPerMetre", "Entropy per metre (ours)", _TABLE2)
_add("uncertainty", "baselines.uncertainty:Uncertainty", "Uncertainty", _TABLE2)
_add("random", "baselines.random_walk:Random", "Random", _TABLE2, suites=_PLANS)
_add(
    "nearest",
    "baselines.nearest:Nearest",
    "Nearest",
    _TABLE2,
    baseline=True,
    suites=(*_PLANS, *_FIGURE16),
)
_add(
    "clairvoyant",
    "baselines.reference.clairvoyant:Clairvoyant",
    "Clairvoyant",
    _TABLE2,
    reference=True,
    plans=("t90", "regret", "regret_most"),
    kinds=("landmark",),
)
_add(
    "clairvoyant-accurate",
    "baselines.reference.clairvoyant:Clairvoyant",
    "Clairvoyant, e and η",
    _TABLE2,
    parameters={"aim": "accuracy"},
    reference=True,
    plans=("trajectory_error", "exploration_efficiency"),
    kinds=("landmark",),
)
