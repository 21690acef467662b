"""How far it is to obstacles on a grid: along rays, and from a point between the centres of cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import TAU, Array, Grid, Pose, place_of

LONGEST_LEAP = 1.5
"""No leap is longer [m]: to know of more costs more than a ray saves by it."""


def leaps(obstacles: NDArray[np.bool_], grid: Grid) -> NDArray[np.float32]:
    """Length [m] that a ray may go on from anywhere in a cell without meeting an obstacle, shape (rows, columns)."""
    centres = clearance_of(obstacles, grid.resolution, LONGEST_LEAP)
    # from a point to its cell's centre, and from an obstacle's centre to its corner: half a diagonal each
    return np.asarray(centres - math.sqrt(2.0) * grid.resolution, dtype=np.float32)


@jit
def cast(
    pose: Pose,
    beams: int,
    reach: float,
    obstacles: NDArray[np.bool_],
    leaps: NDArray[np.float32],
    grid: Grid,
) -> Array:
    """Distance [m] of the first obstacle cell along each beam, shape (beams,); infinite beyond `reach`.

    A ray leaps through open space and walks the cells one by one near obstacles (Amanatides and Woo 1987), so what it
    finds is exact. Outside the grid there is nothing.
    """
    ranges = np.empty(beams)
    for beam in range(beams):
        angle = pose[2] + TAU * beam / beams
        ranges[beam] = _meet(pose[0], pose[1], math.cos(angle), math.sin(angle), reach, obstacles, leaps, grid)
    return ranges


@jit
def _meet(
    x0: float,
    y0: float,
    along_x: float,
    along_y: float,
    reach: float,
    obstacles: NDArray[np.bool_],
    leaps: NDArray[np.float32],
    grid: Grid,
) -> float:
    """Distance at which a ray from (x0, y0) enters an obstacle; infinite beyond `reach` or off the grid."""
    size = grid.resolution
    step_x, step_y = (1 if along_x > 0.0 else -1), (1 if along_y > 0.0 else -1)
    delta_x = size / abs(along_x) if along_x != 0.0 else np.inf
    delta_y = size / abs(along_y) if along_y != 0.0 else np.inf
    travelled = 0.0
    while travelled <= reach:
        x, y = x0 + along_x * travelled, y0 + along_y * travelled
        column, row = place_of(grid, x, y)
        if not (0 <= column < grid.columns and 0 <= row < grid.rows):
            return np.inf
        if obstacles[row, column]:
            return travelled
        leap = leaps[row, column]
        if leap > size:
            travelled += leap
            continue
        next_x = travelled + (grid.x0 + (column + (step_x > 0)) * size - x) / along_x if along_x != 0.0 else np.inf
        next_y = travelled + (grid.y0 + (row + (step_y > 0)) * size - y) / along_y if along_y != 0.0 else np.inf
        while True:
            if next_x < next_y:
                travelled = next_x
                column += step_x
                next_x += delta_x
            else:
                travelled = next_y
                row += step_y
                next_y += delta_y
            if travelled > reach or not (0 <= column < grid.columns and 0 <= row < grid.rows):
                return np.inf
            if obstacles[row, column]:
                return travelled
            leap = leaps[row, column]
            if leap > 4.0 * size:
                travelled += leap
                break
    return np.inf


@jit
def clearance_of(occupied: NDArray[np.bool_], resolution: float, most: float) -> Array:
    """Distance from each cell's centre to that of the nearest occupied cell [m], at most `most`, shape as given.

    First along the columns, then, of the squares, along the rows (Saito and Toriwaki 1994); no farther than `most`.
    """
    rows, columns = occupied.shape
    reach = int(math.ceil(most / resolution))
    far = 2 * (reach + 1) * (reach + 1)
    distances = np.empty(far + 1)
    for k in range(far + 1):
        distances[k] = min(math.sqrt(k) * resolution, most)
    along = np.full((rows, columns), reach + 1, dtype=np.int16)
    for row in range(rows):
        for column in range(columns):
            if occupied[row, column]:
                along[row, column] = 0
            elif row > 0:
                along[row, column] = min(along[row, column], along[row - 1, column] + 1)
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            along[row, column] = min(along[row, column], along[row + 1, column] + 1)
    clearance = np.empty((rows, columns))
    squares = np.full(columns + 2 * reach, far, dtype=np.int16)
    nearest = np.empty(columns, dtype=np.int16)
    for row in range(rows):
        for column in range(columns):
            squares[column + reach] = along[row, column] * along[row, column]
        nearest[:] = far
        for offset in range(2 * reach + 1):
            across = np.int16((offset - reach) * (offset - reach))
            for column in range(columns):
                square = np.int16(squares[column + offset] + across)
                nearest[column] = square if square < nearest[column] else nearest[column]
        for column in range(columns):
            clearance[row, column] = distances[nearest[column]]
    return clearance


@jit
def clearance_at(clearance: Array, grid: Grid, x: float, y: float) -> float:
    """Clearance [m] of the point (x, y) [m], bilinear between the centres of cells; 0 off the grid.

    `clearance` has the grid's shape. Looked up by cell, every small move near a wall would be blocked or none.
    """
    column = (x - grid.x0) / grid.resolution - 0.5
    row = (y - grid.y0) / grid.resolution - 0.5
    if not (-0.5 <= column <= grid.columns - 0.5 and -0.5 <= row <= grid.rows - 0.5):
        return 0.0
    column = min(max(column, 0.0), grid.columns - 1.0)
    row = min(max(row, 0.0), grid.rows - 1.0)
    c0, r0 = int(column), int(row)
    c1, r1 = min(c0 + 1, grid.columns - 1), min(r0 + 1, grid.rows - 1)
    a, b = column - c0, row - r0
    below = (1.0 - a) * clearance[r0, c0] + a * clearance[r0, c1]
    above = (1.0 - a) * clearance[r1, c0] + a * clearance[r1, c1]
    return (1.0 - b) * below + b * above
