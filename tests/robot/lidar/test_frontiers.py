"""Frontiers of hand-made fine maps: their pieces, and from where each is looked at."""

import math

import numpy as np
import pytest

from explore_bench.geometry import Grid
from explore_bench.robot.lidar.frontiers import (
    LEAST_LENGTH,
    LOOK_FROM,
    MOST_TRIES,
    PIECE_RADIUS,
    frontier_mask,
    frontiers,
    look_from,
)
from explore_bench.robot.lidar.terrain import Terrain, in_sight

SIDE = 80
GRID = Grid(SIDE, SIDE, 0.1)
RADIUS = 0.31
NONE = np.zeros(GRID.shape, dtype=bool)
UNTRIED = np.zeros(GRID.shape, dtype=np.uint8)


def terrain_of(opening, *walls, known=None):
    """A known room, x < 4 m, whose right wall is open between two rows; all else is unknown."""
    known = np.zeros(GRID.shape, dtype=bool) if known is None else known
    known[:, :40] = True
    occupied = np.zeros(GRID.shape, dtype=bool)
    occupied[0] = occupied[-1] = occupied[:, 0] = True
    occupied[:, 39] = True
    if opening:
        occupied[slice(*opening), 39] = False
    for rows, columns in walls:
        occupied[rows, columns] = True
    return Terrain(GRID, known, occupied & known)


def cell(row, column):
    return row * SIDE + column


def found_in(terrain, start=(40, 20), tries=UNTRIED, radius=RADIUS):
    ways = terrain.ways(cell(*start), radius)
    return frontiers(terrain, ways, tries), ways


def test_a_frontier_is_known_free_and_beside_the_unknown():
    terrain = terrain_of((30, 50))
    expected = np.zeros(GRID.shape, dtype=bool)
    expected[30:50, 39] = True
    np.testing.assert_array_equal(frontier_mask(terrain), expected)


@pytest.mark.parametrize("seed", range(4))
def test_frontier_cells_are_those_of_the_definition(seed):
    rng = np.random.default_rng(seed)
    known, occupied = rng.random((20, 30)) < 0.8, rng.random((20, 30)) < 0.2
    occupied &= known
    mask = frontier_mask(Terrain(Grid(20, 30, 0.1), known, occupied))
    for row in range(20):
        for column in range(30):
            inside = 0 < row < 19 and 0 < column < 29
            beside = inside and not all(known[row + i, column + j] for i, j in ((0, 1), (1, 0), (0, -1), (-1, 0)))
            assert mask[row, column] == (beside and known[row, column] and not occupied[row, column])


@pytest.mark.parametrize("length", [1, 4, 5, 12])
def test_a_gap_shorter_than_half_a_metre_is_no_way_on(length):
    found, _ = found_in(terrain_of((40, 40 + length)))
    assert len(found) == (length * 0.1 >= LEAST_LENGTH)


