"""Where the robot may drive on its map, and how far everything is: clearances, and the cheapest ways from its place."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid
from explore_bench.geometry.rays import clearance_of
from explore_bench.robot.planning.shortest_paths import SQRT2, trace_path

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
def spread(free: NDArray[np.bool_], price: Array, start: int) -> tuple[Array, NDArray[np.int64]]:
    """Cost and parent of every cell, shape (rows · columns,), of the cheapest ways from the start; none cuts a corner.

    A step costs its length in cells times the mean price of its two cells, arrays of shape (rows, columns). The search
    is Dijkstra's with a ring of buckets for a queue, each as wide as the cheapest step: of the cells in one bucket none
    can make another cheaper, so they may come in any order.
    """
    rows, columns = free.shape
    wide = columns + 2
    # half the price of each cell; those that may not be entered, as all around, are too dear
    half = np.full((rows + 2) * wide, np.inf)
    cheapest, dearest = np.inf, 0.0
    for row in range(rows):
        for column in range(columns):
            cheapest, dearest = min(cheapest, price[row, column]), max(dearest, price[row, column])
            if free[row, column] or row * columns + column == start:
                half[(row + 1) * wide + column + 1] = 0.5 * price[row, column]
    steps = np.array([-wide - 1, -wide, -wide + 1, -1, 1, wide - 1, wide, wide + 1])
    cost = np.full(half.shape[0], np.inf)
    parent = np.full(half.shape[0], -1, dtype=np.int32)
    closed = np.zeros(half.shape[0], dtype=np.bool_)
    # buckets are chains of entries: the first of each, and after each entry the next
    buckets_per_cost = 1.0 / cheapest
    ring = int(SQRT2 * dearest * buckets_per_cost) + 2
    first = np.full(ring, -1, dtype=np.int32)
    following = np.empty(8 * free.size + 1, dtype=np.int32)
    held = np.empty(8 * free.size + 1, dtype=np.int32)
    begin = (start // columns + 1) * wide + start % columns + 1
    cost[begin] = 0.0
    held[0], following[0], first[0] = begin, -1, 0
    entries, waiting, bucket, place = 1, 1, 0, 0
    while waiting > 0:
        while first[place] < 0:
            bucket, place = bucket + 1, (place + 1 if place + 1 < ring else 0)
        entry = first[place]
        first[place] = following[entry]
        waiting -= 1
        cell = held[entry]
        if closed[cell]:
            continue
        closed[cell] = True
        for k in range(8):
            neighbour = cell + steps[k]
            diagonal = k == 0 or k == 2 or k == 5 or k == 7
            through = cost[cell] + (SQRT2 if diagonal else 1.0) * (half[cell] + half[neighbour])
            if not through < cost[neighbour] - 1e-12:
                continue
            beside = -wide if k < 3 else wide
            if diagonal and half[cell + beside] + half[neighbour - beside] == np.inf:
                continue
            cost[neighbour] = through
            parent[neighbour] = cell
            to = place + int(through * buckets_per_cost) - bucket
            to = to - ring if to >= ring else to
            held[entries], following[entries], first[to] = neighbour, first[to], entries
            entries += 1
            waiting += 1
    costs, parents = np.empty(free.size), np.empty(free.size, dtype=np.int64)
    for row in range(rows):
        for column in range(columns):
            cell, at = row * columns + column, (row + 1) * wide + column + 1
            costs[cell] = cost[at]
            parents[cell] = (parent[at] // wide - 1) * columns + parent[at] % wide - 1 if parent[at] >= 0 else -1
    return costs, parents


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
