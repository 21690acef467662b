"""Shortest paths on a grid of 8 neighbours without corner cutting: a diagonal step needs both cells beside it free.

One search from the robot (Dijkstra) serves every goal: A* would need one each, and a map of 200 m has hundreds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit

SQRT2 = math.sqrt(2.0)

_ROW_STEPS = np.array([-1, 0, 0, 1, -1, -1, 1, 1])
_COLUMN_STEPS = np.array([0, -1, 1, 0, -1, 1, -1, 1])


@jit
def may_step(free: NDArray[np.bool_], row: int, column: int, direction: int, start: int) -> int:
    """Cell reached from (row, column) by one of the 8 directions, or −1 where the step is not allowed."""
    rows, columns = free.shape
    to_row, to_column = row + _ROW_STEPS[direction], column + _COLUMN_STEPS[direction]
    if not (0 <= to_row < rows and 0 <= to_column < columns):
        return -1
    cell = to_row * columns + to_column
    if not (free[to_row, to_column] or cell == start):
        return -1
    if direction >= 4:
        beside, across = row * columns + to_column, to_row * columns + column
        if not (free[row, to_column] or beside == start) or not (free[to_row, column] or across == start):
            return -1
    return cell


@jit
def trace_path(parent: NDArray[np.int64], goal: int) -> NDArray[np.int64]:
    """Cells from the start of a search to a cell that it reached, shape (P,)."""
    length = 1
    cell = goal
    while parent[cell] >= 0:
        cell = parent[cell]
        length += 1
    path = np.empty(length, dtype=np.int64)
    cell = goal
    for k in range(length - 1, -1, -1):
        path[k] = cell
        cell = parent[cell]
    return path


@jit
def search_grid(free: NDArray[np.bool_], start: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Cost [cell edges] of the shortest path from a start to every cell, and its parent, shape (rows · columns,).

    `free`, shape (rows, columns), says which cells may be driven through; the start's own never blocks. A cell that
    cannot be reached has an infinite cost; the start has no parent (−1). Ties are broken by cell index, so equal grids
    give equal paths.
    """
    columns, cells = free.shape[1], free.size
    cost = np.full(cells, np.inf)
    parent = np.full(cells, -1, dtype=np.int64)
    closed = np.zeros(cells, dtype=np.bool_)
    heap_key = np.empty(8 * cells + 1)
    heap_cell = np.empty(8 * cells + 1, dtype=np.int64)
    cost[start] = 0.0
    heap_key[0], heap_cell[0] = 0.0, start
    size = 1
    while size > 0:
        cell = heap_cell[0]
        size -= 1
        _sift_down(heap_key, heap_cell, size)
        if closed[cell]:
            continue
        closed[cell] = True
        row, column = cell // columns, cell % columns
        for direction in range(8):
            neighbour = may_step(free, row, column, direction, start)
            if neighbour < 0 or closed[neighbour]:
                continue
            through = cost[cell] + (1.0 if direction < 4 else SQRT2)
            if through < cost[neighbour] - 1e-12:  # not for the rounding of a way of the same length
                cost[neighbour] = through
                parent[neighbour] = cell
                _push(heap_key, heap_cell, size, through, neighbour)
                size += 1
    return cost, parent


@jit
def _before(key: float, cell: int, other_key: float, other_cell: int) -> bool:
    if abs(key - other_key) > 1e-9:  # keys that differ by rounding are equal, and the lower cell comes first
        return key < other_key
    return cell < other_cell


@jit
def _push(heap_key: NDArray[np.float64], heap_cell: NDArray[np.int64], size: int, key: float, cell: int) -> None:
    k = size
    while k > 0:
        up = (k - 1) // 2
        if not _before(key, cell, heap_key[up], heap_cell[up]):
            break
        heap_key[k], heap_cell[k] = heap_key[up], heap_cell[up]
        k = up
    heap_key[k], heap_cell[k] = key, cell


@jit
def _sift_down(heap_key: NDArray[np.float64], heap_cell: NDArray[np.int64], size: int) -> None:
    """Move the heap's last entry, now at `size`, to the root and down to its place."""
    key, cell = heap_key[size], heap_cell[size]
    k = 0
    while 2 * k + 1 < size:
        child = 2 * k + 1
        if child + 1 < size and _before(heap_key[child + 1], heap_cell[child + 1], heap_key[child], heap_cell[child]):
            child += 1
        if not _before(heap_key[child], heap_cell[child], key, cell):
            break
        heap_key[k], heap_cell[k] = heap_key[child], heap_cell[child]
        k = child
    heap_key[k], heap_cell[k] = key, cell
