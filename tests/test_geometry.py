"""SE(2) arithmetic and the grid: inverse properties, hand-worked values, brute force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from explore_bench.geometry import (
    Grid,
    between,
    cell_of,
    cells_of,
    centre_of,
    compose,
    distance_to_segment,
    place_of,
    room_within,
    wrap_angle,
)

metres = st.floats(-100.0, 100.0)
angles = st.floats(-10.0, 10.0)
poses = st.tuples(metres, metres, angles)
sides = st.integers(1, 25)
cell_sizes = st.sampled_from([0.25, 0.5, 1.0, 2.0, 4.0])
quarters = st.integers(-400, 400).map(lambda k: k / 4.0)
grids = st.builds(Grid, sides, sides, cell_sizes, quarters, quarters)
"""Of any shape and anywhere; all their numbers are dyadic, so that their edges and centres are exact."""


def assert_same_pose(pose, expected, tolerance=1e-9):
    assert pose[:2] == pytest.approx(expected[:2], abs=tolerance)
    assert math.remainder(pose[2] - expected[2], math.tau) == pytest.approx(0.0, abs=tolerance)


def test_compose_worked_by_hand():
    assert_same_pose(compose((1.0, 2.0, math.pi / 2), (3.0, 1.0, math.pi)), (0.0, 5.0, -math.pi / 2))


def test_between_worked_by_hand():
    assert_same_pose(between((1.0, 2.0, math.pi / 2), (0.0, 5.0, math.pi)), (3.0, 1.0, math.pi / 2))


@given(poses, poses)
def test_between_undoes_compose(pose, delta):
    assert_same_pose(between(pose, compose(pose, delta)), delta)


@given(poses, poses)
def test_compose_undoes_between(origin, pose):
    assert_same_pose(compose(origin, between(origin, pose)), pose)


@given(poses, poses, poses)
def test_compose_is_associative(a, b, c):
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)))


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_lie_in_the_half_open_turn_and_point_the_same_way(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.remainder(wrapped - angle, math.tau) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, -3 * math.pi, np.nextafter(-math.pi, -4.0)])
def test_half_a_turn_either_way_wraps_to_plus_pi(angle):
    assert wrap_angle(float(angle)) == pytest.approx(math.pi, abs=1e-12)


# Grids


@given(grids, st.data())
def test_a_cell_holds_its_own_centre(grid, data):
    cell = data.draw(st.integers(0, grid.cells - 1))
    centre = centre_of(grid, cell)
    assert cell_of(grid, *centre) == cell
    assert place_of(grid, *centre) == (cell % grid.columns, cell // grid.columns)
    assert grid.holds(*centre)
    assert grid.centre_of(cell) == centre
    assert grid.cell_of(*centre) == cell


def test_cells_run_along_x_first_and_their_lower_edges_belong_to_them():
    grid = Grid(10, 10, 2.0)
    assert cell_of(grid, 0.0, 0.0) == 0
    assert cell_of(grid, 1.999, 0.0) == 0
    assert cell_of(grid, 2.0, 0.0) == 1
    assert cell_of(grid, 0.0, 2.0) == 10
    assert centre_of(grid, 23) == (7.0, 5.0)


def test_a_grid_of_three_rows_and_five_columns_worked_by_hand():
    """Its least corner lies at (−1, 4), cells are half a metre wide: it ends at (1.5, 5.5)."""
    grid = Grid(3, 5, 0.5, -1.0, 4.0)
    assert grid.shape == (3, 5)
    assert grid.cells == 15
    assert centre_of(grid, 0) == (-0.75, 4.25)
    assert centre_of(grid, 4) == (1.25, 4.25)
    assert centre_of(grid, 5) == (-0.75, 4.75)
    assert centre_of(grid, 14) == (1.25, 5.25)
    assert cell_of(grid, 0.0, 5.0) == 12
    assert cell_of(grid, 9.0, 9.0) == 14


@given(grids, metres, metres)
def test_a_point_outside_goes_to_the_nearest_cell(grid, x, y):
    """The nearest cell is the one whose square is at the least distance from the point."""
    cell = cell_of(grid, x, y)
    left, low = (np.arange(count) * grid.resolution for count in (grid.columns, grid.rows))
    off_x = np.maximum(np.maximum(left - (x - grid.x0), (x - grid.x0) - left - grid.resolution), 0.0)
    off_y = np.maximum(np.maximum(low - (y - grid.y0), (y - grid.y0) - low - grid.resolution), 0.0)
    assert off_x[cell % grid.columns] == off_x.min()
    assert off_y[cell // grid.columns] == off_y.min()


def test_points_beyond_each_corner_are_clamped():
    grid = Grid(10, 10, 2.0)
    assert cell_of(grid, -5.0, 100.0) == 90
    assert cell_of(grid, 100.0, -5.0) == 9
    assert cell_of(grid, 20.0, 20.0) == 99
    assert cell_of(grid, -0.001, -0.001) == 0


@pytest.mark.parametrize(
    ("point", "place"),
    [
        ((-1.0, 4.0), (0, 0)),
        ((-1.01, 4.0), (-1, 0)),
        ((-1.0, 3.4), (0, -2)),
        ((1.5, 4.9), (5, 1)),
        ((9.0, 9.0), (20, 10)),
    ],
)
def test_the_place_of_a_point_off_the_grid_is_off_it_too(point, place):
    assert place_of(Grid(3, 5, 0.5, -1.0, 4.0), *point) == place


def test_a_grid_holds_the_points_up_to_its_edges():
    grid = Grid(3, 5, 0.5, -1.0, 4.0)
    assert all(grid.holds(x, y) for x in (-1.0, 0.3, 1.5) for y in (4.0, 4.7, 5.5))
    assert not any(grid.holds(x, 5.0) for x in (-1.001, 1.501, float("nan")))
    assert not any(grid.holds(0.0, y) for y in (3.999, 5.501, float("inf")))


def test_many_centres_are_the_centres_of_each():
    grid = Grid(7, 7, 0.5)
    indices = np.arange(49).reshape(7, 7)
    expected = [[centre_of(grid, int(cell)) for cell in row] for row in indices]
    assert grid.centres(indices).shape == (7, 7, 2)
    assert np.array_equal(grid.centres(indices), expected)


@given(grids)
def test_without_cells_the_centres_are_those_of_all(grid):
    assert np.array_equal(grid.centres(), [centre_of(grid, cell) for cell in range(grid.cells)])
    assert np.array_equal(cells_of(grid, grid.centres()), np.arange(grid.cells))


@given(grids, st.lists(poses, max_size=9))
def test_the_cells_of_many_points_are_the_cell_of_each(grid, points):
    """Of poses the first two columns are taken."""
    rows = np.array(points).reshape(-1, 3)
    expected = [cell_of(grid, x, y) for x, y, _ in points]
    assert cells_of(grid, rows).tolist() == cells_of(grid, rows[:, :2]).tolist() == expected


points = st.lists(st.tuples(quarters, quarters), max_size=4).map(lambda rows: np.array(rows).reshape(-1, 2))


@given(grids, points, st.integers(0, 80).map(lambda k: k / 4.0))
def test_cells_in_reach_are_those_that_brute_force_finds(grid, points, reach):
    """All numbers are dyadic, so that centres exactly at the reach are judged without rounding."""
    found = grid.in_reach(points, reach)
    offsets = grid.centres() - points[:, None]
    assert found.shape == (len(points), grid.cells)
    assert np.array_equal(found, (offsets**2).sum(axis=2) <= reach**2)


@given(sides, sides, st.floats(0.1, 5.0), metres, metres, metres, metres, st.floats(0.0, 20.0))
def test_cells_in_reach_of_any_numbers_but_for_rounding(rows, columns, resolution, x0, y0, x, y, reach):
    grid = Grid(rows, columns, resolution, x0, y0)
    found = grid.in_reach(np.array([[x, y]]), reach)[0]
    distances = np.hypot(*(grid.centres() - (x, y)).T)
    assert found[distances < reach - 1e-9].all()
    assert not found[distances > reach + 1e-9].any()


def test_a_point_amid_the_grid_reaches_a_disc_of_cells():
    """From the centre of cell (1, 2) of 3 × 5 cells, one edge reaches its four neighbours, √2 edges all around."""
    grid = Grid(3, 5, 0.5, -1.0, 4.0)
    middle = np.array([centre_of(grid, 7)])
    assert np.flatnonzero(grid.in_reach(middle, 0.5)[0]).tolist() == [2, 6, 7, 8, 12]
    assert np.flatnonzero(grid.in_reach(middle, 0.71)[0]).tolist() == [1, 2, 3, 6, 7, 8, 11, 12, 13]
    assert np.flatnonzero(grid.in_reach(middle, 0.0)[0]).tolist() == [7]


@pytest.mark.parametrize("reach", [0.3, 0.5, 2.0, 6.2, 15.0])
def test_there_is_room_for_all_that_is_in_reach_wherever_one_stands(reach):
    grid, rng = Grid(40, 50, 0.5, -1.0, 2.0), np.random.default_rng(0)
    places = rng.uniform((-1.0, 2.0), (19.0, 27.0), (200, 2))
    most = grid.in_reach(places, reach).sum(axis=1).max()
    cells, ways = room_within(grid, reach)
    assert most <= len(cells) == len(ways) <= 2000


# Segments


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((2.0, 3.0), 3.0),  # beside the middle
        ((-3.0, 4.0), 5.0),  # before the first end
        ((7.0, -4.0), 5.0),  # beyond the second
        ((4.0, 0.0), 0.0),  # at an end
        ((1.0, 0.0), 0.0),  # on it
    ],
)
def test_distance_to_a_segment_worked_by_hand(point, distance):
    assert distance_to_segment(*point, 0.0, 0.0, 4.0, 0.0) == pytest.approx(distance, abs=1e-12)


def test_distance_to_a_slanted_segment_and_to_a_point():
    assert distance_to_segment(0.0, 5.0, 0.0, 0.0, 4.0, 3.0) == pytest.approx(4.0)
    assert distance_to_segment(3.0, 4.0, 0.0, 0.0, 0.0, 0.0) == pytest.approx(5.0)


@settings(max_examples=50)
@given(*[st.floats(-10.0, 10.0)] * 6)
def test_distance_to_a_segment_is_the_least_to_its_points(x, y, x0, y0, x1, y1):
    t = np.linspace(0.0, 1.0, 2001)
    sampled = np.hypot(x0 + t * (x1 - x0) - x, y0 + t * (y1 - y0) - y).min()
    spacing = math.hypot(x1 - x0, y1 - y0) / 2000
    distance = distance_to_segment(x, y, x0, y0, x1, y1)
    assert distance <= sampled + 1e-9
    assert distance >= sampled - spacing
