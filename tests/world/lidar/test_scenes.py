"""Drawn scenes: enclosed, repeatable, and made as their modules say."""

import numpy as np
import pytest

from explore_bench.world.lidar.scenes import SCENES
from explore_bench.world.lidar.scenes.building import Wall, build, floor_of, furnish, open_door, opened, walls_between
from explore_bench.world.lidar.scenes.canvas import Box, Canvas, divided

FLAT = [Box(0.5, 0.5, 5.5, 4.5), Box(5.5, 0.5, 9.5, 4.5), Box(0.5, 4.5, 9.5, 9.5)]
"""Three rooms: two side by side below a wide one."""


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize(("size", "resolution"), [(20.0, 0.05), (26.0, 0.1), (40.0, 0.05)])
def test_a_scene_has_its_shape_and_a_wall_all_around(scene, size, resolution):
    obstacles = SCENES[scene](size, resolution, np.random.default_rng(3))
    n, thick = round(size / resolution), round(0.1 / resolution)
    assert obstacles.shape == (n, n)
    assert obstacles.dtype == bool
    for side in (obstacles[:thick], obstacles[-thick:], obstacles[:, :thick], obstacles[:, -thick:]):
        assert side.all()
    assert 0.5 < np.mean(~obstacles) < 0.95


@pytest.mark.parametrize("scene", SCENES)
def test_the_stream_alone_decides_what_is_drawn(scene):
    drawn = [SCENES[scene](20.0, 0.05, np.random.default_rng(seed)).tobytes() for seed in (1, 1, 2, 3)]
    assert drawn[0] == drawn[1]
    assert len(set(drawn)) == 3


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("size", [8.0, 10.0, 14.0])
def test_a_small_scene_is_still_one(scene, size):
    for seed in range(5):
        obstacles = SCENES[scene](size, 0.05, np.random.default_rng(seed))
        assert 0.3 < np.mean(~obstacles) < 1.0


@pytest.mark.parametrize("size", [20.0, 40.0])
def test_dense_has_a_tenth_of_an_obstacle_a_square_metre(size):
    # a block covers 1.44 m² in the mean and a pillar 0.54 m², so that 1 − exp(−0.117) of the box is covered
    covered = [
        SCENES["dense"](size, 0.05, np.random.default_rng(seed))[10:-10, 10:-10].mean()
        for seed in range(int(1200 / size))
    ]
    assert np.mean(covered) == pytest.approx(0.110, abs=0.008)


def test_a_box_ends_at_the_nearest_borders_of_cells_and_is_cut_off_at_the_edge():
    canvas = Canvas(2.0, 0.1)
    canvas.fill(Box(0.52, 0.98, 0.71, 1.23))
    assert np.argwhere(canvas.obstacles).tolist() == [[10, 5], [10, 6], [11, 5], [11, 6]]
    canvas.fill(Box(1.87, -3.0, 9.0, 0.1))
    assert canvas.obstacles[0, 19]
    assert canvas.obstacles.sum() == 5
    canvas.fill(Box(5.0, 5.0, 6.0, 6.0))
    assert canvas.obstacles.sum() == 5


def test_a_box_thinner_than_a_cell_is_a_cell_wide():
    canvas = Canvas(2.0, 0.5)
    canvas.fill(Box(1.0, 0.0, 1.01, 2.0))
    assert canvas.obstacles.sum(axis=1).tolist() == [1] * 4


def test_a_disc_is_the_cells_whose_centre_it_holds():
    canvas = Canvas(4.0, 0.05)
    canvas.fill_disc(2.0, 2.0, 0.6)
    assert canvas.obstacles.sum() * 0.05**2 == pytest.approx(np.pi * 0.6**2, rel=0.02)
    assert np.array_equal(canvas.obstacles, canvas.obstacles[::-1].T)
    canvas.fill_disc(-3.0, 2.0, 0.6)
    canvas.fill_disc(0.0, 4.0, 0.6)
    assert canvas.obstacles[-1, 0]
    assert not canvas.obstacles[:, -1].any()


def test_parts_of_a_length_are_about_as_long_as_asked():
    rng = np.random.default_rng(0)
    for _ in range(200):
        cuts = divided(1.0, 21.0, 2.0, 4.0, rng)
        parts = np.diff(cuts)
        assert (cuts[0], cuts[-1]) == (1.0, 21.0)
        assert 5 <= len(parts) <= 10
        assert parts.min() > 2.0 * 0.6
        assert parts.max() < 4.0 / 0.6
    assert divided(0.0, 1.0, 2.0, 4.0, rng) == [0.0, 1.0]


def test_walls_lie_where_two_spaces_touch():
    assert walls_between(FLAT, 1.0) == [
        Wall(0, 1, Box(5.5, 0.5, 5.5, 4.5)),
        Wall(0, 2, Box(0.5, 4.5, 5.5, 4.5)),
        Wall(1, 2, Box(5.5, 4.5, 9.5, 4.5)),
    ]
    assert [wall[:2] for wall in walls_between(FLAT, 4.5)] == [(0, 2)]


def test_a_tree_joins_all_spaces_and_the_rest_opens_by_its_share():
    spaces = [Box(x, y, x + 1.0, y + 1.0) for x in range(6) for y in range(6)]
    walls = walls_between(spaces, 0.5)
    tree = opened(walls, 36, 0.0, np.random.default_rng(0))
    assert len(tree) == 35
    joined = {0}
    for _ in range(36):
        joined |= {place for wall in tree if joined & set(wall[:2]) for place in wall[:2]}
    assert joined == set(range(36))
    assert opened(walls, 36, 1.0, np.random.default_rng(0)) == walls
    assert opened(walls, 36, 0.0, np.random.default_rng(1)) != tree


@pytest.mark.parametrize("turned", [False, True])
def test_a_door_has_its_width_goes_through_and_keeps_from_the_corners(turned):
    spaces = [space.turned for space in FLAT[:2]] if turned else FLAT[:2]
    for seed in range(20):
        canvas = Canvas(10.0, 0.05)
        build(canvas, spaces)
        (wall,) = walls_between(spaces, 1.0)
        open_door(canvas, wall, 1.0, np.random.default_rng(seed))
        obstacles = canvas.obstacles.T if turned else canvas.obstacles
        through = ~obstacles[:, 100:120].any(axis=1)
        assert np.count_nonzero(through) in (19, 20, 21)
        assert not through[:14].any()
        assert not through[-14 - 100 :].any()


def test_a_door_into_a_short_wall_is_as_wide_as_its_corners_allow():
    spaces = [Box(1.0, 1.0, 5.0, 2.5), Box(5.0, 1.0, 9.0, 2.5)]
    canvas = Canvas(10.0, 0.05)
    build(canvas, spaces)
    open_door(canvas, walls_between(spaces, 1.0)[0], 3.0, np.random.default_rng(0))
    assert np.count_nonzero(~canvas.obstacles[:, 100]) == pytest.approx((1.5 - 2 * 0.275) / 0.05, abs=1)


def test_furniture_stands_at_walls_or_in_the_middle_and_never_before_a_door():
    stood = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        canvas = Canvas(10.0, 0.05)
        build(canvas, FLAT)
        for wall in walls_between(FLAT, 1.0):
            open_door(canvas, wall, 1.0, rng)
        bare = canvas.obstacles.copy()
        for space in FLAT:
            furnish(canvas, space, 4, rng)
        added = canvas.obstacles & ~bare
        assert not (added & canvas.kept_free).any()
        assert not any(added[canvas._cells(space)].mean() > 0.35 for space in map(floor_of, FLAT))
        stood += added.any()
    assert stood == 40
