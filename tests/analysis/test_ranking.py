"""Who explores best: the order of strategies, and what is shown of the first place."""

import math

import numpy as np
import pandas as pd
import pytest

from explore_bench.analysis.paired import paired
from explore_bench.analysis.ranking import duels, places_of, ranking_metrics, standings
from explore_bench.analysis.statistics import LEVEL, holm, mean_interval, sign_flip_p

WORLDS = 12
NOISE = np.random.default_rng(5).uniform(0.98, 1.02, WORLDS)


def rows(strategy, e, eta, size=20.0, scenario="paper", **more):
    """Rows of `trials.csv` in which e and η lie closely around two values."""
    return pd.DataFrame(
        {
            "strategy": strategy,
            "training_seed": pd.array([None] * WORLDS, dtype="Int64"),
            "scenario": scenario,
            "size": size,
            "trial": range(WORLDS),
            "trajectory_error": e * NOISE,
            "exploration_efficiency": eta * NOISE[::-1],
            **{name: value * NOISE for name, value in more.items()},
        }
    )


def names(ranking):
    return [own.strategy for own in ranking]


def test_strategies_stand_by_the_mean_logarithm_of_e_and_one_over_eta():
    trials = pd.concat([rows("nearest", 1.0, 2.0), rows("random", 0.9, 1.0), rows("entropy", 2.0, 4.4)])
    ranking = standings(trials, ())
    assert names(ranking) == ["entropy", "nearest", "random"], "a tenth of e is worth a tenth of η"
    means = ranking[1].means
    e, eta = (means[("paper", 20.0), name].mean for name in ("trajectory_error", "exploration_efficiency"))
    assert ranking[1].score == pytest.approx((math.log(e) - math.log(eta)) / 2)


def test_means_and_intervals_are_those_of_the_tables():
    trials = rows("nearest", 1.0, 2.0)
    [own] = standings(trials, ())
    assert own.means[("paper", 20.0), "trajectory_error"] == mean_interval(trials["trajectory_error"].to_numpy())


def test_references_come_last_and_fill_what_they_plan_for_alone():
    trials = pd.concat(
        [rows("clairvoyant-accurate", 0.1, 9.0), rows("clairvoyant", 0.1, 9.0), rows("random", 3.0, 0.5)]
    )
    ranking = standings(trials, {"clairvoyant-accurate", "clairvoyant"})
    assert names(ranking) == ["random", "clairvoyant-accurate"], "the other plans for neither e nor η"
    unknown = trials.replace({"strategy": {"clairvoyant-accurate": "oracle"}})
    assert names(standings(unknown, {"oracle", "clairvoyant"})) == ["random"], "nobody knows what it planned for"


def test_one_that_lacks_a_size_comes_after_those_that_lack_none():
    trials = pd.concat([rows("nearest", 0.1, 9.0), rows("random", 3.0, 0.5), rows("random", 3.0, 0.5, size=40.0)])
    assert names(standings(trials, ())) == ["random", "nearest"]


def test_ablations_are_ranked_only_where_nothing_else_ran():
    ablations = [rows("no-state", 1.0, 2.0), rows("no-spatial", 2.0, 2.0)]
    assert names(standings(pd.concat(ablations), ())) == ["no-state", "no-spatial"]
    assert names(standings(pd.concat([*ablations, rows("random", 3.0, 0.5)]), ())) == ["random"]


def test_a_rule_of_the_field_is_ranked_beside_the_compared_ones_and_an_ablation_is_not():
    trials = pd.concat([rows("nearest", 1.0, 2.0), rows("frontier-tour", 0.5, 2.0), rows("no-state", 0.1, 9.0)])
    assert names(standings(trials, ())) == ["frontier-tour", "nearest"]


def test_a_strategy_that_nobody_registered_is_ranked():
    trials = pd.concat([rows("mine.py:Mine", 1.0, 2.0), rows("random", 3.0, 0.5)])
    assert names(standings(trials, ())) == ["mine.py:Mine", "random"]


def test_a_metric_that_is_not_defined_for_every_trial_is_left_out():
    trials = rows("nearest", 1.0, 2.0)
    trials.loc[3, "exploration_efficiency"] = math.nan
    [own] = standings(trials, ())
    assert {metric for _, metric in own.means} == {"trajectory_error"}


def test_a_mean_of_zero_has_a_rank():
    trials = pd.concat([rows("nearest", 0.0, 2.0), rows("random", 3.0, 0.0)])
    assert names(standings(trials, ())) == ["nearest", "random"]


