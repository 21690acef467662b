"""SE(2) arithmetic, angles, and the step between cells and metres.

A pose is (x, y, heading) in metres and radians; a cell is the integer `row * n + column` of an n × n grid whose
cell 0 lies at the origin, rows running along y.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit

Array = NDArray[np.float64]
Pose = tuple[float, float, float]

TAU = 2.0 * math.pi


@jit
def wrap_angle(angle: float) -> float:
    """Angle [rad] brought into (−π, π]."""
    wrapped = (angle + math.pi) % TAU - math.pi
    return math.pi if wrapped == -math.pi else wrapped


@jit
def compose(pose: Pose, delta: Pose) -> Pose:
    """Pose reached from `pose` by the motion `delta`, given in the frame of `pose`: pose ⊕ delta."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return (
        pose[0] + c * delta[0] - s * delta[1],
        pose[1] + s * delta[0] + c * delta[1],
        wrap_angle(pose[2] + delta[2]),
    )


@jit
def between(origin: Pose, pose: Pose) -> Pose:
    """Pose `pose` as seen from `origin`: ⊖origin ⊕ pose."""
    c, s = math.cos(origin[2]), math.sin(origin[2])
    dx, dy = pose[0] - origin[0], pose[1] - origin[1]
    return c * dx + s * dy, c * dy - s * dx, wrap_angle(pose[2] - origin[2])


@jit
def cell_of(x: float, y: float, cells: int, cell_size: float) -> int:
    """Cell that holds the point (x, y) [m] on a grid of `cells` a side; points outside go to the nearest cell."""
    column = min(max(int(math.floor(x / cell_size)), 0), cells - 1)
    row = min(max(int(math.floor(y / cell_size)), 0), cells - 1)
    return row * cells + column


@jit
def centre_of(cell: int, cells: int, cell_size: float) -> tuple[float, float]:
    """Centre (x, y) [m] of a cell."""
    return (cell % cells + 0.5) * cell_size, (cell // cells + 0.5) * cell_size


def centres(indices: NDArray[np.integer], cells: int, cell_size: float) -> Array:
    """Centres [m] of many cells, shape (..., 2)."""
    index = np.asarray(indices)
    return np.stack(((index % cells + 0.5) * cell_size, (index // cells + 0.5) * cell_size), axis=-1)


@jit
def cells_in_reach(coordinate: float, reach: float, cells: int, cell_size: float) -> tuple[int, int]:
    """First and last row (or column) whose centre can lie within `reach` of a coordinate [m]."""
    first = math.ceil((coordinate - reach) / cell_size - 0.5)
    last = math.floor((coordinate + reach) / cell_size - 0.5)
    return max(int(first), 0), min(int(last), cells - 1)


@jit
def distance_to_segment(x: float, y: float, x0: float, y0: float, x1: float, y1: float) -> float:
    """Distance [m] of the point (x, y) from the segment (x0, y0)–(x1, y1)."""
    dx, dy = x1 - x0, y1 - y0
    length2 = dx * dx + dy * dy
    along = 0.0
    if length2 > 0.0:
        along = min(max(((x - x0) * dx + (y - y0) * dy) / length2, 0.0), 1.0)
    return math.hypot(x - x0 - along * dx, y - y0 - along * dy)
