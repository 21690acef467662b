"""The sensor: noisy bearings and ranges to landmarks, and the occupancy of the cells around (§4.1)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose, place_of, wrap_angle
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.signals import FREE, HIDDEN, OCCUPIED, Patch, Scan, Sightings


class Sensor:
    """A 360° sensor of limited range that identifies landmarks and reads the cells around the robot."""

    def __init__(self, scenario: LandmarkScenario, world: LandmarkWorld, rng: np.random.Generator) -> None:
        self._rng = rng
        self._landmarks = world.landmarks
        self._obstacles = world.obstacles
        self._buried = world.obstacles & ~world.counted
        self._grid = world.grid
        self._range = scenario.sensor_range
        self._min_range = scenario.min_landmark_range
        self._bearing_sigma = scenario.noise.bearing
        self._range_sigma = scenario.noise.range
        self._occlusion = scenario.occlusion
        self._reach = math.ceil(scenario.sensor_range / scenario.cell_size)

    def scan(self, pose: Pose) -> Scan:
        """Scan taken at a true pose. Two standard normals a landmark of the world are drawn, seen or not."""
        normals = self._rng.standard_normal((len(self._landmarks), 2))
        seen, bearings, ranges, patch, origin = _scan(
            pose,
            self._landmarks,
            normals,
            (self._bearing_sigma, self._range_sigma),
            self._obstacles,
            self._grid,
            (self._min_range, self._range),
            self._reach,
            self._occlusion,
        )
        if self._occlusion:
            _show_corners(patch, pose, self._buried, self._grid)
        return Scan(
            Sightings(landmarks=seen, bearings=bearings, ranges=ranges),
            Patch(cells=patch, origin=origin, heading=pose[2]),
        )


@jit
def _scan(
    pose: Pose,
    landmarks: Array,
    normals: Array,
    sigmas: tuple[float, float],
    obstacles: NDArray[np.bool_],
    grid: Grid,
    limits: tuple[float, float],
    reach: int,
    occlusion: bool,
) -> tuple[NDArray[np.int64], Array, Array, NDArray[np.uint8], tuple[float, float]]:
    """Ids, bearings and ranges of the landmarks sighted, with their noise, and the patch with its origin."""
    seen, bearings, ranges = _sight(pose, landmarks, normals, sigmas, obstacles, grid, limits, occlusion)
    patch, origin = _patch(pose, obstacles, grid, reach, occlusion)
    return seen, bearings, ranges, patch, origin


@jit
def _sight(
    pose: Pose,
    landmarks: Array,
    normals: Array,
    sigmas: tuple[float, float],
    obstacles: NDArray[np.bool_],
    grid: Grid,
    limits: tuple[float, float],
    occlusion: bool,
) -> tuple[NDArray[np.int64], Array, Array]:
    count = landmarks.shape[0]
    seen = np.empty(count, dtype=np.int64)
    bearings = np.empty(count)
    ranges = np.empty(count)
    k = 0
    for j in range(count):
        dx, dy = landmarks[j, 0] - pose[0], landmarks[j, 1] - pose[1]
        distance = math.hypot(dx, dy)
        if distance < limits[0] or distance > limits[1]:
            continue
        if occlusion and not _clear(pose[0], pose[1], landmarks[j, 0], landmarks[j, 1], obstacles, grid):
            continue
        seen[k] = j
        bearings[k] = wrap_angle(math.atan2(dy, dx) - pose[2]) + sigmas[0] * normals[j, 0]
        ranges[k] = distance + sigmas[1] * normals[j, 1]
        k += 1
    return seen[:k].copy(), bearings[:k].copy(), ranges[:k].copy()


@jit
def _patch(
    pose: Pose, obstacles: NDArray[np.bool_], grid: Grid, reach: int, occlusion: bool
) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """Cut the (2 reach + 1)² cells around the robot's own; points outside the map read occupied."""
    column0, row0 = place_of(grid, pose[0], pose[1])
    column0, row0 = column0 - reach, row0 - reach
    side = 2 * reach + 1
    patch = np.empty((side, side), dtype=np.uint8)
    for i in range(side):
        for j in range(side):
            row, column = row0 + i, column0 + j
            inside = 0 <= row < grid.rows and 0 <= column < grid.columns
            patch[i, j] = FREE if inside and not obstacles[row, column] else OCCUPIED
            if occlusion:
                x, y = grid.x0 + (column + 0.5) * grid.resolution, grid.y0 + (row + 0.5) * grid.resolution
                if not _clear(pose[0], pose[1], x, y, obstacles, grid):
                    patch[i, j] = HIDDEN
    corner_x, corner_y = grid.x0 + column0 * grid.resolution, grid.y0 + row0 * grid.resolution
    return patch, (pose[0] - corner_x, pose[1] - corner_y)


@jit
def _show_corners(patch: NDArray[np.uint8], pose: Pose, buried: NDArray[np.bool_], grid: Grid) -> None:
    """Let a patch show the corners of walls: no ray meets a cell inside a wall, but two walls that meet are in sight.

    A hidden cell of `buried`, shape (rows, columns), reads occupied where two seen obstacles share a side with it and
    with a seen free cell: that one would stay a frontier for ever.
    """
    side = patch.shape[0]
    column0, row0 = place_of(grid, pose[0], pose[1])
    column0, row0 = column0 - side // 2, row0 - side // 2
    for i in range(max(0, -row0), min(side, grid.rows - row0)):
        for j in range(max(0, -column0), min(side, grid.columns - column0)):
            if patch[i, j] == HIDDEN and buried[row0 + i, column0 + j] and _is_corner(patch, i, j):
                patch[i, j] = OCCUPIED


@jit
def _is_corner(patch: NDArray[np.uint8], i: int, j: int) -> bool:
    side = patch.shape[0]
    for k in (i - 1, i + 1):
        for m in (j - 1, j + 1):
            if not (0 <= k < side and 0 <= m < side):
                continue
            if patch[k, m] == FREE and patch[i, m] == OCCUPIED and patch[k, j] == OCCUPIED:
                return True
    return False


@jit
def _clear(x0: float, y0: float, x1: float, y1: float, obstacles: NDArray[np.bool_], grid: Grid) -> bool:
    """Whether no obstacle lies between two points; the cells that hold the points themselves do not count.

    Walks the cells of the segment in order (Amanatides and Woo 1987).
    """
    column, row = place_of(grid, x0, y0)
    last_column, last_row = place_of(grid, x1, y1)
    dx, dy = x1 - x0, y1 - y0
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    next_x = (grid.x0 + (column + (dx > 0)) * grid.resolution - x0) / dx if dx != 0.0 else np.inf
    next_y = (grid.y0 + (row + (dy > 0)) * grid.resolution - y0) / dy if dy != 0.0 else np.inf
    delta_x = grid.resolution / abs(dx) if dx != 0.0 else np.inf
    delta_y = grid.resolution / abs(dy) if dy != 0.0 else np.inf
    for _ in range(abs(last_column - column) + abs(last_row - row)):
        if next_x < next_y:
            column += step_x
            next_x += delta_x
        else:
            row += step_y
            next_y += delta_y
        if column == last_column and row == last_row:
            return True
        if 0 <= row < grid.rows and 0 <= column < grid.columns and obstacles[row, column]:
            return False
    return True
