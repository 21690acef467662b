"""What a replay holds of a map finer than the grid of decisions: what changed in it from one decision to the next.

A decision says which runs of cells, row by row, have another class than at the decision before, from which pose on the
trajectory is another one, and how many loops were closed so far. `fine_maps` is the reference for the player's reader.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from explore_bench.records.encoding import Replay
from explore_bench.report.packing import SCALES, Columns
from explore_bench.trial.snapshot import UNKNOWN, unpack_fine_map


def add_fine(columns: Columns, replay: Replay, shape: tuple[int, int]) -> None:
    """Add the finer maps of a replay, of this shape, and what else is kept beside them."""
    _add_maps(columns, [unpack_fine_map(packed, shape).ravel() for packed in replay.fine_maps])
    _add_trajectories(columns, [np.rint(places / SCALES["path_x"]) for places in replay.trajectories])
    positions = np.concatenate(replay.positions)
    columns.add("candidate_x", positions[:, 0])
    columns.add("candidate_y", positions[:, 1])
    columns.add("loop_count", [len(loops) for loops in replay.loops], lag=1)
    columns.add("loop_earlier", replay.loops[-1][:, 0])  # loops are added one after the other
    columns.add("loop_later", replay.loops[-1][:, 1])


def fine_maps(found: Mapping[str, Any]) -> NDArray[np.uint8]:
    """Class of every cell at every decision and the end, shape (D + 1, n, n), of an unpacked replay."""
    n = found["fineCells"]
    cells = np.full(n * n, UNKNOWN, dtype=np.uint8)
    maps, run = [], 0
    for count in found["fine_count"].astype(int):
        at = 0
        for _ in range(count):
            at += int(found["fine_gap"][run])
            length = int(found["fine_length"][run])
            cells[at : at + length] = found["fine_class"][run]
            at += length
            run += 1
        maps.append(cells.reshape(n, n).copy())
    return np.array(maps)


def _add_maps(columns: Columns, maps: list[NDArray[np.uint8]]) -> None:
    """Add the runs of cells that changed: how many; of each the gap since the last one, the length and the class."""
    runs = [_changes(one, other) for one, other in itertools.pairwise([np.full_like(maps[0], UNKNOWN), *maps])]
    columns.add("fine_count", [len(own) for own in runs])
    for i, name in enumerate(("fine_gap", "fine_length", "fine_class")):
        columns.add(name, np.concatenate(runs)[:, i])


def _changes(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Runs of cells that changed to one class: gap since the last run, length and class, shape (runs, 3)."""
    changed = np.where(after != before, after.astype(np.int64), -1)
    starts = np.flatnonzero(np.diff(changed, prepend=-1, append=-1))
    lengths, classes = np.diff(starts), changed[starts[:-1]]
    starts, lengths, classes = (values[classes >= 0] for values in (starts[:-1], lengths, classes))
    ends = starts + lengths
    return np.stack((np.diff(ends, prepend=0) - lengths, lengths, classes), axis=1)


def _add_trajectories(columns: Columns, trajectories: list[NDArray[np.float64]]) -> None:
    """Add of each trajectory, in units of SCALES, how many poses it has and those from the first that moved."""
    starts, tails = [], []
    for one, other in itertools.pairwise([np.empty((0, 2)), *trajectories]):
        same = min(len(one), len(other))
        moved = np.flatnonzero((one[:same] != other[:same]).any(axis=1))
        starts.append(int(moved[0]) if len(moved) else same)
        tails.append(other[starts[-1] :])
    columns.add("path_count", [len(places) for places in trajectories], lag=1)
    columns.add("path_from", starts)
    for i, name in enumerate(("path_x", "path_y")):
        columns.add(name, np.concatenate(tails)[:, i] * SCALES[name], lag=1)
