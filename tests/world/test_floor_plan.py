"""Given maps from rows of text: what blocks, what can be reached, what counts, and what is refused."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given, strategies as st

from explore_bench.world.floor_plan import edge_of, floor_plan

ROOMS = (
    "?######",
    "?#..#.#",
    "##..#.#",
    "#S..###",
    "#...#.#",
    "###.#.#",
    "#######",
)
"""One room with a start, and two that a wall cuts off."""


def shown(mask):
    """Draw a mask as rows of text, north first."""
    return ["".join("x" if one else "-" for one in row) for row in mask[::-1]]


def around(rows, column, row):
    n = len(rows)
    return [
        (c, r)
        for c, r in ((column - 1, row), (column + 1, row), (column, row - 1), (column, row + 1))
        if 0 <= c < n and 0 <= r < n
    ]


def reached(rows, start):
    """Free cells (column, row), rows as given, joined to one by steps to the four sides: breadth-first search."""
    seen, queue = {start}, deque([start])
    while queue:
        for cell in around(rows, *queue.popleft()):
            if rows[cell[1]][cell[0]] in ".S" and cell not in seen:
                seen.add(cell)
                queue.append(cell)
    return seen


def test_the_masks_of_a_map_worked_out_by_hand():
    site = floor_plan(ROOMS)
    assert shown(site.blocked) == ["xxxxxxx", "xx--x-x", "xx--x-x", "x---xxx", "x---x-x", "xxx-x-x", "xxxxxxx"]
    assert shown(site.reachable) == ["-------", "--xx---", "--xx---", "-xxx---", "-xxx---", "---x---", "-------"]
    assert shown(site.counted) == ["--xx---", "-xxxx--", "-xxxx--", "xxxxx--", "xxxxx--", "-xxxx--", "---x---"]
    assert shown(site.beside_walls) == ["-------", "--xx---", "--xx---", "-x-x---", "-xxx---", "---x---", "-------"]
    assert site.start == 3 * 7 + 1


def test_a_cell_in_the_open_is_not_beside_a_wall_and_the_border_of_the_grid_is_one():
    assert shown(floor_plan(("...", "...", "...")).beside_walls) == ["xxx", "x-x", "xxx"]


def test_without_a_start_the_largest_region_is_reachable_and_the_first_of_equals():
    assert shown(floor_plan(("..#", "###", "...")).reachable) == ["---", "---", "xxx"]
    assert shown(floor_plan(("...", "###", "...")).reachable) == ["---", "---", "xxx"]
    assert floor_plan(("...", "###", "...")).start is None


def test_the_region_of_the_start_is_reachable_though_another_is_larger():
    assert shown(floor_plan(("S.#", "###", "...")).reachable) == ["xx-", "---", "---"]


def test_cells_that_touch_by_a_corner_are_not_joined():
    assert shown(floor_plan(("S.#", ".#.", "#..")).reachable) == ["xx-", "x--", "---"]


def test_what_the_map_does_not_know_blocks_and_does_not_count():
    site = floor_plan(("?..", " ..", "#.#"))
    assert shown(site.blocked) == ["x--", "x--", "x-x"]
    assert shown(site.counted) == ["-xx", "-xx", "xxx"]
    assert shown(site.beside_walls) == ["-xx", "-xx", "-x-"]


def test_a_map_that_is_no_square_is_unknown_above_and_to_the_right():
    assert shown(floor_plan(("...", "..")).blocked) == ["xxx", "---", "--x"]
    assert shown(floor_plan(("..", "..", "#.")).blocked) == ["--x", "--x", "x-x"]
    assert [edge_of(rows) for rows in ((), ("...", ".."), (".", ".", "."))] == [0, 3, 3]


def test_the_arrays_are_read_only_and_one_map_is_worked_out_once():
    site = floor_plan(ROOMS)
    assert floor_plan(tuple(ROOMS)) is site
    for name in ("blocked", "reachable", "counted", "beside_walls"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(site, name)[0, 0] = True


@pytest.mark.parametrize(
    ("rows", "named"),
    [
        ((".x", ".."), r"row 1 of the map holds 'x'.*# \(obstacle\)"),
        (("..", ".\t"), r"row 2 of the map holds '\\t'"),
        (("S.", ".S"), "2 starts; leave one"),
        (("##", "##"), "no free cell"),
        (("??", "  "), "no free cell"),
        ((".#", "#."), "no two free cells"),
        (("S#", "#.", ".."), "no free cell joins the map's start"),
    ],
)
def test_what_is_no_map_is_refused_with_what_is_wrong(rows, named):
    with pytest.raises(ValueError, match=named) as error:
        floor_plan(rows)
    assert "\n" not in str(error.value)


drawings = st.integers(2, 9).flatmap(
    lambda n: st.lists(st.text("#..?", min_size=n, max_size=n), min_size=n, max_size=n).map(tuple)
)


@given(drawings)
def test_the_region_is_that_of_a_search_and_none_is_larger(rows):
    try:
        site = floor_plan(rows)
    except ValueError:
        free = [(c, r) for r, row in enumerate(rows) for c, one in enumerate(row) if one == "."]
        assert all(len(reached(rows, cell)) == 1 for cell in free)
        return
    n = len(rows)
    own = {(int(cell % n), n - 1 - int(cell // n)) for cell in np.flatnonzero(site.reachable)}
    assert reached(rows, next(iter(own))) == own
    free = {(c, r) for r, row in enumerate(rows) for c, one in enumerate(row) if one == "."}
    assert all(len(reached(rows, cell)) <= len(own) for cell in free)
    walls = {cell for one in own for cell in around(rows, *one) if rows[cell[1]][cell[0]] == "#"}
    counted = {(int(cell % n), n - 1 - int(cell // n)) for cell in np.flatnonzero(site.counted)}
    assert counted == own | walls
