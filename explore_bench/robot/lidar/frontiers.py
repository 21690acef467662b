"""Frontiers of the fine map, in pieces that one look can resolve, and the place from which to look at each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid
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
    grid = terrain.grid
    mask = frontier_mask(terrain) & (tries < MOST_TRIES)
    labels, count = ndimage.label(mask, structure=_EIGHT)
    flat = labels.reshape(-1)
    cells = np.flatnonzero(flat)
    order = cells[np.argsort(flat[cells], kind="stable")]
    ends = np.cumsum(np.bincount(flat[cells], minlength=count + 1)[1:])
    least = LEAST_LENGTH / grid.resolution
    found = []
    for cluster in np.split(order, ends[:-1]) if count else []:
        if len(cluster) < least:
            continue
        for piece in _pieces(cluster, grid):
            middle = _middle(piece, grid)
            again = bool(tries.reshape(-1)[piece].any())
            goal = look_from(ways.reached, ways.cost, terrain.occupied, middle, LOOK_FROM / grid.resolution, again)
            if goal >= 0:
                found.append(Frontier(piece, middle, goal, float(ways.cost[goal])))
    return sorted(found, key=lambda frontier: frontier.middle)


def _pieces(cluster: NDArray[np.int64], grid: Grid) -> list[NDArray[np.int64]]:
    """Parts of a cluster: around its first cell that is left, until none is."""
    pieces = []
    centres = grid.centres(cluster)
    while len(cluster):
        near = np.hypot(*(centres - centres[0]).T) <= PIECE_RADIUS
        pieces.append(cluster[near])
        cluster, centres = cluster[~near], centres[~near]
    return pieces


def _middle(piece: NDArray[np.int64], grid: Grid) -> int:
    centres: Array = grid.centres(piece)
    return int(piece[((centres - centres.mean(axis=0)) ** 2).sum(axis=1).argmin()])


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
