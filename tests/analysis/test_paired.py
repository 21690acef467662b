"""Two strategies on common worlds, and the test of their architectures: by hand, and how often it errs."""

import itertools
import math
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp, ttest_ind

from explore_bench.analysis.paired import ROUNDING, crossed_p, gains_of, paired
from explore_bench.analysis.statistics import effect_size, mean_interval, sign_flip_p

RNG = np.random.default_rng(12)


def rows(values, seeds=(None,), first=0):
    """Rows of `trials.csv`, values of shape (seeds, worlds)."""
    table = [
        {"training_seed": seed, "trial": first + trial, "e": value}
        for seed, of_seed in zip(seeds, np.atleast_2d(values), strict=True)
        for trial, value in enumerate(of_seed)
    ]
    return pd.DataFrame(table).astype({"training_seed": "Int64"})


def test_pairs_are_of_the_worlds_that_every_seed_of_both_tried():
    a = pd.concat((rows([1.0, 2.0, 3.0], [0]), rows([5.0, 6.0, 7.0], [1], first=1)))
    pair = paired(a, rows([10.0, 20.0, 30.0]), "e")
    assert pair.seeds == ((0, 1), ())
    np.testing.assert_array_equal(pair.a, [[2.0, 3.0], [5.0, 6.0]])
    np.testing.assert_array_equal(pair.b, [[20.0, 30.0]])
    assert (pair.worlds, pair.defined, pair.means) == (2, True, (4.0, 25.0))


def test_wins_ties_and_losses_are_counted_in_the_direction_of_the_metric():
    pair = paired(rows([1.0, 2.0, 3.0, 9.0, 4.0, 6.0]), rows([1.0, 3.0, 3.0, 8.0, 3.0, 5.0]), "e")
    assert pair.wins(1.0) == (3.0, 2.0, 1.0)
    assert pair.wins(-1.0) == (1.0, 2.0, 3.0)


def test_without_a_common_world_or_a_value_nothing_is_defined():
    assert not paired(rows([1.0]), rows([1.0], first=1), "e").defined
    assert not paired(rows([1.0]), rows([1.0]).iloc[:0], "e").defined
    assert not paired(rows([1.0, math.nan]), rows([1.0, 2.0]), "e").defined


def test_differences_are_of_averages_over_seeds():
    a, b = RNG.normal(1.0, 0.2, (3, 20)), RNG.normal(1.1, 0.2, (1, 20))
    pair = paired(rows(a, range(3)), rows(b), "e")
    np.testing.assert_allclose(pair.differences, a.mean(axis=0) - b[0])
    assert pair.difference == mean_interval(pair.differences)
    assert pair.p == sign_flip_p(pair.differences)
    assert pair.relative.mean == pytest.approx(a.mean() / b.mean() - 1.0)


def test_effects_do_not_grow_with_the_number_of_seeds():
    """Each seed of many is as much better as a single one; their average is much more surely so."""
    a, b = RNG.normal(0.5, 1.0, (8, 4000)), np.zeros((1, 4000))
    many, single = paired(rows(a, range(8)), rows(b), "e"), paired(rows(a[:1], [0]), rows(b), "e")
    assert many.effect(1.0) == pytest.approx(0.5, abs=0.03)
    assert many.effect(1.0) == pytest.approx(single.effect(1.0), abs=0.05)
    assert many.improvement(1.0) == pytest.approx(0.69, abs=0.02)
    assert effect_size(many.differences) > 1.2
    assert sum(many.wins(1.0)) == 4000.0


def test_every_seed_meets_every_other_but_the_same_weights_themselves():
    a, b = RNG.normal(0.0, 1.0, (2, 12)), RNG.normal(0.2, 1.0, (2, 12))
    tables = rows(a, (3, 4)), rows(b, (3, 4))
    crosswise = [effect_size(one - other) for one, other in itertools.product(a, b)]
    assert paired(*tables, "e").effect(-1.0) == pytest.approx(-np.mean(crosswise))
    same = [effect_size(one - other) for one, other in zip(a, b, strict=True)]
    assert paired(*tables, "e", matched=True).effect(-1.0) == pytest.approx(-np.mean(same))
    others = rows(a, (3, 5))
    assert paired(others, tables[1], "e", matched=True).effect(-1.0) == pytest.approx(-np.mean(crosswise))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_what_differs_by_rounding_is_a_tie(scale):
    one = scale * np.array([0.1 + 0.2, 1.0, 1.0, -1.0, 0.0])
    other = scale * np.array([0.3, 1.0 + 0.5 * ROUNDING, 1.0 + 3 * ROUNDING, -1.0, 0.0])
    gains = gains_of(one, other)
    np.testing.assert_array_equal(gains == 0.0, [True, True, False, True, True])
    assert gains[2] == pytest.approx(-3 * ROUNDING * scale)


