"""Metrics worked by hand on hand-made rows, the rule for trials that did not explore, curves and regret."""

import dataclasses
import math

import numpy as np
import pytest
from handmade import record

from explore_bench.analysis.metrics import (
    CURVES,
    METRICS,
    REGRETS,
    absolute_trajectory_error,
    counts,
    curve,
    finished,
    pose_nees,
    regret,
    score,
)
from explore_bench.world.scenario import Scenario

MAP = Scenario(size=20.0, steps_per_cell=10.0)
"""100 cells, U₀ = 200 m², step limit 1000."""

UNFINISHED = ["step_limit", "stuck", "failed"]


def value(name, made):
    return METRICS[name].value(made)


# What a metric is


@pytest.mark.parametrize("name", [*METRICS, *REGRETS])
def test_every_metric_has_symbol_unit_direction_and_equation(name):
    metric = METRICS[name] if name in METRICS else REGRETS[name][1]
    assert metric.symbol.strip()
    assert metric.unit.strip()
    assert metric.equation.strip()
    assert metric.better in ("lower", "higher", None)


def test_no_two_metrics_share_a_symbol():
    symbols = [metric.symbol for metric in (*METRICS.values(), *(metric for _, metric in REGRETS.values()))]
    assert len(set(symbols)) == len(symbols)


def test_the_paper_s_metrics_have_the_paper_s_symbols_directions_and_equation_numbers():
    e, eta, delta = (METRICS[n] for n in ("trajectory_error", "exploration_efficiency", "uncertainty_reduction"))
    assert (e.symbol, e.better, eta.symbol, eta.better, delta.better) == ("e", "lower", "η", "higher", "higher")
    assert "Eq. 3" in e.equation
    assert "Eq. 2" in eta.equation
    assert "Eq. 1" in delta.equation


# Equations 1 to 3


def test_equations_1_to_3_worked_by_hand():
    """T = n_a = 4 of n_g = 100 cells, max tr Σ = 0.25, U falls from U₀ = 200 to 80."""
    made = record(
        scenario=MAP, uncertainty=[190.0, 150.0, 120.0, 100.0, 80.0], peak_trace=[0.01, 0.04, 0.09, 0.2, 0.25]
    )
    assert value("trajectory_error", made) == pytest.approx(4 / 100 * 0.5)
    assert value("uncertainty_reduction", made) == pytest.approx(120.0)
    assert value("exploration_efficiency", made) == pytest.approx(30.0)


def test_the_error_of_positions_has_the_traces_of_positions():
    made = record(scenario=MAP, peak_trace=[0.01] * 4 + [0.25], peak_position_trace=[0.01] * 4 + [0.16])
    assert value("position_error", made) == pytest.approx(4 / 100 * 0.4)
    assert value("trajectory_error", made) == pytest.approx(4 / 100 * 0.5)


@pytest.mark.parametrize(
    ("status", "counted"), [("explored", True), ("stuck", True), ("failed", True), ("broken", False)]
)
def test_what_the_simulator_broke_counts_for_nothing(status, counted):
    assert counts(record(status, MAP, peak_trace=[0.01])) == counted


def test_the_prior_of_equation_1_follows_the_scenario():
    """U₀ = 2 σ₀² n_g: 2 · 0.25 · 36 = 18."""
    made = record(scenario=Scenario(size=12.0, virtual_sigma=0.5), uncertainty=[17.0, 10.0])
    assert value("uncertainty_reduction", made) == pytest.approx(8.0)


def test_time_counts_steps_of_the_record_and_not_its_rows():
    made = record(scenario=MAP, step=[0, 1, 2, 3], uncertainty=[200.0, 180.0, 160.0, 140.0])
    assert score(made).time == 3
    assert value("exploration_efficiency", made) == pytest.approx(20.0)


def test_a_trial_explored_without_a_step_has_no_efficiency_and_no_trajectory_error():
    made = record(scenario=MAP, uncertainty=[50.0], peak_trace=[0.01])
    assert math.isnan(value("exploration_efficiency", made))
    assert value("trajectory_error", made) == 0.0


