"""Columns of integers in a few bytes: what a replay is packed in.

Quantities are counted in fixed units (SCALES), each value less the one `lag` places before, as zigzag variable-length
integers (LEB128), after a header in JSON that names the columns; all of it compressed by gzip without a date. `unpack`
is the reference for the player's own reader in `assets/player.js`.
"""

from __future__ import annotations

import gzip
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

AXIS_LEVELS, ANGLE_LEVELS = 50, 32
"""Levels of an ellipse's half axes (of σ₀) and angle (of π)."""

SCALES: dict[str, float] = {
    **dict.fromkeys(("x", "y", "true_x", "true_y", "landmark_x", "landmark_y", "target_x", "target_y"), 0.01),  # m
    **dict.fromkeys(("candidate_x", "candidate_y", "path_x", "path_y"), 0.01),  # m
    "heading": math.tau / 256,
    **dict.fromkeys(("pose_major", "pose_minor", "landmark_major", "landmark_minor"), 0.002),  # m
    **dict.fromkeys(("pose_angle", "landmark_angle", "angle"), math.pi / ANGLE_LEVELS),
    **dict.fromkeys(("major", "minor"), 1.0 / AXIS_LEVELS),  # of σ₀
    "explored": 1.0,  # cells
    "trajectory_error": 1e-4,  # m
    "exploration_efficiency": 1e-3,  # m²/step
}
"""Unit of each column that counts something else than 1."""


@dataclass(frozen=True)
class Columns:
    """Columns of integers by name, and how many places before each value the one lies from which it is counted."""

    values: dict[str, np.ndarray] = field(default_factory=dict)
    lags: dict[str, int] = field(default_factory=dict)

    def add(self, name: str, values: Any, lag: int = 0) -> None:
        """Add a column in the unit of SCALES; what is not finite counts as 0."""
        numbers = np.nan_to_num(np.asarray(values, dtype=float) / SCALES.get(name, 1.0), posinf=0.0, neginf=0.0)
        self.values[name] = np.rint(numbers).astype(np.int64).ravel()
        self.lags[name] = lag


def pack(header: Mapping[str, Any], columns: Columns) -> bytes:
    """Pack plain values and columns. The same ones give the same bytes."""
    named = [
        {"name": name, "count": len(own), "lag": columns.lags[name], "scale": SCALES.get(name, 1.0)}
        for name, own in columns.values.items()
    ]
    text = json.dumps({**header, "columns": named}, separators=(",", ":")).encode()
    body = b"".join(_varints(_lagged(own, columns.lags[name])) for name, own in columns.values.items())
    return gzip.compress(len(text).to_bytes(4, "little") + text + body, 9, mtime=0)


def unpack(content: bytes) -> dict[str, Any]:
    """The plain values, and each column under its name in its unit."""
    raw = gzip.decompress(content)
    length = int.from_bytes(raw[:4], "little")
    header: dict[str, Any] = json.loads(raw[4 : 4 + length])
    numbers = _integers(raw[4 + length :])
    place = 0
    for column in header.pop("columns"):
        own = numbers[place : place + column["count"]]
        place += column["count"]
        for start in range(column["lag"]):  # one chain for each place within a lag
            own[start :: column["lag"]] = np.cumsum(own[start :: column["lag"]])
        header[column["name"]] = own * column["scale"]
    return header


def _lagged(values: np.ndarray, lag: int) -> np.ndarray:
    """Values less those `lag` places before; 0 leaves them as they are."""
    if not lag:
        return values
    result = values.copy()
    result[lag:] -= values[:-lag]
    return result


def _varints(values: np.ndarray) -> bytes:
    """Zigzag LEB128: seven bits a byte, the lowest first, the sign in the last bit."""
    unsigned = ((values << 1) ^ (values >> 63)).astype(np.uint64)
    groups = [unsigned]
    while (groups[-1] >> np.uint64(7)).any():
        groups.append(groups[-1] >> np.uint64(7))
    table = np.stack(groups, axis=-1)
    more = np.zeros(table.shape, dtype=bool)
    more[:, :-1] = table[:, 1:] > 0
    written = np.ones(table.shape, dtype=bool)
    written[:, 1:] = more[:, :-1]
    return bytes(((table & np.uint64(127)) | (more.astype(np.uint64) << np.uint64(7)))[written].astype(np.uint8))


def _integers(content: bytes) -> np.ndarray:
    """Return the integers that `_varints` wrote."""
    octets = np.frombuffer(content, dtype=np.uint8).astype(np.int64)
    last = octets < 128
    number = np.concatenate(([0], np.cumsum(last)[:-1])) if len(octets) else np.zeros(0, dtype=np.int64)
    starts = np.concatenate(([0], np.flatnonzero(last)[:-1] + 1)) if last.any() else np.zeros(0, dtype=np.int64)
    shift = 7 * (np.arange(len(octets)) - starts[number])
    unsigned = np.zeros(int(last.sum()), dtype=np.int64)
    np.add.at(unsigned, number, (octets & 127) << shift)
    return (unsigned >> 1) ^ -(unsigned & 1)
