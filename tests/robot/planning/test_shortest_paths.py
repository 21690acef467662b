"""Shortest paths against scipy's on the same graph, and the rules of a step."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import sparse
from scipy.sparse import csgraph

from explore_bench.robot.planning.shortest_paths import search_grid, trace_path


@st.composite
def problems(draw):
    """Draw a grid of up to 8 × 8 cells, a start and a goal, both anywhere, blocked cells included."""
    rows, columns = draw(st.integers(1, 8)), draw(st.integers(2, 8))
    free = draw(st.lists(st.integers(0, 3), min_size=rows * columns, max_size=rows * columns))
    cell = st.integers(0, rows * columns - 1)
    return np.array(free).reshape(rows, columns) > 0, draw(cell), draw(cell)


def is_allowed(free, start, cell, to):
    """Rule of a step, written down once more: neighbours, the target free, no corner cut; the start is free."""
    columns = free.shape[1]
    passable = free.copy()
    passable[divmod(start, columns)] = True
    (row, column), (to_row, to_column) = divmod(cell, columns), divmod(to, columns)
    if max(abs(row - to_row), abs(column - to_column)) != 1:
        return False
    return passable[to_row, to_column] and passable[row, to_column] and passable[to_row, column]


def dijkstra(free, start):
    """Length of the shortest path to every cell, in cell edges."""
    rows, columns = free.shape
    graph = sparse.lil_matrix((free.size, free.size))
    for cell in range(free.size):
        row, column = divmod(cell, columns)
        for r in range(max(row - 1, 0), min(row + 2, rows)):
            for c in range(max(column - 1, 0), min(column + 2, columns)):
                if is_allowed(free, start, cell, r * columns + c):
                    graph[cell, r * columns + c] = math.hypot(r - row, c - column)
    return csgraph.dijkstra(graph.tocsr(), indices=start)


def length_of(path, columns):
    up, along = np.divmod(path, columns)
    return np.hypot(np.diff(up), np.diff(along)).sum()


def shortest_path(free, start, goal):
    """Cells of the path to one goal and its length in cell edges; none and infinity where there is no path."""
    cost, parent = search_grid(free, start)
    return (trace_path(parent, goal) if np.isfinite(cost[goal]) else np.empty(0, dtype=np.int64)), cost[goal]


def grid(*rows):
    """Make a grid from rows of text, '.' for free; the first is row 0."""
    return np.array([[sign == "." for sign in row] for row in rows])


@given(problems())
def test_lengths_are_dijkstra_s(problem):
    free, start, goal = problem
    assert shortest_path(free, start, goal)[1] == pytest.approx(dijkstra(free, start)[goal], abs=1e-9)


@given(problems())
def test_paths_lead_from_start_to_goal_by_allowed_steps_of_that_length(problem):
    free, start, goal = problem
    path, length = shortest_path(free, start, goal)
    if math.isinf(length):
        assert path.shape == (0,)
        return
    assert path[0] == start
    assert path[-1] == goal
    assert all(is_allowed(free, start, *step) for step in pairwise(path.tolist()))
    assert length_of(path, free.shape[1]) == pytest.approx(length, abs=1e-9)


@given(problems())
def test_one_search_gives_the_costs_and_paths_of_all_cells(problem):
    free, start, _ = problem
    cost, parent = search_grid(free, start)
    assert cost == pytest.approx(dijkstra(free, start), abs=1e-9)
    assert parent[start] == -1
    for cell in np.flatnonzero(np.isfinite(cost)).tolist():
        path = trace_path(parent, cell)
        assert (path[0], path[-1]) == (start, cell)
        assert all(is_allowed(free, start, *step) for step in pairwise(path.tolist()))
        assert length_of(path, free.shape[1]) == pytest.approx(cost[cell], abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_lengths_on_a_map_of_full_size(seed):
    """30 × 30 cells, 30 % blocked, to each of 40 goals."""
    rng = np.random.default_rng(seed)
    free = rng.random((30, 30)) > 0.3
    expected = dijkstra(free, 31)
    for goal in rng.integers(900, size=40).tolist():
        assert shortest_path(free, 31, goal)[1] == pytest.approx(expected[goal], abs=1e-9)


def test_the_diagonal_of_open_ground():
    path, length = shortest_path(np.ones((4, 4), dtype=bool), 0, 15)
    assert path.tolist() == [0, 5, 10, 15]
    assert length == pytest.approx(3 * math.sqrt(2.0))


def test_corners_are_not_cut():
    path, length = shortest_path(grid("..", "#."), 0, 3)
    assert path.tolist() == [0, 1, 3]
    assert length == 2.0
    path, length = shortest_path(grid(".#", "#."), 0, 3)
    assert path.size == 0
    assert math.isinf(length)


def test_the_start_never_blocks():
    """Neither to leave it nor to pass diagonally beside it."""
    path, length = shortest_path(grid("#.", ".."), 0, 3)
    assert path.tolist() == [0, 3]
    assert length == pytest.approx(math.sqrt(2.0))


def test_the_start_is_a_path_to_itself():
    for free in (grid("..", ".."), grid("##", "##")):
        path, length = shortest_path(free, 2, 2)
        assert path.tolist() == [2]
        assert length == 0.0


@pytest.mark.parametrize("free", [grid("...", "###", "..."), grid("...", "...", "..#")])
def test_an_unreachable_or_blocked_goal_has_no_path_and_infinite_length(free):
    path, length = shortest_path(free, 0, 8)
    assert path.shape == (0,)
    assert path.dtype == np.int64
    assert length == math.inf


def test_a_detour_worked_by_hand():
    """Along row 0, round the wall's end in column 4, and back along row 2; corners are not cut."""
    free = grid(".....", "####.", ".....", "#####", "#####")
    path, length = shortest_path(free, 0, 10)
    assert path.tolist() == [0, 1, 2, 3, 4, 9, 14, 13, 12, 11, 10]
    assert length == 10.0


def test_a_path_on_two_rows_of_five_columns_and_on_five_rows_of_two():
    """Around the same wall, once along x and once along y."""
    path, length = shortest_path(grid("..#..", "....."), 0, 4)
    assert path.tolist() == [0, 6, 7, 8, 4]
    assert length == pytest.approx(2.0 + 2.0 * math.sqrt(2.0))
    path, length = shortest_path(grid("..", "..", "#.", "..", ".."), 0, 8)
    assert path.tolist() == [0, 3, 5, 7, 8]
    assert length == pytest.approx(2.0 + 2.0 * math.sqrt(2.0))


@given(problems())
def test_equal_grids_give_equal_paths(problem):
    free, start, goal = problem
    expected = shortest_path(free, start, goal)[0].tolist()
    assert shortest_path(free.copy(), start, goal)[0].tolist() == expected
    assert shortest_path(np.asfortranarray(free), start, goal)[0].tolist() == expected


@given(problems())
def test_the_grid_is_left_as_it_was(problem):
    free, start, goal = problem
    before = free.copy()
    shortest_path(free, start, goal)
    assert np.array_equal(free, before)