# The rule for trials that did not explore


@pytest.mark.parametrize("status", UNFINISHED)
def test_an_unfinished_trial_counts_the_step_limit_its_last_uncertainty_and_twice_the_prior_variance(status):
    """T = n_a = 1000, U_T = 80, max tr Σ = 2 σ₀² = 2 for its own 0.25."""
    made = record(status, MAP, uncertainty=[190.0, 150.0, 80.0], peak_trace=[0.01, 0.04, 0.25])
    assert not finished(made)
    assert (score(made).time, score(made).uncertainty, score(made).peak_trace) == (1000, 80.0, 2.0)
    assert value("trajectory_error", made) == pytest.approx(1000 / 100 * math.sqrt(2.0))
    assert value("exploration_efficiency", made) == pytest.approx(0.12)
    assert value("uncertainty_reduction", made) == pytest.approx(120.0)


@pytest.mark.parametrize("status", UNFINISHED)
def test_an_unfinished_trial_keeps_a_larger_trace_of_its_own(status):
    made = record(status, MAP, peak_trace=[0.01, 9.0])
    assert value("trajectory_error", made) == pytest.approx(1000 / 100 * 3.0)


def test_the_trace_of_an_unfinished_trial_follows_the_prior_of_the_scenario():
    made = record("stuck", MAP.replace(virtual_sigma=2.0), peak_trace=[0.01, 1.0])
    assert score(made).peak_trace == pytest.approx(8.0)


def test_a_trial_without_rows_reduced_nothing():
    made = record("failed", MAP, rows=0)
    assert (score(made).time, score(made).uncertainty, score(made).peak_trace) == (1000, 200.0, 2.0)
    assert value("uncertainty_reduction", made) == 0.0
    broken = record("explored", MAP.replace(virtual_sigma=0.1), rows=0)
    assert (score(broken).time, score(broken).peak_trace) == (0, 0.0), "its status is asked for, and no trace is added"
    assert value("exploration_efficiency", made) == 0.0
    assert value("trajectory_error", made) == pytest.approx(10.0 * math.sqrt(2.0))
    assert [value(name, made) for name in ("t50", "t80", "t90")] == [1000.0] * 3


def test_a_larger_trace_of_an_explored_trial_is_its_own():
    """The floor of 2 σ₀² is for unfinished trials only."""
    assert score(record(scenario=MAP, peak_trace=[0.01, 0.5])).peak_trace == 0.5


# Times to a share of the map


def test_times_to_a_share_are_the_first_steps_that_reach_it():
    made = record(scenario=MAP, explored=[0.2, 0.5, 0.5, 0.79, 0.8, 0.85, 0.9])
    assert [value(name, made) for name in ("t50", "t80", "t90")] == [1.0, 4.0, 6.0]


def test_a_share_that_exploring_does_not_ask_for_has_no_time_where_it_was_not_reached():
    made = record(scenario=MAP.replace(coverage=0.8), explored=[0.2, 0.5, 0.85])
    assert [value(name, made) for name in ("t50", "t80", "t90")] == pytest.approx([1.0, 2.0, math.nan], nan_ok=True)


def test_a_share_never_reached_counts_the_step_limit():
    made = record("stuck", MAP, explored=[0.2, 0.5, 0.6])
    assert [value(name, made) for name in ("t50", "t80", "t90")] == [1.0, 1000.0, 1000.0]


# Absolute trajectory error


def test_absolute_trajectory_error_compares_the_final_estimate_with_the_truth():
    """Distances 0, 3, 4 and 0 m: √(25 / 4); the running estimate, far off, plays no part."""
    made = record(
        true_x=[1.0, 2.0, 3.0, 4.0],
        true_y=[1.0, 1.0, 1.0, 1.0],
        x=[50.0] * 4,
        y=[50.0] * 4,
        final={"final_x": [1.0, 5.0, 3.0, 4.0], "final_y": [1.0, 1.0, 5.0, 1.0]},
    )
    assert absolute_trajectory_error(made) == pytest.approx(2.5)


