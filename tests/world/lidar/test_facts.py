"""Facts of worlds drawn by hand, whose answers are known."""

import math

import numpy as np
import pytest

from explore_bench.geometry import Grid
from explore_bench.world.lidar.facts import facts_of
from explore_bench.world.lidar.world import LidarWorld

RESOLUTION = 0.1


def world_of(*obstacles, free=np.s_[1:-1, 1:-1], n=80, start=(0.15, 0.15, 0.0), uncounted=None):
    """A square of 80 cells of 0.1 m that is a wall but for `free`, in which these slices are filled."""
    cells = np.ones((n, n), dtype=bool)
    cells[free] = False
    for place in obstacles:
        cells[place] = True
    counted = ~cells
    if uncounted is not None:
        counted[uncounted] = False
    return LidarWorld(Grid(n, n, RESOLUTION), cells, counted, start)


@pytest.mark.parametrize("width", [15, 16])
@pytest.mark.parametrize("turned", [False, True])
def test_a_corridor_is_as_wide_as_it_is(width, turned):
    free = np.s_[30 : 30 + width, 5:75]
    facts = facts_of(world_of(free=free[::-1] if turned else free), 1.0)
    assert facts.corridor_width == pytest.approx(width * RESOLUTION)
    assert facts.free_area == pytest.approx(width * 70 * RESOLUTION**2)
    assert facts.loops == facts.long_loops == 0


def test_the_width_is_the_median_by_length():
    # two corridors, 2 m and 1 m wide, whose lengths change which is the longer

    def width_of(world):
        return facts_of(world, 1.0).corridor_width

    apart = np.s_[15:40, :]
    assert width_of(world_of(apart, np.s_[:40, 30:], free=np.s_[5:60, 10:70])) == pytest.approx(2.0)
    assert width_of(world_of(apart, np.s_[40:, 35:], free=np.s_[5:60, 10:70])) == pytest.approx(1.0)


def test_there_is_no_width_without_facing_walls():
    assert math.isnan(facts_of(world_of(free=np.s_[5:6, 5:6]), 1.0).corridor_width)


def test_a_loop_is_an_island_whatever_its_size():
    assert facts_of(world_of(), 1.0).loops == 0
    assert facts_of(world_of(np.s_[40, 40]), 1.0).loops == 1
    assert facts_of(world_of(np.s_[20:30, 20:30], np.s_[50:60, 50:60]), 1.0).loops == 2
    assert facts_of(world_of(np.s_[0:30, 20:30]), 1.0).loops == 0, "it stands at the wall"


def test_islands_without_a_way_between_them_are_one():
    corner = (np.s_[20:30, 20:30], np.s_[30:40, 30:40])
    assert facts_of(world_of(*corner), 1.0).loops == 1
    apart = (np.s_[20:30, 20:30], np.s_[20:30, 32:42])
    assert facts_of(world_of(*apart), 1.0).loops == 2
    assert facts_of(world_of(*apart, uncounted=np.s_[20:30, 30:32]), 1.0).loops == 1


def test_a_room_within_an_island_is_no_loop():
    court = world_of(np.s_[20:60, 20:60], uncounted=np.s_[30:40, 30:40])
    assert facts_of(court, 1.0).loops == 1


@pytest.mark.parametrize(("side", "long"), [(24, 0), (25, 1)])
def test_a_long_loop_is_ten_metres_around(side, long):
    facts = facts_of(world_of(np.s_[20 : 20 + side, 20 : 20 + side], np.s_[10, 10]), 1.0)
    assert facts.loops == 2
    assert facts.long_loops == long


def test_the_share_beyond_the_range_is_a_distance_that_walls_do_not_change():
    # a corridor a cell wide, from 0.1 to 7.9 m, the start in its first cell
    corridor = world_of(free=np.s_[1:2, 1:79])
    assert facts_of(corridor, 3.85).beyond_range == pytest.approx(39 / 78)
    assert facts_of(corridor, 10.0).beyond_range == 0.0
    assert facts_of(world_of(np.s_[1, 5], free=np.s_[1:2, 1:79]), 3.85).beyond_range == pytest.approx(39 / 77)


def test_what_does_not_count_is_no_part_of_any_fact():
    facts = facts_of(world_of(uncounted=np.s_[:, 40:]), 4.0)
    assert facts.free_area == pytest.approx(78 * 39 * RESOLUTION**2)
    with pytest.raises(ValueError, match="no cell"):
        facts_of(world_of(uncounted=np.s_[:]), 4.0)
