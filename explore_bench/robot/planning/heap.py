"""A binary heap of cells in two arrays, for compiled searches. Equal keys come in ascending order of cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit


@jit
def _before(key: float, cell: int, other_key: float, other_cell: int) -> bool:
    if abs(key - other_key) > 1e-9:  # keys that differ by rounding are equal, and the lower cell comes first
        return key < other_key
    return cell < other_cell


@jit
def push(heap_key: NDArray[np.float64], heap_cell: NDArray[np.int64], size: int, key: float, cell: int) -> None:
    """Add a cell with its key to a heap of `size` entries."""
    k = size
    while k > 0:
        up = (k - 1) // 2
        if not _before(key, cell, heap_key[up], heap_cell[up]):
            break
        heap_key[k], heap_cell[k] = heap_key[up], heap_cell[up]
        k = up
    heap_key[k], heap_cell[k] = key, cell


@jit
def sift_down(heap_key: NDArray[np.float64], heap_cell: NDArray[np.int64], size: int) -> None:
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