@pytest.mark.parametrize("status", ["failed", "stuck"])
def test_a_trial_that_broke_off_has_no_trajectory_error(status):
    """A crash after two steps would look like the best trajectory of all."""
    made = record(status, true_x=[0.0, 0.0], true_y=[0.0, 0.0], x=[0.0, 3.0], y=[0.0, 4.0])
    assert math.isnan(absolute_trajectory_error(made))


# NEES


def covariances(*matrices):
    names = {"cov_xx": (0, 0), "cov_xy": (0, 1), "cov_yy": (1, 1), "cov_xh": (0, 2), "cov_yh": (1, 2), "cov_hh": (2, 2)}
    return {name: [matrix[place] for matrix in matrices] for name, place in names.items()}


def test_nees_of_diagonal_covariances_by_hand():
    """Row 0: 1²/4 + 2²/1 + 0.1²/0.01 = 5.25; row 1: 0; mean 2.625."""
    made = record(
        x=[1.0, 3.0],
        y=[2.0, 3.0],
        heading=[0.1, 0.7],
        true_x=[0.0, 3.0],
        true_y=[0.0, 3.0],
        true_heading=[0.0, 0.7],
        **covariances(np.diag([4.0, 1.0, 0.01]), np.eye(3)),
    )
    assert pose_nees(made) == pytest.approx(2.625)


def test_nees_uses_all_entries_of_the_covariance():
    root = np.random.default_rng(5).normal(size=(3, 3))
    sigma = root @ root.T + 0.1 * np.eye(3)
    error = np.array([0.3, -0.2, 0.05])
    made = record(x=[error[0]], y=[error[1]], heading=[error[2]], **covariances(sigma))
    assert pose_nees(made) == pytest.approx(error @ np.linalg.inv(sigma) @ error)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_nees_wraps_the_error_of_the_heading_at_half_a_turn(sign):
    """Headings of ±(π − 0.1) are 0.2 rad apart: 0.04 / 0.01 = 4."""
    heading = sign * (math.pi - 0.1)
    made = record(heading=[heading], true_heading=[-heading], **covariances(np.diag([1.0, 1.0, 0.01])))
    assert pose_nees(made) == pytest.approx(4.0)


def test_nees_is_three_for_an_honest_filter():
    rng = np.random.default_rng(3)
    sigma = np.array([[0.5, 0.1, 0.02], [0.1, 0.3, 0.0], [0.02, 0.0, 0.04]])
    errors = rng.multivariate_normal(np.zeros(3), sigma, 5000)
    made = record(x=errors[:, 0], y=errors[:, 1], heading=errors[:, 2], **covariances(*[sigma] * 5000))
    assert pose_nees(made) == pytest.approx(3.0, abs=0.15)


# Plain last values


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("path_length", "path_length"),
        ("decisions", "decisions"),
        ("explored", "explored"),
        ("collisions", "collisions"),
        ("mislabelled", "mislabelled"),
    ],
)
def test_counts_are_the_last_value_of_their_column(name, column):
    assert value(name, record(**{column: [5, 0, 3]})) == 3.0


@pytest.mark.parametrize("name", ["path_length", "decisions", "collisions", "mislabelled"])
def test_what_adds_up_along_the_way_says_nothing_of_a_trial_that_broke_off(name):
    for status in ("failed", "stuck", "broken"):
        assert math.isnan(value(name, record(status, **{name: [5, 0, 3]})))
    assert value(name, record("step_limit", **{name: [5, 0, 3]})) == 3.0


# Regret


def noted(**notes):
    return dataclasses.replace(record(scenario=MAP, rows=101), notes=notes)


