"""The row that a trial keeps of every step, and what it keeps of every decision for a replay: one schema.

Rows hold primitives only; metrics are functions of them, so that a changed metric never asks for a new simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple, get_type_hints

import numpy as np

from explore_bench.slam.belief import Belief

SCHEMA_VERSION = 1
"""Raised whenever a column's meaning changes; records of another version are refused, never mixed in."""


@dataclass(frozen=True)
class Column:
    """Storage type (as pyarrow names it), unit and meaning of a column."""

    dtype: str
    unit: str
    meaning: str


class Step(NamedTuple):
    """Primitives after one step; row 0 follows the scan at the start."""

    step: Annotated[int, Column("int32", "1", "steps taken")]
    decisions: Annotated[int, Column("int32", "1", "decisions made")]
    true_x: Annotated[float, Column("float64", "m", "true pose")]
    true_y: Annotated[float, Column("float64", "m", "true pose")]
    true_heading: Annotated[float, Column("float64", "rad", "true pose")]
    x: Annotated[float, Column("float64", "m", "estimated pose")]
    y: Annotated[float, Column("float64", "m", "estimated pose")]
    heading: Annotated[float, Column("float64", "rad", "estimated pose")]
    cov_xx: Annotated[float, Column("float64", "m²", "covariance of the estimated pose, world frame")]
    cov_xy: Annotated[float, Column("float64", "m²", "")]
    cov_yy: Annotated[float, Column("float64", "m²", "")]
    cov_xh: Annotated[float, Column("float64", "m rad", "")]
    cov_yh: Annotated[float, Column("float64", "m rad", "")]
    cov_hh: Annotated[float, Column("float64", "rad²", "")]
    uncertainty: Annotated[float, Column("float64", "m²", "U of Eq. 1")]
    peak_trace: Annotated[float, Column("float64", "m² + rad²", "largest tr Σ (3 × 3) of the trajectory, for Eq. 3")]
    peak_position_trace: Annotated[float, Column("float64", "m²", "the same of the position block (2 × 2)")]
    explored: Annotated[float, Column("float64", "1", "known share of the cells that count towards coverage")]
    path_length: Annotated[float, Column("float64", "m", "length of the straight commands so far")]
    turned: Annotated[float, Column("float64", "rad", "sum of the magnitudes of the turns so far")]
    collisions: Annotated[int, Column("int32", "1", "entries of the true robot into obstacles or off the map")]
    mislabelled: Annotated[int, Column("int32", "1", "known cells believed to be what they are not")]
    landmarks: Annotated[int, Column("int32", "1", "landmarks seen so far")]


STEP_COLUMNS: dict[str, Column] = {
    name: hint.__metadata__[0] for name, hint in get_type_hints(Step, include_extras=True).items()
}

FINAL_COLUMNS: dict[str, Column] = {
    "final_x": Column("float32", "m", "estimate of this step's pose at the end of the trial"),
    "final_y": Column("float32", "m", ""),
    "final_heading": Column("float32", "rad", ""),
    "final_cov_xx": Column("float32", "m²", "its covariance then, world frame"),
    "final_cov_xy": Column("float32", "m²", ""),
    "final_cov_yy": Column("float32", "m²", ""),
}

REPLAY_COLUMNS: dict[str, Column] = {
    "candidates": Column("list<int32>", "cell", "choices of the decision made at this step; null where none was"),
    "choice": Column("int32", "1", "index of the chosen one"),
    "map": Column("binary", "1", "occupancy of each cell: 0–200 for probabilities 0–1, 255 unknown"),
    "ellipses": Column("binary", "1", "virtual landmarks: half axes in σ₀/250, angle in π/256; 3 bytes a cell"),
    "landmark_estimates": Column("list<float32>", "m, m²", "x, y, xx, xy, yy of each landmark seen"),
}

UNKNOWN_CELL = 255
_OCCUPANCY_LEVELS, _AXIS_LEVELS, _ANGLE_LEVELS = 200, 250, 256


class Snapshot(NamedTuple):
    """What a replay keeps of one decision (of the end of the trial where choice is None)."""

    candidates: list[int] | None
    choice: int | None
    map: bytes
    ellipses: bytes
    landmark_estimates: list[float]


def take_snapshot(belief: Belief, candidates: list[int] | None = None, choice: int | None = None) -> Snapshot:
    """Pack what the replay shows of a belief into a few bytes a cell."""
    levels = np.round(belief.occupancy * _OCCUPANCY_LEVELS).astype(np.uint8)
    levels[~belief.known] = UNKNOWN_CELL
    xx, xy, yy = np.moveaxis(belief.virtual_map, -1, 0)
    mean, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    axes = np.sqrt(np.maximum(np.stack((mean + radius, mean - radius), axis=-1), 0.0))
    scaled = np.round(np.minimum(axes / belief.scenario.virtual_sigma, 1.0) * _AXIS_LEVELS)
    angle = np.round(0.5 * np.arctan2(2 * xy, xx - yy) % np.pi / np.pi * _ANGLE_LEVELS) % _ANGLE_LEVELS
    packed = np.concatenate((scaled, angle[..., None]), axis=-1).astype(np.uint8)
    entries = belief.landmark_covariances[:, [0, 0, 1], [0, 1, 1]]
    landmarks = np.concatenate((belief.landmarks, entries), axis=1)
    return Snapshot(candidates, choice, levels.tobytes(), packed.tobytes(), landmarks.ravel().tolist())


def unpack_map(packed: bytes, cells: int) -> np.ndarray:
    """Occupancy probability of every cell, NaN where unknown, shape (n, n)."""
    levels = np.frombuffer(packed, dtype=np.uint8).reshape(cells, cells)
    return np.where(levels == UNKNOWN_CELL, np.nan, levels / _OCCUPANCY_LEVELS)


def unpack_ellipses(packed: bytes, cells: int, virtual_sigma: float) -> np.ndarray:
    """Half axes [m] and angle [rad] of every virtual landmark's 1-σ ellipse, shape (n, n, 3)."""
    values = np.frombuffer(packed, dtype=np.uint8).reshape(cells, cells, 3).astype(float)
    return values * np.array([virtual_sigma / _AXIS_LEVELS, virtual_sigma / _AXIS_LEVELS, np.pi / _ANGLE_LEVELS])
