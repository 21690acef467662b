"""The metrics: pure functions of a trial's rows, each with its symbol, unit, direction and equation.

METRICS are common to all kinds of world; `metrics_of` gives those that a kind has beside them. The arithmetic of Eq. 2
and 3, and how a trial that did not explore is scored, are in `trial.error_and_efficiency`: training needs them, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from explore_bench.analysis.rounding import significant
from explore_bench.trial import error_and_efficiency
from explore_bench.trial.error_and_efficiency import Score
from explore_bench.trial.spec import Status
from explore_bench.world.kinds import KINDS, kind_of

if TYPE_CHECKING:
    from explore_bench.records.encoding import TrialRecord
    from explore_bench.world.scenario import Scenario

Array = np.ndarray


@dataclass(frozen=True)
class Metric:
    """A number of a trial.

    Attributes
    ----------
    symbol, unit : as printed.
    better : which direction is better; None where neither is.
    equation : definition, with its source.
    value : the function of a trial's record; of a training curve for what training is measured by.
    ranks : whether strategies are ranked by it; the metrics of a kind of world that rank take the place of the common.
    """

    symbol: str
    unit: str
    better: Literal["lower", "higher"] | None
    equation: str
    value: Callable[[Any], float]
    ranks: bool = False


def finished(record: TrialRecord) -> bool:
    """Whether a trial explored its map."""
    return record.status == Status.EXPLORED.value


def counts(record: TrialRecord) -> bool:
    """Whether a trial says something of its strategy: the simulator did not break down in it."""
    return record.status != Status.BROKEN.value


def broken_off(record: TrialRecord) -> bool:
    """Whether a trial failed, broke or got stuck, so that what only adds up along the way says nothing about it."""
    return record.status in (Status.FAILED.value, Status.BROKEN.value, Status.STUCK.value)


def score(record: TrialRecord, traces: str = "peak_trace") -> Score:
    """Score of a trial, by the rule for trials that did not explore where it did not; its traces are a column's."""
    steps = record.steps
    if not len(steps["step"]):
        return error_and_efficiency.score(record.status, 0, None, 0.0, record.spec.scenario)
    last = int(steps["step"][-1]), float(steps["uncertainty"][-1]), float(steps[traces][-1])
    return error_and_efficiency.score(record.status, *last, record.spec.scenario)


def trajectory_error(record: TrialRecord) -> float:
    """Eq. 3: e = n_a / n_g · √(max tr Σ)."""
    return score(record).trajectory_error


def position_error(record: TrialRecord) -> float:
    """Eq. 3 of positions alone: n_a / n_g · √(max tr Σ) with the 2 × 2 covariances [m²]: nothing is added in rad²."""
    return score(record, "peak_position_trace").trajectory_error


def exploration_efficiency(record: TrialRecord) -> float:
    """Eq. 2: η = (U₀ − U_T) / T; a trial that explored without a step has none (NaN)."""
    return score(record).exploration_efficiency


def uncertainty_reduction(record: TrialRecord) -> float:
    """ΔU = U₀ − U_T, with U of Eq. 1."""
    return score(record).uncertainty_reduction


def explored(record: TrialRecord) -> float:
    """Known share of the map at the end; 0 where there is no row."""
    values = record.steps["explored"]
    return float(values[-1]) if len(values) else 0.0


def step_limit(scenario: Scenario) -> float:
    """Steps that a trial counts as when it did not explore."""
    return float(scenario.step_limit)


def time_to(
    coverage: float, column: str = "step", limit: Callable[[Scenario], float] = step_limit
) -> Callable[[TrialRecord], float]:
    """Metric of the first step with this share of the map known, or of what a column says then.

    It is the limit for a trial that ended unexplored before, and NaN where exploring asks for less.
    """

    def value(record: TrialRecord) -> float:
        reached = np.flatnonzero(record.steps["explored"] >= coverage)
        if len(reached):
            return float(record.steps[column][reached[0]])
        return math.nan if finished(record) else limit(record.spec.scenario)

    return value


def absolute_trajectory_error(record: TrialRecord) -> float:
    """Root mean square distance of the final estimate of the trajectory from the truth.

    No alignment: the start is known. NaN for a trial that broke off.
    """
    if broken_off(record):
        return math.nan
    steps, final = record.steps, record.final
    squared = (final["final_x"] - steps["true_x"]) ** 2 + (final["final_y"] - steps["true_y"]) ** 2
    return float(np.sqrt(squared.mean()))