def test_regret_is_the_relative_excess_over_a_note_of_the_reference():
    """Not over the time of its own trial, 100 steps."""
    reference = noted(tour=80.0, bound=50.0)
    slow = record(scenario=MAP, rows=121)
    assert regret(slow, reference, "tour") == pytest.approx(0.5)
    assert regret(slow, reference, "bound") == pytest.approx(1.4)
    assert regret(record(scenario=MAP, rows=61), reference, "tour") == pytest.approx(-0.25)


def test_regret_of_an_unfinished_trial_counts_the_step_limit():
    assert regret(record("failed", MAP, rows=3), noted(tour=100.0), "tour") == pytest.approx(9.0)


def test_regret_without_a_reference_or_a_note_is_undefined():
    made = record(scenario=MAP, rows=101)
    assert math.isnan(regret(made, None, "tour"))
    assert math.isnan(regret(made, noted(tour=80.0), "bound"))
    assert math.isnan(regret(made, noted(tour=0.0), "tour"))


# Curves


def climbing(status="explored"):
    return record(
        status,
        MAP,
        explored=[0.1, 0.4, 0.7, 0.9],
        uncertainty=[190.0, 180.0, 150.0, 110.0],
        peak_trace=[0.01, 0.04, 0.09, 0.25],
    )


def test_there_is_a_curve_for_each_panel_of_the_paper_s_figures():
    assert list(CURVES) == ["explored", "trajectory_error", "exploration_efficiency"]


def test_curves_worked_by_hand_are_undefined_at_step_0_but_for_the_exploration_rate():
    made = climbing()
    assert curve(made, "explored", 4) == pytest.approx([0.1, 0.4, 0.7, 0.9])
    assert curve(made, "trajectory_error", 4) == pytest.approx([math.nan, 0.002, 0.006, 0.015], nan_ok=True)
    assert curve(made, "exploration_efficiency", 4) == pytest.approx([math.nan, 20.0, 25.0, 30.0], nan_ok=True)


def test_after_its_end_an_explored_trial_holds_its_last_values():
    made = climbing()
    assert curve(made, "explored", 7)[3:] == pytest.approx([0.9] * 4)
    assert curve(made, "trajectory_error", 7)[3:] == pytest.approx([value("trajectory_error", made)] * 4)
    assert curve(made, "exploration_efficiency", 7)[3:] == pytest.approx([30.0] * 4)


@pytest.mark.parametrize("status", UNFINISHED)
def test_after_its_end_an_unfinished_trial_holds_what_the_tables_say_of_it(status):
    made = climbing(status)
    assert curve(made, "explored", 1001)[4:] == pytest.approx(0.9)
    for name in ("trajectory_error", "exploration_efficiency"):
        values = curve(made, name, 1001)
        assert values[4:] == pytest.approx(value(name, made))
        assert values[1:4] == pytest.approx(curve(climbing(), name, 4)[1:]), "what was measured stays"


@pytest.mark.parametrize("name", ["trajectory_error", "exploration_efficiency"])
@pytest.mark.parametrize("status", ["explored", "step_limit"])
def test_a_curve_ends_at_the_value_of_the_tables(name, status):
    made = climbing(status)
    assert curve(made, name, MAP.step_limit + 1)[-1] == pytest.approx(value(name, made))


def test_a_curve_can_be_cut_short():
    assert curve(climbing(), "explored", 2) == pytest.approx([0.1, 0.4])


def test_curves_of_a_trial_without_rows_hold_its_score():
    made = record("failed", MAP, rows=0)
    assert curve(made, "explored", 3) == pytest.approx([0.0, 0.0, 0.0])
    expected = [math.nan, 10.0 * math.sqrt(2.0), 10.0 * math.sqrt(2.0)]
    assert curve(made, "trajectory_error", 3) == pytest.approx(expected, nan_ok=True)
    assert curve(made, "exploration_efficiency", 3) == pytest.approx([math.nan, 0.0, 0.0], nan_ok=True)


def test_an_unknown_curve_is_an_error():
    with pytest.raises(KeyError, match="speed"):
        curve(climbing(), "speed", 3)
