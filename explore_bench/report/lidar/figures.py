"""The figure of trials in lidar worlds: how far every strategy drove, and how long, in each scenario."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from explore_bench.analysis.lidar.metrics import METRICS
from explore_bench.analysis.ranking import places_of
from explore_bench.analysis.statistics import mean_interval
from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import heading, shown_by_world, shown_name
from explore_bench.strategies.registry import in_order

PANELS = ("l90", "t98_seconds")
"""Metrics, a row of panels each."""


def figures(trials: pd.DataFrame) -> dict[str, Figure]:
    """Figures by the names of their files."""
    return {"stage-ranking": ranking(trials)}


def ranking(trials: pd.DataFrame) -> Figure:
    """Means of PANELS with 95 % intervals, a column of panels for each scenario and size, a line a strategy."""
    names = in_order(trials["strategy"])
    places = places_of(trials)
    figure, grid = plt.subplots(
        len(PANELS),
        len(places),
        figsize=(2.2 + 2.6 * len(places), 0.9 + len(PANELS) * (0.5 + 0.24 * len(names))),
        sharey=True,
        squeeze=False,
    )
    for column, (scenario, size) in enumerate(places):
        here = trials[(trials["scenario"] == scenario) & (trials["size"] == size)]
        for row, metric in enumerate(PANELS):
            _panel(grid[row, column], here, names, metric)
        grid[0, column].set_title(f"{scenario}, {size:g} m")
    for axes in grid[:, 0]:
        axes.set_yticks(range(len(names)), [shown_name(name) for name in names])
        axes.set_ylim(len(names) - 0.5, -0.5)
    return figure


def _panel(axes: Axes, trials: pd.DataFrame, names: list[str], metric: str) -> None:
    for line, name in enumerate(names):
        own = trials[trials["strategy"] == name]
        values = np.array(list(shown_by_world(own, metric).values()))
        if not len(values) or not np.isfinite(values).all():
            continue
        mean = mean_interval(values)
        reach = [[mean.mean - mean.low], [mean.high - mean.mean]] if mean.n > 1 else None
        axes.errorbar([mean.mean], [line], xerr=reach, fmt="o", ms=5, color=entry_of(name).color, capsize=2)
    axes.set_xlim(left=0.0)
    axes.set_xlabel(heading(METRICS[metric]))