def pose_nees(record: TrialRecord) -> float:
    """Mean over the steps of dᵀ Σ⁻¹ d, d the error of the running pose estimate: 3 where the filter is honest.

    Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation", 2001, §5.4.
    """
    s = record.steps
    if broken_off(record):
        return math.nan
    turn = (s["heading"] - s["true_heading"] + math.pi) % math.tau - math.pi
    error = np.stack((s["x"] - s["true_x"], s["y"] - s["true_y"], turn), axis=1)
    rows = [[s["cov_xx"], s["cov_xy"], s["cov_xh"]], [s["cov_xy"], s["cov_yy"], s["cov_yh"]]]
    rows.append([s["cov_xh"], s["cov_yh"], s["cov_hh"]])
    sigma = np.moveaxis(np.array(rows), -1, 0)
    return float(np.einsum("ti,ti->t", error, np.linalg.solve(sigma, error[..., None])[..., 0]).mean())


def last(column: str) -> Callable[[TrialRecord], float]:
    """Metric of a column's last value; NaN for a trial that broke off: a short way is no merit then."""

    def value(record: TrialRecord) -> float:
        return math.nan if broken_off(record) else float(record.steps[column][-1])

    return value


FAR = 2.0
"""A drive this many times as long as the one to the nearest candidate goes to a far one.

From 2 on the robot is no nearer to that candidate at the end of the drive than it was before, wherever the two lie (the
triangle inequality).
"""


def crossings(record: TrialRecord) -> float:
    """Decisions that took a far frontier while a near one was left behind; NaN for a trial that broke off.

    A decision is one where the planned drive to its choice is at least FAR times the one to its nearest candidate, the
    robot drove at least as far as that candidate was, and it is a frontier still when the drive ends.
    """
    if broken_off(record):
        return math.nan
    steps = record.steps
    ends = np.flatnonzero(np.diff(steps["decisions"], append=-1))  # last row of each decision that took a step
    of, way = ends[1:], steps["path_length"]
    near = steps["nearest_drive"][of]
    far = (steps["chosen_drive"][of] >= FAR * near) & (steps["chosen_drive"][of] > near)  # near may be 0
    left = (way[of] - way[ends[:-1]] >= near) & (steps["nearest_waits"][of] > 0)
    return float(np.count_nonzero(far & left))


THROUGH = 3.0
"""Cells' edges of way along which a robot drives where it was, for a round trip.

It is somewhere again within one edge of there. To cross an old track takes 2 edges at a right angle, up to 3 at 42°;
what takes longer goes along it.
"""


def round_trips(record: TrialRecord) -> float:
    """How often the robot drove back through where it was long before; NaN for a trial that broke off.

    A pose is one of going back where the robot was within a cell's edge of there before, has been farther off since,
    and its way since it was last there is twice the sensor's range or more: there and back as far as it can see. A
    round trip is a run of such poses over THROUGH edges of way or more; what interrupts it for at most half a range of
    way is part of it, and to turn about ends it. Places are the true ones: the estimate jumps where loops are closed.
    """
    from explore_bench.analysis.going_back import going_back  # compiled: what only lists metrics waits for no compiler

    if broken_off(record):
        return math.nan
    steps, edge, in_range = record.steps, record.spec.scenario.cell_size, record.spec.scenario.sensor_range
    way, places = steps["path_length"], np.stack((steps["true_x"], steps["true_y"]), axis=1)
    back = way[going_back(places, way, edge, 2.0 * in_range)]
    runs = np.split(back, np.flatnonzero(np.diff(back) > in_range / 2.0) + 1)
    return float(sum(len(run) > 0 and run[-1] - run[0] >= THROUGH * edge for run in runs))


