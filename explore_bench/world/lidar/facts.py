"""What a lidar world is like, in five numbers that stand beside its results."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.geometry import Array
from explore_bench.world.lidar.world import LidarWorld

FACING = 1.6
"""Two nearest obstacles face each other where they are this many times farther apart than the nearer is away: they are
seen more than 106° apart, which the two sides of a right corner are not."""

LONG_LOOP = 10.0
"""Length [m] from which a loop is a long one."""


class Facts(NamedTuple):
    """What a world is like; all of it is of the space that counts towards coverage, never of places out of reach.

    Attributes
    ----------
    free_area : area of that space [m²].
    corridor_width : median distance [m] of the obstacles on either side, over the lines midway between two that face
        each other (the medial axis without its branches into corners); nan where none do.
    loops : independent cycles of that space, which are the islands in it: obstacles of any size around which the robot
        finds a way; a group between which it finds none is one island.
    long_loops : those of them around which the way is at least 10 m long, by the sides of a box around the island.
    beyond_range : share of that space farther from the start than the sensor's range, as the crow flies: what the first
        scan could not see if no wall stood.
    """

    free_area: float
    corridor_width: float
    loops: int
    long_loops: int
    beyond_range: float


def facts_of(world: LidarWorld, sensor_range: float) -> Facts:
    """Facts of a world for a sensor of this range [m].

    Raises
    ------
    ValueError : where nothing of the world counts.
    """
    cells = int(np.count_nonzero(world.counted))
    if not cells:
        raise ValueError("no cell of the world counts towards coverage")
    around = _ways_around_islands(world)
    widths = _widths(world)
    away = np.hypot(*(world.grid.centres(np.flatnonzero(world.counted)) - world.start[:2]).T)
    return Facts(
        free_area=cells * world.grid.resolution**2,
        corridor_width=float(np.median(widths)) if len(widths) else math.nan,
        loops=len(around),
        long_loops=int(np.count_nonzero(around >= LONG_LOOP - 1e-9)),
        beyond_range=float(np.mean(away > sensor_range)),
    )


def _ways_around_islands(world: LidarWorld) -> Array:
    """Length [m] around the bounding box of each island, shape (loops,).

    Cells that only meet at a corner are joined: between them is no way.
    """
    labels, count = ndimage.label(np.pad(~world.counted, 1, constant_values=True), structure=np.ones((3, 3)))
    outside = labels[0, 0]
    boxes = ndimage.find_objects(labels)
    sides = [(rows.stop - rows.start) + (columns.stop - columns.start) for rows, columns in boxes]
    return 2.0 * world.grid.resolution * np.array([sides[i] for i in range(count) if i + 1 != outside], dtype=float)


def _widths(world: LidarWorld) -> Array:
    """Distance [m] of two facing obstacles at every place midway between them, shape (K,).

    A place is a pair of neighbouring cells that count and are nearest to different obstacles. Across a corridor, their
    clearances, from centre to centre, add up to its width.
    """
    clearance = world.clearance / world.grid.resolution
    nearest = ndimage.distance_transform_edt(np.pad(~world.obstacles, 1), return_distances=False, return_indices=True)[
        :, 1:-1, 1:-1
    ]
    along_x = _facing(nearest, clearance, world.counted)
    along_y = _facing(nearest.swapaxes(1, 2), clearance.T, world.counted.T)
    return np.concatenate((along_x, along_y)) * world.grid.resolution


def _facing(nearest: NDArray[np.int32], clearance: Array, counted: NDArray[np.bool_]) -> Array:
    """Widths [cells] at pairs of neighbours along the second axis that lie between two facing obstacles."""
    rows, columns = np.nonzero(counted[:, :-1] & counted[:, 1:])
    one, other = clearance[rows, columns], clearance[rows, columns + 1]
    apart = np.hypot(*(nearest[:, rows, columns] - nearest[:, rows, columns + 1])) - 1.0  # they are a cell apart, too
    widths: Array = (one + other)[apart >= FACING * np.minimum(one, other)]
    return widths
