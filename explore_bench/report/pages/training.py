"""The paper's training figures from the curves that are stored beside the weights."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from explore_bench.analysis.training_curve import CURVE_WINDOW, on_one_axis, trainings
from explore_bench.report.drawing import save_all, styled
from explore_bench.strategies.registry import strategies

TRAINING_FIGURES = {"figure-07": "layers", "figure-09": "table2", "figure-12": "table3"}
"""Figure → the table whose learned strategies it shows."""

VALIDATION_FIGURES = {f"validation-{name.removeprefix('figure-')}": table for name, table in TRAINING_FIGURES.items()}
"""Likewise of the greedy policies in their worlds of validation."""

PANELS = {"reward": "reward a decision (Eq. 24)", "efficiency": "η [m²/step]", "error": "e [m]"}
VALIDATED = {"objective": "log e − log η", "efficiency": "η [m²/step]", "error": "e [m]"}

EPISODES = 500.0
"""Between two places at which validations of several seeds are averaged."""


def write_training_figures(folder: Path) -> list[Path]:
    """Draw the training of every learned strategy that ships with a curve; returns the files written."""
    written: list[Path] = []
    with styled():
        for (name, table), greedy in zip(TRAINING_FIGURES.items(), VALIDATION_FIGURES, strict=True):
            shown = {
                key: list(trainings(entry).values()) for key, entry in strategies().items() if table in entry.tables
            }
            curves = {key: [training.curve for training in own] for key, own in shown.items() if own}
            written += save_all(_curves(curves) if curves else None, folder / name)
            validated = {
                key: [training.validations for training in own if training.validations is not None]
                for key, own in shown.items()
            }
            validated = {key: own for key, own in validated.items() if own}
            written += save_all(_validations(validated) if validated else None, folder / greedy)
    return written


def _curves(curves: dict[str, list[pd.DataFrame]]) -> Figure:
    return _figure(
        curves,
        PANELS,
        "steps",
        CURVE_WINDOW,
        "simulated steps [thousand]",
        f"Training, means over {CURVE_WINDOW:,} steps; bands: lowest to highest of the seeds",
    )


def _validations(curves: dict[str, list[pd.DataFrame]]) -> Figure:
    return _figure(
        curves,
        VALIDATED,
        "episodes",
        EPISODES,
        "episodes of training [thousand]",
        "Greedy policies in their worlds of validation; bands: lowest to highest of the seeds",
    )


def _figure(
    curves: dict[str, list[pd.DataFrame]],
    panels: dict[str, str],
    along: str,
    spacing: float,
    axis: str,
    title: str,
) -> Figure:
    figure, grid = plt.subplots(1, len(panels), figsize=(11.5, 3.6))
    for axes, (column, label) in zip(grid, panels.items(), strict=True):
        for name, own in curves.items():
            entry = strategies()[name]
            places, values = on_one_axis(own, column, along, spacing)
            places = places / 1000
            seeds = f" ({len(own)} seeds)" if len(own) > 1 else ""
            axes.plot(places, np.nanmean(values, axis=0), color=entry.color, linewidth=1.2, label=entry.label + seeds)
            if len(own) > 1:
                axes.fill_between(
                    places, np.nanmin(values, axis=0), np.nanmax(values, axis=0), color=entry.color, alpha=0.15, lw=0
                )
        axes.set(xlabel=axis, title=label)
        axes.set_xlim(left=0)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(curves)))
    figure.suptitle(title, fontsize=10)
    return figure