METRICS: dict[str, Metric] = {
    "trajectory_error": Metric("e", "m", "lower", "n_a / n_g · √(max tr Σ_v, v ∈ V_p) (Eq. 3)", trajectory_error, True),
    "exploration_efficiency": Metric("η", "m²/step", "higher", "(U₀ − U_T) / T (Eq. 2)", exploration_efficiency, True),
    "uncertainty_reduction": Metric("ΔU", "m²", "higher", "U₀ − U_T, U = Σ tr Σ_v (Eq. 1)", uncertainty_reduction),
    "position_error": Metric("e, position", "m", "lower", "Eq. 3 of 2 × 2 covariances", position_error),
    "path_length": Metric("L", "m", "lower", "Σ length of the straight commands", last("path_length")),
    "decisions": Metric("D", "1", None, "decisions made", last("decisions")),
    "explored": Metric("c", "1", "higher", "known share of the map at the end", explored),
    "t50": Metric("T50", "step", "lower", "first step with 50 % of the map known", time_to(0.5)),
    "t80": Metric("T80", "step", "lower", "first step with 80 % of the map known", time_to(0.8)),
    "t90": Metric("T90", "step", "lower", "first step with 90 % of the map known", time_to(0.9)),
    "absolute_trajectory_error": Metric(
        "ATE", "m", "lower", "√ mean ‖x̂ₜ − xₜ‖² of the final estimate", absolute_trajectory_error
    ),
    "pose_nees": Metric("NEES", "1", None, "mean dᵀ Σ⁻¹ d of the running pose; 3 is honest", pose_nees),
    "collisions": Metric("C", "1", "lower", "true entries into obstacles or off the map", last("collisions")),
    "mislabelled": Metric("M", "cells", "lower", "known cells believed to be what they are not", last("mislabelled")),
    "crossings": Metric(
        "crossings", "1", "lower", "decisions that took a frontier ≥ 2 times as far as one left behind", crossings
    ),
    "round_trips": Metric(
        "round trips", "1", "lower", "drives along where it was, ≥ 2 sensor ranges of way ago", round_trips
    ),
}


def metrics_of(kind: str) -> dict[str, Metric]:
    """Metrics of a kind of world beside the common ones, by name.

    Raises
    ------
    RequestError : for a kind that is not known.
    """
    return dict(kind_of(kind).load("metrics", {}))


REGRETS: dict[str, tuple[str, Metric]] = {
    "regret": (
        "tour",
        Metric("R ≥", "1", "lower", "T / T_tour − 1, to the fastest tour known of the same world", lambda _: math.nan),
    ),
    "regret_most": (
        "bound",
        Metric("R ≤", "1", "lower", "T / T_bound − 1, to a lower bound on T in the same world", lambda _: math.nan),
    ),
}
"""The regret to the fastest way there is lies between these: the note of a reference by which each is measured, and it.

They pair a trial with what a reference said of its world, so they are computed from both.
"""


def regret(record: TrialRecord, reference: TrialRecord | None, note: str) -> float:
    """Return T over the steps that a note of the reference says of the same world, less 1; NaN without such a note."""
    steps = 0.0 if reference is None else reference.notes.get(note, 0.0)
    return score(record).time / steps - 1.0 if steps else math.nan


def all_metrics() -> dict[str, Metric]:
    """Metrics of trials in every kind of world, by name."""
    return METRICS | {name: metric for kind in KINDS for name, metric in metrics_of(kind).items()}


CURVES: dict[str, tuple[str, str]] = {
    "explored": ("exploration rate", "1"),
    "trajectory_error": ("trajectory error e", "m"),
    "exploration_efficiency": ("exploration efficiency η", "m²/step"),
}
"""Curves of Figures 10, 11 and 13 to 15: title and unit."""


def curve(record: TrialRecord, name: str, length: int) -> Array:
    """Values of a curve at steps 0 … length − 1, shape (length,).

    Undefined (NaN) at step 0 but for the exploration rate; after its end a trial holds its last value, scored as
    the tables score it where it did not explore.

    Raises
    ------
    KeyError : for a name that is not in CURVES.
    """
    scenario, steps = record.spec.scenario, record.steps
    step = steps["step"].astype(float)
    if name == "explored":
        values, end = steps["explored"], explored(record)
    elif name == "trajectory_error":
        values = error_and_efficiency.trajectory_error(step, steps["peak_trace"], scenario)
        end = trajectory_error(record)
    elif name == "exploration_efficiency":
        with np.errstate(divide="ignore", invalid="ignore"):
            values = (scenario.prior_uncertainty - steps["uncertainty"]) / step
        end = exploration_efficiency(record)
    else:
        raise KeyError(name)
    result = np.full(length, end)
    kept = min(len(values), length)
    result[:kept] = values[:kept]
    if name != "explored" and length:
        result[0] = math.nan
    return significant(result)
