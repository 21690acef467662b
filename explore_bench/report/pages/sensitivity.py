"""How each strategy degrades when the physical constants change: a table and a figure of a folder of variations."""

from __future__ import annotations

import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.ranking import COMPARED
from explore_bench.analysis.statistics import mean_interval, ratio_interval
from explore_bench.report.drawing import entry_of, plain_log, save_all, styled
from explore_bench.report.tables import (
    PAPER_METRICS,
    Table,
    groups_of,
    heading,
    interval_text,
    shown_by_world,
    shown_name,
)
from explore_bench.runs.suites import ROBUSTNESS
from explore_bench.world.scenarios import PAPER

UNCHANGED = next(iter(ROBUSTNESS))


def write_sensitivity(trials: pd.DataFrame, folder: Path) -> list[Path]:
    """Write the table and the figure `sensitivity`; returns the files."""
    written = sensitivity_table(trials).write(folder / "tables", "sensitivity")
    with styled():
        return written + save_all(sensitivity_figure(trials), folder / "figures" / "sensitivity")


def variations_of(trials: pd.DataFrame) -> list[str]:
    """Names of the scenarios of some trials, in the order of the suite, others after them."""
    order = {name: place for place, name in enumerate(ROBUSTNESS)}
    return sorted(set(trials["scenario"]), key=lambda name: (order.get(name, len(order)), name))


def sensitivity_table(trials: pd.DataFrame) -> Table:
    """Mean of e and η of every strategy on the unchanged constants, and its ratio to that under each variation."""
    names = variations_of(trials)
    changed = [name for name in names if name != UNCHANGED]
    rows = []
    for (strategy, size), cell in groups_of(trials):
        own = {str(name): part for name, part in cell.groupby("scenario")}
        place = shown_name(strategy), f"{size:g}"
        for metric in PAPER_METRICS:
            values = {name: shown_by_world(own[name], metric) for name in own}
            rows.append((*place, heading(METRICS[metric]), *_row(values, changed)))
        unfinished = [_unfinished(own.get(name)) for name in (UNCHANGED, *changed)]
        rows.append((*place, "trials not explored", *unfinished))
    header = ("Method", "size [m]", "", f"mean, {UNCHANGED}", *(f"{name}: ratio" for name in changed))
    note = (
        f"First column: mean over worlds with the constants of '{UNCHANGED}' [95 % BCa bootstrap interval]. Others: "
        "mean under the variation over that mean, on the worlds that both have, resampled together [95 % percentile "
        "bootstrap interval]. A world draws the same noise under all variations; where densities change, so does its "
        "map."
    )
    return Table("Sensitivity to the physical constants", header, tuple(rows), note)


def _row(values: dict[str, dict[int, float]], changed: list[str]) -> list[str]:
    base = values.get(UNCHANGED, {})
    finite = {name: all(map(math.isfinite, own.values())) for name, own in values.items()}
    row = [interval_text(mean_interval(np.array(list(base.values())))) if base and finite[UNCHANGED] else "–"]
    for name in changed:
        own = values.get(name, {})
        worlds = sorted(base.keys() & own.keys())
        if not worlds or not (finite[name] and finite[UNCHANGED]):
            row.append("–")
            continue
        varied, unchanged = (np.array([of[world] for world in worlds]) for of in (own, base))
        row.append(interval_text(ratio_interval(varied, unchanged)))
    return row


def _unfinished(cell: pd.DataFrame | None) -> str:
    return "–" if cell is None else f"{int((cell['status'] != 'explored').sum())} of {len(cell)}"


def sensitivity_figure(trials: pd.DataFrame) -> Figure | None:
    """Means of e and η over the values of every constant that varies, a line a strategy."""
    axis = {
        constant: {
            name: float(changes.get(constant, getattr(PAPER, constant)))
            for name, changes in ROBUSTNESS.items()
            if constant in changes or not changes
        }
        for constant in dict.fromkeys(key for changes in ROBUSTNESS.values() for key in changes)
    }
    ran = set(trials["scenario"])
    shown = {constant: own for constant, own in axis.items() if len(ran & own.keys()) > 1}
    groups = [
        (name, cell)
        for (name, _), cell in groups_of(trials)
        if COMPARED in entry_of(name).tables and any(map(entry_of(name).fills, PAPER_METRICS))
    ]
    if not shown or not groups:
        return None
    figure, grid = plt.subplots(
        len(PAPER_METRICS), len(shown), figsize=(2.5 * len(shown), 5.6), sharex="col", sharey="row", squeeze=False
    )
    for column, (constant, places) in enumerate(shown.items()):
        for row, metric in enumerate(PAPER_METRICS):
            for name, cell in groups:
                own = {str(scenario): shown_by_world(part, metric) for scenario, part in cell.groupby("scenario")}
                points = sorted((places[where], np.mean([*own[where].values()])) for where in places if own.get(where))
                style = "--" if entry_of(name).reference else "-"
                x, y = zip(*points, strict=True) if points else ((), ())
                grid[row, column].plot(
                    x, y, style, color=entry_of(name).color, marker="o", ms=3, lw=1.2, label=shown_name(name)
                )
            grid[row, column].set_yscale("log")
        grid[-1, column].set(xlabel=constant.replace("_", " "), xticks=sorted(places.values()))
        if isinstance(getattr(PAPER, constant), bool):
            grid[-1, column].set_xticks([0, 1], ["off", "on"])
    for row, metric in enumerate(PAPER_METRICS):
        grid[row, 0].set_ylabel(heading(METRICS[metric]))
        plain_log(grid[row, 0].yaxis)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)), fontsize=8)
    figure.suptitle("Means over worlds while one constant changes", fontsize=10)
    return figure
