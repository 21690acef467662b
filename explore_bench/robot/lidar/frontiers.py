"""Frontiers of the fine map, in pieces that one look can resolve, and the place from which to look at each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.compiled import jit
from explore_bench.geometry import Array
from explore_bench.robot.lidar.terrain import Terrain, Ways, in_sight

LEAST_LENGTH = 0.5
"""A shorter cluster is a gap between beams, not a way on [m]."""

PIECE_RADIUS = 1.5
"""Cells of a cluster this near to one of them make a piece of it [m]."""

LOOK_FROM = 1.0
"""A place to look from lies this near to the middle of a piece [m]."""

MOST_TRIES = 2
"""How often a frontier is looked at in vain before it is withheld."""

_EIGHT = np.ones((3, 3), dtype=bool)


class Frontier(NamedTuple):
    """A piece of a frontier that can be looked at.

    Attributes
    ----------
    cells : of the piece, ascending, shape (K,).
    middle : the one of them nearest to their mean.
    goal : cell to drive to: reached, near the middle, with a free view of it.
    cost : of the way there.
    """

    cells: NDArray[np.int64]
    middle: int
    goal: int
    cost: float


def frontier_mask(terrain: Terrain) -> NDArray[np.bool_]:
    """Known free cells beside an unknown one (4 neighbours), shape (rows, columns)."""
    return frontier_of(terrain.known, terrain.occupied)


@jit
def frontier_of(known: NDArray[np.bool_], occupied: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Compiled part of `frontier_mask`."""
    rows, columns = known.shape
    mask = np.zeros((rows, columns), dtype=np.bool_)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            if known[row, column] and not occupied[row, column]:
                mask[row, column] = not (
                    known[row - 1, column]
                    and known[row + 1, column]
                    and known[row, column - 1]
                    and known[row, column + 1]
                )
    return mask


def frontiers(terrain: Terrain, ways: Ways, tries: NDArray[np.uint8]) -> list[Frontier]:
    """Pieces of the frontiers that can be looked at; by their middles.

    `tries` says how often each cell, shape (rows, columns), was looked at in vain: the first look is from the cheapest
    place, the second from the nearest, since from most places a corner hides the same as before; then it is withheld.
    """
    columns, cell_size = terrain.grid.columns, terrain.grid.resolution
    mask = frontier_mask(terrain) & (tries < MOST_TRIES)
    labels = ndimage.label(mask, structure=_EIGHT)[0].reshape(-1)
    cells = np.flatnonzero(labels)
    cells = cells[np.argsort(labels[cells], kind="stable")]
    piece_of = pieces_of(cells, labels[cells], columns, PIECE_RADIUS / cell_size, LEAST_LENGTH / cell_size)
    found = []
    for number in range(piece_of.max(initial=-1) + 1):
        piece = cells[piece_of == number]
        middle = middle_of(piece, columns)
        again = bool(tries.reshape(-1)[piece].any())
        goal = look_from(ways.reached, ways.cost, terrain.occupied, middle, LOOK_FROM / cell_size, again)
        if goal >= 0:
            found.append(Frontier(piece, middle, goal, float(ways.cost[goal])))
    return sorted(found, key=lambda frontier: frontier.middle)


@jit
def pieces_of(
    cells: NDArray[np.int64], clusters: NDArray[np.int32], columns: int, reach: float, least: float
) -> NDArray[np.int64]:
    """Number of the piece to which each cell belongs, shape (K,); −1 where its cluster has fewer than `least` cells.

    A piece is what lies within `reach` cells of the first cell of a cluster that is left, until none is. Cells come by
    their clusters.
    """
    pieces = np.full(cells.shape[0], -1, dtype=np.int64)
    count = begin = 0
    while begin < cells.shape[0]:
        end = begin
        while end < cells.shape[0] and clusters[end] == clusters[begin]:
            end += 1
        for k in range(begin, end if end - begin >= least else begin):
            if pieces[k] >= 0:
                continue
            for other in range(k, end):
                rise, run = cells[other] // columns - cells[k] // columns, cells[other] % columns - cells[k] % columns
                if pieces[other] < 0 and rise * rise + run * run <= reach * reach:
                    pieces[other] = count
            count += 1
        begin = end
    return pieces


@jit
def middle_of(piece: NDArray[np.int64], columns: int) -> int:
    """The cell of a piece that is nearest to their mean."""
    row, column = (piece // columns).mean(), (piece % columns).mean()
    return piece[((piece // columns - row) ** 2 + (piece % columns - column) ** 2).argmin()]


@jit
def look_from(
    reached: NDArray[np.bool_], cost: Array, occupied: NDArray[np.bool_], middle: int, reach: float, nearest: bool
) -> int:
    """Cell within `reach` cells of another that sees it, the cheapest or the nearest; −1 where there is none."""
    rows, columns = reached.shape
    row, column = middle // columns, middle % columns
    most = int(reach)
    best, best_cost = -1, np.inf
    for i in range(max(row - most, 0), min(row + most + 1, rows)):
        for j in range(max(column - most, 0), min(column + most + 1, columns)):
            cell, squared = i * columns + j, float((i - row) ** 2 + (j - column) ** 2)
            price = squared if nearest else cost[cell]
            if not reached[i, j] or price >= best_cost or squared > reach * reach:
                continue
            if in_sight(occupied, cell, middle):
                best, best_cost = cell, price
    return best
