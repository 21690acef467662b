"""Means with bootstrap intervals against scipy, and differences paired by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import bootstrap

from explore_bench.seeding import stream
from explore_bench.statistics import CONFIDENCE, RESAMPLES, mean_interval, paired_difference

SKEWED = np.random.default_rng(1).exponential(2.0, 50)


def same(first, second):
    """Equality of estimates in which NaN equals NaN."""
    return np.array_equal(
        [first.mean, first.low, first.high, first.n], [second.mean, second.low, second.high, second.n], equal_nan=True
    )


@pytest.mark.parametrize("seed", [0, 7])
def test_the_interval_is_scipy_s_bca_bootstrap_of_the_seeded_stream(seed):
    rng = stream("evaluate", seed, 0, 0, "statistics")
    expected = bootstrap(
        (SKEWED,), np.mean, n_resamples=RESAMPLES, confidence_level=CONFIDENCE, method="BCa", rng=rng
    ).confidence_interval
    estimate = mean_interval(SKEWED, seed)
    assert estimate.mean == pytest.approx(SKEWED.mean())
    assert (estimate.low, estimate.high) == pytest.approx((expected.low, expected.high), rel=1e-12)
    assert estimate.n == 50


def test_the_interval_is_bias_corrected_and_not_the_plain_percentile_one():
    rng = stream("evaluate", 0, 0, 0, "statistics")
    plain = bootstrap((SKEWED,), np.mean, n_resamples=RESAMPLES, method="percentile", rng=rng).confidence_interval
    assert mean_interval(SKEWED).high > plain.high


def test_confidence_is_95_percent():
    assert CONFIDENCE == 0.95


def test_one_seed_gives_one_interval_and_another_seed_another():
    first, second, other = mean_interval(SKEWED, 3), mean_interval(SKEWED, 3), mean_interval(SKEWED, 4)
    assert first == second
    assert first.mean == other.mean
    assert (first.low, first.high) != (other.low, other.high)


def test_the_interval_does_not_depend_on_what_was_drawn_before():
    first = mean_interval(SKEWED)
    np.random.default_rng().normal()
    mean_interval(SKEWED * 2)
    assert mean_interval(SKEWED) == first


def test_equal_values_have_an_interval_of_no_width():
    estimate = mean_interval(np.full(5, 1.25))
    assert (estimate.mean, estimate.low, estimate.high, estimate.n) == (1.25, 1.25, 1.25, 5)


def test_without_values_there_is_no_mean():
    estimate = mean_interval(np.array([]))
    assert estimate.n == 0
    assert all(map(math.isnan, (estimate.mean, estimate.low, estimate.high)))


def test_one_value_has_a_mean_but_no_interval():
    estimate = mean_interval(np.array([2.5]))
    assert (estimate.mean, estimate.n) == (2.5, 1)
    assert math.isnan(estimate.low)
    assert math.isnan(estimate.high)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_is_refused_and_counted(bad):
    with pytest.raises(ValueError, match="2 of 4"):
        mean_interval(np.array([1.0, bad, 2.0, bad]))


@given(st.lists(st.floats(-1e3, 1e3), min_size=2, max_size=12))
def test_every_interval_is_finite_and_lies_within_the_values(values):
    """Also where ties make the bootstrap distribution degenerate."""
    estimate = mean_interval(np.array(values))
    slack = 1e-9 * max(1.0, *map(abs, values))
    assert min(values) - slack <= estimate.low <= estimate.high <= max(values) + slack


@pytest.mark.parametrize("values", [[0.0, 0.0, 0.0, 1.0], [0.0, 1.0], [5.0, 5.0, 5.0, 5.0, 5.0, 5.1]])
def test_few_or_tied_values_still_have_an_interval_around_their_mean(values):
    estimate = mean_interval(np.array(values))
    assert math.isfinite(estimate.low)
    assert math.isfinite(estimate.high)
    assert estimate.low <= estimate.mean <= estimate.high


def test_the_interval_covers_the_true_mean_about_95_times_in_100(monkeypatch):
    """200 samples of 50 normals: the standard error of the coverage is 1.5 %."""
    monkeypatch.setattr("explore_bench.statistics.RESAMPLES", 1000)
    samples = np.random.default_rng(11).normal(3.0, 2.0, (200, 50))
    estimates = [mean_interval(sample, seed) for seed, sample in enumerate(samples)]
    covered = np.mean([estimate.low <= 3.0 <= estimate.high for estimate in estimates])
    assert 0.90 <= covered <= 0.99


# Paired differences


def test_differences_are_taken_world_by_world():
    """3 − 1, 5 − 2, 4 − 6: mean 1; the order of the worlds plays no part."""
    a, b = {0: 3.0, 1: 5.0, 2: 4.0}, {2: 6.0, 0: 1.0, 1: 2.0}
    estimate = paired_difference(a, b)
    assert estimate.mean == pytest.approx(1.0)
    assert same(estimate, mean_interval(np.array([2.0, 3.0, -2.0])))


def test_only_common_worlds_count():
    estimate = paired_difference({0: 3.0, 1: 5.0, 7: 100.0}, {0: 1.0, 1: 4.0, 9: -100.0})
    assert (estimate.mean, estimate.n) == (pytest.approx(1.5), 2)


def test_without_common_worlds_there_is_no_difference():
    estimate = paired_difference({0: 3.0}, {1: 2.0})
    assert estimate.n == 0
    assert math.isnan(estimate.mean)


def test_pairing_narrows_the_interval_when_worlds_differ_more_than_strategies():
    rng = np.random.default_rng(2)
    worlds = rng.normal(100.0, 30.0, 40)
    a, b = worlds + 2.0 + rng.normal(0, 1, 40), worlds + rng.normal(0, 1, 40)
    paired = paired_difference(dict(enumerate(a)), dict(enumerate(b)))
    alone = mean_interval(a)
    assert paired.low > 0.0
    assert paired.high - paired.low < 0.2 * (alone.high - alone.low)


def test_swapping_the_two_changes_the_sign():
    a, b = dict(enumerate(SKEWED)), dict(enumerate(SKEWED[::-1] + 1.0))
    assert paired_difference(a, b).mean == pytest.approx(-paired_difference(b, a).mean)
