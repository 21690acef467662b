"""The grid of decisions: what it says of hand-made fine maps, and what a scan hides from it."""

import math

import numpy as np
import pytest
from lidar_worlds import drawn, ranges_at

from explore_bench.robot.lidar.decision_grid import known, occupancy, patch_reach, seen_patch
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import FREE, HIDDEN

SCENARIO = LidarScenario(size=6.0, sensor_range=5.0)
LOW = SCENARIO.occupancy_clamp


def map_of(free=(), walls=()):
    """Map whose cells are known in these slices of (rows, columns)."""
    found = GridMap(SCENARIO)
    for place in (*free, *walls):
        found.passes[place] = 3
    for place in walls:
        found.hits[place] = 3
    return found


def test_a_cell_s_occupancy_is_the_mean_of_what_is_believed_in_it():
    """Rows run along y: the wall in the upper half of cell 5, (row 1, column 2), is there and nowhere else."""
    found = map_of(free=[np.s_[20:30, 40:60]], walls=[np.s_[30:35, 40:60]])
    values = occupancy(found, SCENARIO)
    expected = np.full((3, 3), 0.5)
    expected[1, 2] = 0.5 * LOW + 0.25 * (1.0 - LOW) + 0.25 * 0.5
    np.testing.assert_allclose(values, expected)


def test_occupancy_stays_within_the_clamp():
    assert occupancy(map_of(free=[np.s_[:, :]]), SCENARIO) == pytest.approx(np.full((3, 3), LOW))
    assert occupancy(map_of(walls=[np.s_[:, :]]), SCENARIO) == pytest.approx(np.full((3, 3), 1.0 - LOW))


@pytest.mark.parametrize(("cells", "expected"), [(199, False), (200, True), (201, True)])
def test_a_cell_is_known_when_half_of_it_is(cells, expected):
    found = map_of()
    block = np.zeros(400, dtype=np.int32)
    block[:cells] = 1
    found.passes[20:40, 0:20] = block.reshape(20, 20)
    expect = np.zeros((3, 3), dtype=bool)
    expect[1, 0] = expected
    np.testing.assert_array_equal(known(found, SCENARIO), expect)


def test_what_is_not_known_often_enough_is_not_known():
    found = GridMap(SCENARIO.replace(known_after=3))
    found.passes[:20, :20], found.passes[:20, 20:40] = 2, 3
    assert known(found, SCENARIO)[0].tolist() == [False, True, False]


# Patches

REACH = patch_reach(SCENARIO)
CELL = SCENARIO.cell_size


def patch_of(ranges, sensor_range=5.0):
    return seen_patch(ranges, sensor_range, CELL, REACH)


def ways():
    """Way from the robot to each cell's centre in its frame (x ahead, y left) [m], shape (P, P) each."""
    return np.meshgrid(CELL * np.arange(-REACH, REACH + 1), CELL * np.arange(-REACH, REACH + 1))


def test_a_patch_holds_all_that_a_scan_can_reach():
    assert SCENARIO.sensor_range + 0.5 * CELL <= REACH * CELL
    patch = patch_of(np.full(360, np.inf))
    assert patch.shape == (2 * REACH + 1, 2 * REACH + 1)
    assert (patch[[0, -1]] == HIDDEN).all()
    assert (patch[:, [0, -1]] == HIDDEN).all()


def test_in_the_open_the_cells_in_range_are_seen():
    x, y = ways()
    patch = patch_of(np.full(360, np.inf))
    assert (patch[np.hypot(x, y) <= 5.0 - 0.5 * CELL] == FREE).all()
    assert (patch[np.hypot(x, y) >= 5.0 + 0.7 * CELL] == HIDDEN).all()


def test_a_wall_hides_what_is_behind_it():
    """A wall 2.8 m ahead, 5 m wide: the cells beyond are hidden, those before, beside and behind the robot are seen."""
    angles = math.tau * np.arange(360) / 360
    ahead = (np.cos(angles) > 0.0) & (np.abs(2.8 * np.tan(angles)) < 2.5)
    patch = patch_of(np.where(ahead, 2.8 / np.maximum(np.cos(angles), 1e-9), np.inf))
    middle = REACH
    assert patch[middle, middle] == FREE
    assert patch[middle, middle + 1] == FREE
    assert patch[middle, middle + 2] == HIDDEN
    assert patch[middle, middle - 2] == FREE
    assert patch[middle + 2, middle] == FREE
    assert patch[middle - 2, middle] == FREE


def test_left_is_up_and_ahead_is_right():
    """A wall on the left alone: rows of the patch run along the robot's y."""
    angles = math.tau * np.arange(360) / 360
    patch = patch_of(np.where(np.sin(angles) > 0.5, 1.2 / np.maximum(np.sin(angles), 1e-9), np.inf))
    assert patch[REACH + 2, REACH] == HIDDEN
    assert patch[REACH - 2, REACH] == FREE
    assert patch[REACH, REACH + 2] == FREE


def test_what_a_third_of_is_reached_is_seen():
    """A wall ahead, nearer and nearer: of the cell 2 m ahead three columns of places lie at 1.33, 2 and 2.67 m."""
    angles = math.tau * np.arange(360) / 360
    cosine = np.maximum(np.cos(angles), 1e-9)
    seen = [
        patch_of(np.where(np.cos(angles) > 0.1, wall / cosine, np.inf))[REACH, REACH + 1] == FREE
        for wall in (2.8, 2.2, 1.5, 1.2)
    ]
    assert seen == [True, True, True, False]


def test_behind_a_wall_of_a_room_nothing_is_seen():
    """A scan of a real room: every cell that is seen has a place within it."""
    world = drawn(12.0, free=[(4.0, 8.0, 4.0, 8.0)])
    patch = seen_patch(ranges_at(world, (6.0, 6.0, 0.0)), 10.0, CELL, 6)
    row, column = np.nonzero(patch == FREE)
    assert set(zip((row - 6).tolist(), (column - 6).tolist(), strict=True)) == {
        (i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)
    }
