"""The colour of each compared strategy, in every figure and page."""

from __future__ import annotations

COLORS = {
    "graph-stnn": "#d62728",
    "belief-attention": "#ff7f0e",
    "graph-stnn-path": "#f7b6d2",
    "graph-stnn-1-layer": "#ff9896",
    "graph-stnn-3-layers": "#98df8a",
    "gcn-no-obs": "#6baed6",
    "gcn-obs": "#1f77b4",
    "gcn-obs-blind": "#393b79",
    "no-state": "#9467bd",
    "no-temporal": "#e377c2",
    "no-spatial": "#8c564b",
    "no-temporal-state": "#bcbd22",
    "no-spatial-state": "#17becf",
    "no-spatial-temporal": "#aec7e8",
    "entropy": "#e69f00",
    "entropy-path": "#b35900",
    "entropy-per-metre": "#ffd92f",
    "uncertainty": "#009e73",
    "random": "#7f7f7f",
    "nearest": "#b07aa1",
    "clairvoyant": "#000000",
}
