"""Where the robot may drive on its map, and how far everything is: clearances, and the cheapest ways from its place."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid
from explore_bench.robot.planning.astar import SQRT2, trace_path

SOFT_RADIUS = 0.6
"""Clearance [m] from which on a way costs no more than its length."""

SOFT_GAIN = 3.0
"""A way at no clearance would cost this much more than its length; in proportion in between."""


class Terrain:
    """The believed map as far as driving needs it, at one moment.

    Attributes
    ----------
    grid : of the map.
    known, occupied : of its cells, shape (rows, columns).
    clearance : distance of a cell's centre from the nearest occupied one's [m], at most SOFT_RADIUS, same shape.
    """

    def __init__(self, grid: Grid, known: NDArray[np.bool_], occupied: NDArray[np.bool_]) -> None:
        self.grid, self.known, self.occupied = grid, known, occupied
        self.clearance = clearance_of(occupied, grid.resolution, SOFT_RADIUS)

    def free(self, radius: float) -> NDArray[np.bool_]:
        """Known cells with this clearance [m], shape (rows, columns)."""
        return np.asarray(self.known & (self.clearance >= radius))

    def ways(self, start: int, radius: float) -> Ways:
        """Cheapest ways from a cell through those with this clearance [m]."""
        return Ways(self, start, self.free(radius))


class Ways:
    """The cheapest way from one cell to every other. The start's own cell never blocks.

    Attributes
    ----------
    free : cells that may be entered, shape (rows, columns).
    start : cell.
    cost : of the way to each cell [m, dearer near walls], infinite where there is none, shape (rows · columns,).
    """

    def __init__(self, terrain: Terrain, start: int, free: NDArray[np.bool_]) -> None:
        self.start, self.free, self._grid = start, free, terrain.grid
        near = 1.0 - np.minimum(terrain.clearance, SOFT_RADIUS) / SOFT_RADIUS
        self._price = np.asarray(1.0 + SOFT_GAIN * near) * terrain.grid.resolution
        self.cost, self._parent = spread(free, self._price, start)

    def to(self, cell: int) -> NDArray[np.int64]:
        """Cells of the way to a cell that can be reached, the start first, shape (P,)."""
        return trace_path(self._parent, cell)

    @cached_property
    def reached(self) -> NDArray[np.bool_]:
        """Cells that can be reached, shape (rows, columns)."""
        return np.asarray(np.isfinite(self.cost)).reshape(self._grid.shape)


@jit
def clearance_of(occupied: NDArray[np.bool_], resolution: float, most: float) -> Array:
    """Distance from each cell's centre to that of the nearest occupied cell [m], at most `most`, shape as given."""
    rows, columns = occupied.shape
    reach = int(math.ceil(most / resolution))
    squares = np.full((rows, columns), most * most / (resolution * resolution))
    for row in range(rows):
        for column in range(columns):
            if not occupied[row, column]:
                continue
            inside = 0 < row < rows - 1 and 0 < column < columns - 1
            if inside and (
                occupied[row - 1, column]
                and occupied[row + 1, column]
                and occupied[row, column - 1]
                and occupied[row, column + 1]
            ):
                squares[row, column] = 0.0
                continue  # what lies around is nearer to one of these
            for i in range(max(row - reach, 0), min(row + reach + 1, rows)):
                for j in range(max(column - reach, 0), min(column + reach + 1, columns)):
                    square = float((i - row) * (i - row) + (j - column) * (j - column))
                    if square < squares[i, j]:
                        squares[i, j] = square
    return np.sqrt(squares) * resolution


@jit
def spread(free: NDArray[np.bool_], price: Array, start: int) -> tuple[Array, NDArray[np.int64]]:
    """Cost and parent of every cell, shape (rows · columns,), of the cheapest ways from the start; none cuts a corner.

    A step costs its length in cells times the mean price of its two cells, arrays of shape (rows, columns). The search
    is Dijkstra's with a ring of buckets for a queue, each as wide as the cheapest step: of the cells in one bucket none
    can make another cheaper, so they may come in any order.
    """
    rows, columns = free.shape
    cells = free.size
    prices = price.reshape(-1)
    width = prices.min()
    ring = int(SQRT2 * prices.max() / width) + 2
    cost = np.full(cells, np.inf)
    parent = np.full(cells, -1, dtype=np.int64)
    closed = np.zeros(cells, dtype=np.bool_)
    # buckets are chains of entries: the first of each, and after each entry the next
    first = np.full(ring, -1, dtype=np.int64)
    following = np.empty(8 * cells + 1, dtype=np.int64)
    held = np.empty(8 * cells + 1, dtype=np.int64)
    cost[start] = 0.0
    held[0], following[0], first[0] = start, -1, 0
    entries, waiting, bucket = 1, 1, 0
    while waiting > 0:
        while first[bucket % ring] < 0:
            bucket += 1
        entry = first[bucket % ring]
        first[bucket % ring] = following[entry]
        waiting -= 1
        cell = held[entry]
        if closed[cell]:
            continue
        closed[cell] = True
        row, column = cell // columns, cell % columns
        for i in range(-1, 2):
            if not 0 <= row + i < rows:
                continue
            for j in range(-1, 2):
                if not 0 <= column + j < columns or not free[row + i, column + j]:
                    continue
                neighbour = cell + i * columns + j
                if closed[neighbour] or (i != 0 and j != 0 and not (free[row + i, column] and free[row, column + j])):
                    continue
                length = SQRT2 if i != 0 and j != 0 else 1.0
                through = cost[cell] + 0.5 * length * (prices[cell] + prices[neighbour])
                if through < cost[neighbour] - 1e-12:
                    cost[neighbour] = through
                    parent[neighbour] = cell
                    place = int(through / width) % ring
                    held[entries], following[entries], first[place] = neighbour, first[place], entries
                    entries += 1
                    waiting += 1
    return cost, parent


@jit
def length_of(path: NDArray[np.int64], columns: int, resolution: float) -> float:
    """Length of a path of cells [m]."""
    total = 0.0
    for k in range(1, path.shape[0]):
        one, other = path[k - 1], path[k]
        diagonal = one // columns != other // columns and one % columns != other % columns
        total += SQRT2 if diagonal else 1.0
    return total * resolution


@jit
def in_sight(blocked: NDArray[np.bool_], one: int, other: int) -> bool:
    """Whether no blocked cell, shape (rows, columns), lies on the straight line between two cells' centres."""
    columns = blocked.shape[1]
    row, column = one // columns, one % columns
    rise, run = other // columns - row, other % columns - column
    steps = 2 * max(abs(rise), abs(run))
    for k in range(1, steps):
        share = k / steps
        if blocked[int(math.floor(row + share * rise + 0.5)), int(math.floor(column + share * run + 0.5))]:
            return False
    return True
