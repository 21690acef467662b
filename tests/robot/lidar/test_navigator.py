"""The fine planner of a trial: what it offers, what it withholds and when that comes back, and closed routes."""

import itertools
import math

import numpy as np
import pytest
from lidar_worlds import SMALL, begin, cluttered, ranges_at

from explore_bench.robot.lidar.frontiers import MOST_TRIES, frontiers
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.robot.lidar.navigator import (
    LAST_MARGIN,
    MARGINS,
    RELEASES,
    Navigator,
    along,
    seconds_for,
)
from explore_bench.strategies.contract import Observation
from explore_bench.world.lidar.constants import LidarScenario

SCENARIO = LidarScenario(size=8.0)
START = (2.05, 4.05, 0.0)


def map_of(*openings, known=40, walls=()):
    """A known room up to a column, whose right wall is open between pairs of rows; all else is unknown."""
    found = GridMap(SCENARIO)
    found.passes[:, :known] = 4
    for edge in (found.hits[0], found.hits[-1], found.hits[:, 0], found.hits[:, known - 1]):
        edge[:] = 4
    for low, high in openings:
        found.hits[low:high, known - 1] = 0
    for rows, columns in walls:
        found.hits[rows, columns] = 4
    np.minimum(found.hits, found.passes, out=found.hits)
    return found


def navigator_of(*openings, scenario=SCENARIO, **options):
    return Navigator(scenario, map_of(*openings, **options))


def test_every_frontier_is_a_candidate_of_the_decision_cell_in_which_its_middle_lies():
    offer = navigator_of((8, 16), (34, 44), (60, 70)).offer(START)
    assert offer.cells.tolist() == [1, 5, 13]  # column 1 of 4; rows at 1.2, 3.9 and 6.5 m
    np.testing.assert_allclose(offer.positions[:, 0], 3.95)
    np.testing.assert_allclose(offer.positions[:, 1], (1.2, 3.9, 6.5), atol=0.06)
    for frontier, route, length in zip(offer.frontiers, offer.routes, offer.lengths, strict=True):
        assert route[0] == offer.roads.start == SCENARIO.map_grid.cell_of(*START[:2])
        assert route[-1] == frontier.goal
        steps = np.hypot(*np.diff(SCENARIO.map_grid.centres(route), axis=0).T)
        assert steps.max() <= math.sqrt(2.0) * 0.1 + 1e-9
        assert length == pytest.approx(steps.sum())


def test_of_two_frontiers_in_one_decision_cell_the_cheaper_one_is_offered():
    navigator = navigator_of((21, 27), (32, 38))
    upper = navigator.offer((2.05, 3.55, 0.0))
    lower = navigator.offer((2.05, 2.05, 0.0))
    assert upper.cells.tolist() == lower.cells.tolist() == [5]
    assert upper.positions[0, 1] == pytest.approx(3.5, abs=0.06)
    assert lower.positions[0, 1] == pytest.approx(2.4, abs=0.06)


def test_the_nearest_candidates_are_offered_where_there_are_more_than_asked_for():
    openings = (8, 16), (34, 44), (60, 70)
    navigator = navigator_of(*openings, scenario=SCENARIO.replace(candidates_per_robot=2))
    assert navigator.offer((2.05, 6.05, 0.0)).cells.tolist() == [5, 13]
    assert navigator.offer((2.05, 2.05, 0.0)).cells.tolist() == [1, 5]


def played_offers(scenario, count, trial=0, world=None):
    """Observations of the first decisions of a trial, each for the nearest."""
    events, choice, found = begin(scenario, trial, world), None, []
    while len(found) < count:
        try:
            event = events.send(choice)
        except StopIteration:
            break
        choice = None
        if isinstance(event, Observation):
            found.append(event)
            choice = int(event.path_lengths.argmin())
    return found


@pytest.mark.parametrize("trial", range(3))
def test_what_is_offered_in_a_drawn_world_keeps_the_contract(trial):
    scenario = SMALL.replace(size=10.0)
    for observation in played_offers(scenario, 8, trial):
        cells = observation.candidates
        assert (np.diff(cells) > 0).all(), "ascending, each once"
        grid = scenario.grid
        own = grid.cell_of(*observation.pose[:2])
        assert [grid.cell_of(*place) for place in observation.positions] == cells.tolist()
        for cell, path in zip(cells, observation.paths, strict=True):
            assert path[0] == own
            assert path[-1] == cell
            for one, other in itertools.pairwise(path.tolist()):
                assert one != other
        for array in (cells, observation.positions, observation.path_lengths, *observation.paths):
            assert not array.flags.writeable


