"""The fine map: counts that add up and can be taken out again, and what a beam without a return says."""

import numpy as np
import pytest
from lidar_worlds import cluttered, ranges_at

from explore_bench.robot.lidar.grid_map import OCCUPIED_SHARE, GridMap
from explore_bench.world.lidar.constants import LidarScenario

SCENARIO = LidarScenario(size=10.0)
WORLD = cluttered()


def scans(count, seed=0, reach=10.0):
    """Poses anywhere in the world, some in obstacles, and noisy ranges from there."""
    rng = np.random.default_rng(seed)
    poses = [tuple(row) for row in np.column_stack((rng.uniform(0.2, 9.8, (count, 2)), rng.uniform(-3, 3, count)))]
    return [(pose, ranges_at(WORLD, pose, 180, reach, 0.02, rng)) for pose in poses]


def map_of(entries, scenario=SCENARIO):
    found = GridMap(scenario)
    for pose, ranges in entries:
        found.insert(pose, ranges)
    return found


def single(*ranges, pose=(1.05, 1.05, 0.0), **changes):
    """Map after one scan of few beams in a square of 10 m."""
    return map_of([(pose, np.array(ranges))], SCENARIO.replace(**changes))


def cells(mask):
    """(column, row) of the cells of a mask."""
    return {(int(column), int(row)) for row, column in zip(*np.nonzero(mask), strict=True)}


def test_a_beam_passes_the_cells_up_to_the_one_it_ends_in():
    found = single(0.52)
    assert cells(found.passes) == {(column, 10) for column in range(10, 16)}
    assert cells(found.hits) == {(15, 10)}
    assert found.passes.max() == 1
    assert cells(found.occupied) == {(15, 10)}
    np.testing.assert_array_equal(found.known, found.passes > 0)


def test_a_slanted_beam_passes_what_the_line_crosses():
    """Against points a tenth of a millimetre apart."""
    rng = np.random.default_rng(1)
    for _ in range(30):
        pose, length = (*rng.uniform(3.0, 7.0, 2), rng.uniform(-3.0, 3.0)), rng.uniform(0.1, 2.9)
        points = np.array(pose[:2]) + np.linspace(0.0, length, 30_000)[:, None] * [np.cos(pose[2]), np.sin(pose[2])]
        columns, rows = (points // 0.1).astype(int).T
        crossed = cells(np.bincount(rows * 100 + columns, minlength=10_000).reshape(100, 100))
        passed = cells(single(length, pose=pose).passes)
        assert crossed <= passed
        assert len(passed - crossed) <= 1  # a corner cut by less than that


def test_beams_count_from_straight_ahead_to_the_left():
    found = single(0.5, 0.3, np.inf, np.inf, pose=(5.05, 5.05, np.pi / 2), no_return_clears=False)
    assert cells(found.hits) == {(50, 55), (47, 50)}


def test_a_beam_that_returns_nothing_clears_its_reach_or_nothing_at_all():
    found = single(np.inf, sensor_range=3.0)
    assert cells(found.known) == {(column, 10) for column in range(10, 41)}
    assert not found.hits.any()
    assert not single(np.inf, sensor_range=3.0, no_return_clears=False).passes.any()


def test_a_range_beyond_the_reach_is_no_return():
    """Noise may carry a range beyond it, and it must not put a wall there."""
    assert not single(3.004, sensor_range=3.0).hits.any()
    assert not single(3.004, sensor_range=3.0, no_return_clears=False).passes.any()
    assert single(2.996, sensor_range=3.0).hits.sum() == 1


def test_a_cell_is_known_after_as_many_beams_as_asked_for():
    entry = ((1.05, 1.05, 0.0), np.array([0.52]))
    for count in (1, 2, 3, 4):
        found = map_of([entry] * count, SCENARIO.replace(known_after=3))
        assert found.known.any() == (count >= 3)
        assert found.occupied.any() == (count >= 3)


@pytest.mark.parametrize(("ended", "passed"), [(1, 3), (1, 4), (2, 7), (1, 0)])
def test_a_cell_is_occupied_where_the_share_of_beams_that_ended_there_is_large_enough(ended, passed):
    at = (1.05, 1.05, 0.0)
    found = map_of([(at, np.array([0.52]))] * ended + [(at, np.array([0.92]))] * passed)
    assert found.passes[10, 15] == ended + passed
    assert found.occupied[10, 15] == (ended / (ended + passed) >= OCCUPIED_SHARE)


def test_what_was_inserted_can_be_taken_out_again():
    entries = scans(12)
    found = map_of(entries)
    assert found.passes.sum() > 10_000
    for pose, ranges in entries:
        found.remove(pose, ranges)
    assert not found.passes.any()
    assert not found.hits.any()
    assert not found.known.any()


def test_a_map_with_moved_scans_is_the_one_built_anew():
    entries = scans(12)
    found = map_of(entries)
    moved = [((x + 0.07, y - 0.11, heading + 0.02), ranges) for (x, y, heading), ranges in entries[3:9]]
    for (old, ranges), (new, _) in zip(entries[3:9], moved, strict=True):
        found.remove(old, ranges)
        found.insert(new, ranges)
    anew = map_of([*moved, *entries[9:], *entries[:3]])
    np.testing.assert_array_equal(found.passes, anew.passes)
    np.testing.assert_array_equal(found.hits, anew.hits)
    assert (found.hits != map_of(entries).hits).any()


def test_beams_that_leave_the_map_count_only_on_it():
    found = single(5.0, pose=(8.05, 1.05, 0.0), sensor_range=10.0)
    assert cells(found.passes) == {(column, 10) for column in range(80, 100)}
    assert not found.hits.any()


def test_walls_are_mapped_where_they_are():
    """Perfectly localized, what is believed occupied touches a wall, and no open place is taken for one."""
    found = map_of(
        [
            entry
            for entry in scans(40, seed=2)
            if not WORLD.obstacles[WORLD.grid.cell_of(*entry[0][:2]) // 200, WORLD.grid.cell_of(*entry[0][:2]) % 200]
        ]
    )
    solid = WORLD.obstacles.reshape(100, 2, 100, 2).any(axis=(1, 3))
    near = solid.copy()
    near[1:] |= solid[:-1]
    near[:-1] |= solid[1:]
    near[:, 1:] |= solid[:, :-1]
    near[:, :-1] |= solid[:, 1:]
    assert found.occupied.sum() > 300
    assert near[found.occupied].mean() > 0.995


def test_what_the_newest_scan_meets_near_the_robot_is_an_obstacle_whatever_passed_it_before():
    """A pillar that a thousand beams missed; one beam alone is noise, and farther off than a metre the map decides."""
    scenario = LidarScenario(size=8.0)
    map_, pose = GridMap(scenario), (4.05, 4.05, 0.0)
    map_.passes[:] = 1000
    ranges = np.full(360, np.inf)
    ranges[:8], ranges[90], ranges[180:188] = 0.6, 0.6, 1.5
    map_.insert(pose, ranges)
    assert not map_.occupied.any()
    map_.watch(pose, ranges)
    rows, columns = np.nonzero(map_.obstacles)
    assert set(columns.tolist()) == {46}
    assert set(rows.tolist()) <= {40, 41}
    assert not map_.occupied.any(), "it is no part of the map"
    map_.watch(pose, np.full(360, np.inf))
    assert not map_.obstacles.any(), "the newest scan alone"
