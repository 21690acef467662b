"""Pixels of a map, and how they become cells."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.floor_plan import FREE, OBSTACLE, START, UNKNOWN
from explore_bench.world.scenario import MAX_CELLS

FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL = 0, 1, 2
MAX_PIXELS = 25_000_000
"""5000 × 5000: 250 m at 5 cm."""

RESOLUTIONS = 1e-6, 1e6
"""Smallest and largest edge of a pixel that is understood [m]."""

OCCUPIED_ABOVE, FREE_BELOW = 0.65, 0.196
"""Probabilities of being occupied that part obstacles, unknown and free, as map_server's maps are written."""

MAP_SAVER_UNKNOWN = 205.0
"""Level of grey that map_saver writes for unknown."""

WORTH_NAMING = 0.001
"""Share of an image from which on levels between free and occupied are named."""


@dataclass(frozen=True, eq=False)
class Raster:
    """A map in pixels.

    Attributes
    ----------
    pixels : FREE_PIXEL, OCCUPIED_PIXEL or UNKNOWN_PIXEL, shape (h, w), the first row the northernmost (largest y).
    resolution : edge of a pixel [m].
    origin : (x, y) of the lower left corner in the map's frame [m].
    start : (x, y) of the start in the map's frame [m], None where the map names none.
    notes : what a reader had to decide, for a person who looks whether it is his map; each follows the file's name.
    """

    pixels: NDArray[np.uint8]
    resolution: float
    origin: tuple[float, float] = (0.0, 0.0)
    start: tuple[float, float] | None = None
    notes: tuple[str, ...] = ()


def classified(
    probability: NDArray[np.floating], occupied_above: float = OCCUPIED_ABOVE, free_below: float = FREE_BELOW
) -> NDArray[np.uint8]:
    """Pixels by their probability of being occupied, shape as given; NaN and what lies between is unknown."""
    pixels = np.full(probability.shape, UNKNOWN_PIXEL, dtype=np.uint8)
    pixels[probability > occupied_above] = OCCUPIED_PIXEL
    pixels[probability < free_below] = FREE_PIXEL
    return pixels


def between(
    levels: NDArray[np.floating], pixels: NDArray[np.uint8], unit: str, free: str, occupied: str
) -> tuple[str, ...]:
    """Sentences on levels of pixels that are neither free nor occupied; none where nobody need look at them.

    The most frequent are named, by the share of the image that has them. 205 alone is how map_saver writes unknown.

    Parameters
    ----------
    levels : of the pixels, NaN where one has none, shape (h, w).
    pixels : what they were taken for, shape (h, w).
    unit : what they are levels of.
    free, occupied : which levels are that, in words.
    """
    unknown = levels[pixels == UNKNOWN_PIXEL]
    values, counts = np.unique(unknown[np.isfinite(unknown)].round(3), return_counts=True)
    shares = counts / max(levels.size, 1)
    if set(values.tolist()) <= {MAP_SAVER_UNKNOWN} or shares.sum() < WORTH_NAMING:
        return ()
    most = sorted(np.argsort(-shares, kind="stable")[:3].tolist())
    named = ", ".join(f"{values[one]:.4g} ({100 * shares[one]:.1f} % of the pixels)" for one in most)
    more = f" and {len(values) - 3} more levels" if len(values) > 3 else ""
    return (f"{unit} {named}{more}: between free ({free}) and occupied ({occupied}), hence unknown, which blocks",)


def check_pixels(width: int, height: int) -> None:
    """Refuse an image that is empty or too large to be read.

    Raises
    ------
    ValueError : where it has no pixel or more than MAX_PIXELS.
    """
    if not width * height:
        raise ValueError(f"it has {width} × {height} pixels; there is nothing to explore, so draw something")
    if width * height > MAX_PIXELS:
        raise ValueError(f"it has {width} × {height} pixels, more than {MAX_PIXELS:,}; crop it, or scale it down")


def cells_of(raster: Raster, cell_size: float, most: int = MAX_CELLS) -> tuple[str, ...]:
    """Rows of text (see `floor_plan.floor_plan`) of a map in cells of an edge [m], at most so many in a square.

    Borders of cells lie at multiples of the cell size in the map's frame, and margins of which nothing is known are cut
    off, so one place gives the same cells however its image is cropped. A pixel belongs to the cell that holds its
    centre (one larger than a cell is cut in pieces first). Of a cell's own pixels,

    1. if the occupied ones would fill half a line across it (or across its part on the image), it is an obstacle: a
       straight wall one pixel thin stays closed, a speck does not block;
    2. else, if more than half are unknown (outside the image, too), it is unknown;
    3. else it is free.

    Raises
    ------
    ValueError : for a map without known pixels, one of too many cells, or a start that is not free.
    """
    height, width = cropped(raster).pixels.shape
    _check_extent(width, height, raster.resolution, cell_size, most)
    pixels, up, across = shared_out(raster, cell_size)
    occupied = _count(pixels == OCCUPIED_PIXEL, up.starts, across.starts)
    known = _count(pixels != UNKNOWN_PIXEL, up.starts, across.starts)
    cells = np.full(occupied.shape, FREE)
    cells[2 * known < up.room[:, None] * across.room] = UNKNOWN
    cells[2 * occupied >= np.minimum(up.widths[:, None], across.widths)] = OBSTACLE
    if raster.start is not None:
        column = math.floor(raster.start[0] / cell_size + 1e-9) - across.first
        row = math.floor(raster.start[1] / cell_size + 1e-9) - up.first
        if cells[row, column] != FREE:
            raise ValueError("the start marker stands in a cell that is not free; move it, or take a finer cell size")
        cells[row, column] = START
    return tuple("".join(row) for row in cells[::-1])


