"""SE(2) arithmetic, angles, and grids: the step between cells and metres.

A pose is (x, y, heading) in metres and radians.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from explore_bench.compiled import jit

Array = NDArray[np.float64]
Pose = tuple[float, float, float]

TAU = 2.0 * math.pi


@jit
def wrap_angle(angle: float) -> float:
    """Angle [rad] brought into (−π, π]."""
    wrapped = (angle + math.pi) % TAU - math.pi
    return math.pi if wrapped == -math.pi else wrapped


@jit
def compose(pose: Pose, delta: Pose) -> Pose:
    """Pose reached from `pose` by the motion `delta`, given in the frame of `pose`: pose ⊕ delta."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return (
        pose[0] + c * delta[0] - s * delta[1],
        pose[1] + s * delta[0] + c * delta[1],
        wrap_angle(pose[2] + delta[2]),
    )


@jit
def between(origin: Pose, pose: Pose) -> Pose:
    """Pose `pose` as seen from `origin`: ⊖origin ⊕ pose."""
    c, s = math.cos(origin[2]), math.sin(origin[2])
    dx, dy = pose[0] - origin[0], pose[1] - origin[1]
    return c * dx + s * dy, c * dy - s * dx, wrap_angle(pose[2] - origin[2])


class Grid(NamedTuple):
    """A grid of square cells: the one value by which cells and metres belong together, in compiled code as well.

    A cell is the integer `row * columns + column`, rows running along y. A named tuple, so compiled functions take it.

    Attributes
    ----------
    rows, columns : cells along y and along x.
    resolution : edge of a cell [m].
    x0, y0 : corner of cell 0 that no other cell shares: the grid's least x and y [m].
    """

    rows: int
    columns: int
    resolution: float
    x0: float = 0.0
    y0: float = 0.0

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns), the shape of an array with an entry a cell."""
        return self.rows, self.columns

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.rows * self.columns

    def holds(self, x: float, y: float) -> bool:
        """Whether a point [m] lies on the grid."""
        width, height = self.columns * self.resolution, self.rows * self.resolution
        return bool(0.0 <= x - self.x0 <= width and 0.0 <= y - self.y0 <= height)

    def cell_of(self, x: float, y: float) -> int:
        """Cell that holds a point [m]; see `cell_of`, whose source the interpreter runs sooner than it calls it."""
        return _interpreted_cell_of(self, x, y)

    def centre_of(self, cell: int) -> tuple[float, float]:
        """Centre (x, y) [m] of a cell."""
        return centre_of(self, cell)

    def centres(self, cells: ArrayLike | None = None) -> Array:
        """Centres [m] of many cells, shape (..., 2); of all where none are given, shape (rows · columns, 2)."""
        index = np.arange(self.cells) if cells is None else np.asarray(cells)
        x, y = (index % self.columns + 0.5) * self.resolution, (index // self.columns + 0.5) * self.resolution
        return np.stack((self.x0 + x, self.y0 + y), axis=-1)

    def in_reach(self, points: Array, reach: float) -> NDArray[np.bool_]:
        """Whether each cell's centre lies within `reach` [m] of points, shape (K, 2); gives (K, rows · columns)."""
        if not 0.0 <= reach < math.inf:
            raise ValueError(f"reach is {reach}; give a length in metres")
        return in_reach(self, np.ascontiguousarray(points, dtype=np.float64), min(float(reach), 1e9))


@jit
def place_of(grid: Grid, x: float, y: float) -> tuple[int, int]:
    """(column, row) of a point [m]; those of a point off the grid are off it, too."""
    return int(math.floor((x - grid.x0) / grid.resolution)), int(math.floor((y - grid.y0) / grid.resolution))


@jit
def cell_of(grid: Grid, x: float, y: float) -> int:
    """Cell that holds the point (x, y) [m]; points outside go to the nearest cell."""
    column, row = math.floor((x - grid.x0) / grid.resolution), math.floor((y - grid.y0) / grid.resolution)
    return min(max(int(row), 0), grid.rows - 1) * grid.columns + min(max(int(column), 0), grid.columns - 1)


