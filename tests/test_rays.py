"""Rays: exact against every obstacle cell by brute force and in closed form, whatever they leap over."""

import math

import numpy as np
import pytest

from explore_bench.geometry import Grid
from explore_bench.geometry.rays import cast, leaps

GRID = Grid(30, 40, 0.25, -3.0, 2.0)
BEAMS = 64


def scattered(seed, share):
    return np.random.default_rng(seed).random(GRID.shape) < share


def pose_in(obstacles, rng):
    """Return a random pose in a free cell."""
    while True:
        x, y = GRID.x0 + 10.0 * rng.random(), GRID.y0 + 7.5 * rng.random()
        if not obstacles.reshape(-1)[GRID.cell_of(x, y)]:
            return x, y, rng.uniform(-4.0, 4.0)


def brute_force(pose, beams, reach, obstacles, grid):
    """Entry of each ray into each obstacle cell, by the slabs of its edges; the least of them."""
    centres = grid.centres(np.flatnonzero(obstacles))
    found = []
    for beam in range(beams):
        angle = pose[2] + math.tau * beam / beams
        with np.errstate(divide="ignore"):
            ends = [
                (centres + side * grid.resolution - np.array(pose[:2])) / (math.cos(angle), math.sin(angle))
                for side in (-0.5, 0.5)
            ]
        enter, leave = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
        met = np.maximum(enter, 0.0)[(enter < leave) & (leave > 0.0)]
        found.append(met.min() if len(met) and met.min() <= reach else np.inf)
    return np.array(found)


@pytest.mark.parametrize("share", [0.001, 0.005, 0.03, 0.3])
@pytest.mark.parametrize("seed", range(5))
def test_ranges_are_those_of_brute_force(seed, share):
    obstacles, rng = scattered(seed, share), np.random.default_rng(100 + seed)
    room = leaps(obstacles, GRID)
    hits = 0
    for _ in range(6):
        pose = pose_in(obstacles, rng)
        ranges = cast(pose, BEAMS, 6.0, obstacles, room, GRID)
        np.testing.assert_allclose(ranges, brute_force(pose, BEAMS, 6.0, obstacles, GRID), atol=1e-9)
        hits += np.isfinite(ranges).sum()
    assert share < 0.03 or hits > 50


@pytest.mark.parametrize("share", [0.0, 0.002, 0.01, 0.1])
def test_leaps_save_time_and_nothing_else(share):
    """Against walking every cell, which a leap of no length makes of the same rays."""
    rng, total = np.random.default_rng(0), 0.0
    for seed in range(10):
        obstacles = scattered(seed, share)
        room = leaps(obstacles, GRID)
        pose = pose_in(obstacles, rng)
        walked = cast(pose, 360, 9.0, obstacles, np.full_like(room, -1.0), GRID)
        np.testing.assert_allclose(cast(pose, 360, 9.0, obstacles, room, GRID), walked, atol=1e-6)
        total += np.isfinite(walked).sum()
    assert total == 0 if share == 0.0 else total > 100


def test_no_leap_reaches_an_obstacle_from_anywhere_in_its_cell():
    obstacles = scattered(3, 0.01)
    room = leaps(obstacles, GRID)
    walls = GRID.centres(np.flatnonzero(obstacles))
    for cell, centre in enumerate(GRID.centres()):
        nearest = np.inf
        for corner in ((-0.125, -0.125), (-0.125, 0.125), (0.125, -0.125), (0.125, 0.125)):
            aside = np.maximum(np.abs(walls - centre - corner) - 0.125, 0.0)
            nearest = min(nearest, float(np.hypot(*aside.T).min()))
        assert room.reshape(-1)[cell] <= nearest + 1e-5
    assert room.max() > 1.0, "there is room to leap"


def test_in_a_box_ranges_are_those_of_its_four_walls():
    grid = Grid(100, 100, 0.1)
    walls = np.ones(grid.shape, dtype=bool)
    walls[10:60, 20:90] = False  # 2 to 9 m by 1 to 6 m
    x, y, heading = pose = (3.37, 4.21, 0.4)
    expected = []
    for beam in range(36):
        along_x, along_y = math.cos(heading + math.tau * beam / 36), math.sin(heading + math.tau * beam / 36)
        expected.append(
            min(((9.0 if along_x > 0 else 2.0) - x) / along_x, ((6.0 if along_y > 0 else 1.0) - y) / along_y)
        )
    np.testing.assert_allclose(cast(pose, 36, 20.0, walls, leaps(walls, grid), grid), expected, atol=1e-9)


def test_the_first_beam_looks_ahead_and_the_others_follow_to_the_left():
    grid = Grid(80, 80, 0.1)
    walls = np.zeros(grid.shape, dtype=bool)
    walls[:, 60:] = True  # from x = 6 m on
    walls[70:] = True  # from y = 7 m on
    ranges = cast((4.0, 4.0, math.pi / 2), 4, 10.0, walls, leaps(walls, grid), grid)
    np.testing.assert_allclose(ranges, [3.0, np.inf, np.inf, 2.0], atol=1e-9)


def test_what_lies_beyond_the_reach_is_not_there():
    grid = Grid(20, 100, 0.1)
    walls = np.zeros(grid.shape, dtype=bool)
    walls[:, 80] = True
    room = leaps(walls, grid)
    at = (2.03, 1.0, 0.0)
    assert cast(at, 1, 5.98, walls, room, grid)[0] == pytest.approx(5.97)
    assert cast(at, 1, 5.96, walls, room, grid)[0] == np.inf


def test_outside_of_the_grid_there_is_nothing():
    walls = np.zeros(GRID.shape, dtype=bool)
    walls[10:20, 10:20] = True
    room = leaps(walls, GRID)
    assert np.isinf(cast((GRID.x0 - 0.1, GRID.y0 + 3.7, 0.0), 8, 20.0, walls, room, GRID)).all()
    nothing = np.zeros_like(walls)
    assert np.isinf(cast((0.0, 5.0, 0.1), 8, 100.0, nothing, leaps(nothing, GRID), GRID)).all()


def test_a_ray_from_within_an_obstacle_is_of_no_length():
    walls = np.zeros(GRID.shape, dtype=bool)
    walls[4, 4] = True
    assert (cast((GRID.x0 + 1.1, GRID.y0 + 1.1, 0.3), 8, 5.0, walls, leaps(walls, GRID), GRID) == 0.0).all()
