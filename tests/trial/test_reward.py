"""The reward of Eq. 24, worked by hand on two rows: R = −ω₁ ΔU − ω₂ R₂ − ω₃ R₃ − ω₄ e − ω₅ R₅ + ω₆ R₆."""

import dataclasses
import itertools
import math
from dataclasses import replace

import pytest
from handmade import record
from hypothesis import given, strategies as st

from explore_bench.analysis.metrics import METRICS, curve
from explore_bench.analysis.rounding import ROUNDING
from explore_bench.trial.error_and_efficiency import trajectory_error
from explore_bench.trial.landmark.step import LandmarkStep
from explore_bench.trial.reward import REWARD_WEIGHTS, RewardWeights, reward
from explore_bench.trial.steps import step_columns
from explore_bench.world.scenario import Scenario

MAP = Scenario(size=20.0)
"""100 cells."""

NAMES = [field.name for field in dataclasses.fields(RewardWeights)]
ODD = RewardWeights(uncertainty=1.0, turning=2.0, length=3.0, error=4.0, steps=5.0, explored=6.0)


def row(**columns):
    """Make a row that is zero elsewhere."""
    return LandmarkStep(**dict.fromkeys(step_columns("landmark"), 0) | columns)


BEFORE = row(step=4, decisions=1, uncertainty=150.0, peak_trace=0.04, explored=0.2, path_length=3.0, turned=1.0)
AFTER = row(step=10, decisions=2, uncertainty=120.0, peak_trace=0.25, explored=0.4, path_length=7.0, turned=2.5)


def error_of(row, scenario=MAP):
    """Eq. 3 at a row."""
    return trajectory_error(float(row.step), row.peak_trace, scenario)


def gained(before=BEFORE, after=AFTER, scenario=MAP, weights=ODD):
    return reward(before, after, scenario, weights)


# Worked by hand


def test_equation_24_worked_by_hand():
    """ΔU = −30 m², turned 1.5 rad, 4 m long, e = 10 / 100 · 0.5, 10 steps, 0.4 known, of 100 cells.

    −1 · (−0.3) − 2 · 1.5 − 3 · 4 − 4 · 0.05 − 5 · 0.1 + 6 · 0.4 = −13.
    """
    assert gained() == pytest.approx(-13.0, rel=1e-12)


@pytest.mark.parametrize(
    ("name", "term"),
    [("uncertainty", 0.3), ("turning", -1.5), ("length", -4.0), ("error", -0.05), ("steps", -0.1), ("explored", 0.4)],
)
def test_each_weight_multiplies_its_own_term(name, term):
    heavier = replace(ODD, **{name: getattr(ODD, name) + 10.0})
    assert gained(weights=heavier) - gained() == pytest.approx(10.0 * term, rel=1e-9)


def test_the_weights_of_the_benchmark_are_used_where_none_are_given():
    assert reward(BEFORE, AFTER, MAP) == reward(BEFORE, AFTER, MAP, REWARD_WEIGHTS) != gained()
    assert RewardWeights() == REWARD_WEIGHTS


def test_with_all_weights_one_the_reward_is_the_sum_of_the_terms():
    """0.3 − 1.5 − 4 − 0.05 − 0.1 + 0.4."""
    assert gained(weights=RewardWeights(*[1.0] * 6)) == pytest.approx(-4.95, rel=1e-12)


# Directions


@pytest.mark.parametrize(
    ("column", "change", "difference"),
    [
        ("uncertainty", -10.0, +1.0 * 10.0 / 100),
        ("uncertainty", +10.0, -1.0 * 10.0 / 100),
        ("turned", +0.5, -2.0 * 0.5),
        ("path_length", +2.0, -3.0 * 2.0),
        ("peak_trace", 0.36 - 0.25, -4.0 * 10 / 100 * (0.6 - 0.5)),
        ("explored", +0.1, +6.0 * 0.1),
    ],
)
def test_a_term_alone_changes_the_reward_in_its_direction(column, change, difference):
    changed = replace(AFTER, **{column: getattr(AFTER, column) + change})
    assert gained(after=changed) - gained() == pytest.approx(difference, rel=1e-9)


def test_steps_alone_lower_the_reward():
    """With a certain trajectory e is 0 for any number of steps: 7 more of 100 cells cost 5 · 0.07."""
    certain = replace(AFTER, peak_trace=0.0)
    assert gained(after=replace(certain, step=17)) - gained(after=certain) == pytest.approx(-0.35, rel=1e-9)


