"""The compared strategies. Each line of STRATEGIES is one of them; an ablation is a line, not a class."""

from __future__ import annotations

from explore_bench.strategy import Entry

STRATEGIES: dict[str, Entry] = {
    "random": Entry("baselines.random_walk:Random", "Random", "#8c8c8c"),
    "nearest": Entry("baselines.nearest:Nearest", "Nearest", "#b07aa1"),
    "entropy": Entry("baselines.entropy:Entropy", "Entropy", "#e69f00"),
    "uncertainty": Entry("baselines.uncertainty:Uncertainty", "Uncertainty", "#009e73"),
    "clairvoyant": Entry("baselines.clairvoyant:Clairvoyant", "Clairvoyant", "#000000", reference=True),
    "graph-stnn": Entry(None, "Graph-STNN", "#d62728"),
    "gcn-obs": Entry(None, "GCN-obs", "#1f77b4", tables=("table2",)),
    "gcn-no-obs": Entry(None, "GCN-no_obs", "#6baed6", tables=("table2",)),
    "no-state": Entry(None, "no state", "#9467bd", tables=("table3",)),
    "no-temporal": Entry(None, "no temporal", "#e377c2", tables=("table3",)),
    "no-spatial": Entry(None, "no spatial", "#8c564b", tables=("table3",)),
    "no-temporal-state": Entry(None, "no temporal and state", "#bcbd22", tables=("table3",)),
    "no-spatial-state": Entry(None, "no spatial and state", "#17becf", tables=("table3",)),
    "no-spatial-temporal": Entry(None, "no spatial and temporal", "#7f7f7f", tables=("table3",)),
}
