"""Episodes in lockstep are those played one at a time and those of `rollout`, and their scores those of the tables."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from handmade import TINY, record, write_plugin

from baselines.training.episodes import Episode, play
from explore_bench.analysis.metrics import METRICS
from explore_bench.strategies.contract import Observation
from explore_bench.trial.decision_process import Course
from explore_bench.trial.explorer import ChoiceError
from explore_bench.trial.landmark.step import LandmarkStep
from explore_bench.trial.loop import rollout
from explore_bench.trial.reward import REWARD_WEIGHTS, RewardWeights, reward
from explore_bench.trial.run import run_trial
from explore_bench.trial.seeding import stream
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import step_columns
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

COURSE = Course(TINY, "train", 5)
NUMBERS = [0, 1, 2, 3, 4]
SHORT = PAPER.replace(steps_per_cell=0.25)
"""100 cells, 25 steps: too few to explore."""

ODD = RewardWeights(uncertainty=1.0, turning=2.0, length=3.0, error=4.0, steps=5.0, explored=6.0)


def nearest(waiting, observations):
    return [int(observation.path_lengths.argmin()) for observation in observations]


def farthest(waiting, observations):
    return [int(observation.path_lengths.argmax()) for observation in observations]


def by_hand(course, number, rule=nearest):
    """Rows, the index of the row before each decision, and how it ended, of one rollout."""
    streams = {
        role: stream(course.purpose, course.root, course.scenario.size, number, role)
        for role in ("world", "motion", "sensor")
    }
    world = draw_world(course.scenario, streams["world"])
    events = rollout(course.scenario, world, streams["motion"], streams["sensor"])
    rows, decided, choice = [], [], None
    while True:
        try:
            event = events.send(choice)
        except StopIteration as stop:
            return rows, decided, stop.value.status
        choice = None
        if isinstance(event, Observation):
            decided.append(len(rows) - 1)
            (choice,) = rule([0], [event])
        else:
            rows.append(event)


def spec_of(course, number, factory="baselines.nearest:Nearest"):
    """Specification of the trial with the same physics and the same streams."""
    return TrialSpec("nearest", factory, course.scenario, number, purpose=course.purpose, root=course.root)


def record_of(result):
    """Record of a trial, for the metrics."""
    columns = {name: [getattr(step, name) for step in result.steps] for name in step_columns("landmark")}
    return record(status=result.status.value, scenario=result.spec.scenario, **columns)


def row(**columns):
    return LandmarkStep(**dict.fromkeys(step_columns("landmark"), 0) | columns)


# One at a time, in lockstep, by hand


@pytest.mark.parametrize("rule", [nearest, farthest])
@pytest.mark.parametrize("scenario", [TINY, SHORT, Scenario(size=10.0)])
def test_episodes_in_lockstep_are_those_played_one_at_a_time(scenario, rule):
    course = Course(scenario, "train", 1)
    together = play(course, NUMBERS, rule)
    assert together == [play(course, [number], rule)[0] for number in NUMBERS]
    assert len({len(episode.rewards) for episode in together}) > 1, "they end at different times"


def test_the_two_rules_differ():
    """Else the test above would tell less."""
    assert play(COURSE, NUMBERS, nearest) != play(COURSE, NUMBERS, farthest)


def test_the_order_of_the_episodes_is_that_of_their_results_and_changes_none():
    episodes = play(COURSE, [4, 0, 2], nearest)
    assert [episode.number for episode in episodes] == [4, 0, 2]
    assert sorted(episodes, key=lambda x: x.number) == play(COURSE, [0, 2, 4], nearest)


@pytest.mark.parametrize("rule", [nearest, farthest])
@pytest.mark.parametrize("scenario", [TINY, SHORT])
def test_episodes_are_those_of_the_simulation_loop(scenario, rule):
    course = Course(scenario, "validate", 2)
    for episode in play(course, NUMBERS, rule):
        rows, decided, status = by_hand(course, episode.number, rule)
        assert episode.last == rows[-1]
        assert episode.steps == rows[-1].step == len(rows) - 1
        assert episode.status is status
        assert len(episode.rewards) == len(decided) == rows[-1].decisions


def test_episodes_are_those_of_trials_with_the_same_streams():
    for episode in play(COURSE, NUMBERS, nearest):
        result = run_trial(spec_of(COURSE, episode.number))
        assert (episode.last, episode.status) == (result.steps[-1], result.status)


def test_episodes_of_one_course_played_twice_are_equal():
    assert play(COURSE, NUMBERS, nearest) == play(COURSE, NUMBERS, nearest)


def test_an_observation_is_asked_about_once_and_by_the_place_of_its_episode():
    """Number 3 is at place 0; who has ended is not asked again, all others are asked in every round."""
    numbers, asked, rounds = [3, 0, 2], [[], [], []], []

    def act(waiting, observations):
        assert len(waiting) == len(observations) > 0
        assert waiting == sorted(set(waiting))
        rounds.append(set(waiting))
        for i, observation in zip(waiting, observations, strict=True):
            asked[i].append((observation.decision, observation.step, observation.candidates.tolist()))
        return nearest(waiting, observations)

    episodes = play(COURSE, numbers, act)
    assert rounds[0] == {0, 1, 2}
    assert all(later <= earlier for earlier, later in itertools.pairwise(rounds))
    for own, episode in zip(asked, episodes, strict=True):
        rows, decided, _ = by_hand(COURSE, episode.number)
        assert [decision for decision, _, _ in own] == list(range(len(episode.rewards)))
        assert [step for _, step, _ in own] == [rows[i].step for i in decided]


def test_choices_may_come_as_an_array():
    episodes = play(COURSE, [0, 1], lambda waiting, seen: np.array(nearest(waiting, seen)))
    assert episodes == play(COURSE, [0, 1], nearest)


def test_of_no_episodes_nobody_is_asked():
    assert play(COURSE, [], lambda waiting, observations: pytest.fail("asked")) == []


@pytest.mark.parametrize("choices", [[], [0], [0, 0, 0]])
def test_an_answer_for_each_is_asked_for(choices):
    with pytest.raises(ValueError, match="zip"):
        play(COURSE, [0, 1], lambda waiting, observations: choices)


def test_a_choice_that_is_no_candidate_is_refused():
    with pytest.raises(ChoiceError, match="999"):
        play(COURSE, [0], lambda waiting, observations: [999])


# Rewards


@pytest.mark.parametrize("weights", [REWARD_WEIGHTS, ODD])
def test_each_decision_is_rewarded_by_the_rows_before_and_after_it(weights):
    for episode in play(dataclasses.replace(COURSE, weights=weights), NUMBERS, nearest):
        rows, decided, _ = by_hand(COURSE, episode.number)
        between = itertools.pairwise([*decided, len(rows) - 1])
        expected = [reward(rows[i], rows[j], TINY, weights) for i, j in between]
        assert len(expected) >= 1
        assert episode.rewards == expected
        assert sum(episode.rewards) == pytest.approx(sum(expected))


def test_the_weights_of_the_benchmark_are_used_where_none_are_given():
    assert COURSE.weights == REWARD_WEIGHTS
    assert play(COURSE, [0, 1], nearest) != play(dataclasses.replace(COURSE, weights=ODD), [0, 1], nearest)


def test_the_last_decision_of_an_episode_cut_short_is_rewarded_too():
    for episode in play(Course(SHORT, "train", 0), NUMBERS, nearest):
        assert episode.status is Status.STEP_LIMIT
        assert episode.steps == 25
        assert len(episode.rewards) == episode.last.decisions > 0


# Scores


@pytest.mark.parametrize("purpose", ["train", "validate", "calibrate", "evaluate"])
@pytest.mark.parametrize("scenario", [TINY, SHORT])
def test_the_score_is_that_of_the_trial_in_the_tables(scenario, purpose, tmp_path):
    """A plugin with the same rule on the same streams."""
    course = Course(scenario, purpose, 3)
    factory = write_plugin(tmp_path)
    for episode in play(course, NUMBERS[:3], nearest):
        result = run_trial(spec_of(course, episode.number, factory))
        made = record_of(result)
        assert result.status is (Status.EXPLORED if scenario is TINY else Status.STEP_LIMIT)
        time, efficiency, error = episode.score(scenario)
        assert time == (result.steps[-1].step if scenario is TINY else scenario.step_limit)
        assert efficiency == pytest.approx(METRICS["exploration_efficiency"].value(made), rel=1e-12)
        assert error == pytest.approx(METRICS["trajectory_error"].value(made), rel=1e-12)


@pytest.mark.parametrize("peak", [0.25, 2.0, 9.0])
@pytest.mark.parametrize("status", Status)
def test_the_score_of_every_ending_is_that_of_the_tables(status, peak):
    """A trace below the prior's, 2 σ₀² = 2, at it and above it."""
    last = row(step=40, uncertainty=80.0, peak_trace=peak)
    made = record(status=status.value, scenario=PAPER, step=[0, 40], uncertainty=[200.0, 80.0], peak_trace=[0.01, peak])
    time, efficiency, error = Episode(0, last, [], status).score(PAPER)
    assert time == (40 if status is Status.EXPLORED else 1000)
    assert efficiency == pytest.approx(METRICS["exploration_efficiency"].value(made), rel=1e-12)
    assert error == pytest.approx(METRICS["trajectory_error"].value(made), rel=1e-12)


def test_the_score_of_an_explored_map_worked_by_hand():
    """Eq. 2: (200 − 80) / 40; Eq. 3: 40 of 100 cells times √0.25."""
    last = row(step=40, uncertainty=80.0, peak_trace=0.25)
    assert Episode(0, last, [], Status.EXPLORED).score(PAPER) == pytest.approx((40.0, 3.0, 0.2))


def test_an_unfinished_episode_is_scored_by_the_step_limit():
    """1000 steps of 100 cells: η = (200 − 80) / 1000, e = 10 · √max(0.25, 2)."""
    last = row(step=40, uncertainty=80.0, peak_trace=0.25)
    for status in (Status.STUCK, Status.STEP_LIMIT, Status.FAILED):
        assert Episode(0, last, [], status).score(PAPER) == pytest.approx((1000.0, 0.12, 10.0 * math.sqrt(2.0)))


def test_an_episode_that_never_began_has_no_steps():
    assert Episode(0).steps == 0
    assert Episode(0).status is Status.FAILED


def test_another_root_is_another_course():
    assert play(COURSE, [0], nearest) != play(dataclasses.replace(COURSE, root=6), [0], nearest)
