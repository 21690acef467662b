"""Eq. 2 and 3 and the rule for trials that did not explore, worked by hand."""

import math

import numpy as np
import pytest
from handmade import record

from explore_bench.analysis.metrics import METRICS
from explore_bench.trial.error_and_efficiency import Score, score, trajectory_error
from explore_bench.trial.spec import Status
from explore_bench.world.scenario import Scenario

MAP = Scenario(size=20.0, virtual_sigma=2.0, steps_per_cell=5.0)
"""100 cells, U₀ = 2 · 2² · 100 = 800 m², a limit of 500 steps, 2 σ₀² = 8 m²."""

UNEXPLORED = (Status.STEP_LIMIT, Status.STUCK, Status.FAILED)


def test_a_trial_that_explored_is_scored_by_its_last_row():
    """Worked by hand: e = 50 / 100 · √0.09, ΔU = 800 − 300, η = 500 / 50."""
    found = score(Status.EXPLORED, 50, 300.0, 0.09, MAP)
    assert found == Score(MAP, 50, 300.0, 0.09)
    assert found.trajectory_error == pytest.approx(0.15, rel=1e-12)
    assert found.uncertainty_reduction == 500.0
    assert found.exploration_efficiency == 10.0


@pytest.mark.parametrize("status", UNEXPLORED)
def test_one_that_did_not_is_scored_with_the_step_limit_and_at_least_the_prior_s_trace(status):
    """Stopping after 50 steps counts as 500: e = 5 · √8, η = (800 − 300) / 500."""
    found = score(status, 50, 300.0, 0.09, MAP)
    assert found == Score(MAP, 500, 300.0, 8.0)
    assert found.trajectory_error == pytest.approx(5.0 * math.sqrt(8.0), rel=1e-12)
    assert found.uncertainty_reduction == 500.0
    assert found.exploration_efficiency == 1.0


@pytest.mark.parametrize("status", UNEXPLORED)
def test_a_trace_above_the_prior_s_stays_what_it_is(status):
    assert score(status, 50, 300.0, 9.0, MAP).trajectory_error == pytest.approx(5.0 * 3.0, rel=1e-12)


def test_a_trial_without_a_row_has_reduced_nothing():
    found = score(Status.FAILED, 0, None, 0.0, MAP)
    assert found == Score(MAP, 500, 800.0, 8.0)
    assert found.uncertainty_reduction == found.exploration_efficiency == 0.0


def test_a_map_seen_whole_at_the_start_has_no_efficiency_and_no_error():
    found = score(Status.EXPLORED, 0, 300.0, 0.09, MAP)
    assert math.isnan(found.exploration_efficiency)
    assert found.trajectory_error == 0.0
    assert found.uncertainty_reduction == 500.0


@pytest.mark.parametrize("status", Status)
def test_a_status_may_be_given_as_records_keep_it(status):
    assert score(status.value, 50, 300.0, 0.09, MAP) == score(status, 50, 300.0, 0.09, MAP)


@pytest.mark.parametrize("status", Status)
def test_the_metrics_of_a_record_are_its_score(status):
    made = record(status.value, MAP, uncertainty=[700.0, 500.0, 300.0], peak_trace=[0.01, 0.04, 0.09])
    wanted = score(status, 2, 300.0, 0.09, MAP)
    for name in ("trajectory_error", "exploration_efficiency"):
        assert METRICS[name].value(made) == pytest.approx(getattr(wanted, name), rel=1e-12)


def test_the_trajectory_error_of_arrays_is_that_of_each_entry():
    times, peaks = np.array([0.0, 10.0, 50.0]), np.array([4.0, 0.25, 0.09])
    found = trajectory_error(times, peaks, MAP)
    assert found == pytest.approx([0.0, 0.05, 0.15], rel=1e-12)
    assert found.tolist() == [trajectory_error(*pair, MAP) for pair in zip(times, peaks, strict=True)]


def test_the_trajectory_error_counts_steps_per_cell_of_the_map():
    """Eq. 3 on 400 cells instead of 100."""
    assert trajectory_error(10.0, 0.25, MAP.replace(size=40.0)) == pytest.approx(0.0125, rel=1e-12)
