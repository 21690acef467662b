"""The paper's training figures from the curves that are stored beside the weights."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from explore_bench.analysis.training_curve import CURVE_WINDOW, on_one_axis, trainings
from explore_bench.report.drawing import save_all, styled
from explore_bench.report.figures import without_variants
from explore_bench.strategies.registry import strategies

TRAINING_FIGURES = {"figure-07": "layers", "figure-09": "table2", "figure-12": "table3"}
"""Figure → the table whose learned strategies it shows."""

VALIDATION_FIGURES = {f"validation-{name.removeprefix('figure-')}": table for name, table in TRAINING_FIGURES.items()}
"""Likewise of the greedy policies in their worlds of validation."""

PANELS = {"reward": "reward a decision (Eq. 24)", "efficiency": "η [m²/step]", "error": "e [m]"}
VALIDATED = {"objective": "log e − log η", "efficiency": "η [m²/step]", "error": "e [m]"}


class View(NamedTuple):
    """How rows that are stored of trainings are drawn.

    Attributes
    ----------
    panels : columns with their titles.
    along, spacing : column of the horizontal axis, and how far apart values of several seeds are averaged.
    axis, title : what stands below and above.
    """

    panels: dict[str, str]
    along: str
    spacing: float
    axis: str
    title: str


TRAINING = View(
    PANELS,
    "steps",
    CURVE_WINDOW,
    "simulated steps [thousand]",
    f"Training, means over {CURVE_WINDOW:,} steps; bands: lowest to highest of the seeds",
)
VALIDATION = View(
    VALIDATED,
    "episodes",
    500.0,
    "episodes of training [thousand]",
    "Greedy policies in their worlds of validation; bands: lowest to highest of the seeds",
)


def write_training_figures(folder: Path, names: Collection[str] | None = None) -> list[Path]:
    """Draw the training of the learned strategies (None: all) that ship with a curve; returns the files written.

    A network without its variants has no figure of variants.
    """
    written: list[Path] = []
    with styled():
        for (name, table), greedy in zip(TRAINING_FIGURES.items(), VALIDATION_FIGURES, strict=True):
            shown = {
                key: trainings(entry).values()
                for key, entry in strategies().items()
                if table in entry.tables and (names is None or key in names)
            }
            curves = {key: [own.curve for own in of] for key, of in shown.items()}
            validated = {
                key: [own.validations for own in of if own.validations is not None] for key, of in shown.items()
            }
            written += save_all(_figure(curves, table, TRAINING), folder / name)
            written += save_all(_figure(validated, table, VALIDATION), folder / greedy)
    return written


def _figure(curves: dict[str, list[pd.DataFrame]], table: str, view: View) -> Figure | None:
    """Curves of each strategy's seeds; None where there are none to be compared."""
    curves = {name: own for name, own in curves.items() if own}
    if not curves or without_variants(table, curves):
        return None
    figure, grid = plt.subplots(1, len(view.panels), figsize=(11.5, 3.6))
    for axes, (column, label) in zip(grid, view.panels.items(), strict=True):
        for name, own in curves.items():
            entry = strategies()[name]
            places, values = on_one_axis(own, column, view.along, view.spacing)
            places = places / 1000
            seeds = f" ({len(own)} seeds)" if len(own) > 1 else ""
            axes.plot(places, np.nanmean(values, axis=0), color=entry.color, linewidth=1.2, label=entry.label + seeds)
            if len(own) > 1:
                axes.fill_between(
                    places, np.nanmin(values, axis=0), np.nanmax(values, axis=0), color=entry.color, alpha=0.15, lw=0
                )
        axes.set(xlabel=view.axis, title=label)
        axes.set_xlim(left=0)
    handles, labels = grid[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(4, len(curves)))
    figure.suptitle(view.title, fontsize=10)
    return figure