@pytest.mark.parametrize("most", [1, 3])
def test_no_more_candidates_than_asked_for_are_offered_and_those_are_the_nearest(most):
    world = cluttered(10.0, 12, 3, clear=[(1.0, 1.0)])
    scenario = SMALL.replace(size=10.0)
    (every,) = played_offers(scenario, 1, world=world)
    (few,) = played_offers(scenario.replace(candidates_per_robot=most), 1, world=world)
    assert len(every.candidates) > most
    assert len(few.candidates) == most
    assert set(few.candidates) <= set(every.candidates)
    chosen = np.isin(every.candidates, few.candidates)
    assert every.path_lengths[chosen].max() <= every.path_lengths[~chosen].min() + 0.3  # by cost, which walls add to


def withhold(navigator, frontier):
    for _ in range(MOST_TRIES):
        navigator.note_in_vain(frontier)


def test_a_frontier_is_looked_at_in_vain_twice_and_then_withheld_and_the_others_are_not():
    navigator = navigator_of((8, 16), (60, 70))
    lower, upper = navigator.offer(START).frontiers
    navigator.note_in_vain(lower)
    again, other = navigator.offer(START).frontiers
    assert again.middle == lower.middle
    assert again.goal != lower.goal, "from another place"
    assert other.goal == upper.goal
    navigator.note_in_vain(again)
    (left,) = navigator.offer(START).frontiers
    assert left.middle == upper.middle


def test_around_a_withheld_frontier_its_neighbourhood_is_withheld_too():
    """When a look moves the frontier by a cell or two it is still the same one; farther away it is another."""
    found = map_of((8, 16), (40, 52))
    navigator = Navigator(SCENARIO, found)
    _, upper = navigator.offer(START).frontiers
    withhold(navigator, upper)
    for column, offered in ((39, 1), (40, 1), (41, 1), (42, 2)):
        found.passes[40:52, column] = 1
        found.hits[[39, 52], column] = found.passes[[39, 52], column] = 4
        navigator.look()
        assert len(navigator.offer(START).frontiers) == offered, column


