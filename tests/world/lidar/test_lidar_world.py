"""Lidar worlds: every place where the robot fits is reached, gaps are closed, and a record tells the same world."""

import json

import numpy as np
import pytest
from scipy import ndimage

from explore_bench.errors import RequestError
from explore_bench.geometry import Grid, cell_of
from explore_bench.trial.seeding import stream
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.scenes import SCENES
from explore_bench.world.lidar.world import LidarWorld, clearance_of


def world_of(trial, **changes):
    scenario = LidarScenario(**changes)
    return LidarWorld.draw(scenario, stream("evaluate", 0, scenario.size, trial, "world"))


def reached_from(world, passage):
    """Cells joined to the start's with at least this clearance, by steps to the four sides."""
    labels, _ = ndimage.label(world.clearance >= passage)
    start = labels.reshape(-1)[cell_of(world.grid, *world.start[:2])]
    assert start
    return labels == start


def drawn_by_hand(monkeypatch, *obstacles, **changes):
    """World of a 4 m scene that is an empty box with these slices filled."""

    def draw(size, resolution, rng):
        n = round(size / resolution)
        cells = np.ones((n, n), dtype=bool)
        cells[2:-2, 2:-2] = False
        for place in obstacles:
            cells[place] = True
        return cells

    monkeypatch.setitem(SCENES, "dense", draw)
    return world_of(0, **{"size": 4.0, **changes})


@pytest.mark.parametrize("scene", SCENES)
def test_every_place_where_the_robot_fits_is_reached(scene):
    scenario = LidarScenario(scene=scene)
    for trial in range(15):
        world = world_of(trial, scene=scene)
        reached = reached_from(world, scenario.passage)
        away = ndimage.distance_transform_edt(~reached) * scenario.resolution
        assert away[world.clearance >= scenario.robot_radius].max() <= scenario.passage
        assert np.array_equal(world.counted, ~world.obstacles & (away <= 0.30))
        assert np.mean(world.counted) > 0.5


@pytest.mark.parametrize("scene", SCENES)
def test_a_larger_world_keeps_the_promise(scene):
    scenario = LidarScenario(scene=scene, size=40.0)
    world = world_of(1, scene=scene, size=40.0)
    away = ndimage.distance_transform_edt(~reached_from(world, scenario.passage)) * scenario.resolution
    assert away[world.clearance >= scenario.robot_radius].max() <= scenario.passage


def test_one_stream_gives_one_world():
    first, second = world_of(7), world_of(7)
    assert np.array_equal(first.obstacles, second.obstacles)
    assert np.array_equal(first.counted, second.counted)
    assert first.start == second.start
    assert first.digest == second.digest
    assert len({world_of(trial, size=8.0).digest for trial in range(40)}) == 40


def test_starts_lie_anywhere_in_the_open_and_face_anywhere():
    worlds = [world_of(trial, size=8.0) for trial in range(60)]
    headings = np.array([world.start[2] for world in worlds])
    assert (np.abs(headings) <= np.pi).all()
    assert headings.min() < -2.0
    assert headings.max() > 2.0
    places = np.array([world.start[:2] for world in worlds])
    assert (places.min(axis=0) < 2.5).all()
    assert (places.max(axis=0) > 5.5).all()
    for world in worlds:
        assert world.clearance.reshape(-1)[cell_of(world.grid, *world.start[:2])] >= 0.6 - 1e-9


def test_a_gap_that_the_robot_fits_into_but_may_not_pass_is_closed(monkeypatch):
    # a slot of 0.6 m between the wall and a block 1.5 m long
    world = drawn_by_hand(monkeypatch, np.s_[14:30, 2:32])
    assert world.obstacles[2:14, 2:20].all()
    assert not world.obstacles[2:14, 45:60].any()
    assert not world.obstacles[2, -3]  # the room's corner, where the robot does not fit, stays as it is


def test_a_gap_that_the_robot_does_not_fit_into_stays(monkeypatch):
    world = drawn_by_hand(monkeypatch, np.s_[8:30, 2:32])  # 0.3 m
    assert not world.obstacles[2:8, 2:32].any()
    assert not world.counted[2:8, 2:25].any()


def test_a_gap_as_wide_as_the_passage_stays(monkeypatch):
    world = drawn_by_hand(monkeypatch, np.s_[18:34, 2:32])  # 0.8 m
    assert not world.obstacles[2:18, 2:32].any()
    assert world.counted[9, 2 + 8]


def test_a_small_closet_is_filled_in_and_a_room_is_not_given_up(monkeypatch):
    closet = drawn_by_hand(monkeypatch, np.s_[:26, 26:29], np.s_[26:29, :29])
    assert closet.obstacles[2:26, 2:26].all()
    with pytest.raises(
        RequestError, match=r"no dense world of 4 m with a passage of 0\.4 m .* 200 draws; lower passage"
    ):
        drawn_by_hand(monkeypatch, np.s_[:, 39:42])


def test_what_lies_behind_a_thin_wall_does_not_count(monkeypatch):
    # a robot so small that 0.30 m from where it goes reaches through the wall, into a slit where even it does not fit
    world = drawn_by_hand(monkeypatch, np.s_[:, 75], robot_radius=0.11, passage=0.2)
    assert world.counted[40, 74]
    assert not world.obstacles[40, 76:78].any()
    assert not world.counted[:, 76:].any()


