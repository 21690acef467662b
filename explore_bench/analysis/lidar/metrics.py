"""The metrics that trials in lidar worlds have beside the common ones: seconds, metres, the map, loops and the drive.

A trial that did not explore is scored as everywhere (`trial.error_and_efficiency`): what it did not reach counts as
reached at the limit. In seconds that is the time limit, in metres the longest way that a robot can drive until then.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from explore_bench.analysis.metrics import Metric, broken_off, finished, last, score, time_to
from explore_bench.trial import error_and_efficiency

if TYPE_CHECKING:  # compiled code and scipy take a second to import, and a list of metrics needs none
    from explore_bench.analysis.lidar.map_quality import MapQuality
    from explore_bench.geometry import Array
    from explore_bench.records.encoding import TrialRecord

Value = Callable[["TrialRecord"], float]

RELATIVE_OVER = 1.0
"""True way [m] over which the relative pose error is taken."""


def most_seconds(scenario: Any) -> float:
    """Seconds that a trial counts as when it did not explore."""
    return float(scenario.time_limit)


def most_metres(scenario: Any) -> float:
    """Metres that a trial counts as when it did not explore: at top speed until the time limit."""
    return float(scenario.max_speed * scenario.time_limit)


def seconds(record: TrialRecord) -> float:
    """Simulated time [s] at the end of the trial."""
    return float(record.steps["seconds"][-1]) if finished(record) else most_seconds(record.spec.scenario)


def metres(record: TrialRecord) -> float:
    """Way driven [m] at the end of the trial."""
    return float(record.steps["path_length"][-1]) if finished(record) else most_metres(record.spec.scenario)


def error_over(effort: Value) -> Value:
    """Metric of Eq. 3 with another effort in the place of the steps n_a."""

    def value(record: TrialRecord) -> float:
        peak, scenario = score(record).peak_trace, record.spec.scenario
        return float(error_and_efficiency.trajectory_error(effort(record), peak, scenario))

    return value


def efficiency_over(effort: Value) -> Value:
    """Metric of Eq. 2 with another effort in the place of the steps T; NaN for a trial that explored without any."""

    def value(record: TrialRecord) -> float:
        spent = effort(record)
        return score(record).uncertainty_reduction / spent if spent else math.nan

    return value


def relative_pose_error(record: TrialRecord) -> float:
    """Root mean square error [m] of the motion between two key poses 1 m of true way apart, by the final estimate.

    Each key pose is paired with the first one at least so far on (Sturm et al. 2012, "A benchmark for the evaluation of
    RGB-D SLAM systems"). NaN for a trial that broke off or drove less.
    """
    if broken_off(record):
        return math.nan
    steps, final = record.steps, record.final
    true = np.stack([steps[name] for name in ("true_x", "true_y", "true_heading")], axis=1)
    estimate = np.stack([final[name] for name in ("final_x", "final_y", "final_heading")], axis=1).astype(float)
    later = np.searchsorted(steps["path_length"], steps["path_length"] + RELATIVE_OVER - 1e-9)
    earlier = np.flatnonzero(later < len(later))
    if not len(earlier):
        return math.nan
    errors = _seen_from(estimate[earlier], estimate[later[earlier]]) - _seen_from(true[earlier], true[later[earlier]])
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def _seen_from(poses: Array, others: Array) -> Array:
    """Places of other poses in the frames of some, shape (K, 2), of shapes (K, 3)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    dx, dy = (others - poses)[:, :2].T
    return np.stack((c * dx + s * dy, c * dy - s * dx), axis=1)


def heading_error(record: TrialRecord) -> float:
    """Root mean square error [°] of the headings of the final estimate; NaN for a trial that broke off."""
    if broken_off(record):
        return math.nan
    turn = record.final["final_heading"].astype(float) - record.steps["true_heading"]
    return math.degrees(float(np.sqrt((((turn + math.pi) % math.tau - math.pi) ** 2).mean())))


def of_map(value: Callable[[MapQuality], float]) -> Value:
    """Metric of the robot's last map beside the truth; NaN where no map was kept."""

    def of_record(record: TrialRecord) -> float:
        from explore_bench.analysis.lidar.map_quality import map_quality

        quality = map_quality(record)
        return math.nan if quality is None else value(quality)

    return of_record


def true_closures(record: TrialRecord) -> float:
    """Loops closed whose relative pose is the true one; NaN for a trial that broke off."""
    return last("closures")(record) - last("false_closures")(record)


def ratio(column: str, over: str) -> Value:
    """Metric of one column's last value over another's; NaN for a trial that broke off, and where that is 0."""

    def value(record: TrialRecord) -> float:
        whole = last(over)(record)
        return last(column)(record) / whole if whole else math.nan

    return value


METRICS: dict[str, Metric] = {
    "simulated_seconds": Metric("T", "s", "lower", "simulated time; the time limit where it did not explore", seconds),
    "t90_seconds": Metric(
        "T90", "s", "lower", "time with 90 % of the map known", time_to(0.9, "seconds", most_seconds)
    ),
    "t98_seconds": Metric(
        "T98", "s", "lower", "time with 98 % of the map known", time_to(0.98, "seconds", most_seconds), True
    ),
    "l90": Metric(
        "L90", "m", "lower", "way with 90 % of the map known", time_to(0.9, "path_length", most_metres), True
    ),
    "error_seconds": Metric("e", "m s", "lower", "Eq. 3 with seconds in the place of n_a", error_over(seconds)),
    "error_metres": Metric("e", "m²", "lower", "Eq. 3 with metres in the place of n_a", error_over(metres)),
    "efficiency_seconds": Metric(
        "η", "m²/s", "higher", "Eq. 2 with seconds in the place of T", efficiency_over(seconds)
    ),
    "efficiency_metres": Metric("η", "m²/m", "higher", "Eq. 2 with metres in the place of T", efficiency_over(metres)),
    "relative_pose_error": Metric(
        "RPE", "m", "lower", "√ mean squared error of the final motions over 1 m of true way", relative_pose_error
    ),
    "heading_error": Metric("heading error", "°", "lower", "√ mean squared error of the final headings", heading_error),
    "wall_precision_1": Metric(
        "wall precision, 1 cell",
        "1",
        "higher",
        "cells believed occupied with a true surface at most 1 cell away, share",
        of_map(lambda quality: quality.wall_precision(1)),
    ),
    "wall_recall_1": Metric(
        "wall recall, 1 cell",
        "1",
        "higher",
        "true surfaces beside what counts with a cell believed occupied at most 1 cell away, share",
        of_map(lambda quality: quality.wall_recall(1)),
    ),
    "wall_f1_1": Metric(
        "wall F1, 1 cell",
        "1",
        "higher",
        "harmonic mean of the two, 1 cell",
        of_map(lambda quality: quality.wall_f1(1)),
    ),
    "wall_precision_2": Metric(
        "wall precision, 2 cells",
        "1",
        "higher",
        "the same with at most 2 cells",
        of_map(lambda quality: quality.wall_precision(2)),
    ),
    "wall_recall_2": Metric(
        "wall recall, 2 cells",
        "1",
        "higher",
        "the same with at most 2 cells",
        of_map(lambda quality: quality.wall_recall(2)),
    ),
    "wall_f1_2": Metric(
        "wall F1, 2 cells",
        "1",
        "higher",
        "harmonic mean of the two, 2 cells",
        of_map(lambda quality: quality.wall_f1(2)),
    ),
    "free_iou": Metric(
        "IoU",
        "1",
        "higher",
        "free space, believed and true: intersection over union",
        of_map(lambda quality: quality.free_iou()),
    ),
    "covered": Metric(
        "c, believed",
        "1",
        "higher",
        "share of what counts within what the robot believes to be the free space around itself",
        of_map(lambda quality: quality.covered()),
    ),
    "true_closures": Metric("closures, true", "1", None, "loops closed by the true relative pose", true_closures),
    "false_closures": Metric(
        "closures, false", "1", "lower", "loops closed by more than 0.3 m or 3° beside it", last("false_closures")
    ),
    "missed_closures": Metric(
        "closures, missed", "1", "lower", "revisits at which no loop was closed", last("missed_closures")
    ),
    "in_vain": Metric(
        "in vain",
        "1",
        "lower",
        "share of the decisions that did not resolve their frontier",
        ratio("in_vain", "decisions"),
    ),
    "clearance": Metric(
        "clearance", "m", "higher", "least distance of the hull from an obstacle (MRPB)", last("clearance")
    ),
    "unsafe": Metric(
        "unsafe", "1", "lower", "share of time with less than 0.1 m of it (MRPB)", ratio("unsafe_seconds", "seconds")
    ),
    "smoothness": Metric(
        "acceleration",
        "m/s²",
        "lower",
        "mean magnitude of the forward one: changes of speed over time (MRPB)",
        ratio("speed_change", "seconds"),
    ),
}
