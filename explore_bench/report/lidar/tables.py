"""The tables of trials in lidar worlds: how every strategy did, and how much better or worse than the baseline."""

from __future__ import annotations

import pandas as pd

from explore_bench.analysis.lidar.metrics import METRICS as OWN
from explore_bench.analysis.metrics import METRICS as COMMON
from explore_bench.analysis.tables import by_world
from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import Scope, Table, groups_of, heading, mean_text, paired_texts, shown_name

METRICS = COMMON | OWN

SHOWN_METRICS = (
    *("t90_seconds", "t98_seconds", "path_length", "l90", "decisions", "in_vain", "crossings", "round_trips"),
    *("uncertainty_reduction", "trajectory_error", "absolute_trajectory_error", "relative_pose_error", "pose_nees"),
    *("wall_f1_1", "true_closures", "false_closures", "missed_closures"),
    *("collisions", "clearance", "unsafe", "smoothness"),
)
PAIRED_METRICS = (
    *("t90_seconds", "t98_seconds", "path_length", "l90"),
    *("trajectory_error", "absolute_trajectory_error", "wall_f1_1"),
)

NOTE = (
    "Mean over n worlds [95 % BCa bootstrap interval], training seeds averaged within a world first; a dash where a "
    "trial has no such value. T90, T98: simulated time until 90 and 98 % of what counts is known; L: way driven; L90: "
    "way until 90 %. A trial that did not get there counts the time limit, and the way at top speed until then. D: "
    "decisions; in vain: share of them that did not resolve their frontier; crossings: those that took one twice as "
    "far as one left behind; round trips: drives along where it was long before. ΔU, e: Eq. 1 and 3, in key poses. "
    "ATE: error of the final trajectory; RPE: of its motions over 1 m of way; NEES: 3 where covariances are honest. "
    "Wall F1: walls of the final map within one cell of true ones, and the reverse. Closures: loops closed rightly, "
    "closed wrongly, and revisits at which none was closed. C: contacts. Clearance: least distance of the hull from an "
    "obstacle; unsafe: share of time under 0.1 m of it; acceleration: mean magnitude (all three after MRPB)."
)
PAIRED_NOTE = (
    "Mean difference over the n worlds that both tried, scored as in the table before [95 % BCa bootstrap interval]; "
    "below 0 the strategy has less of it than the baseline. Less is better of all but wall F1."
)


def tables(trials: pd.DataFrame) -> dict[str, Table]:
    """Tables by the names of their files."""
    paired = paired_table(trials)
    return {"stage": stage_table(trials)} | ({"stage-paired": paired} if paired.rows else {})


def stage_table(trials: pd.DataFrame) -> Table:
    """What was measured of every strategy in every scenario and size, a row each."""
    header = (
        "Method",
        "scenario",
        "size [m]",
        "n",
        "not explored",
        *(heading(METRICS[name]) for name in SHOWN_METRICS),
    )
    rows, scopes = [], []
    for strategy, scenario, size, cell in _cells(trials):
        unfinished = int((cell["status"] != "explored").sum())
        row = (shown_name(strategy), scenario, f"{size:g}", str(cell["trial"].nunique()), str(unfinished))
        rows.append((*row, *(mean_text(cell, name) for name in SHOWN_METRICS)))
        scopes.append(Scope((strategy,), size))
    return Table("Strategies in lidar worlds", header, tuple(rows), NOTE, tuple(scopes))


def paired_table(trials: pd.DataFrame) -> Table:
    """Differences of every strategy to each baseline, paired by world within a scenario and size."""
    header = ("Method", "baseline", "scenario", "size [m]", "n", *(heading(METRICS[name]) for name in PAIRED_METRICS))
    cells = {(strategy, scenario, size): cell for strategy, scenario, size, cell in _cells(trials)}
    rows, scopes = [], []
    for (strategy, scenario, size), cell in cells.items():
        if entry_of(strategy).reference:
            continue
        for other, base in cells.items():
            if other[1:] != (scenario, size) or other[0] == strategy or not entry_of(other[0]).baseline:
                continue
            both = set(cell["trial"]) & set(base["trial"])
            found = paired_texts([(by_world(cell, name), by_world(base, name)) for name in PAIRED_METRICS])
            labels = entry_of(strategy).label, entry_of(other[0]).label
            rows.append((*labels, scenario, f"{size:g}", str(len(both)), *found))
            scopes.append(Scope((strategy, other[0]), size))
    title = "Differences to the baseline in lidar worlds, paired by world"
    return Table(title, header, tuple(rows), PAIRED_NOTE, tuple(scopes))


def _cells(trials: pd.DataFrame) -> list[tuple[str, str, float, pd.DataFrame]]:
    """Strategy, scenario, size and their trials, in the registered order of the strategies."""
    return [
        (strategy, str(scenario), size, own)
        for (strategy, size), cell in groups_of(trials)
        for scenario, own in cell.groupby("scenario")
    ]
