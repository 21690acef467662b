"""Frontier cells: known free cells with unknown cells among their 8 neighbours ([11])."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit


@jit
def frontier_cells(
    known: NDArray[np.bool_], free_known: NDArray[np.bool_], free: NDArray[np.bool_], start: int, least: int = 1
) -> NDArray[np.int64]:
    """Frontier cells reachable from `start` through `free`, without the start itself, ascending.

    `least` unknown neighbours make a cell of `free_known` a frontier; the arrays have the shape (rows, columns).
    Without corner cutting the cells reachable by 8-connected paths are those reachable by 4-connected ones.
    """
    rows, columns = known.shape
    reached = np.zeros(rows * columns, dtype=np.bool_)
    stack = np.empty(rows * columns, dtype=np.int64)
    reached[start] = True
    stack[0] = start
    size = 1
    while size > 0:
        size -= 1
        row, column = stack[size] // columns, stack[size] % columns
        for to_row, to_column in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if 0 <= to_row < rows and 0 <= to_column < columns and free[to_row, to_column]:
                cell = to_row * columns + to_column
                if not reached[cell]:
                    reached[cell] = True
                    stack[size] = cell
                    size += 1
    found = np.empty(rows * columns, dtype=np.int64)
    count = 0
    for cell in range(rows * columns):
        row, column = cell // columns, cell % columns
        if cell == start or not reached[cell] or not free_known[row, column]:
            continue
        if unknown_neighbours(known, row, column) >= least:
            found[count] = cell
            count += 1
    return found[:count].copy()


@jit
def unknown_neighbours(known: NDArray[np.bool_], row: int, column: int) -> int:
    """How many of the 8 neighbours of a cell are unknown."""
    count = 0
    for to_row in range(max(row - 1, 0), min(row + 2, known.shape[0])):
        for to_column in range(max(column - 1, 0), min(column + 2, known.shape[1])):
            if not known[to_row, to_column]:
                count += 1
    return count