def rotated(raster: Raster, yaw: float) -> Raster:
    """Raster turned about its origin, counterclockwise by an angle [rad]; a pixel has the class of the one it covers.

    A turn that moves no pixel by half of one is none. A straight wall one pixel thin still parts what it parted.

    Raises
    ------
    ValueError : where the turned image has more than MAX_PIXELS.
    """
    from scipy import ndimage

    height, width = raster.pixels.shape
    yaw = math.remainder(yaw, math.tau)
    if abs(yaw) * math.hypot(height, width) < 0.5:
        return raster
    cos, sin = math.cos(yaw), math.sin(yaw)
    turn = np.array([[cos, -sin], [sin, cos]])
    corners = turn @ np.array([[0, width, 0, width], [0, 0, height, height]])
    lowest = corners.min(axis=1)
    columns, rows = np.ceil(np.ptp(corners, axis=1) - 1e-6).astype(int).tolist()
    check_pixels(columns, rows)
    first = turn.T @ (lowest + 0.5) - 0.5  # column and row of the old image under the lower left of the new one
    pixels = ndimage.affine_transform(
        raster.pixels[::-1], turn, first[::-1], (rows, columns), order=0, mode="grid-constant", cval=UNKNOWN_PIXEL
    )
    x, y = raster.origin + lowest * raster.resolution
    turned = replace(raster, pixels=pixels[::-1], origin=(float(x), float(y)))
    if raster.start is None:
        return turned
    x, y = raster.origin + turn @ np.subtract(raster.start, raster.origin)
    return replace(turned, start=(float(x), float(y)))


@dataclass(frozen=True, eq=False)
class Axis:
    """Pixels along an axis in cells.

    Attributes
    ----------
    first : number of the first cell, which begins at so many times the cell size.
    starts : first pixel of each cell.
    widths : pixels that each cell holds.
    room : the same with those off the image.
    """

    first: int
    starts: NDArray[np.int64]
    widths: NDArray[np.int64]
    room: NDArray[np.int64]


def shared_out(raster: Raster, cell_size: float) -> tuple[NDArray[np.uint8], Axis, Axis]:
    """Share out the pixels of a map among cells of an edge [m].

    Returns them without unknown margins, those larger than a cell cut in pieces, shape (h, w), the first row the
    southernmost; and the axes along y and x.
    """
    raster = cropped(raster)
    pieces = max(1, math.ceil(raster.resolution / cell_size - 1e-9))
    height, width = raster.pixels.shape
    step = raster.resolution / pieces
    across = _cells_along(raster.origin[0], step, width * pieces, cell_size)
    up = _cells_along(raster.origin[1], step, height * pieces, cell_size)
    return np.repeat(np.repeat(raster.pixels, pieces, axis=0), pieces, axis=1)[::-1], up, across


def _cells_along(origin: float, step: float, count: int, cell_size: float) -> Axis:
    """Share out `count` pixels from `origin` on among cells."""
    spare = math.ceil(cell_size / step) + 1
    cells = np.floor((origin + (np.arange(-spare, count + spare) + 0.5) * step) / cell_size + 1e-9).astype(np.int64)
    own = cells[spare : spare + count]
    numbers = np.arange(own[0], own[-1] + 1)
    held, room = (
        np.searchsorted(all_, numbers, side="right") - np.searchsorted(all_, numbers) for all_ in (own, cells)
    )
    return Axis(int(own[0]), np.searchsorted(own, numbers), held, room)


def _count(pixels: NDArray[np.bool_], rows: NDArray[np.int64], columns: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.add.reduceat(np.add.reduceat(pixels, rows, axis=0, dtype=np.int64), columns, axis=1)


def cropped(raster: Raster) -> Raster:
    """Raster without the rows and columns at its margins of which nothing is known.

    Raises
    ------
    ValueError : where nothing is known at all.
    """
    known = raster.pixels != UNKNOWN_PIXEL
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        raise ValueError("nothing in it is free or occupied, all is unknown; look at the thresholds")
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    x, y = raster.origin
    below = len(known) - bottom
    origin = x + float(left) * raster.resolution, y + float(below) * raster.resolution
    return replace(raster, pixels=raster.pixels[top:bottom, left:right], origin=origin)


def _check_extent(width: int, height: int, resolution: float, cell_size: float, most: int) -> None:
    longer = max(width, height) * resolution
    extent = f"{width * resolution:g} × {height * resolution:g} m"
    if longer < cell_size:
        raise ValueError(f"it shows {extent}, less than a cell of {cell_size:g} m; look at the resolution")
    edge = math.ceil(longer / cell_size - 1e-9)
    if edge * edge > most:
        fix = "take a larger cell_size" if resolution < cell_size * (1 - 1e-9) else "crop it, scale it down"
        raise ValueError(
            f"{extent} are {edge} cells of {cell_size:g} m a side, and a square holds at most {math.isqrt(most)}; "
            f"{fix}, or give the metres of a pixel as resolution"
        )
