"""The roads beside the candidates: where the robot could drive, how far, and on which way."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

from explore_bench.geometry import Grid
from explore_bench.robot.planning.roads import Roads
from explore_bench.robot.planning.shortest_paths import search_grid


def roads_of(drawing, start, resolution=2.0):
    """Roads of a drawing, '.' for free; the first line is row 0."""
    free = np.array([[sign == "." for sign in row] for row in drawing])
    return Roads(Grid(*free.shape, resolution), free, start)


@st.composite
def roads(draw):
    """Draw roads of up to 7 × 7 cells, not always square, anywhere; the start may be blocked."""
    rows, columns = draw(st.integers(1, 7)), draw(st.integers(2, 7))
    free = draw(st.lists(st.integers(0, 3), min_size=rows * columns, max_size=rows * columns))
    grid = Grid(rows, columns, draw(st.sampled_from([0.5, 2.0, 3.7])), -7.0, 4.0)
    return Roads(grid, np.array(free).reshape(rows, columns) > 0, draw(st.integers(0, rows * columns - 1)))


@given(roads())
def test_reachable_are_the_cells_to_which_a_shortest_path_leads_with_its_length(one):
    expected = dict(enumerate(search_grid(one.free, one.start)[0].tolist()))
    cells, lengths = one.reachable
    assert cells.tolist() == [cell for cell in expected if cell != one.start and math.isfinite(expected[cell])]
    assert lengths == pytest.approx([one.grid.resolution * expected[cell] for cell in cells.tolist()], rel=1e-12)
    assert one.lengths_to(np.arange(one.grid.cells)).tolist() == [
        one.grid.resolution * length for length in expected.values()
    ]


@given(roads())
def test_a_path_leads_from_the_robot_to_the_cell_over_its_length_and_none_where_it_cannot(one):
    lengths = dict(zip(*(column.tolist() for column in one.reachable), strict=True))
    for cell in range(one.grid.cells):
        path = one.path_to(cell)
        if cell not in lengths and cell != one.start:
            assert path.shape == (0,)
            continue
        assert (path[0], path[-1]) == (one.start, cell)
        assert one.free.reshape(-1)[path[1:]].all()
        centres = one.grid.centres(path)
        steps = [math.dist(a, b) for a, b in pairwise(centres.tolist())]
        assert sum(steps) == pytest.approx(lengths.get(cell, 0.0), abs=1e-9)
        assert all(step < 1.5 * one.grid.resolution for step in steps)


def test_roads_worked_by_hand():
    """Round a wall that no corner is cut of; the room beyond it cannot be reached."""
    one = roads_of((".#.#.", "...#."), 0)
    assert one.reachable.cells.tolist() == [2, 5, 6, 7]
    assert one.reachable.lengths == pytest.approx([8.0, 2.0, 4.0, 6.0])
    assert one.path_to(2).tolist() == [0, 5, 6, 7, 2]
    assert one.path_to(4).shape == (0,)
    assert one.path_to(1).shape == (0,)


def test_the_robot_s_own_cell_is_not_reachable_and_the_way_to_it_is_itself():
    for drawing in (("..", ".."), ("#.", "..")):
        one = roads_of(drawing, 0)
        assert one.reachable.cells.tolist() == [1, 2, 3]
        assert one.path_to(0).tolist() == [0]


def test_a_robot_that_is_walled_in_can_reach_nothing():
    cells, lengths = roads_of((".#", "##"), 0).reachable
    assert cells.shape == lengths.shape == (0,)


def test_the_arrays_are_read_only_and_computed_once():
    one = roads_of(("...", ".#.", "..."), 0)
    for array in (one.free, *one.reachable):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    assert one.reachable is one.reachable


def test_a_path_may_be_changed_without_harm():
    one = roads_of(("...", ".#.", "..."), 0)
    before = one.path_to(8).tolist()
    one.path_to(8)[:] = 0
    assert one.path_to(8).tolist() == before