# Architectures


def crossed(rng, seeds, worlds, of_seed, of_world, of_both, shared):
    """Values by seed and world; `shared` effects of the worlds, of which each architecture has its own share."""
    own = np.sqrt(0.9) * shared + np.sqrt(0.1) * rng.normal(0.0, 1.0, worlds)
    return of_seed * rng.normal(0.0, 1.0, (seeds, 1)) + of_world * own + of_both * rng.normal(0.0, 1.0, (seeds, worlds))


def test_where_trainings_do_not_differ_it_is_the_t_test_over_worlds():
    d = RNG.normal(0.1, 1.0, 30)
    same = np.tile(d, (4, 1))
    assert crossed_p(d, same, None) == pytest.approx(ttest_1samp(d, 0.0).pvalue)


def test_where_worlds_do_not_differ_it_is_welch_s_t_test_over_seeds():
    a, b = RNG.normal(0.0, 1.0, (5, 1)), RNG.normal(1.0, 0.3, (4, 1))
    a, b = np.tile(a, 50), np.tile(b, 50)
    p = crossed_p(a.mean(axis=0) - b.mean(axis=0), a, b)
    assert p == pytest.approx(ttest_ind(a[:, 0], b[:, 0], equal_var=False).pvalue)


def test_a_single_seed_is_taken_to_vary_as_those_of_the_other_side():
    """Of worlds that are all alike: a new value against four of its kind, three degrees of freedom."""
    a, b = np.tile(np.array([[1.0], [2.0], [4.0], [3.0]]), 50), np.full((1, 50), 8.0)
    spread = math.sqrt(np.var([1.0, 2.0, 4.0, 3.0], ddof=1) * (1 / 4 + 1))
    from scipy.stats import t

    assert crossed_p(a.mean(axis=0) - b[0], a, b) == pytest.approx(2 * t.sf((8.0 - 2.5) / spread, 3))
    assert crossed_p(b[0] - a.mean(axis=0), b, a) == crossed_p(a.mean(axis=0) - b[0], a, b)


def p_by_hand(differences, sides):
    """Satterthwaite's t from sums of squares, world by world and seed by seed."""
    n = len(differences)
    mean = sum(differences) / n
    of_worlds = sum((d - mean) ** 2 for d in differences) / (n - 1) / n
    variance, squares = of_worlds, of_worlds**2 / (n - 1)
    for side in sides:
        k = len(side)
        if k == 1:
            continue
        share = 1 / k + sum(len(other) == 1 for other in sides)
        by_seed = [sum(own) / n for own in side]
        by_world = [sum(own[j] for own in side) / k for j in range(n)]
        all_ = sum(by_seed) / k
        of_seeds = sum((own - all_) ** 2 for own in by_seed) / (k - 1)
        rest = sum((side[i][j] - by_seed[i] - by_world[j] + all_) ** 2 for i in range(k) for j in range(n))
        of_rest = rest / ((k - 1) * (n - 1)) / n
        variance += max(share * (of_seeds - of_rest), 0.0)
        squares += (share * of_seeds) ** 2 / (k - 1) + (share * of_rest) ** 2 / ((k - 1) * (n - 1))
    from scipy.stats import t

    return 2 * t.sf(abs(mean) / math.sqrt(variance), variance**2 / squares)


@pytest.mark.parametrize("of_seed", [0.0, 0.3, 2.0])
@pytest.mark.parametrize(("seeds", "worlds"), [((3, 4), 6), ((2, 2), 5), ((3, 2), 2), ((1, 3), 7), ((2, 5), 3)])
def test_seeds_and_worlds_are_components_of_one_variance(seeds, worlds, of_seed):
    """Few worlds, and effects of both, so that every term matters."""
    rng = np.random.default_rng([*seeds, worlds])
    a, b = (crossed(rng, k, worlds, of_seed, 1.0, 1.5, rng.normal(0.0, 1.0, worlds)) for k in seeds)
    differences = a.mean(axis=0) - b.mean(axis=0)
    assert crossed_p(differences, a, b) == pytest.approx(p_by_hand(differences, [a, b]), rel=1e-9)


