"""One-sided bounds against scipy's t test, Holm's levels against adjusted p-values, the power against simulation."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.integrate import quad
from scipy.stats import chi2, norm, t, ttest_1samp

from explore_bench.analysis.gate.margins import beyond_p, holm_levels, lower_bound, power, upper_bound
from explore_bench.analysis.statistics import holm, sign_flip_p

VALUES = np.random.default_rng(0).normal(0.04, 0.2, 60)

p_values = st.lists(st.floats(0, 1), min_size=1, max_size=8)


@pytest.mark.parametrize("margin", [-0.1, 0.0, 0.03, 0.2])
def test_p_values_are_those_of_the_one_sided_t_test(margin):
    expected = ttest_1samp(VALUES, margin, alternative="greater").pvalue
    assert beyond_p(VALUES, margin) == pytest.approx(expected, rel=1e-9)


def test_p_values_agree_with_flipping_signs():
    assert beyond_p(VALUES, 0.0) == pytest.approx(sign_flip_p(VALUES) / 2, abs=0.01)


@pytest.mark.parametrize("level", [0.05, 0.05 / 6])
def test_bounds_are_those_of_the_t_distribution(level):
    low, high = t.interval(1 - 2 * level, 59, VALUES.mean(), VALUES.std(ddof=1) / math.sqrt(60))
    assert (lower_bound(VALUES, level), upper_bound(VALUES, level)) == (pytest.approx(low), pytest.approx(high))


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=20), st.floats(0.001, 0.4))
def test_the_p_value_of_a_bound_is_its_level(values, level):
    bound = lower_bound(np.array(values), level)
    assert beyond_p(np.array(values), bound) == pytest.approx(level, rel=1e-3)


@pytest.mark.parametrize("values", [[], [5.0]])
def test_fewer_than_two_values_show_nothing(values):
    values = np.array(values)
    assert beyond_p(values, 0.0) == 1.0
    assert (lower_bound(values, 0.05), upper_bound(values, 0.05)) == (-math.inf, math.inf)
    assert power(0.1, 0.2, len(values), 0.05) == 0.0


def test_values_without_spread_are_certain_but_rounding_is_no_evidence():
    same = np.full(10, 0.05)
    assert beyond_p(same, 0.04) == pytest.approx(0.0, abs=1e-12)
    assert beyond_p(same, 0.06) == pytest.approx(1.0)
    assert 0.4 < beyond_p(same + 1e-17, 0.05) < 0.6
    assert lower_bound(same, 0.05) == pytest.approx(upper_bound(same, 0.05))


def test_levels_of_holm_worked_by_hand():
    """0.01 ≤ 0.05/4 is rejected, 0.02 > 0.05/3 is not: it and the two above it were tested at 0.05/3."""
    np.testing.assert_allclose(holm_levels([0.5, 0.01, 0.02, 0.9], 0.05), [0.05 / 3, 0.05 / 4, 0.05 / 3, 0.05 / 3])


@given(p_values, st.floats(0.01, 0.2))
def test_a_p_value_is_at_most_its_level_where_holm_rejects_it(p, level):
    levels, rejected = holm_levels(p, level), holm(p) <= level
    for value, own, out in zip(p, levels, rejected, strict=True):
        assert out == (value <= own) or math.isclose(value, own, rel_tol=1e-12)


@pytest.mark.parametrize(("excess", "n"), [(0.07, 50), (0.05, 250), (0.0, 30), (-0.02, 40)])
def test_the_power_is_that_of_simulated_tests(excess, n):
    level, spread = 0.05 / 6, 0.25
    draws = np.random.default_rng(n).normal(excess, spread, (2000, n))
    caught = np.mean([beyond_p(own, 0.0) <= level for own in draws])
    assert power(excess, spread, n, level) == pytest.approx(caught, abs=0.04)


@pytest.mark.parametrize("n", [3, 5, 20])
def test_the_power_for_few_values_is_that_of_the_noncentral_t(n):
    """As scipy's normal and χ² make it: P(t > critical) where t = (z + shift) / √(χ²/ν)."""
    level, shift = 0.05, 0.4 / 0.25 * np.sqrt(n)
    critical = t.isf(level, n - 1)
    share = expectation(lambda x: norm.sf(critical * np.sqrt(x / (n - 1)) - shift), n - 1)
    assert power(0.4, 0.25, n, level) == pytest.approx(share, abs=1e-6)
    assert power(-1e9, 1e-3, n, level) == 0.0
    assert power(1e9, 1e-3, n, level) == 1.0


def expectation(function, degrees):
    """Of a function of a χ² variable."""
    return quad(lambda x: function(x) * chi2.pdf(x, degrees), 0.0, np.inf, epsabs=1e-10)[0]


def test_the_power_grows_with_the_number_of_worlds_and_falls_with_the_spread():
    by_n = [power(0.05, 0.2, n, 0.01) for n in (2, 10, 50, 250, 1000)]
    assert by_n == sorted(by_n)
    assert by_n[-1] > 0.999
    by_spread = [power(0.05, spread, 50, 0.01) for spread in (0.0, 0.1, 0.3, 1.0)]
    assert by_spread == sorted(by_spread, reverse=True)
    assert by_spread[0] == 1.0
