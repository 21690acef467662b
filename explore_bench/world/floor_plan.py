"""A given map as rows of text: which cells block, where the robot can go, and what counts towards coverage."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

OBSTACLE, FREE, START, UNKNOWN, BLANK = "#.S? "


@dataclass(frozen=True, eq=False)
class FloorPlan:
    """A given map on a square grid; arrays are read-only, of shape (n, n), rows along y.

    Attributes
    ----------
    blocked : obstacles, and cells that the map does not know: neither the robot nor its sensor tells them apart.
    reachable : free cells joined to the start by steps to the four sides; without a start, the largest such region.
    counted : cells that count towards coverage: reachable ones, and obstacles that share a side with one of them. The
        rest (other rooms, the inside of a wall, what the map does not know) shows the robot no side.
    beside_walls : reachable cells that share a side with a blocked cell or with the border of the grid.
    start : cell of the start, None where the map names none.
    """

    blocked: NDArray[np.bool_]
    reachable: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    beside_walls: NDArray[np.bool_]
    start: int | None


@lru_cache(maxsize=64)
def floor_plan(rows: tuple[str, ...]) -> FloorPlan:
    """Floor plan that rows of text draw, the first row the northernmost (largest y).

    `#` is an obstacle, `.` free, `?` or a blank unknown, `S` the free cell of the start. Short rows, and what a square
    lacks above and to the right, are unknown.

    Raises
    ------
    ValueError : for another character, a second start, or no region of at least two free cells; without a full stop.
    """
    cells = _grid(rows)
    starts = np.flatnonzero(cells == START)
    if len(starts) > 1:
        raise ValueError(f"the map has {len(starts)} starts; leave one S")
    free = (cells == FREE) | (cells == START)
    start = int(starts[0]) if len(starts) else None
    reachable = _region(free, start)
    sides = _beside(reachable)
    blocked = ~free
    plan = FloorPlan(
        blocked=blocked,
        reachable=reachable,
        counted=reachable | (sides & (cells == OBSTACLE)),
        beside_walls=reachable & _beside(np.pad(blocked, 1, constant_values=True))[1:-1, 1:-1],
        start=start,
    )
    for array in (plan.blocked, plan.reachable, plan.counted, plan.beside_walls):
        array.setflags(write=False)
    return plan


def edge_of(rows: tuple[str, ...]) -> int:
    """Cells along an edge of the square that holds the rows."""
    return max(len(rows), *(len(row) for row in rows)) if rows else 0


def _grid(rows: tuple[str, ...]) -> NDArray[np.str_]:
    """Characters by cell, shape (n, n), rows along y."""
    for number, row in enumerate(rows, start=1):
        strange = set(row) - {OBSTACLE, FREE, START, UNKNOWN, BLANK}
        if strange:
            raise ValueError(
                f"row {number} of the map holds {min(strange)!r}; draw it with # (obstacle), . (free), ? or a blank "
                "(unknown) and one S (start)"
            )
    n = edge_of(rows)
    cells = np.full((n, n), UNKNOWN)
    for place, row in enumerate(reversed(rows)):
        cells[place, : len(row)] = list(row)
    return cells


def _region(free: NDArray[np.bool_], start: int | None) -> NDArray[np.bool_]:
    """Free cells joined to the start, or the largest region of joined free cells (the first of equals)."""
    from scipy import ndimage

    if not free.any():
        raise ValueError("the map has no free cell; mark some as free, or look at the thresholds with which it is read")
    labels, _ = ndimage.label(free)
    sizes = np.bincount(labels.reshape(-1))
    sizes[0] = 0
    label = int(sizes.argmax()) if start is None else labels.reshape(-1)[start]
    if sizes[label] < 2:
        where = "no two free cells of the map share a side" if start is None else "no free cell joins the map's start"
        raise ValueError(f"{where}; there is nothing to explore, so open some, or take a finer cell size")
    return np.asarray(labels == label)


def _beside(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells that share a side with one of these."""
    beside = np.zeros_like(cells)
    beside[1:] |= cells[:-1]
    beside[:-1] |= cells[1:]
    beside[:, 1:] |= cells[:, :-1]
    beside[:, :-1] |= cells[:, 1:]
    return beside