_interpreted_cell_of: Callable[[Grid, float, float], int] = getattr(cell_of, "py_func", cell_of)


@jit
def cells_of(grid: Grid, points: Array) -> NDArray[np.int64]:
    """Cell of each of the points [m], shape (K, 2) or more columns, of which the first two are taken; shape (K,)."""
    cells = np.empty(points.shape[0], dtype=np.int64)
    for i in range(points.shape[0]):
        cells[i] = cell_of(grid, points[i, 0], points[i, 1])
    return cells


@jit
def centre_of(grid: Grid, cell: int) -> tuple[float, float]:
    """Centre (x, y) [m] of a cell."""
    return (
        grid.x0 + (cell % grid.columns + 0.5) * grid.resolution,
        grid.y0 + (cell // grid.columns + 0.5) * grid.resolution,
    )


@jit
def _span(offset: float, reach: float, count: int, resolution: float) -> tuple[int, int]:
    """First and last row (or column) whose centre can lie within `reach` of an offset from the grid's edge [m]."""
    first = math.ceil((offset - reach) / resolution - 0.5)
    last = math.floor((offset + reach) / resolution - 0.5)
    return max(int(first), 0), min(int(last), count - 1)


@jit
def room_within(grid: Grid, reach: float) -> tuple[NDArray[np.int64], Array]:
    """Room for what `cells_within` finds: cells, shape (K,), and the ways to their centres [m], shape (K, 2)."""
    side = 2.0 * reach / grid.resolution + 2.0
    count = int(min(side, float(grid.rows))) * int(min(side, float(grid.columns)))
    return np.empty(count, dtype=np.int64), np.empty((count, 2))


@jit
def cells_within(grid: Grid, x: float, y: float, reach: float, cells: NDArray[np.int64], ways: Array) -> int:
    """Find the cells whose centre lies within `reach` of the point (x, y) [m], ascending; returns how many there are.

    The only place that says what is in range: sensing, maps, features and predictions all ask here. What is found is
    written into `cells`, and the way from the point to each centre into `ways`, both from `room_within`: hot loops ask
    for thousands of points, and a generator or new arrays would cost as much as what is done with them.
    """
    row0, row1 = _span(y - grid.y0, reach, grid.rows, grid.resolution)
    column0, column1 = _span(x - grid.x0, reach, grid.columns, grid.resolution)
    reach2 = reach * reach
    count = 0
    for row in range(row0, row1 + 1):
        dy = grid.y0 + (row + 0.5) * grid.resolution - y
        for column in range(column0, column1 + 1):
            dx = grid.x0 + (column + 0.5) * grid.resolution - x
            if dx * dx + dy * dy <= reach2:
                cells[count] = row * grid.columns + column
                ways[count, 0], ways[count, 1] = dx, dy
                count += 1
    return count


@jit
def in_reach(grid: Grid, points: Array, reach: float) -> NDArray[np.bool_]:
    """Compiled part of `Grid.in_reach`."""
    view = np.zeros((points.shape[0], grid.rows * grid.columns), dtype=np.bool_)
    cells, ways = room_within(grid, reach)
    for i in range(points.shape[0]):
        for k in range(cells_within(grid, points[i, 0], points[i, 1], reach, cells, ways)):
            view[i, cells[k]] = True
    return view


@jit
def distance_to_segment(x: float, y: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """Distance [m] of the point (x, y) from the segment (x0, y0)–(x1, y1)."""
    dx, dy = x1 - x0, y1 - y0
    length2 = dx * dx + dy * dy
    along = 0.0
    if length2 > 0.0:
        along = min(max(((x - x0) * dx + (y - y0) * dy) / length2, 0.0), 1.0)
    return math.hypot(x - x0 - along * dx, y - y0 - along * dy)