def test_steps_raise_the_trajectory_error_too():
    """7 more of 100 cells cost 5 · 0.07 and 4 · 0.07 · 0.5."""
    assert gained(after=replace(AFTER, step=17)) - gained() == pytest.approx(-0.35 - 0.14, rel=1e-9)


def test_reducing_the_uncertainty_is_rewarded_and_losing_ground_is_punished():
    same = replace(BEFORE, step=0, peak_trace=0.0, explored=0.0)
    assert gained(same, same) == 0.0
    assert gained(same, replace(same, uncertainty=149.0)) == pytest.approx(0.01)
    assert gained(same, replace(same, uncertainty=151.0)) == pytest.approx(-0.01)


@pytest.mark.parametrize("column", ["uncertainty", "turned", "path_length"])
def test_what_the_decision_changed_counts_and_not_where_it_began(column):
    shift = {column: getattr(BEFORE, column) + 17.0}
    moved = gained(replace(BEFORE, **shift), replace(AFTER, **{column: getattr(AFTER, column) + 17.0}))
    assert moved == pytest.approx(gained(), rel=1e-12)
    assert gained(replace(BEFORE, **shift)) != pytest.approx(gained())


@pytest.mark.parametrize("column", ["step", "peak_trace", "explored"])
def test_error_steps_and_known_share_are_those_after_the_decision(column):
    assert gained(replace(BEFORE, **{column: 3})) == gained()


REWARDED = {"step", "uncertainty", "peak_trace", "explored", "path_length", "turned"}


@pytest.mark.parametrize("column", sorted(step_columns("landmark").keys() - REWARDED))
def test_nothing_else_of_a_row_matters_the_truth_least(column):
    assert gained(replace(BEFORE, **{column: 5}), replace(AFTER, **{column: 9})) == gained()


def test_uncertainty_and_steps_count_per_cell_of_the_map():
    """Four times the cells, four times ΔU and the steps: the same reward."""
    larger = Scenario(size=40.0)
    before, after = (replace(r, uncertainty=4 * r.uncertainty, step=4 * r.step) for r in (BEFORE, AFTER))
    assert gained(before, after, larger) == pytest.approx(gained(), rel=1e-12)


@given(st.lists(st.tuples(*[st.floats(0, 100)] * 3), min_size=2, max_size=10))
def test_over_an_episode_the_changes_add_up_to_the_whole(values):
    rows = [row(uncertainty=u, turned=t, path_length=p) for u, t, p in values]
    total = sum(gained(a, b) for a, b in itertools.pairwise(rows))
    assert total == pytest.approx(gained(rows[0], rows[-1]), abs=1e-9)


# Eq. 3 at a step


def test_the_trajectory_error_worked_by_hand():
    """Eq. 3: 10 of 100 cells times √0.25; on 40 m 10 of 400."""
    assert error_of(AFTER) == pytest.approx(0.05)
    assert error_of(AFTER, Scenario(size=40.0)) == pytest.approx(0.0125)
    assert error_of(row()) == 0.0


def test_the_trajectory_error_is_the_metric_of_a_trial_that_ends_there():
    peaks = [0.01, 0.04, 0.09, 0.2, 0.25]
    made = record(scenario=MAP, peak_trace=peaks)
    now = [error_of(row(step=i, peak_trace=peak)) for i, peak in enumerate(peaks)]
    assert now[-1] == pytest.approx(METRICS["trajectory_error"].value(made), rel=1e-12)
    assert now[1:] == pytest.approx(curve(made, "trajectory_error", 5)[1:].tolist(), rel=ROUNDING)


def test_the_trajectory_error_of_real_rows_is_that_of_the_records(stored):
    for spec, result in zip(stored.specs, stored.results, strict=True):
        made = stored.store.find(spec)
        now = [error_of(step, spec.scenario) for step in result.steps]
        assert now[-1] == pytest.approx(METRICS["trajectory_error"].value(made), rel=1e-12)
        assert now[1:] == pytest.approx(curve(made, "trajectory_error", len(now))[1:].tolist(), rel=ROUNDING)


# The weights


@pytest.mark.parametrize("value", [0.0, -0.0, -1.0, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", NAMES)
def test_a_weight_is_a_positive_number(name, value):
    with pytest.raises(ValueError, match=f"'{name}' of the reward is {value}; .* positive"):
        RewardWeights(**{name: value})


def test_there_is_a_weight_for_each_of_the_six_terms():
    assert NAMES == ["uncertainty", "turning", "length", "error", "steps", "explored"]
    assert all(value > 0 for value in dataclasses.asdict(REWARD_WEIGHTS).values())


def test_weights_do_not_change():
    with pytest.raises(dataclasses.FrozenInstanceError):
        REWARD_WEIGHTS.error = 2.0