def test_single_seeds_or_a_single_world_say_nothing_of_an_architecture():
    one, many = RNG.normal(0.0, 1.0, (1, 20)), RNG.normal(0.0, 1.0, (3, 20))
    assert math.isnan(crossed_p(one[0], one, None))
    assert math.isnan(crossed_p(one[0] - one[0], one, one))
    assert math.isnan(crossed_p(many[:, :1].mean(axis=0), many[:, :1], None))
    assert math.isnan(crossed_p(many[:2].mean(axis=0), many[:2], None))
    assert math.isnan(crossed_p(many[:2].mean(axis=0) - one[0], many[:2], one))
    assert 0.0 < crossed_p(many[:2].mean(axis=0) - many[1:].mean(axis=0), many[:2], many[1:]) < 1.0
    assert crossed_p(np.zeros(5), np.zeros((3, 5)), None) == 1.0
    assert crossed_p(np.ones(5), np.ones((3, 5)), None) == 0.0


def components(values):
    """Standard deviations (seed, world, both) of values by seed and world, from the mean squares of the crossing."""
    seeds, worlds = values.shape
    of_seeds, of_worlds = values.mean(axis=1), values.mean(axis=0)
    rest = values - of_seeds[:, None] - of_worlds + values.mean()
    both = (rest**2).sum() / ((seeds - 1) * (worlds - 1))
    found = (of_seeds.var(ddof=1) - both / worlds, of_worlds.var(ddof=1) - both / seeds, both)
    return tuple(math.sqrt(max(own, 0.0)) for own in found)


def test_components_are_found_again():
    rng = np.random.default_rng(4)
    values = crossed(rng, 200, 300, 0.3, 1.0, 0.5, rng.normal(0.0, 1.0, 300))
    assert components(values) == (pytest.approx(0.3, rel=0.1), pytest.approx(1.0, rel=0.1), pytest.approx(0.5, rel=0.1))


@cache
def stored_components(metric, size):
    """Those of every strategy with at least three training seeds, from the committed trials."""
    stored = pd.read_csv(Path(__file__).parents[2] / "results" / "trials.csv")
    own = stored[stored["training_seed"].notna() & (stored["size"] == size)]
    found = {
        name: components(cell.pivot(index="training_seed", columns="trial", values=metric).to_numpy())
        for name, cell in own.groupby("strategy")
        if cell["training_seed"].nunique() >= 3
    }
    assert len(found) >= 5
    assert np.isfinite(list(found.values())).all()
    return found


def of_worlds_alone(differences, a, b):
    """p-value of the other test, which knows nothing of trainings."""
    return ttest_1samp(differences, 0.0).pvalue


def told_apart(by, of, first, second, times=1.0):
    """Share of 2,000 pairs of equal architectures that a test tells apart.

    `second` is 0 for one that learns nothing; its trainings may differ by `times` as much.
    """
    of_seed, of_world, of_both = of
    rng, told, cases = np.random.default_rng(1), 0, 2000
    for _ in range(cases):
        shared = rng.normal(0.0, 1.0, 50)
        a = crossed(rng, first, 50, of_seed, of_world, of_both, shared)
        b = crossed(rng, max(second, 1), 50, times * of_seed if second else 0.0, of_world, of_both, shared)
        told += by(a.mean(axis=0) - b.mean(axis=0), a, b if second else None) <= 0.05
    return told / cases


@pytest.mark.slow
@pytest.mark.parametrize(("first", "second"), [(5, 5), (5, 3), (3, 1), (3, 3), (5, 0)])
@pytest.mark.parametrize("metric", ["trajectory_error", "exploration_efficiency"])
@pytest.mark.parametrize("size", [20.0, 30.0, 40.0])
def test_of_equal_architectures_at_most_one_in_twenty_is_told_apart(metric, size, first, second):
    """With the components of the stored trials of Graph-STNN, and with the largest of any learned strategy."""
    found = stored_components(metric, size)
    for of in (found["graph-stnn"], max(found.values(), key=lambda of: of[0] / of[2])):
        assert told_apart(crossed_p, of, first, second) <= 0.05 + 2.5 * math.sqrt(0.05 * 0.95 / 2000)


@pytest.mark.slow
@pytest.mark.parametrize("metric", ["trajectory_error", "exploration_efficiency"])
def test_what_the_other_test_and_the_assumption_cost(metric):
    """What docs/statistics.md says of worlds alone, and of a single seed that varies more than it is taken to."""
    of = stored_components(metric, 40.0)["graph-stnn"]
    assert told_apart(of_worlds_alone, of, 5, 5) > 0.1
    assert told_apart(of_worlds_alone, of, 3, 1) > 0.1
    assert told_apart(crossed_p, of, 5, 1, times=4.0) > 0.1
