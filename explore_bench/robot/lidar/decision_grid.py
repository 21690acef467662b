"""The fine map and the scans as the grid of decisions sees them: occupancy, what is known, and what hides what."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import TAU, Array, Grid, cells_within, room_within
from explore_bench.geometry.rays import cast
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import FREE, HIDDEN

KNOWN_SHARE = 0.5
"""A cell of the decision grid is known where at least this share of the map's cells in it is."""

SEEN_SHARE = 1.0 / 3.0
"""A cell is seen from a pose where the beams reach at least this share of it."""

_SAMPLES = 3
"""Places along an edge of a cell at which is looked whether a beam reaches it."""


def occupancy(map_: GridMap, scenario: LidarScenario) -> Array:
    """Probability that a place of each cell is occupied, shape (rows, columns) of the decision grid.

    The mean over the map's cells in it: 0.5 where one is unknown, else the bounds of the scenario's clamp.
    """
    low = scenario.occupancy_clamp
    values = np.where(map_.known, np.where(map_.occupied, 1.0 - low, low), 0.5)
    return _mean(values, scenario)


def known(map_: GridMap, scenario: LidarScenario) -> NDArray[np.bool_]:
    """Whether each cell of the decision grid is known, shape (rows, columns)."""
    return np.asarray(_mean(map_.known, scenario) >= KNOWN_SHARE - 1e-9)


def _mean(values: NDArray[np.generic], scenario: LidarScenario) -> Array:
    rows, columns = scenario.grid.shape
    return np.asarray(values.reshape(rows, len(values) // rows, columns, -1).mean(axis=(1, 3)))


def patch_reach(scenario: LidarScenario) -> int:
    """Cells from the middle of a patch to its edge."""
    return math.ceil(scenario.sensor_range / scenario.cell_size) + 1


@jit
def _is_reached(x: float, y: float, cell_size: float, sensor_range: float, ranges: Array) -> bool:
    """Whether the beams of a scan, which start along x, reach the cell around (x, y) [m]."""
    reached = 0
    for a in range(_SAMPLES):
        for b in range(_SAMPLES):
            u = x + ((b + 0.5) / _SAMPLES - 0.5) * cell_size
            v = y + ((a + 0.5) / _SAMPLES - 0.5) * cell_size
            beam = int(round(math.atan2(v, u) / TAU * ranges.shape[0])) % ranges.shape[0]
            distance = math.hypot(u, v)
            reached += distance <= sensor_range and ranges[beam] >= distance
    return reached >= SEEN_SHARE * _SAMPLES * _SAMPLES


def seen_patch(ranges: Array, sensor_range: float, cell_size: float, reach: int) -> NDArray[np.uint8]:
    """Cells around the robot, in its own frame, that a scan reaches: FREE, or else HIDDEN.

    The patch has 2 · reach + 1 cells a side, the robot in the middle of the middle one; see `signals.Patch`.
    """
    return _patch(ranges, sensor_range, *_samples(len(ranges), cell_size, reach))


@cache
def _samples(beams: int, cell_size: float, reach: int) -> tuple[NDArray[np.int64], Array]:
    """Beam towards each place of each cell of a patch, and how far it is [m]: the same for every scan; (P, P, S²)."""
    offsets = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    places = (np.arange(-reach, reach + 1)[:, None] + offsets) * cell_size
    side = 2 * reach + 1
    x, y = np.broadcast_arrays(places[None, :, None, :], places[:, None, :, None])
    towards = np.rint(np.arctan2(y, x) / TAU * beams).astype(np.int64) % beams
    return towards.reshape(side, side, -1), np.hypot(x, y).reshape(side, side, -1)


@jit
def _patch(ranges: Array, sensor_range: float, beams: NDArray[np.int64], distances: Array) -> NDArray[np.uint8]:
    side, _, count = beams.shape
    patch = np.empty((side, side), dtype=np.uint8)
    for i in range(side):
        for j in range(side):
            reached = 0
            for k in range(count):
                distance = distances[i, j, k]
                reached += distance <= sensor_range and ranges[beams[i, j, k]] >= distance
            patch[i, j] = FREE if reached >= SEEN_SHARE * count else HIDDEN
    return patch


@jit
def cells_in_view(
    places: Array,
    sensor_range: float,
    beams: int,
    occupied: NDArray[np.bool_],
    leaps: NDArray[np.float32],
    fine: Grid,
    grid: Grid,
) -> NDArray[np.bool_]:
    """Cells of a grid within range of places [m], shape (K, 2), that beams cast in a fine map reach; gives (K, n_g).

    Parameters
    ----------
    occupied, leaps : walls of the fine map, and `rays.leaps` of them; shapes of the grid `fine`.
    """
    view = np.zeros((places.shape[0], grid.rows * grid.columns), dtype=np.bool_)
    cells, ways = room_within(grid, sensor_range)
    for i in range(places.shape[0]):
        x, y = places[i, 0], places[i, 1]
        ranges = cast((x, y, 0.0), beams, sensor_range, occupied, leaps, fine)
        for k in range(cells_within(grid, x, y, sensor_range, cells, ways)):
            view[i, cells[k]] = _is_reached(ways[k, 0], ways[k, 1], grid.resolution, sensor_range, ranges)
    return view
