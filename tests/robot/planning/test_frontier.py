"""Frontier cells on small maps drawn by hand, and against their definition on random ones that are not square."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import ndimage

from explore_bench.robot.planning.frontier import frontier_cells


def frontiers(drawing, start):
    """Frontiers of a drawing ('?' unknown, '.' known and free, '#' known and occupied), through known free cells."""
    signs = np.array([list(row) for row in drawing])
    free = signs == "."
    return frontier_cells(signs != "?", free, free, start).tolist()


@pytest.mark.parametrize(
    ("drawing", "start", "expected"),
    [
        (("....?", "....."), 0, [3, 8, 9]),  # the corner below counts as well
        ((".....", "....."), 0, []),
        (("..#.?",), 0, []),  # nothing leads there
        (("..#.?",), 3, []),  # the start is none itself
        (("?..", "...", "...", "..."), 11, [1, 3, 4]),
        ((".", ".", "?"), 0, [1]),
    ],
)
def test_frontiers_by_hand_on_maps_that_are_wider_or_higher(drawing, start, expected):
    assert frontiers(drawing, start) == expected


@st.composite
def maps(draw):
    """Draw what is known, what is known to be free, what may be driven through, and a start."""
    rows, columns = draw(st.integers(1, 7)), draw(st.integers(1, 7))
    signs = draw(st.lists(st.sampled_from("??....#"), min_size=rows * columns, max_size=rows * columns))
    signs = np.array(signs).reshape(rows, columns)
    free = signs == "." if draw(st.booleans()) else signs != "#"
    return signs != "?", signs == ".", free, draw(st.integers(0, rows * columns - 1))


@given(maps())
def test_frontiers_are_what_the_definition_says(field):
    """Beside the unknown by a dilation, reach by connected components."""
    known, known_free, free, start = field
    passable = free.copy()
    passable.reshape(-1)[start] = True
    rooms = ndimage.label(passable)[0]
    frontier = known_free & ndimage.binary_dilation(~known, np.ones((3, 3))) & (rooms == rooms.reshape(-1)[start])
    frontier.reshape(-1)[start] = False
    assert frontier_cells(known, known_free, free, start).tolist() == np.flatnonzero(frontier).tolist()
