"""Whether the passages of a map in pixels stay open when it becomes cells, and the cell size that keeps them so."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.floor_plan import floor_plan
from explore_bench.world.maps.raster import FREE_PIXEL, Raster, cells_of, cropped, shared_out

GAP = 0.5
"""What is narrower [m] is no passage but a hole in a wall, or the slit between two."""

ENOUGH = 0.85
"""Share of the open floor from which on a map counts as kept."""

SMALLEST_CELL = 0.5
"""Finest cells [m] that are taken: the noise of a step is not much less."""


@lru_cache(maxsize=4)
def open_floor(raster: Raster, gap: float = GAP) -> NDArray[np.bool_]:
    """Free pixels that belong together: all ways between them are wider than a gap [m].

    They are those of the largest such region, or of the one that is nearest to the start; shape and order of the
    rows as `raster.shared_out` gives them for a pixel.
    """
    from scipy import ndimage

    pixels, up, across = shared_out(raster, raster.resolution)
    free = pixels == FREE_PIXEL
    room = max(math.floor((gap / raster.resolution + 1) / 2 + 1e-9), 1)
    inner = ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] >= room
    labels, count = ndimage.label(inner)
    if not count:
        return np.zeros_like(free)
    sizes = np.bincount(labels.reshape(-1))
    sizes[0] = 0
    label = int(sizes.argmax())
    if raster.start is not None:
        places = np.argwhere(inner)
        start = np.array([raster.start[1], raster.start[0]]) / raster.resolution - (up.first, across.first)
        label = int(labels[tuple(places[np.square(places + 0.5 - start).sum(axis=1).argmin()])])
    return np.asarray(free & (ndimage.distance_transform_edt(labels != label) < room))


@lru_cache(maxsize=8)
def within_reach(raster: Raster, rows: tuple[str, ...], cell_size: float) -> float:
    """Share of the open floor that is in, or in front of, cells which the robot can reach when the map is these rows.

    A place is in front of a cell that the way there through the open floor is no longer than a cell: so a cell that a
    wall takes counts with the room it is in, never with the one behind the wall.
    """
    from scipy import ndimage

    floor = open_floor(raster)
    if not floor.any():
        return 0.0
    pixels, up, across = shared_out(raster, cell_size)
    pieces = len(pixels) // len(floor)
    reachable = floor_plan(rows).reachable
    of_rows, of_columns = (np.repeat(np.arange(len(axis.widths)), axis.widths) for axis in (up, across))
    floor = np.repeat(np.repeat(floor, pieces, axis=0), pieces, axis=1)
    reached = floor & reachable[of_rows][:, of_columns]
    steps = math.ceil(cell_size * pieces / raster.resolution)
    if reached.any():
        reached = ndimage.binary_dilation(reached, iterations=steps, mask=floor)
    return float(reached.sum() / floor.sum())


def kept_by(raster: Raster, cell_size: float, most: int) -> float:
    """The same share of a map in cells of an edge [m]; 0 where these leave nothing to explore."""
    try:
        return within_reach(raster, cells_of(raster, cell_size, most), cell_size)
    except ValueError:
        return 0.0


def finer(raster: Raster, cell_size: float) -> Iterator[float]:
    """Halves, quarters, … of a cell size [m] that may still be taken for a map."""
    while cell_size / 2 >= max(SMALLEST_CELL, raster.resolution) - 1e-9:
        cell_size /= 2
        yield cell_size


def narrow_for(raster: Raster, cell_size: float) -> bool:
    """Whether passages are narrower than two cells of an edge [m]: without them the open floor falls apart."""
    return bool(open_floor(raster, 2 * cell_size).sum() < ENOUGH * open_floor(raster).sum())


def outdoors(raster: Raster) -> float:
    """Share of the open floor from which no wall lies in one of the four directions."""
    pixels, _, _ = shared_out(raster, raster.resolution)
    floor, blocked, seen = open_floor(raster), pixels != FREE_PIXEL, np.logical_or.accumulate
    down, up = seen(blocked, axis=0), seen(blocked[::-1], axis=0)[::-1]
    right, left = seen(blocked, axis=1), seen(blocked[:, ::-1], axis=1)[:, ::-1]
    return float((floor & ~(down & up & right & left)).sum() / max(floor.sum(), 1))


def extent(raster: Raster) -> tuple[float, float]:
    """Width and height [m] of what is known of a map."""
    height, width = cropped(raster).pixels.shape
    return width * raster.resolution, height * raster.resolution