def test_a_frontier_s_goal_is_the_cheapest_place_near_by_that_sees_its_middle():
    terrain = terrain_of((35, 45))
    (frontier,), ways = found_in(terrain)
    np.testing.assert_array_equal(frontier.cells, [cell(row, 39) for row in range(35, 45)])
    assert frontier.middle in (cell(39, 39), cell(40, 39))
    assert frontier.cost == ways.cost[frontier.goal]
    row, column = divmod(frontier.middle, SIDE)
    near = [
        c
        for c in np.flatnonzero(ways.reached)
        if math.hypot(c // SIDE - row, c % SIDE - column) <= LOOK_FROM / 0.1 + 1e-9
        and in_sight(terrain.occupied, int(c), frontier.middle)
    ]
    assert frontier.goal in near
    assert frontier.cost == pytest.approx(min(ways.cost[near]))


def test_a_place_behind_a_wall_is_none_to_look_from():
    """A screen stands before the opening: without it the robot would look from where it hides the middle."""
    screen = (slice(28, 52), 34)
    free, hidden = terrain_of((35, 45)), terrain_of((35, 45), screen)
    (plain,), ways = found_in(free, (40, 30))
    assert not in_sight(hidden.occupied, plain.goal, plain.middle) or plain.goal % SIDE > 34
    seen, _ = found_in(hidden, (40, 20))
    for frontier in seen:
        assert in_sight(hidden.occupied, frontier.goal, frontier.middle)
    cost = np.where(np.arange(SIDE * SIDE) % SIDE < 34, 1.0, 2.0)  # cheaper where the screen hides it
    reached = np.ones(GRID.shape, dtype=bool)
    assert look_from(reached, cost, hidden.occupied, plain.middle, 10.0, False) % SIDE >= 34
    assert look_from(reached, cost, free.occupied, plain.middle, 10.0, False) % SIDE < 34
    assert ways.cost[plain.goal] < 1.5


def test_a_place_that_is_too_far_away_is_none_to_look_from():
    reached, cost = np.zeros(GRID.shape, dtype=bool), np.ones(GRID.cells)
    reached[40, 20] = True
    assert look_from(reached, cost, NONE, cell(40, 30), 10.0, False) == cell(40, 20)
    assert look_from(reached, cost, NONE, cell(40, 31), 10.0, False) == -1
    assert look_from(reached, cost, NONE, cell(48, 27), 10.0, False) == -1
    assert look_from(reached, cost, NONE, cell(46, 28), 10.0, False) == cell(40, 20)


def test_what_no_place_near_by_is_reached_of_is_not_offered():
    """The opening lies behind a wall with no way around."""
    walled = terrain_of((35, 45), (slice(None), 25))
    assert frontier_mask(walled).any()
    assert found_in(walled)[0] == []


def test_a_long_frontier_is_looked_at_in_pieces():
    """Every cell is in one piece, and the cells of each are near to one of them."""
    terrain = terrain_of((5, 75))
    found, _ = found_in(terrain)
    together = np.concatenate([frontier.cells for frontier in found])
    np.testing.assert_array_equal(np.sort(together), np.flatnonzero(frontier_mask(terrain)))
    assert len(np.unique(together)) == len(together)
    assert len(found) > 3
    for frontier in found:
        assert np.ptp(frontier.cells // SIDE) * 0.1 <= PIECE_RADIUS + 1e-9
        centres = GRID.centres(frontier.cells)
        away = np.hypot(*(centres - centres.mean(axis=0)).T)
        assert away[list(frontier.cells).index(frontier.middle)] == pytest.approx(away.min())
    assert [frontier.middle for frontier in found] == sorted(frontier.middle for frontier in found)


def test_two_clusters_are_two_frontiers_even_where_they_are_near():
    terrain = terrain_of(None)
    terrain.occupied[30:38, 39] = terrain.occupied[40:48, 39] = False
    found, _ = found_in(Terrain(GRID, terrain.known, terrain.occupied))
    assert sorted(len(frontier.cells) for frontier in found) == [8, 8]


def test_what_was_looked_at_in_vain_often_enough_is_no_frontier():
    terrain = terrain_of((30, 50))
    tries = np.zeros(GRID.shape, dtype=np.uint8)
    tries[30:44, 39] = MOST_TRIES
    (frontier,), _ = found_in(terrain, tries=tries)
    np.testing.assert_array_equal(frontier.cells, [cell(row, 39) for row in range(44, 50)])
    tries[30:47, 39] = MOST_TRIES
    assert found_in(terrain, tries=tries)[0] == [], "what is left is too short"
    tries[30:50, 39] = MOST_TRIES - 1
    assert sum(len(frontier.cells) for frontier in found_in(terrain, tries=tries)[0]) == 20


def test_the_second_look_is_from_the_nearest_place():
    """The first from the cheapest: a frontier that was looked at in vain is looked at from elsewhere."""
    terrain = terrain_of((33, 47))
    (first,), ways = found_in(terrain)
    tries = np.zeros(GRID.shape, dtype=np.uint8)
    tries[first.cells[3] // SIDE, 39] = 1
    (second,), _ = found_in(terrain, tries=tries)
    assert second.middle == first.middle
    assert second.cost == ways.cost[second.goal] > first.cost
    row, column = divmod(first.middle, SIDE)
    reached = np.argwhere(ways.reached) - (row, column)
    assert math.hypot(second.goal // SIDE - row, second.goal % SIDE - column) == np.hypot(*reached.T).min()


def test_the_nearest_place_has_to_see_the_middle_too():
    """A screen hides it from what is nearest; a place 0.7 m aside sees it."""
    blocked = np.zeros(GRID.shape, dtype=bool)
    blocked[38:43, 37] = True
    reached = np.zeros(GRID.shape, dtype=bool)
    reached[40, 36] = reached[47, 40] = True
    cost = np.ones(GRID.cells)
    assert look_from(reached, cost, NONE, cell(40, 40), 10.0, True) == cell(40, 36)
    assert look_from(reached, cost, blocked, cell(40, 40), 10.0, True) == cell(47, 40)
    assert look_from(reached, cost, blocked, cell(40, 40), 6.0, True) == -1
