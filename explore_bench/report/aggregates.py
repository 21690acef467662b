"""Robust views of the same trials: interquartile means, times to coverage as survival curves, wins by world.

Axes: worlds, with training seeds averaged within a world first; of survival curves trials; wins are of every seed.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.paired import paired
from explore_bench.analysis.ranking import COMPARED
from explore_bench.analysis.statistics import Survival, interquartile_mean_interval, survival
from explore_bench.report.drawing import entry_of, plain_log, save_all, styled
from explore_bench.report.tables import (
    PAPER_METRICS,
    Scope,
    Table,
    groups_of,
    heading,
    interval_text,
    shown_by_world,
    shown_name,
)

COVERAGES = {"t50": 0.5, "t80": 0.8, "t90": 0.9}


def aggregate_tables(trials: pd.DataFrame) -> dict[str, Table]:
    """Tables by the names of their files."""
    return {"robust": robust_table(trials), "wins": wins_table(trials)}


def write_survival_figures(trials: pd.DataFrame, folder: Path) -> list[Path]:
    """Write a figure of survival curves a size; returns the files."""
    written: list[Path] = []
    with styled():
        for size in sorted(set(trials["size"])):
            written += save_all(survival_figure(trials, size), folder / f"times-{size:g}m")
    return written


def robust_table(trials: pd.DataFrame) -> Table:
    """Interquartile means of e and η, and how fast trials reach a share of the map, of every strategy and size."""
    header = ["Method", "size [m]", "n", *(f"{heading(METRICS[name])}, IQM" for name in PAPER_METRICS)]
    header += [f"{METRICS[name].symbol}, median [step]" for name in COVERAGES] + ["never 90 %"]
    rows = []
    for (strategy, size), cell in groups_of(trials):
        row = [shown_name(strategy), f"{size:g}", str(cell["trial"].nunique())]
        for name in PAPER_METRICS:
            values = np.array(list(shown_by_world(cell, name).values()))
            shown = len(values) and np.isfinite(values).all()
            row.append(interval_text(interquartile_mean_interval(values)) if shown else "–")
        row += [_median(cell, name) for name in COVERAGES]
        row.append(f"{int((~_reached(cell, 't90')).sum())} of {len(cell)}")
        rows.append(tuple(row))
    note = (
        "IQM: mean over the middle half of the worlds [95 % BCa bootstrap interval], training seeds averaged within a "
        "world first. Medians of the time to a share of the map are over trials: one that ended before it never "
        "reached it."
    )
    scopes = tuple(Scope((strategy,), size) for (strategy, size), _ in groups_of(trials))
    return Table("Interquartile means and times to coverage", tuple(header), tuple(rows), note, scopes)


def coverage_survival(cell: pd.DataFrame, name: str) -> Survival:
    """Survival curve of the time to a share of the map, `name` of COVERAGES, over the trials of a cell."""
    return survival(np.where(_reached(cell, name), cell[name], np.inf))


def _median(cell: pd.DataFrame, name: str) -> str:
    """Median time to a share of the map; a dash where most trials never knew it or a reference does not plan for it."""
    median = coverage_survival(cell, name).median if shown_by_world(cell, name) else math.inf
    return f"{median:.0f}" if math.isfinite(median) else "–"


def _reached(cell: pd.DataFrame, name: str) -> np.ndarray:
    """Which trials knew that share of the map before they ended; the time of the others is the step limit."""
    return np.asarray((cell["explored"] >= COVERAGES[name]) | (cell[name] < cell["steps"]))


def wins_table(trials: pd.DataFrame) -> Table:
    """Worlds won, tied and lost by the first of every two strategies, in e and η; references compete with nobody."""
    header = ("size [m]", "A", "B", *(f"{METRICS[name].symbol}: A wins/ties/loses" for name in PAPER_METRICS))
    rows, scopes = [], []
    for size in sorted(set(trials["size"])):
        own = {name: cell for (name, s), cell in groups_of(trials) if s == size and not entry_of(name).reference}
        for a, b in itertools.combinations(own, 2):
            counts = [_wins(own[a], own[b], name) for name in PAPER_METRICS]
            rows.append((f"{size:g}", entry_of(a).label, entry_of(b).label, *counts))
            scopes.append(Scope((a, b), size))
    note = (
        "Worlds that all seeds of both tried, of every training seed against every other, then averaged; less e and "
        "more η win, and what differs by no more than rounding ties."
    )
    return Table("Wins, ties and losses by world", header, tuple(rows), note, tuple(scopes))


def _wins(a: pd.DataFrame, b: pd.DataFrame, metric: str) -> str:
    sign = 1.0 if METRICS[metric].better == "higher" else -1.0
    pair = paired(a, b, metric)
    return "/".join(f"{round(count, 1):g}" for count in pair.wins(sign)) if pair.defined else "–"


def survival_figure(trials: pd.DataFrame, size: float) -> Figure | None:
    """Share of trials that do not yet know 50, 80 and 90 % of the map, over the steps; None where nobody is shown."""
    own = {
        name: cell
        for (name, s), cell in groups_of(trials)
        if s == size and COMPARED in entry_of(name).tables and any(map(entry_of(name).fills, COVERAGES))
    }
    if not own:
        return None
    figure, grid = plt.subplots(1, len(COVERAGES), figsize=(11.5, 3.8), sharey=True)
    lines: dict[str, Line2D] = {}
    for axes, (metric, coverage) in zip(grid, COVERAGES.items(), strict=True):
        for name, cell in own.items():
            if not shown_by_world(cell, metric):
                continue
            curve, entry = coverage_survival(cell, metric), entry_of(name)
            last = float(np.fmax(np.where(_reached(cell, metric), cell[metric], cell["steps"]), 1.0).max())
            times, shares = _stairs(curve.times, curve.shares, last)
            style = "--" if entry.reference else "-"
            [lines[name]] = axes.step(
                times, shares, where="post", color=entry.color, linestyle=style, lw=1.2, label=shown_name(name)
            )
        axes.set(xlabel="step", title=f"trials below {coverage:.0%} of the map", ylim=(0, 1.02))
        axes.set_xscale("log")
        plain_log(axes.xaxis)
    grid[0].set_ylabel("share of trials")
    handles, labels = [lines[name] for name in own], [shown_name(name) for name in own]
    figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(own)), fontsize=8)
    figure.suptitle(f"{size:g} m × {size:g} m, over trials", fontsize=10)
    return figure


def _stairs(times: np.ndarray, shares: np.ndarray, last: float) -> tuple[Sequence[float], Sequence[float]]:
    """A survival curve from shortly before its first step to the last time seen."""
    begin = 0.8 * float(times[0] if len(times) else last)
    return [begin, *times, last], [1.0, *shares, shares[-1] if len(shares) else 1.0]
