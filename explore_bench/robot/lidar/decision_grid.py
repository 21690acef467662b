"""The fine map and the scans as the grid of decisions sees them: occupancy, what is known, and what hides what."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import TAU, Array
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.world.lidar.scenario import LidarScenario
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
def seen_patch(ranges: Array, sensor_range: float, cell_size: float, reach: int) -> NDArray[np.uint8]:
    """Cells around the robot, in its own frame, that a scan reaches: FREE, or else HIDDEN.

    The patch has 2 · reach + 1 cells a side, the robot in the middle of the middle one; see `signals.Patch`.
    """
    side = 2 * reach + 1
    patch = np.empty((side, side), dtype=np.uint8)
    beams = ranges.shape[0]
    for i in range(side):
        for j in range(side):
            reached = 0
            for a in range(_SAMPLES):
                for b in range(_SAMPLES):
                    x = (j - reach + (b + 0.5) / _SAMPLES - 0.5) * cell_size
                    y = (i - reach + (a + 0.5) / _SAMPLES - 0.5) * cell_size
                    beam = int(round(math.atan2(y, x) / TAU * beams)) % beams
                    distance = math.hypot(x, y)
                    reached += distance <= sensor_range and ranges[beam] >= distance
            patch[i, j] = FREE if reached >= SEEN_SHARE * _SAMPLES * _SAMPLES else HIDDEN
    return patch
