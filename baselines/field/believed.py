"""The map that the rules look at, its frontiers, and the ways between candidates: what several of them begin with."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench import OCCUPIED_ABOVE, Array, FineMap, Observation, spread

_FOUR, _EIGHT = ndimage.generate_binary_structure(2, 1), ndimage.generate_binary_structure(2, 2)


def finest_map(observation: Observation) -> FineMap:
    """Finest map that the robot has: that of its scans, or else the grid of decisions."""
    belief = observation.belief
    if belief.fine is not None:
        return belief.fine
    return FineMap(belief.scenario.grid, belief.known, belief.known & (belief.occupancy > OCCUPIED_ABOVE))


class Frontiers(NamedTuple):
    """The frontier of which each candidate is a part.

    Attributes
    ----------
    number : of the frontier, 0 where the candidate lies on none, shape (C,).
    length : number of its cells times their edge [m]; of none that edge, shape (C,).
    nearest : straight distance from the robot to the nearest of its cells [m], shape (C,).
    """

    number: NDArray[np.int64]
    length: Array
    nearest: Array


def frontiers(observation: Observation) -> Frontiers:
    """Frontiers of the finest map: known free cells beside an unknown one, joined where they touch (8 neighbours).

    Beside means among 4 neighbours on a map of scans and among 8 on the grid of decisions, as the candidates are made.
    """
    map_ = finest_map(observation)
    beside = _EIGHT if observation.belief.fine is None else _FOUR
    mask = map_.known & ~map_.occupied & ndimage.binary_dilation(~map_.known, beside)
    labels = ndimage.label(mask, _EIGHT)[0].astype(np.int64)
    grid = map_.grid
    cells = np.flatnonzero(labels)
    own = labels.reshape(-1)[cells]
    count = int(own.max(initial=0)) + 1
    away = np.hypot(*(grid.centres(cells) - observation.pose[:2]).T)
    nearest = np.full(count, np.inf)
    np.minimum.at(nearest, own, away)
    sizes = np.bincount(own, minlength=count)
    sizes[0] = 1
    number = np.array([labels.reshape(-1)[grid.cell_of(x, y)] for x, y in observation.positions.tolist()])
    straight = np.hypot(*(observation.positions - observation.pose[:2]).T)
    return Frontiers(number, sizes[number] * grid.resolution, np.where(number > 0, nearest[number], straight))


def stands(observation: Observation) -> NDArray[np.int64]:
    """Cell of the roads from which each candidate is looked at: the nearest one that can be reached, shape (C,)."""
    roads, (cells, _) = observation.roads, observation.reachable
    if not len(cells):
        return np.full(len(observation.candidates), roads.start)
    centres = roads.grid.centres(cells)
    found = [cells[((centres - place) ** 2).sum(axis=1).argmin()] for place in observation.positions]
    return np.array(found, dtype=np.int64)


def lengths_from(observation: Observation, cells: NDArray[np.int64]) -> Array:
    """Length [m] of the shortest drive from each of some cells of the roads to every other, shape (K, cells)."""
    roads = observation.roads
    grid = roads.grid
    if roads.origin is not None:
        centres = grid.centres()
        lengths = np.hypot(*(centres[None] - grid.centres(cells)[:, None]).transpose(2, 0, 1))
        lengths[:, ~roads.free.reshape(-1)] = np.inf
        return np.asarray(lengths)
    free = roads.free.copy()
    free.reshape(-1)[roads.start] = True
    price = np.full(grid.shape, grid.resolution)
    distinct, place = np.unique(cells, return_inverse=True)
    return np.array([spread(free, price, int(cell))[0] for cell in distinct])[place]


def costs(observation: Observation, price: Array, cells: NDArray[np.int64]) -> Array:
    """Cost of the cheapest drive from the robot to some cells of the roads, shape (K,).

    A step costs its length in cells times the mean of the prices of its two cells; `price` is of the roads' shape.
    """
    roads = observation.roads
    return np.asarray(spread(roads.free, price, roads.start)[0][cells])
