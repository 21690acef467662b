"""The robot's map: how many beams of its key frames passed each cell, and how many ended in it (as Karto's).

Counts add up, so a scan can be taken out again exactly: after a loop closure only the scans whose pose moved are traced
anew, and the map is the same as one built from nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import TAU, Array, Grid, Pose, place_of
from explore_bench.robot.belief import FineMap
from explore_bench.world.lidar.constants import LidarScenario

OCCUPIED_SHARE = 0.25
"""A cell is believed occupied where at least this share of the beams that came to it ended in it (Karto: 0.1)."""


NEAR, NEAR_BEAMS = 1.0, 3
"""Of what the newest scan meets within this [m], a cell with so many beams' ends is an obstacle, whatever passed it
before: a thin pillar that thousands of beams missed stops the robot all the same."""


class GridMap:
    """Counts of beams by cell; shapes are those of the grid, rows along y.

    Attributes
    ----------
    grid : of the map.
    passes : beams that came to a cell, those that ended there among them.
    hits : beams that ended in a cell.
    """

    def __init__(self, scenario: LidarScenario) -> None:
        self.grid = scenario.map_grid
        self._reach, self._known_after = scenario.sensor_range, scenario.known_after
        self._clears = scenario.no_return_clears
        self.passes = np.zeros(self.grid.shape, dtype=np.int32)
        self.hits = np.zeros(self.grid.shape, dtype=np.int32)
        self._near = np.zeros(self.grid.shape, dtype=bool)

    def insert(self, pose: Pose, ranges: Array) -> None:
        """Add a scan, taken at this estimate; ranges as in `RangeScan`."""
        trace_scan(self.passes, self.hits, pose, ranges, self._reach, self._clears, self.grid, 1)

    def remove(self, pose: Pose, ranges: Array) -> None:
        """Take out a scan that was inserted with these very values."""
        trace_scan(self.passes, self.hits, pose, ranges, self._reach, self._clears, self.grid, -1)

    def watch(self, pose: Pose, ranges: Array) -> None:
        """Look at a scan, the newest, for obstacles near the robot."""
        passes, hits = np.zeros_like(self.passes), np.zeros_like(self.hits)
        trace_scan(passes, hits, pose, ranges, NEAR, True, self.grid, 1)
        self._near = occupied_of(passes, hits, NEAR_BEAMS) & (hits >= NEAR_BEAMS)

    def frozen(self) -> FineMap:
        """Copy of what is known now."""
        return FineMap(self.grid, self.known, self.occupied)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Cells to which enough beams came."""
        return np.asarray(self.passes >= self._known_after)

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Known cells believed occupied."""
        return occupied_of(self.passes, self.hits, self._known_after)

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """Cells from which a drive keeps away: those believed occupied, and what the newest scan saw near the robot."""
        return self.occupied | self._near


@jit
def occupied_of(passes: NDArray[np.int32], hits: NDArray[np.int32], known_after: int) -> NDArray[np.bool_]:
    """Cells to which so many beams came, and OCCUPIED_SHARE of them ended; all shapes are the same."""
    occupied = np.empty(passes.shape, dtype=np.bool_)
    for row in range(passes.shape[0]):
        for column in range(passes.shape[1]):
            ended = hits[row, column] >= OCCUPIED_SHARE * passes[row, column]
            occupied[row, column] = ended and passes[row, column] >= known_after
    return occupied


@jit
def trace_scan(
    passes: NDArray[np.int32],
    hits: NDArray[np.int32],
    pose: Pose,
    ranges: Array,
    reach: float,
    clears: bool,
    grid: Grid,
    change: int,
) -> None:
    """Add `change` to the cells that the beams of a scan passed, shape (rows, columns), and to those that they met.

    A beam that met nothing passes what lies within `reach` [m] where it `clears`, else nothing.
    """
    for beam in range(ranges.shape[0]):
        met = ranges[beam] <= reach
        if not met and not clears:
            continue
        angle = pose[2] + TAU * beam / ranges.shape[0]
        length = min(ranges[beam], reach)
        dx, dy = length * math.cos(angle), length * math.sin(angle)
        column, row = place_of(grid, pose[0], pose[1])
        last_column, last_row = place_of(grid, pose[0] + dx, pose[1] + dy)
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        next_x = (grid.x0 + (column + (dx > 0.0)) * grid.resolution - pose[0]) / dx if dx != 0.0 else np.inf
        next_y = (grid.y0 + (row + (dy > 0.0)) * grid.resolution - pose[1]) / dy if dy != 0.0 else np.inf
        delta_x = grid.resolution / abs(dx) if dx != 0.0 else np.inf
        delta_y = grid.resolution / abs(dy) if dy != 0.0 else np.inf
        for _ in range(abs(last_column - column) + abs(last_row - row)):
            if not (0 <= row < grid.rows and 0 <= column < grid.columns):
                break
            passes[row, column] += change
            if next_x < next_y:
                column += step_x
                next_x += delta_x
            else:
                row += step_y
                next_y += delta_y
        if 0 <= last_row < grid.rows and 0 <= last_column < grid.columns:
            passes[last_row, last_column] += change
            if met:
                hits[last_row, last_column] += change
