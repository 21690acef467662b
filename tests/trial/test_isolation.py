"""What a strategy can reach from its observation: nothing of the truth, and nothing that it could change."""

import copy
import dataclasses
import types

import numpy as np
import pytest
from playing import PAPER, arrays_in, first_observation, nearest, play, reachable_from

from explore_bench.robot.landmark.smoother import Smoother
from explore_bench.robot.planning.candidates import Withheld
from explore_bench.trial.landmark.explorer import LandmarkExplorer
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.motion import Robot
from explore_bench.world.landmark.sensor import Sensor
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import Patch, Scan


@pytest.fixture(scope="module")
def mid_trial():
    """Return an observation in the middle of a trial, the row before it, and the true world."""
    world = draw_world(PAPER, TrialSpec("none", "none:none", PAPER, 0).generator("world"))
    observation, row, events = first_observation(after=6)
    assert events.gi_frame is not None
    return observation, row, world


def test_the_walk_does_find_what_is_there(mid_trial):
    """A walk that saw nothing would prove nothing."""
    observation = mid_trial[0]
    belief = observation.belief
    found = {id(item) for item in reachable_from(observation)}
    graph = belief.graph
    parts = [belief, belief.poses, graph.linearization.odometry_to, graph.elimination.corner, belief.scenario]
    parts += [observation.roads, observation.roads.free]
    assert all(id(part) in found for part in [*parts, *observation.paths])
    hidden = types.SimpleNamespace(held=[{"deep": (mid_trial[2],)}])
    assert any(isinstance(item, LandmarkWorld) for item in reachable_from(hidden))


def test_no_object_of_the_simulator_can_be_reached(mid_trial):
    simulator = (LandmarkWorld, LandmarkExplorer, Scan, Patch, Robot, Sensor, Smoother, Withheld, Step)
    forbidden = (*simulator, np.random.Generator, types.GeneratorType)
    frames = (types.FrameType, types.MethodType)
    assert not [item for item in reachable_from(mid_trial[0]) if isinstance(item, forbidden + frames)]


def test_no_true_number_can_be_reached(mid_trial):
    """Neither the true pose (also within its cell, as a scan holds it), nor landmarks, nor the obstacles."""
    observation, row, world = mid_trial
    true = [row.true_x, row.true_y, row.true_heading, row.true_x % 2.0, row.true_y % 2.0, *world.landmarks.ravel()]
    for item in reachable_from(observation):
        if isinstance(item, float):
            assert item not in true
        elif isinstance(item, np.ndarray) and item.dtype.kind == "f":
            assert not np.isin(item, true).any()
        elif isinstance(item, np.ndarray) and item.dtype.kind in "bu" and item.size == world.obstacles.size:
            assert not np.array_equal(item.reshape(-1), world.obstacles.reshape(-1))


def test_all_arrays_of_an_observation_are_read_only(mid_trial):
    """The nested ones of the belief too."""
    arrays = arrays_in(mid_trial[0], bases=False)
    assert len(arrays) > 20
    assert not [array.shape for array in arrays if array.flags.writeable]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_no_array_of_an_observation_is_a_view_of_one_that_can_be_written(mid_trial):
    assert not [array.shape for array in arrays_in(mid_trial[0]) if array.flags.writeable]


def test_an_observation_and_its_belief_are_frozen(mid_trial):
    observation = mid_trial[0]
    for target, name in ((observation, "step"), (observation.belief, "poses"), (observation, "anything")):
        with pytest.raises((AttributeError, TypeError)):
            setattr(target, name, 0)


def numbers_of(part):
    """All numbers of a dataclass of arrays, nested ones too, as bytes."""
    if isinstance(part, np.ndarray):
        return part.tobytes()
    if isinstance(part, tuple):
        return [numbers_of(item) for item in part]
    if dataclasses.is_dataclass(part):
        return [numbers_of(getattr(part, field.name)) for field in dataclasses.fields(part)]
    return part


def test_observations_stay_as_they_were_while_the_trial_goes_on():
    kept = []

    def keep(observation):
        kept.append((observation, copy.deepcopy(numbers_of(observation))))
        return nearest(observation)

    play(PAPER, keep, 6)
    assert len(kept) > 5
    for observation, numbers in kept:
        assert numbers_of(observation) == numbers


@pytest.mark.parametrize("scenario", [PAPER, LidarScenario(size=12.0)], ids=["landmark", "lidar"])
def test_an_observation_shares_nothing_that_could_be_changed_with_what_drives_and_judges(scenario):
    """Neither an array's memory nor an object with attributes or items, the scenario included."""
    observation, _, events = first_observation(scenario, after=3)
    explorer = events.gi_frame.f_locals["explorer"]
    shown = {id(item): item for item in reachable_from(observation)}
    own = {id(item): item for item in reachable_from(explorer)}
    both = [shown[key] for key in shown.keys() & own.keys()]
    assert explorer.scenario is not observation.scenario
    assert explorer.scenario == observation.scenario
    changeable = [item for item in both if isinstance(item, dict | list | set) or hasattr(item, "__dict__")]
    changeable = [item for item in changeable if not isinstance(item, type | types.ModuleType | types.FunctionType)]
    assert [type(item) for item in changeable] == []
    arrays = [[item for item in found.values() if isinstance(item, np.ndarray)] for found in (shown, own)]
    assert all(arrays)
    assert not [(a.shape, b.shape) for a in arrays[0] for b in arrays[1] if np.shares_memory(a, b)]
