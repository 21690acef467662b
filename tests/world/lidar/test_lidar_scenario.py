"""Constants of lidar worlds: their grids, what follows from them, and a sentence for what does not fit together."""

import math

import pytest

from explore_bench.errors import RequestError
from explore_bench.geometry import Grid
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.world import LidarWorld
from explore_bench.world.scenario import Scenario

REFUSED = {
    "a true cell that does not fit into one of decisions": (
        {"resolution": 0.3},
        r"cell_size 2 m is no multiple of resolution 0\.3 m",
    ),
    "a cell of the map that does not": (
        {"map_resolution": 0.15},
        r"cell_size 2 m is no multiple of map_resolution 0\.15 m",
    ),
    "too fine a truth": ({"size": 40.0, "resolution": 0.01}, r"resolution 0\.01 m gives more than 4,200,000 cells"),
    "too fine a map": (
        {"size": 100.0, "map_resolution": 0.04},
        r"map_resolution 0\.04 m gives more than 4,200,000 cells",
    ),
    "a robot wider than the passage": (
        {"robot_radius": 0.35},
        r"passage 0\.4 m is less than the 0\.44 m that a robot of 0\.35 m keeps on a map of 0\.1 m; widen it",
    ),
    "a passage too narrow for the map": (
        {"map_resolution": 0.25},
        r"passage 0\.4 m is less than the 0\.415 m that a robot of 0\.22 m keeps on a map of 0\.25 m; widen it",
    ),
    "a range that shows not even a cell": (
        {"sensor_range": 1.9},
        r"sensor_range 1\.9 m does not leave a cell of 2 m",
    ),
    "no range at all": ({"sensor_range": 0.0}, r"'sensor_range' is 0\.0"),
    "a robot of no size": ({"robot_radius": 0.0}, r"'robot_radius' is 0\.0"),
    "too few beams": ({"beams": 4}, r"'beams' is 4"),
    "no candidates": ({"candidates_per_robot": 0}, r"'candidates_per_robot' is 0"),
    "candidates near landmarks": ({"candidates_per_landmark": 3}, r"'candidates_per_landmark' is 3"),
    "a scene of no name": ({"scene": "garden"}, r"'scene' is 'garden'.*'dense'"),
    "a planner of no name": ({"local_planner": "teb"}, r"'local_planner' is 'teb'.*'pursuit'"),
    "a cell of the map that is no whole number of true cells": (
        {"resolution": 0.1, "map_resolution": 0.125},
        r"map_resolution 0\.125 m is no multiple of resolution 0\.1 m",
    ),
    "a map finer than the truth": (
        {"resolution": 0.1, "map_resolution": 0.05},
        r"map_resolution 0\.05 m is no multiple of resolution 0\.1 m",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_does_not_fit_together_is_refused_in_a_sentence(case):
    changes, sentence = REFUSED[case]
    with pytest.raises(RequestError, match=sentence) as refused:
        LidarScenario(**changes)
    assert "\n" not in str(refused.value)
    assert str(refused.value).endswith(".")


@pytest.mark.parametrize(
    "changes",
    [
        {"passage": 0.31, "resolution": 0.05},
        {"sensor_range": 2.0},
        {"size": 100.0, "resolution": 0.05},
        {"resolution": 0.1, "map_resolution": 0.1},
        {"resolution": 0.05, "map_resolution": 0.2},
    ],
)
def test_what_just_fits_is_taken(changes):
    assert LidarScenario(**changes).replace() == LidarScenario(**changes)


def test_the_kind_finds_its_scenario():
    assert type(Scenario(kind="lidar")) is LidarScenario
    assert Scenario(kind="lidar", size=8.0) == LidarScenario(size=8.0)


def test_the_three_grids_cover_the_same_square():
    scenario = LidarScenario(size=14.0, resolution=0.05, map_resolution=0.2)
    assert scenario.grid == Grid(7, 7, 2.0)
    assert scenario.map_grid == Grid(70, 70, 0.2)
    assert scenario.truth_grid == Grid(280, 280, 0.05)
    coarse = scenario.replace(size=10.0)
    assert (coarse.map_grid, coarse.truth_grid) == (Grid(50, 50, 0.2), Grid(200, 200, 0.05))


def test_there_is_room_between_the_robot_its_ways_and_the_passage():
    scenario = LidarScenario()
    assert scenario.lethal_radius == pytest.approx(0.31)
    assert scenario.robot_radius + 0.5 * scenario.resolution < scenario.lethal_radius
    assert scenario.lethal_radius + 0.5 * scenario.map_resolution < scenario.passage
    assert LidarScenario(map_resolution=0.2).lethal_radius == pytest.approx(0.38)


def test_a_point_in_view_is_seen_as_well_as_beams_tell():
    assert LidarScenario().sight_sigmas == pytest.approx((math.radians(0.5), 0.01))
    assert LidarScenario(range_sigma=0.0).sight_sigmas[1] == 1e-3


def test_limits_are_those_of_this_kind():
    scenario = LidarScenario(size=8.0)
    assert scenario.landmarks == 0
    assert scenario.coverage == 0.98
    assert scenario.step_limit == 16 * scenario.steps_per_cell


def test_a_tiny_one_is_small_and_can_be_drawn():
    import numpy as np

    tiny = LidarScenario(scene="maze", size=40.0).tiny
    assert tiny.size == 8.0
    assert tiny.sensor_range < tiny.size
    assert LidarWorld.draw(tiny, np.random.default_rng(0)).counted.any()
