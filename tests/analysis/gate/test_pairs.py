"""Losses worked by hand, what is missing in words, and pairing that does not depend on the order of rows."""

import math

import numpy as np
import pandas as pd
import pytest
from handmade import trial_rows as trials
from hypothesis import given, strategies as st

from explore_bench.analysis.gate.pairs import pair_up
from explore_bench.analysis.gate.thresholds import Threshold

ERROR = Threshold(metric="trajectory_error", strategy="Mine", size=20.0, tolerance=0.05, reason="test")
GAIN = ERROR.model_copy(update={"metric": "exploration_efficiency"})


def test_a_loss_is_the_change_for_the_worse_over_the_mean_of_the_reference():
    before, now = trials([1.0, 3.0]), trials([1.2, 2.8])
    np.testing.assert_allclose(pair_up(ERROR, before, now).losses, [0.1, -0.1])
    np.testing.assert_allclose(pair_up(GAIN, before, now).losses, [-0.1, 0.1])


def test_a_loss_from_a_negative_mean_is_a_loss():
    np.testing.assert_allclose(pair_up(ERROR, trials([-1.0, -3.0]), trials([-0.8, -3.2])).losses, [0.1, -0.1])


def test_the_mean_loss_is_the_relative_change_of_the_mean():
    pair = pair_up(GAIN, trials([1.0, 2.0, 6.0]), trials([0.9, 1.8, 5.4]))
    assert pair.losses.mean() == pytest.approx(0.1)
    np.testing.assert_allclose(pair.losses, [0.1, 0.1, 0.1])  # every world lost a tenth of what it had


def test_the_spread_of_a_loss_is_that_of_a_ratio_over_draws_of_the_worlds():
    """Against draws from 400 worlds, of which those that have much lose most; a fixed denominator has 1.5 times it."""
    rng = np.random.default_rng(0)
    before = rng.gamma(2.0, size=400)
    now = before * (0.8 + 0.1 * rng.standard_normal(400))
    drawn = rng.integers(0, 400, (4000, 400))
    ratios = 1.0 - now[drawn].mean(1) / before[drawn].mean(1)
    losses = pair_up(GAIN, trials(before), trials(now)).losses
    assert losses.std(ddof=1) / 20.0 == pytest.approx(ratios.std(), rel=0.05)
    assert ((before - now) / before.mean()).std(ddof=1) / 20.0 > 1.4 * ratios.std()


def test_training_seeds_are_averaged_within_a_world():
    before = pd.concat((trials([1.0, 1.0], seed=0), trials([3.0, 3.0], seed=1)))
    now = pd.concat((trials([1.0, 1.0], seed=0), trials([4.0, 3.0], seed=1)))
    np.testing.assert_allclose(pair_up(ERROR, before, now).losses, [0.25, 0.0])  # both had as much


@given(st.permutations(range(6)))
def test_the_order_of_rows_does_not_matter(order):
    before, now = trials(np.arange(1.0, 7.0)), trials(np.arange(2.0, 8.0))
    shuffled = pair_up(ERROR, before.iloc[order], now.iloc[order[::-1]])
    np.testing.assert_array_equal(shuffled.losses, pair_up(ERROR, before, now).losses)


def test_only_its_strategy_size_and_scenario_count_and_further_worlds_and_seeds_do_not():
    before = trials([1.0, 2.0])
    others = [trials([9.0, 9.0], **change) for change in ({"strategy": "Other"}, {"size": 30.0}, {"scenario": "wide"})]
    now = pd.concat((*others, trials([1.0, 2.0, 9.0]), trials([9.0, 9.0], seed=7)))
    pair = pair_up(ERROR, pd.concat((before, *others)), now)
    assert pair.missing == ""
    np.testing.assert_array_equal(pair.losses, [0.0, 0.0])


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (trials([1.0, 1.0], strategy="Other"), "2 of its 2 trials were not run, or by older code"),
        (trials([1.0, 1.0], size=30.0), "2 of its 2 trials were not run"),
        (trials([1.0]), "1 of its 2 trials were not run"),
        (trials([1.0, 1.0], seed=1), "2 of its 2 trials were not run"),
        (trials([1.0, 1.0], world="v"), r"2 of its 2 trials are in other worlds \(another --seed"),
        (trials([1.0, math.nan]), "trajectory_error is not defined in 1 of its 2 trials, which broke off"),
        (trials([1.0, 1.0])[:0], "2 of its 2 trials were not run"),
    ],
)
def test_what_is_missing_is_said_and_nothing_is_computed_of_it(now, words):
    pair = pair_up(ERROR, trials([1.0, 2.0]), now)
    assert pd.Series([pair.missing]).str.contains(words).all(), pair.missing
    assert len(pair.losses) == 0


def test_one_of_several_training_seeds_is_missing():
    before = pd.concat((trials([1.0, 1.0], seed=0), trials([3.0, 3.0], seed=1)))
    assert pair_up(ERROR, before, trials([1.0, 1.0], seed=0)).missing.startswith("2 of its 4 trials were not run")


def test_trials_that_did_not_explore_are_counted_and_take_part():
    now = pd.concat((trials([1.0]), trials([1.0, 9.0], status="stuck")[1:]))
    pair = pair_up(ERROR, trials([1.0, 2.0]), now)
    assert pair.unexplored == (0, 1)
    assert pair.losses.mean() == pytest.approx(3.5 / 1.5)


def test_the_spread_is_at_least_that_of_the_worlds():
    before = trials([1.0, 2.0, 3.0])
    assert pair_up(ERROR, before, before).spread == pytest.approx(0.5)
    changes = np.array([2.0, 0.0, -1.0]) - 1.0 / 3.0 * np.array([-0.5, 0.0, 0.5])
    assert pair_up(ERROR, before, trials([5.0, 2.0, 1.0])).spread == pytest.approx(np.std(changes, ddof=1))
    assert pair_up(ERROR, before, before[:1]).spread == pytest.approx(0.5)
