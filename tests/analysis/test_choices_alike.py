"""Agreement of choices by hand: what is the same, whose trajectories count, and the mean over worlds."""

import math

import pytest

from explore_bench.analysis.choices import COLUMNS, Choice, Chooser, Trajectory, agreement_table

A, B = Chooser("a", None), Chooser("b", None)


def picks(*candidates):
    """Choices of candidates, each in the cell 10 times its number."""
    return tuple(Choice(candidate, 10 * candidate) for candidate in candidates)


def way(driver, driven, asked, trial=0, candidates=None, scenario="paper", size=20.0):
    """Return a trajectory whose driver chooses the same again."""
    counts = candidates or (4,) * len(driven)
    return Trajectory(driver, scenario, size, trial, counts, driven, {driver: driven} | asked)


def row(table, a, b):
    """Return the row of a pair, whichever comes first."""
    for one, other in ((a, b), (b, a)):
        own = table[(table["a"] == one.strategy) & (table["b"] == other.strategy)]
        own = own[own["seed_a"].fillna(-1).eq(-1 if one.training_seed is None else one.training_seed)]
        own = own[own["seed_b"].fillna(-1).eq(-1 if other.training_seed is None else other.training_seed)]
        if len(own):
            return own.iloc[0]
    return None


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        (Choice(1, 10), Choice(1, 10), True),
        (Choice(1, 10), Choice(2, 20), False),
        (Choice(1, 10), Choice(2, 10), False),  # two candidates are two, wherever they lie
        (Choice(None, 10), Choice(None, 10), True),
        (Choice(None, 10), Choice(None, 11), False),
        (Choice(None, 10), Choice(1, 10), True),
        (Choice(None, 10), Choice(1, 11), False),
    ],
)
def test_candidates_are_the_same_by_their_index_and_targets_by_their_cell(one, other, same):
    assert one.same(other) == other.same(one) == same


def test_a_pair_is_compared_along_both_its_trajectories_which_count_alike():
    """Along A's two observations they agree at one, along B's eight at two: (1/2 + 1/4) / 2."""
    table = agreement_table(
        [
            way(A, picks(0, 1), {B: picks(0, 2)}),
            way(B, picks(*range(4), *range(4)), {A: picks(0, 1, *[9] * 6)}),
        ]
    )
    assert tuple(table.columns) == COLUMNS
    pair = row(table, A, B)
    assert (pair["agreement"], pair["n"], pair["observations"]) == (0.375, 1, 10)
    assert math.isnan(pair["ci_low"]), "one world has no interval"
    assert row(table, A, A)["agreement"] == row(table, B, B)["agreement"] == 1.0
    assert row(table, A, A)["observations"] == 2


def test_who_else_is_compared_changes_no_number_of_a_pair():
    c = Chooser("c", None)
    two = [way(A, picks(0, 1), {B: picks(0, 2)}), way(B, picks(1), {A: picks(1)})]
    three = [way(A, picks(0, 1), {B: picks(0, 2), c: picks(5, 5)}), way(B, picks(1), {A: picks(1), c: picks(5)})]
    three.append(way(c, picks(5, 5, 5), {A: picks(0, 0, 0), B: picks(0, 0, 0)}))
    assert row(agreement_table(two), A, B).equals(row(agreement_table(three), A, B))


def test_the_mean_is_over_worlds_with_an_interval_and_chance_is_what_two_draws_would_have():
    shares = [(0, 0, 0, 0), (0, 0, 0, 9), (0, 0, 9, 9), (0, 9, 9, 9)]
    ways = []
    for trial, other in enumerate(shares):
        ways += [
            way(A, picks(0, 0, 0, 0), {B: picks(*other)}, trial, candidates=(1, 2, 4, 4)),
            way(B, picks(*other), {A: picks(0, 0, 0, 0)}, trial, candidates=(1, 2, 4, 4)),
        ]
    pair = row(agreement_table(ways), A, B)
    assert (pair["agreement"], pair["n"], pair["chance"]) == (0.625, 4, 0.5)
    assert pair["ci_low"] < 0.625 < pair["ci_high"]


def test_a_world_in_which_one_of_a_pair_did_not_answer_does_not_count():
    ways = [way(A, picks(0), {B: picks(0)}, trial=0), way(B, picks(0), {A: picks(0)}, trial=0)]
    ways += [way(A, picks(0), {}, trial=1), way(B, picks(1), {A: picks(0)}, trial=1)]
    ways += [way(A, picks(0), {B: picks(1)}, trial=2)]
    table = agreement_table(ways)
    assert (row(table, A, B)["n"], row(table, A, B)["agreement"]) == (1, 1.0)
    assert row(table, A, A)["n"] == 3
    nobody = row(agreement_table(ways[2:]), A, B)
    assert nobody["n"] == 0
    assert math.isnan(nobody["agreement"])


def test_worlds_without_a_decision_say_nothing():
    none = [way(A, (), {B: ()}), way(B, (), {A: ()})]
    some = [way(A, picks(0), {B: picks(1)}, trial=1), way(B, (), {A: ()}, trial=1)]
    pair = row(agreement_table(none + some), A, B)
    assert (pair["n"], pair["observations"], pair["agreement"]) == (1, 1, 0.0)


def test_each_training_seed_chooses_for_itself_and_scenarios_and_sizes_stay_apart():
    one, two = Chooser("net", 0), Chooser("net", 1)
    ways = []
    for size in (20.0, 40.0):
        other = picks(0, 0) if size == 20.0 else picks(0, 1)
        ways += [
            way(one, picks(0, 0), {two: other}, size=size, scenario=f"of {size:g} m"),
            way(two, other, {one: picks(0, 0)}, size=size, scenario=f"of {size:g} m"),
        ]
    table = agreement_table(ways)
    assert len(table) == 6
    pairs = table[table["seed_a"] != table["seed_b"]]
    assert dict(zip(pairs["scenario"], pairs["agreement"], strict=True)) == {"of 20 m": 1.0, "of 40 m": 0.5}
    assert [str(one), str(A)] == ["net, seed 0", "a"]