def test_a_world_without_room_to_start_asks_for_a_smaller_passage():
    with pytest.raises(RequestError, match=r"no maze world of 8 m with a passage of 1\.2 m"):
        world_of(0, scene="maze", size=8.0, passage=1.2, resolution=0.1)


def test_clearance_is_the_distance_of_centres_and_the_edge_of_the_grid_a_wall():
    obstacles = np.zeros((9, 9), dtype=bool)
    obstacles[4, 4] = True
    clearance = clearance_of(obstacles, 0.5)
    assert clearance[4, 4] == 0.0
    assert clearance[3, 5] == pytest.approx(0.5 * np.sqrt(2))
    assert clearance[0, 0] == 0.5
    assert clearance[2, 4] == 1.0


def test_a_record_tells_the_same_world():
    scenario = LidarScenario(scene="office")
    world = world_of(3, scene="office")
    text = json.dumps(world.facts())
    again = LidarWorld.from_facts(json.loads(text), scenario)
    assert np.array_equal(again.obstacles, world.obstacles)
    assert np.array_equal(again.counted, world.counted)
    assert again.start == world.start
    assert again.grid == world.grid == Grid(400, 400, 0.05)
    assert again.digest == world.digest
    assert len(text) < 6_000


def test_whatever_makes_a_world_another_changes_its_digest():
    world = world_of(0, size=8.0)
    x, y, heading = world.start
    fewer = world.counted.copy()
    fewer[80, :] = False
    others = [
        LidarWorld(world.grid, world.obstacles, world.counted, (x, y, heading + 1e-9)),
        LidarWorld(world.grid, world.obstacles, fewer, world.start),
        LidarWorld(world.grid, world.obstacles | ~fewer, world.counted, world.start),
        LidarWorld(Grid(160, 160, 0.1), world.obstacles, world.counted, world.start),
    ]
    assert len({world.digest, *(other.digest for other in others)}) == 5


def test_a_world_is_read_only_and_fits_its_grid():
    world = world_of(0, size=8.0)
    assert world.landmarks.shape == (0, 2)
    for array in (world.obstacles, world.counted, world.clearance):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1
    with pytest.raises(ValueError, match="counted have the shape"):
        LidarWorld(world.grid, world.obstacles, world.counted[1:], world.start)


# Given maps


def plan(*obstacles, edge=80):
    """Rows of a map of 8 m, free but for these slices (rows from the north)."""
    cells = np.zeros((edge, edge), dtype=bool)
    for place in obstacles:
        cells[place] = True
    return tuple("".join("#" if cell else "." for cell in row) for row in cells)


def walls(top, bottom, left, right):
    """The four walls of a box, one cell thick."""
    across, along = slice(left, right), slice(top, bottom)
    return [np.s_[top, across], np.s_[bottom - 1, across], np.s_[along, left], np.s_[along, right - 1]]


def given(rows, trial=0, **changes):
    scenario = LidarScenario(map=rows, resolution=0.1, **changes)
    return LidarWorld.draw(scenario, stream("evaluate", 0, scenario.size, trial, "world"))


def place_of(world):
    """Row from the north and column of the start in the picture of an 80-cell map."""
    row, column = divmod(cell_of(world.grid, *world.start[:2]), world.grid.columns)
    return 79 - (row - 5), column - 5


def test_half_a_metre_of_wall_lies_around_a_given_map_and_nothing_of_it_is_lost():
    rows = plan(np.s_[0, :40], np.s_[30:40, 79])
    world = given(rows)
    assert world.grid.columns == 100, "8 m, twice half a metre, in whole cells of 2 m"
    drawn = np.array([list(row) for row in reversed(rows)]) == "#"
    np.testing.assert_array_equal(world.obstacles[5:85, 5:85], drawn)
    around = world.obstacles.copy()
    around[5:85, 5:85] = True
    assert around.all()


def test_the_border_is_whole_cells_where_half_a_metre_is_none():
    scenario = LidarScenario(map=plan(edge=20), resolution=0.4, map_resolution=0.4, passage=0.7)
    world = LidarWorld.draw(scenario, np.random.default_rng(0))
    assert world.grid.columns == 25, "8 m, twice two cells, in whole cells of 2 m"
    assert not world.obstacles[2:22, 2:22].any()
    assert world.obstacles[:2].all()


@pytest.mark.parametrize("trial", range(20))
def test_a_start_is_drawn_indoors_though_a_door_stands_open(trial):
    """The house takes a quarter of the map; a pocket in its wall, closed, is indoors as well, but small."""
    house, door = walls(10, 50, 10, 50), np.s_[25:35, 49]
    rows = [list(row) for row in plan(*house, *walls(60, 71, 60, 71))]
    for row in rows[door[0]]:
        row[49] = "."
    row, column = place_of(given(tuple("".join(row) for row in rows), trial))
    assert 10 < row < 50
    assert 10 < column < 50


@pytest.mark.parametrize("trial", range(5))
def test_without_an_indoors_a_start_is_drawn_in_the_largest_region(trial):
    row, _ = place_of(given(plan(np.s_[30, :]), trial))
    assert row > 30


def test_a_start_that_the_map_names_is_where_it_says():
    rows = list(plan())
    rows[20] = rows[20][:33] + "S" + rows[20][34:]
    assert place_of(given(tuple(rows))) == (20, 33)
