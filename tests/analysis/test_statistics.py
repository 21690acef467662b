"""Means with bootstrap intervals against scipy, and differences paired by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.stats
from hypothesis import given, strategies as st
from scipy.stats import bootstrap, kendalltau, permutation_test, t, trim_mean

from explore_bench.analysis import statistics
from explore_bench.analysis.statistics import (
    CONFIDENCE,
    PERMUTATIONS,
    RESAMPLES,
    Estimate,
    effect_size,
    holm,
    improvement_probability,
    interquartile_mean_interval,
    mean_interval,
    mean_intervals,
    order_agreement,
    paired_difference,
    ratio_interval,
    sign_flip_p,
    survival,
    unpaired_difference,
    win_tie_loss,
)
from explore_bench.trial.seeding import stream

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


def test_values_of_0_and_1_have_an_interval():
    found = mean_interval(np.repeat([0.0, 1.0], 10))
    assert 0.2 < found.low < 0.5 < found.high < 0.8


@pytest.mark.parametrize("statistic", [mean_interval, interquartile_mean_interval])
def test_where_bca_cannot_be_had_the_interval_is_that_of_percentiles(statistic, monkeypatch):
    """Either end may be what is not finite."""
    values = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0])
    for ends in ((math.nan, 5.0), (5.0, math.nan), (math.nan, math.nan)):
        broken = SimpleNamespace(confidence_interval=SimpleNamespace(low=np.array(ends[:1]), high=np.array(ends[1:])))
        monkeypatch.setattr(scipy.stats, "bootstrap", lambda *given, broken=broken, **options: broken)
        drawn = stream("evaluate", 0, 0, 0, "statistics").choice(values, (RESAMPLES, 8))
        means = drawn.mean(axis=1) if statistic is mean_interval else trim_mean(drawn, 0.25, axis=1)
        found = statistic(values)
        assert [found.low, found.high] == pytest.approx(np.quantile(means, [0.025, 0.975]))


def test_many_intervals_are_those_of_each_alone(monkeypatch):
    monkeypatch.setattr(statistics, "AT_ONCE", 3)
    rng = np.random.default_rng(2)
    samples = [rng.exponential(size=n) for n in (9, 20, 9, 1, 0, 20, 9, 9, 2)]
    samples[5:5] = [np.full(20, 0.3), np.array([1.0, 1.0, 1.0, 5.0])]
    found = mean_intervals(samples, seed=4)
    assert len(found) == len(samples)
    for own, sample in zip(found, samples, strict=True):
        alone = mean_interval(sample, seed=4)
        assert own.n == alone.n == len(sample)
        ends = (own.mean, own.low, own.high), (alone.mean, alone.low, alone.high)
        np.testing.assert_allclose(*ends, rtol=1e-12)
    with pytest.raises(ValueError, match="1 of 9 values are not finite"):
        mean_intervals([samples[0], np.array([*samples[0][1:], math.nan])])


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
    with pytest.raises(ValueError, match="2 of 5"):
        mean_interval(np.array([1.0, bad, 2.0, bad, 3.0]))
    with pytest.raises(ValueError, match="1 differences are not finite"):
        sign_flip_p(np.array([1.0, bad, 2.0]))


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


# Paired differences


def test_differences_are_taken_world_by_world():
    """3 − 1, 5 − 2, 4 − 6: mean 1; the order of the worlds plays no part."""
    a, b = {0: 3.0, 1: 5.0, 2: 4.0}, {2: 6.0, 0: 1.0, 1: 2.0}
    estimate = paired_difference(a, b)
    assert estimate.mean == pytest.approx(1.0)
    assert same(estimate, mean_interval(np.array([2.0, 3.0, -2.0])))
    many = dict(enumerate(SKEWED.tolist()))
    assert same(paired_difference(many, dict.fromkeys(many, 0.0), seed=5), mean_interval(SKEWED, 5))


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


# Robust means


def test_the_interquartile_mean_is_scipy_s_trimmed_mean_with_its_bca_interval():
    estimate = interquartile_mean_interval(SKEWED, 3)

    def middle(x, axis=-1):
        return trim_mean(x, 0.25, axis=axis)

    rng = stream("evaluate", 3, 0, 0, "statistics")
    expected = bootstrap((SKEWED,), middle, n_resamples=RESAMPLES, method="BCa", rng=rng).confidence_interval
    assert estimate.mean == pytest.approx(trim_mean(SKEWED, 0.25))
    assert (estimate.low, estimate.high) == pytest.approx((expected.low, expected.high), rel=1e-12)


def test_the_interquartile_mean_by_hand():
    """Of eight values two are cut off at either end: the mean of 3, 4, 5 and 6, whatever the outliers."""
    values = np.array([6.0, 1.0, 5.0, 900.0, 3.0, 4.0, 2.0, -70.0])
    assert interquartile_mean_interval(values).mean == pytest.approx((2.0 + 3.0 + 4.0 + 5.0) / 4)
    assert interquartile_mean_interval(np.array([4.0])).mean == 4.0


# Tests of differences


@pytest.mark.parametrize("n", [2, 5, 13])
def test_few_signs_are_flipped_in_every_way_as_scipy_does(n):
    differences = np.random.default_rng(n).normal(0.5, 1.0, n)
    expected = permutation_test((differences,), np.mean, permutation_type="samples", n_resamples=np.inf).pvalue
    assert sign_flip_p(differences) == pytest.approx(expected)


def test_many_signs_are_flipped_at_random_and_agree_with_scipy():
    differences = np.random.default_rng(4).normal(0.25, 1.0, 50)
    rng = np.random.default_rng(0)
    expected = permutation_test((differences,), np.mean, permutation_type="samples", n_resamples=40_000, rng=rng).pvalue
    assert 0.02 < expected < 0.5
    assert sign_flip_p(differences) == pytest.approx(expected, abs=4 * math.sqrt(expected / PERMUTATIONS))


def test_the_p_value_has_a_seed_and_no_memory():
    differences = np.random.default_rng(4).normal(0.25, 1.0, 50)
    assert sign_flip_p(differences, 1) == sign_flip_p(differences, 1) != sign_flip_p(differences, 2)


def test_p_values_at_the_ends():
    assert sign_flip_p(np.zeros(20)) == 1.0
    assert sign_flip_p(np.full(50, 0.1)) == pytest.approx(1 / (PERMUTATIONS + 1))
    assert sign_flip_p(np.array([3.0])) == 1.0
    assert math.isnan(sign_flip_p(np.array([])))
    with pytest.raises(ValueError, match="1 differences"):
        sign_flip_p(np.array([1.0, math.nan]))


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=20), st.floats(0.01, 100))
def test_the_p_value_knows_neither_sign_nor_scale(values, scale):
    differences = np.array(values)
    assert sign_flip_p(-differences) == sign_flip_p(differences)
    assert 0.0 < sign_flip_p(differences) <= 1.0


def test_unpaired_samples_are_compared_by_welch_s_test():
    """Variances 2.5 of 5 and 7/12 of 3, and the degrees of freedom that follow."""
    a, b = np.array([3.0, 4.0, 5.0, 6.0, 7.0]), np.array([1.0, 2.0, 2.5])
    estimate, p = unpaired_difference(a, b)
    one, other = 2.5 / 5, 7 / 12 / 3
    error, freedom = math.sqrt(one + other), (one + other) ** 2 / (one**2 / 4 + other**2 / 2)
    assert estimate.mean == pytest.approx(5.0 - 5.5 / 3)
    assert p == pytest.approx(2 * t.sf(estimate.mean / error, freedom))
    assert estimate.high - estimate.mean == pytest.approx(t.isf(0.025, freedom) * error)
    assert estimate.n == 3


def test_single_and_steady_samples():
    a = np.array([3.0, 4.0])
    estimate, p = unpaired_difference(a, np.array([1.0]))
    assert (estimate.mean, estimate.n) == (2.5, 1)
    assert math.isnan(estimate.low)
    assert math.isnan(p)
    assert unpaired_difference(np.ones(3), np.zeros(2)) == (Estimate(1.0, 1.0, 1.0, 2), 0.0)
    assert unpaired_difference(np.ones(3), np.ones(2))[1] == 1.0


@pytest.mark.parametrize("counts", [(5, 5), (5, 3), (3, 3)])
def test_of_equal_trainings_at_most_one_in_twenty_is_told_apart_and_intervals_cover(counts):
    rng, told, covered = np.random.default_rng(14), 0, 0
    for _ in range(2000):
        estimate, p = unpaired_difference(*(rng.normal(0.0, 1.0, count) for count in counts))
        told += p <= 0.05
        covered += estimate.low <= 0.0 <= estimate.high
    assert told / 2000 <= 0.06
    assert covered / 2000 >= 0.94


def test_a_ratio_of_means_resamples_worlds_together():
    """Where one is always twice the other there is no doubt about the ratio, however much worlds differ."""
    assert ratio_interval(2 * SKEWED, SKEWED) == Estimate(2.0, 2.0, 2.0, 50)
    other = np.random.default_rng(6).exponential(3.0, 50)
    estimate = ratio_interval(other, SKEWED)
    assert estimate.mean == pytest.approx(other.mean() / SKEWED.mean())
    assert estimate.low < estimate.mean < estimate.high
    assert ratio_interval(other, SKEWED) == estimate != ratio_interval(other, SKEWED, 1)
    assert math.isnan(ratio_interval(other[:1], SKEWED[:1]).low)


def test_percentile_intervals_leave_a_fortieth_out_at_either_end():
    """Means of a thousand values are normal: 1.96 standard errors to either side; 1.64 would leave out a twentieth."""
    values = 10.0 + np.random.default_rng(9).normal(size=1000)
    estimate = ratio_interval(values, np.ones(1000))
    error = values.std() / math.sqrt(1000)
    assert [(end - estimate.mean) / error for end in (estimate.low, estimate.high)] == pytest.approx(
        [-1.96, 1.96], abs=0.1
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_ratio_has_an_interval_where_all_resamples_have_the_sign_of_the_mean(sign):
    """However near to 0 they are."""
    small = sign * np.array([1e-3, 2e-3, 3e-3, 4e-3])
    found = ratio_interval(2.0 * small, small)
    assert [found.mean, found.low, found.high] == pytest.approx([2.0, 2.0, 2.0])
    crossing = ratio_interval(small, np.array([-1e-3, 2e-3, -1e-3, 2e-3]) * sign)
    assert crossing.mean == pytest.approx(5.0)
    assert same(crossing, Estimate(crossing.mean, math.nan, math.nan, 4))
    assert same(ratio_interval(np.array([3.0]), np.array([2.0])), Estimate(1.5, math.nan, math.nan, 1))


def test_a_ratio_to_nothing_is_not_defined():
    assert math.isnan(ratio_interval(np.ones(2), np.array([-1.0, 1.0])).mean)
    few = ratio_interval(np.ones(3), np.array([0.0, 0.0, 3.0]))
    assert (few.mean, math.isnan(few.low), math.isnan(few.high)) == (1.0, True, True)
    estimate = ratio_interval(np.ones(4), np.zeros(4))
    assert math.isnan(estimate.mean)
    assert math.isnan(estimate.low)
    assert estimate.n == 4


def test_holm_by_hand():
    """Sorted 0.01, 0.02, 0.03 times 3, 2, 1, never falling; more than one is one; no p-value is not of the family."""
    np.testing.assert_allclose(holm([0.02, 0.01, 0.03]), [0.04, 0.03, 0.04])
    np.testing.assert_allclose(holm([0.6, 0.5]), [1.0, 1.0])
    np.testing.assert_allclose(holm([0.04, math.nan, 0.01]), [0.04, math.nan, 0.02])
    assert holm([]).shape == (0,)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_is_between_no_correction_and_bonferroni_and_keeps_the_order(values):
    p, adjusted = np.array(values), holm(values)
    assert (adjusted >= p).all()
    assert (adjusted <= np.minimum(p * len(p), 1.0) + 1e-15).all()
    order = np.argsort(p, kind="stable")
    assert (np.diff(adjusted[order]) >= 0).all()


def test_under_the_null_a_family_errs_in_at_most_five_of_a_hundred_cases(monkeypatch):
    """400 families of 8 dependent comparisons over 30 worlds without any difference: all share one strategy."""
    monkeypatch.setattr(statistics, "PERMUTATIONS", 999)  # p-values are valid whatever the number of flips
    rng = np.random.default_rng(11)
    errors = 0
    for family in range(400):
        values = rng.normal(size=(9, 30)) + rng.normal(size=30)
        errors += (holm([sign_flip_p(values[0] - other, family) for other in values[1:]]) <= 0.05).any()
    assert errors / 400 <= 0.05 + 2 * math.sqrt(0.05 * 0.95 / 400)


@pytest.mark.parametrize("shape", ["normal", "skewed"])
def test_intervals_of_fifty_worlds_cover_the_true_mean_in_93_to_97_of_a_hundred_cases(shape, monkeypatch):
    """Paired differences as large and as skewed as those of the benchmark."""
    monkeypatch.setattr(statistics, "RESAMPLES", 1000)
    rng = np.random.default_rng(5)
    covered = 0
    for case in range(1000):
        values = rng.normal(0.3, 1.0, 50) if shape == "normal" else rng.gamma(4.0, 0.5, 50) - rng.gamma(3.4, 0.5, 50)
        estimate = mean_interval(values, case)
        covered += estimate.low <= 0.3 <= estimate.high
    assert 0.93 <= covered / 1000 <= 0.97


def test_effects_by_hand():
    gains = np.array([1.0, 2.0, 3.0, 0.0, -1.0])
    assert effect_size(gains) == pytest.approx(1.0 / math.sqrt(2.5))
    assert win_tie_loss(gains) == (3, 1, 1)
    assert improvement_probability(gains) == pytest.approx(0.7)
    assert effect_size(np.array([2.0, 2.0])) == math.inf
    assert effect_size(np.array([-2.0, -2.0])) == -math.inf
    assert effect_size(np.zeros(3)) == 0.0
    assert math.isnan(effect_size(np.array([1.0])))
    assert math.isnan(improvement_probability(np.array([])))


# Order and survival


def test_tau_is_scipy_s_of_the_means_over_worlds_and_lies_within_its_interval():
    rng = np.random.default_rng(2)
    reference, values = [3.0, 1.0, 2.0, 5.0, 4.0], rng.normal([[3.0], [1.5], [1.0], [5.0], [5.5]], 1.0, (5, 40))
    estimate = order_agreement(reference, values)
    assert estimate.mean == pytest.approx(kendalltau(reference, values.mean(axis=1)).statistic)
    assert -1.0 <= estimate.low <= estimate.mean <= estimate.high <= 1.0
    assert estimate.low < estimate.high
    assert estimate.n == 40


def test_the_interval_of_tau_is_of_the_pairs_that_are_open():
    """Of the six pairs of four strategies, two and three differ by noise alone: one of three orders of them is open."""
    noise = np.random.default_rng(5).normal(0.0, 0.1, (4, 30))
    values = noise + [[1.0], [2.0], [2.0], [4.0]]
    estimate = order_agreement([1.0, 2.0, 3.0, 4.0], values)
    assert (estimate.low, estimate.high) == (pytest.approx(4 / 6), 1.0)
    assert estimate.mean in (estimate.low, estimate.high)
    backwards = order_agreement([4.0, 3.0, 2.0, 1.0], values)
    assert (backwards.low, backwards.high) == (-1.0, pytest.approx(-4 / 6))


def test_pairs_are_shown_to_differ_only_after_holm_s_correction():
    """Six worlds that agree have p = 2/64: of one pair that is enough, of three it is not."""
    steady = np.tile([[1.0], [2.0], [3.0]], 6)
    assert order_agreement([1.0, 2.0], steady[:2]) == Estimate(1.0, 1.0, 1.0, 6)
    assert order_agreement([1.0, 2.0, 3.0], steady) == Estimate(1.0, -1.0, 1.0, 6)


def test_the_true_agreement_lies_within_the_interval_of_tau_in_95_of_a_hundred_cases():
    rng, reference = np.random.default_rng(8), [1.0, 2.0, 3.0, 4.0, 5.0]
    truth = np.array([1.0, 1.1, 1.05, 1.3, 1.25])
    tau = kendalltau(reference, truth).statistic
    found = [order_agreement(reference, rng.normal(truth[:, None], 0.3, (5, 12))) for _ in range(200)]
    assert np.mean([own.low - 1e-9 <= tau <= own.high + 1e-9 for own in found]) >= 0.95


def test_tau_at_its_ends():
    steady = np.tile([[1.0], [2.0], [3.0]], 10)
    assert order_agreement([1.0, 2.0, 3.0], steady) == Estimate(1.0, 1.0, 1.0, 10)
    assert order_agreement([3.0, 2.0, 1.0], steady) == Estimate(-1.0, -1.0, -1.0, 10)


def test_survival_by_hand():
    """Of five trials one never gets there; it stays among those that have not, whatever it did before it ended."""
    found = survival(np.array([10.0, 20.0, 20.0, math.inf, 40.0]))
    assert dict(zip(found.times.tolist(), found.shares.tolist(), strict=True)) == pytest.approx(
        {10.0: 0.8, 20.0: 0.4, 40.0: 0.2}
    )
    assert found.median == 20.0


def test_trials_that_ended_early_without_success_do_not_make_the_others_typical():
    """Forty of fifty crash at step 10 and ten get there at 100: half of them never do."""
    found = survival(np.array([math.inf] * 40 + [100.0] * 10))
    assert (found.times.tolist(), found.shares.tolist(), found.median) == ([100.0], [0.8], math.inf)


def test_survival_without_any_success_has_no_median():
    assert survival(np.array([math.inf, math.inf])).median == math.inf
    assert len(survival(np.array([math.inf])).times) == 0
    assert survival(np.array([5.0, 7.0])).median == 5.0
