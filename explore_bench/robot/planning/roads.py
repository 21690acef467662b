"""Where the robot could drive from where it is, beyond the candidates: computed when a strategy asks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Array, Grid
from explore_bench.robot.planning.shortest_paths import search_grid, trace_path


class Reachable(NamedTuple):
    """Cells that can be reached, and how far each is.

    Attributes
    ----------
    cells : ascending, without the robot's own, shape (R,).
    lengths : length of the drive to each [m], shape (R,).
    """

    cells: NDArray[np.int64]
    lengths: Array


@dataclass(frozen=True, eq=False)
class Roads:
    """The cells that the robot drives through, and where it is.

    Drives are 8-connected and cut no corner; where they go straight to their end, whatever lies between, `origin` is
    set.

    Attributes
    ----------
    grid : of the cells.
    free : cells that may be driven through, shape (rows, columns), read-only: those from which the candidates' paths
        were made.
    start : the robot's own cell, which never blocks.
    origin : place from which straight drives begin [m]; None where drives follow the cells.
    """

    grid: Grid
    free: NDArray[np.bool_]
    start: int
    origin: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        self.free.setflags(write=False)

    @cached_property
    def _searched(self) -> tuple[Array, NDArray[np.int64]]:
        """Length [m] of the drive to every cell, and the cell before it, shape (rows · columns,) each."""
        if self.origin is None:
            cost, before = search_grid(self.free, self.start)
            lengths = cost * self.grid.resolution
        else:
            lengths = np.hypot(*(self.grid.centres() - self.origin).T)
            lengths[~self.free.reshape(-1)] = np.inf
            lengths[self.start] = 0.0
            before = np.where(np.isfinite(lengths), self.start, -1)
            before[self.start] = -1
        lengths.setflags(write=False)
        before.setflags(write=False)
        return lengths, before

    @cached_property
    def reachable(self) -> Reachable:
        """All cells that can be reached, the robot's own aside."""
        cells = np.flatnonzero(np.isfinite(self._searched[0]))
        cells = cells[cells != self.start]
        lengths = self._searched[0][cells]
        cells.setflags(write=False)
        lengths.setflags(write=False)
        return Reachable(cells, lengths)

    def path_to(self, cell: int) -> NDArray[np.int64]:
        """Cells of the shortest drive from the robot's own to another, shape (P,); none where it cannot be reached.

        Raises
        ------
        ValueError : for a cell that is not on the grid.
        """
        if not 0 <= cell < self.grid.cells:
            raise ValueError(f"cell {cell} is not on the grid; its cells are 0 to {self.grid.cells - 1}")
        lengths, before = self._searched
        return trace_path(before, cell) if np.isfinite(lengths[cell]) else np.empty(0, dtype=np.int64)

    def lengths_to(self, cells: NDArray[np.int64]) -> Array:
        """Length of the shortest drive to each of some cells [m], shape as given; infinite where there is none."""
        return self._searched[0][cells]