def test_in_lidar_worlds_way_and_time_rank_and_each_scenario_is_a_place():
    near = rows("nearest", 9.0, 0.1, scenario="range 5 m", l90=20.0, t98_seconds=60.0)
    random = rows("random", 0.1, 9.0, scenario="range 5 m", l90=40.0, t98_seconds=90.0)
    trials = pd.concat([random, near, near.assign(scenario="range 10 m"), random.assign(scenario="range 10 m")])
    assert set(ranking_metrics(trials)) == {"l90", "t98_seconds"}
    assert places_of(trials) == [("range 5 m", 20.0), ("range 10 m", 20.0)]
    assert names(standings(trials, ())) == ["nearest", "random"]


# What is shown


def test_a_duel_is_won_lost_or_open_in_the_direction_of_its_metric():
    trials = pd.concat([rows("nearest", 1.0, 1.0), rows("random", 2.0, 2.0), rows("entropy", 1.0, 1.0)])
    found = {(duel.other, duel.metric): duel for duel in duels(trials, ["nearest", "random", "entropy"])}
    won, lost = found["random", "trajectory_error"], found["random", "exploration_efficiency"]
    assert (won.won, won.lost) == (True, False)
    assert (lost.won, lost.lost) == (False, True)
    assert won.relative.mean == pytest.approx(-0.5)
    for metric in ("trajectory_error", "exploration_efficiency"):
        same = found["entropy", metric]
        assert (same.won, same.lost) == (False, False)
    assert {duel.worlds for duel in found.values()} == {WORLDS}


def test_p_values_are_of_paired_differences_and_corrected_over_all_duels():
    trials = pd.concat([rows("nearest", 1.0, 1.0), rows("random", 1.01, 1.0), rows("random", 1.0, 1.0, size=40.0)])
    trials = pd.concat([trials, rows("nearest", 0.99, 1.0, size=40.0)])
    found = duels(trials, ["nearest", "random"])
    assert len(found) == 4
    plain = []
    for duel in found:
        own, other = (
            trials[(trials["strategy"] == name) & (trials["size"] == duel.place[1])][duel.metric].to_numpy()
            for name in ("nearest", "random")
        )
        plain.append(sign_flip_p(own - other))
    assert [duel.p for duel in found] == pytest.approx(holm(plain).tolist())


def test_a_duel_of_weights_says_whether_other_trainings_would_win_it_too():
    """Both win with their weights; those of the second would lie anywhere from world to world and seed to seed."""
    seeds = [
        rows("graph-stnn", 1.0 + shift, 1.0).assign(training_seed=seed) for seed, shift in enumerate((-0.3, 0, 0.3))
    ]
    others = [rows(name, 1.5, 1.0) for name in ("nearest", "random")]
    found = duels(pd.concat([*seeds, *others]), ["graph-stnn", "nearest", "random"])
    found = [duel for duel in found if duel.metric == "trajectory_error"]
    assert all(duel.won and not duel.won_after_other_trainings for duel in found)
    plain = duels(pd.concat(others), ["nearest", "random"])
    assert all(duel.p == duel.p_architecture for duel in plain)


@pytest.mark.parametrize(("rivals", "won"), [(1, True), (6, False)])
def test_whether_other_trainings_would_win_is_asked_of_the_corrected_p_value(rivals, won):
    """A raw p of 0.017 is enough among two duels, and not among twelve; with these weights both are won."""
    seeds = [
        rows("graph-stnn", 1.0 + shift, 1.0).assign(training_seed=seed) for seed, shift in enumerate((-0.08, 0, 0.08))
    ]
    others = ["nearest", "random", "entropy", "uncertainty", "mine.py:A", "mine.py:B"][:rivals]
    trials = pd.concat([*seeds, *(rows(name, 1.35, 1.0) for name in others)])
    found = [duel for duel in duels(trials, ["graph-stnn", *others]) if duel.metric == "trajectory_error"]
    raw = paired(pd.concat(seeds), rows("nearest", 1.35, 1.0), "trajectory_error").p_architecture
    assert raw <= LEVEL
    assert [duel.p_architecture for duel in found] == pytest.approx([2 * rivals * raw] * rivals)
    assert {(duel.won, duel.won_after_other_trainings) for duel in found} == {(True, won)}


def test_strategies_without_a_common_place_or_world_are_not_compared():
    trials = pd.concat([rows("nearest", 1.0, 1.0), rows("random", 2.0, 2.0, size=40.0)])
    assert duels(trials, ["nearest", "random"]) == []
    apart = rows("random", 2.0, 2.0)
    apart = pd.concat([rows("nearest", 1.0, 1.0), apart.assign(trial=apart["trial"] + 100)])
    assert duels(apart, ["nearest", "random"]) == []
