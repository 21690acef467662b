"""What a trial keeps of every decision for a replay, packed into a few bytes a cell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from explore_bench.robot.belief import Belief, FineMap
from explore_bench.trial.steps import Column

REPLAY_COLUMNS: dict[str, Column] = {
    "candidates": Column("list<int32>", "cell", "choices of the decision made at this step; null where none was"),
    "choice": Column("int32", "1", "index of the chosen one; null where a target was answered"),
    "target": Column("list<float64>", "m", "x, y of the target that was answered instead"),
    "map": Column("binary", "1", "occupancy of each cell: 0–200 for probabilities 0–1, 255 unknown"),
    "ellipses": Column("binary", "1", "virtual landmarks: half axes in σ₀/250, angle in π/256; 3 bytes a cell"),
    "landmark_estimates": Column("list<float32>", "m, m²", "x, y, xx, xy, yy of each landmark seen"),
}

FINE_COLUMNS: dict[str, Column] = {
    "fine": Column(
        "binary", "1", "the robot's finer map: 0 unknown, 1 free, 2 occupied; four cells a byte, lowest first"
    ),
    "positions": Column("list<float32>", "m", "x, y of each candidate; null where no decision was"),
    "trajectory": Column("list<float32>", "m", "x, y of each pose so far as estimated at this step"),
    "loops": Column("list<int32>", "1", "two poses for each loop closure so far that joined them, the earlier first"),
}
"""What a kind of world with a finer map adds; shards of other kinds do not have these columns."""

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
"""Classes of a cell of a finer map."""

UNKNOWN_CELL = 255
_OCCUPANCY_LEVELS, _AXIS_LEVELS, _ANGLE_LEVELS = 200, 250, 256
_SHIFTS = np.arange(0, 8, 2, dtype=np.uint8)


class Snapshot(NamedTuple):
    """What a replay keeps of one decision, or of the end of the trial, where there are no candidates.

    What FINE_COLUMNS names is None in a kind of world without a finer map.
    """

    candidates: list[int] | None
    choice: int | None
    target: list[float] | None
    map: bytes
    ellipses: bytes
    landmark_estimates: list[float]
    fine: bytes | None = None
    positions: list[float] | None = None
    trajectory: list[float] | None = None
    loops: list[int] | None = None


def take_snapshot(
    belief: Belief, candidates: list[int] | None = None, positions: NDArray[np.float64] | None = None
) -> Snapshot:
    """Pack what the replay shows of a belief into a few bytes a cell; positions of the candidates [m], shape (C, 2)."""
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
    kept = Snapshot(candidates, None, None, levels.tobytes(), packed.tobytes(), landmarks.ravel().tolist())
    if belief.fine is None:
        return kept
    return kept._replace(
        fine=pack_fine_map(belief.fine),
        positions=None if positions is None else positions.ravel().tolist(),
        trajectory=belief.poses[:, :2].ravel().tolist(),
        loops=belief.graph.closures.ravel().tolist(),
    )


def pack_fine_map(fine: FineMap) -> bytes:
    """Class of every cell in two bits. It is the shard that is compressed: maps in a row are mostly alike."""
    classes = np.where(fine.known, np.where(fine.occupied, OCCUPIED, FREE), UNKNOWN).astype(np.uint8).ravel()
    quads = np.pad(classes, (0, -len(classes) % 4)).reshape(-1, 4)
    return np.bitwise_or.reduce(quads << _SHIFTS, axis=1).tobytes()


def unpack_fine_map(packed: bytes, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Class of every cell of a finer map of this shape."""
    quads = (np.frombuffer(packed, dtype=np.uint8)[:, None] >> _SHIFTS & 3).astype(np.uint8)
    return quads.ravel()[: shape[0] * shape[1]].reshape(shape)


def unpack_map(packed: bytes, shape: tuple[int, int]) -> np.ndarray:
    """Occupancy probability of every cell of a grid of this shape, NaN where unknown."""
    levels = np.frombuffer(packed, dtype=np.uint8).reshape(shape)
    return np.where(levels == UNKNOWN_CELL, np.nan, levels / _OCCUPANCY_LEVELS)


def unpack_ellipses(packed: bytes, shape: tuple[int, int], virtual_sigma: float) -> np.ndarray:
    """Half axes [m] and angle [rad] of every virtual landmark's 1-σ ellipse, shape (rows, columns, 3)."""
    values = np.frombuffer(packed, dtype=np.uint8).reshape(*shape, 3).astype(float)
    return values * np.array([virtual_sigma / _AXIS_LEVELS, virtual_sigma / _AXIS_LEVELS, np.pi / _ANGLE_LEVELS])
