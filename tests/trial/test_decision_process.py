"""A decision process is `rollout`, one decision at a time, and its worlds are those of the named streams."""

import dataclasses
import itertools

import numpy as np
import pytest
from handmade import TINY
from lidar_worlds import SMALL as BY_LIDAR

from explore_bench.trial.decision_process import Course, DecisionProcess
from explore_bench.trial.explorer import ChoiceError
from explore_bench.trial.reward import REWARD_WEIGHTS, RewardWeights, reward
from explore_bench.trial.run import run_trial
from explore_bench.trial.seeding import PURPOSES, ROLES, stream
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenarios import PAPER

COURSE = Course(TINY, "train", 5)
ODD = RewardWeights(uncertainty=1.0, turning=2.0, length=3.0, error=4.0, steps=5.0, explored=6.0)


def nearest(observation):
    return int(observation.path_lengths.argmin())


def drive(process, choose=nearest):
    """Play to the end; return the rewards and the number of rows at each decision."""
    rewards, decided = [], []
    while process.observation is not None:
        decided.append(len(process.rows) - 1)
        rewards.append(process.decide(choose(process.observation)))
    return rewards, decided


@pytest.mark.parametrize("scenario", [TINY, PAPER.replace(steps_per_cell=0.25), BY_LIDAR])
def test_the_rows_and_the_ending_are_those_of_the_trial_on_the_same_streams(scenario):
    for number in range(3):
        process = Course(scenario, "train", 5).begin(number)
        drive(process)
        spec = TrialSpec("nearest", "baselines.nearest:Nearest", scenario, number, purpose="train", root=5)
        result = run_trial(spec)
        assert process.rows == result.steps
        assert process.ending.status is result.status
        np.testing.assert_array_equal(process.ending.belief.poses, result.final_poses)


@pytest.mark.parametrize("weights", [REWARD_WEIGHTS, ODD])
def test_a_decision_earns_what_eq_24_gives_for_the_rows_before_and_after_it(weights):
    process = dataclasses.replace(COURSE, weights=weights).begin(0)
    rewards, decided = drive(process)
    rows = process.rows
    pairs = itertools.pairwise([*decided, len(rows) - 1])
    assert len(rewards) > 1
    assert rewards == [reward(rows[i], rows[j], TINY, weights) for i, j in pairs]


def test_it_waits_at_the_first_decision_and_either_for_a_decision_or_at_the_end():
    process = COURSE.begin(0)
    assert len(process.rows) == 1
    assert process.observation.decision == 0
    drive(process, lambda observation: 0 if process.ending is None else pytest.fail("asked after the end"))
    assert process.observation is None
    assert process.ending.status is Status.EXPLORED


@pytest.mark.parametrize("choice", [-1, 999])
def test_a_choice_that_is_no_candidate_is_refused(choice):
    with pytest.raises(ChoiceError, match=str(choice)):
        COURSE.begin(0).decide(choice)


def test_a_robot_that_is_walled_in_has_nothing_to_decide():
    obstacles = np.zeros((10, 10), dtype=bool)
    obstacles[3:6, 3:6] = True
    obstacles[4, 4] = False
    scenario = PAPER.replace(sensor_range=2.9, landmark_count=0, obstacle_count=8)
    world = LandmarkWorld(scenario.grid, obstacles, np.empty((0, 2)), (9.0, 9.0, 0.5))
    process = DecisionProcess(scenario, world, COURSE.generator(0, "motion"), COURSE.generator(0, "sensor"))
    assert process.observation is None
    assert process.ending.status is Status.STUCK


# Streams


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("purpose", PURPOSES)
def test_the_streams_of_a_course_are_those_of_the_benchmark(purpose, role):
    course = Course(TINY, purpose, 7)
    for episode in (0, 1, 12_345):
        own, expected = course.generator(episode, role), stream(purpose, 7, 12.0, episode, role)
        np.testing.assert_array_equal(own.integers(2**63, size=4), expected.integers(2**63, size=4))


def test_maps_of_several_sizes_come_by_turns():
    course = Course(TINY, "train", 5, scales=(1.0, 1.5))
    assert [course.scenario_of(episode) for episode in range(4)] == [TINY, TINY.replace(size=18.0)] * 2
    for episode in range(4):
        alone = Course(course.scenario_of(episode), "train", 5)
        one, other = course.begin(episode), alone.begin(episode)
        assert one.scenario.size == (12.0, 18.0)[episode % 2]
        assert one.rows == other.rows
        np.testing.assert_array_equal(one.observation.candidates, other.observation.candidates)


def first(course, episode, role):
    return int(course.generator(episode, role).integers(2**63))


@pytest.mark.parametrize("role", ROLES)
def test_no_stream_of_training_is_one_of_evaluation(role):
    """Whatever the root, the episode or the size."""
    seen = {
        purpose: {
            first(Course(PAPER.replace(size=size), purpose, root), episode, role)
            for root in range(6)
            for episode in range(12)
            for size in (20.0, 30.0, 40.0)
        }
        for purpose in PURPOSES
    }
    assert {len(values) for values in seen.values()} == {6 * 12 * 3}
    for one, other in itertools.combinations(PURPOSES, 2):
        assert not seen[one] & seen[other]


@pytest.mark.parametrize("purpose", ["train", "validate"])
def test_no_world_of_training_is_one_of_evaluation(purpose):
    def starts(purpose):
        courses = [Course(PAPER, purpose, root) for root in (0, 1)]
        return {draw_world(PAPER, course.generator(i, "world")).start for course in courses for i in range(10)}

    assert len(starts(purpose)) == len(starts("evaluate")) == 20
    assert not starts(purpose) & starts("evaluate")


def test_courses_of_other_physics_and_the_same_size_meet_the_same_worlds():
    """So that a setting may change without changing what it is tried on."""
    quieter = dataclasses.replace(COURSE, scenario=TINY.replace(odometry_sigma=TINY.odometry_sigma / 2))
    worlds = [draw_world(course.scenario, course.generator(3, "world")) for course in (COURSE, quieter)]
    assert worlds[0].start == worlds[1].start
    np.testing.assert_array_equal(worlds[0].obstacles, worlds[1].obstacles)
