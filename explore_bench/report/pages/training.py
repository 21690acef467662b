"""The paper's training figures from the curves that are stored beside the weights."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from explore_bench.analysis.training_curve import CURVE_WINDOW, on_one_axis, training_curves
from explore_bench.report.drawing import save_all, styled
from explore_bench.strategies.registry import strategies

TRAINING_FIGURES = {"figure-07": "layers", "figure-09": "table2", "figure-12": "table3"}
"""Figure → the table whose learned strategies it shows."""

PANELS = {"reward": "reward a decision (Eq. 24)", "efficiency": "η [m²/step]", "error": "e [m]"}


def write_training_figures(folder: Path) -> list[Path]:
    """Draw the training of every learned strategy that ships with a curve; returns the files written."""
    written: list[Path] = []
    with styled():
        for name, table in TRAINING_FIGURES.items():
            shown = {key: training_curves(entry) for key, entry in strategies().items() if table in entry.tables}
            curves = {key: list(own.values()) for key, own in shown.items() if own}
            written += save_all(_figure(curves) if curves else None, folder / name)
    return written


def _figure(curves: dict[str, list[pd.DataFrame]]) -> Figure:
    figure, grid = plt.subplots(1, len(PANELS), figsize=(11.5, 3.6))
    for axes, (column, label) in zip(grid, PANELS.items(), strict=True):
        for name, own in curves.items():
            entry = strategies()[name]
            steps, values = on_one_axis(own, column)
            steps = steps / 1000
            seeds = f" ({len(own)} seeds)" if len(own) > 1 else ""
            axes.plot(steps, np.nanmean(values, axis=0), color=entry.color, linewidth=1.2, label=entry.label + seeds)
            if len(own) > 1:
                axes.fill_between(
                    steps, np.nanmin(values, axis=0), np.nanmax(values, axis=0), color=entry.color, alpha=0.15, lw=0
                )
        axes.set(xlabel="simulated steps [thousand]", title=label)
        axes.set_xlim(left=0)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(curves)))
    figure.suptitle(f"Training, means over {CURVE_WINDOW:,} steps; bands: lowest to highest of the seeds", fontsize=10)
    return figure