def test_only_what_is_near_the_middle_of_a_frontier_is_withheld():
    """Of a long opening, what lies more than a metre from the middle of one piece may be looked at from elsewhere."""
    navigator = navigator_of((20, 60))
    pieces = navigator.offer(START).frontiers
    cells = np.concatenate([piece.cells for piece in pieces])
    first = max(pieces, key=lambda piece: len(piece.cells))
    withhold(navigator, first)
    left = np.concatenate([piece.cells for piece in navigator.offer(START).frontiers])
    gone = np.setdiff1d(cells, left)
    away = np.abs(gone // 80 - first.middle // 80) * 0.1
    assert len(gone) >= 15
    assert away.max() <= 1.0 + 0.2 + 1e-9
    assert np.isin(first.cells[np.abs(first.cells // 80 - first.middle // 80) * 0.1 <= 1.0], gone).all()


def test_withheld_frontiers_come_back_a_few_times_when_nothing_else_is_left():
    navigator = navigator_of((30, 45))
    offers = 0
    while (offer := navigator.offer(START)) is not None:
        offers += 1
        assert offers < 50
        for frontier in offer.frontiers:
            navigator.note_in_vain(frontier)
    assert offers == MOST_TRIES * (1 + RELEASES)
    navigator.release()  # as a loop closure does, without counting
    assert navigator.offer(START) is not None


def test_what_comes_back_is_looked_at_afresh():
    navigator = navigator_of((30, 45))
    (frontier,) = navigator.offer(START).frontiers
    withhold(navigator, frontier)
    (back,) = navigator.offer(START).frontiers
    assert back.goal == frontier.goal


def test_where_nothing_is_withheld_and_nothing_open_there_is_no_offer():
    assert navigator_of().offer(START) is None
    assert navigator_of((30, 50), walls=[(slice(None), 30)]).offer(START) is None


def test_a_strait_that_is_too_narrow_is_taken_when_nothing_else_is_left():
    """Between rows of wall 0.6 m apart the clearance is 0.3 m: a centimetre or eight less than lethal."""
    walls = [(slice(0, 38), 25), (slice(43, 80), 25)]
    assert pytest.approx(0.31) == SCENARIO.lethal_radius
    narrow = navigator_of((35, 45), walls=walls)
    assert not frontiers(narrow.terrain, narrow.ways(START, 0.0), np.zeros((80, 80), dtype=np.uint8))
    offer = narrow.offer(START)
    assert offer is not None
    clearance = narrow.terrain.clearance.reshape(-1)[offer.routes[0][1:]]
    assert SCENARIO.lethal_radius - MARGINS[1] <= clearance.min() < SCENARIO.lethal_radius
    goal = offer.frontiers[0].goal
    assert math.isfinite(narrow.ways(START).cost[goal]), "the way is planned anew with the same margin"
    assert not narrow.blocked(offer.routes[0])
    two_ways = navigator_of((35, 45), (60, 70), walls=[*walls, (slice(55, 75), 25)])
    two_ways._map.hits[55:75, 25] = 0
    two_ways.look()
    wide = two_ways.offer(START)
    assert min(two_ways.terrain.clearance.reshape(-1)[route[1:]].min() for route in wide.routes) >= 0.31


def test_no_margin_lets_the_robot_through_where_it_does_not_fit():
    """Nothing narrower than the robot itself is driven through, unless it has come that way."""
    assert SCENARIO.lethal_radius - max(MARGINS) > SCENARIO.robot_radius
    narrow = navigator_of((35, 45), walls=[(slice(0, 39), 25), (slice(42, 80), 25)])
    assert narrow.offer(START) is None
    assert narrow.offer(START, np.array([(1.0, 1.0), (1.0, 4.0), START[:2]])) is None
    assert narrow.offer(START, np.array([(3.5, 4.05), START[:2]])) is not None


def test_a_robot_that_its_map_closes_in_goes_back_the_way_that_it_came():
    """In an alley of five cells one row is believed occupied: clearance 0.2 m, where 0.23 m are asked for."""
    walls = [(30, slice(10, 40)), (36, slice(10, 40)), (31, slice(16, 26))]
    navigator, pose = Navigator(SCENARIO, map_of((8, 20), walls=walls)), (2.05, 3.45, 0.0)
    assert navigator.ways(pose, MARGINS[-1]).reached.sum() == 1
    assert navigator.offer(pose) is None
    offer = navigator.offer(pose, np.array([(0.5, 1.5), (0.5, 3.45), pose[:2]]))
    assert offer is not None
    assert navigator.margin == LAST_MARGIN
    assert not navigator.blocked(offer.routes[0])
    assert math.isfinite(navigator.ways(pose).cost[offer.frontiers[0].goal])
    assert navigator.offer((1.0, 1.0, 0.0)) is not None
    assert navigator.margin == 0.0, "outside nothing is given up any more"


def test_a_frontier_is_resolved_when_half_of_it_is_one_no_more():
    found = map_of((30, 45))
    navigator = Navigator(SCENARIO, found)
    (frontier,) = navigator.offer(START).frontiers
    assert not navigator.resolved(frontier)
    cells = frontier.cells // 80
    for share, done in ((0.3, False), (0.6, True)):
        beyond = cells[: round(share * len(cells))]
        found.passes[beyond, 40] = 1
        navigator.look()
        assert navigator.resolved(frontier) == done


def test_a_route_is_blocked_when_a_wall_appears_on_it_or_beside_it():
    found = map_of((30, 50))
    navigator = Navigator(SCENARIO, found)
    route = navigator.offer(START).routes[0]
    assert not navigator.blocked(route)
    row, column = divmod(int(route[len(route) // 2]), 80)
    for rows, blocks in ((row + 8, False), (row + 2, True), (row, True)):
        found.hits[rows, column] = 4
        navigator.look()
        assert navigator.blocked(route) == blocks
        found.hits[rows, column] = 0
    found.hits.reshape(-1)[route[0]] = 4
    navigator.look()
    assert not navigator.blocked(route[:1]), "the robot's own cell blocks nothing"


def test_cells_along_a_route_come_once_in_a_row_and_end_in_the_candidate_s():
    grid, decisions = SCENARIO.map_grid, SCENARIO.grid
    row = np.array([5 * 80 + column for column in range(15, 45)])
    assert along(row, 2, grid, decisions).tolist() == [0, 1, 2]
    assert along(row, 6, grid, decisions).tolist() == [0, 1, 2, 6]
    assert along(row[:3], 0, grid, decisions).tolist() == [0]
    assert along(np.concatenate((row, row[::-1])), 0, grid, decisions).tolist() == [0, 1, 2, 1, 0]


def test_a_drive_is_given_up_after_a_time_that_its_length_explains():
    assert seconds_for(0.0) == 30.0
    assert seconds_for(10.0) == 90.0
    assert seconds_for(10.0) > 2.0 * 10.0 / SCENARIO.max_speed


def test_a_look_takes_in_the_map_as_it_is_and_nothing_before_does():
    world = cluttered(8.0, 6, 1, clear=[(4.0, 4.0)])
    found = GridMap(SCENARIO)
    navigator = Navigator(SCENARIO, found)
    assert navigator.offer((4.0, 4.0, 0.0)) is None
    found.insert((4.0, 4.0, 0.0), ranges_at(world, (4.0, 4.0, 0.0), reach=2.5))
    assert not navigator.terrain.known.any()
    navigator.look()
    np.testing.assert_array_equal(navigator.terrain.known, found.known)
    np.testing.assert_array_equal(navigator.terrain.occupied, found.occupied)
    assert navigator.offer((4.0, 4.0, 0.0)) is not None
