"""An observation as arrays of fixed shape, every number within [−1, 1]: what a plain network can learn from.

Row i of the candidates is the one with the i-th shortest path, so that the number of a row means something. Distances
saturate, d / (d + 10 m), and depend on no size of the map.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Array, Grid, wrap_angle
from explore_bench.robot.belief import Belief
from explore_bench.strategies.contract import Observation
from explore_bench.world.scenario import Scenario

CANDIDATE_COLUMNS = {
    "present": "1 for a candidate, 0 in every column of a row that pads",
    "ahead": "its place in the robot's frame, direction times d / (d + 10 m): along the heading",
    "left": "the same, across the heading",
    "length": "length of its path L, as L / (L + 10 m)",
    "turn": "angle from the heading to the path's first waypoint, magnitude in π",
    "unknown": "unknown cells in view from it, as a share of a full view",
    "trace": "trace of the virtual landmark's covariance there, as a share of the prior's",
    "view_trace": "the same, mean over the known cells in view from it",
    "landmark": "nearness r / (r + d) of the nearest landmark seen, r the sensor's range; 0 while none is seen",
}
"""Columns of a candidate's features and their meaning, in order."""

STATE_COLUMNS = {
    "explored": "known share of the map",
    "uncertainty": "U / U₀",
    "sigma": "s / (s + 1 m) of s = √tr Σ of the robot's position",
    "peak": "the same of the largest √tr Σ (3 × 3) of the trajectory",
    "steps": "steps taken, as a share of the step limit",
    "landmarks": "landmarks seen, as a share of those that a map of this size holds",
    "candidates": "candidates, as a share of the most there can be",
}
"""Columns of the robot's own features and their meaning, in order."""

DISTANCE = 10.0
"""Distance that is half of the farthest [m]."""


class Features(NamedTuple):
    """Features of one observation.

    Attributes
    ----------
    candidates : shape (W, CANDIDATE_COLUMNS), float32, ascending by path length; rows of zeros where there are fewer.
    state : shape (STATE_COLUMNS,), float32.
    order : index in the observation of the candidate in each row that is one, shape (min(C, W),).
    """

    candidates: NDArray[np.float32]
    state: NDArray[np.float32]
    order: NDArray[np.int64]


def candidate_limit(scenario: Scenario) -> int:
    """Most candidates that a decision can have: 5 nearest to the robot, 3 to each landmark (§4.1), or all cells."""
    most = scenario.candidates_per_robot + scenario.candidates_per_landmark * scenario.landmarks
    return min(most, scenario.cell_count)


def features(observation: Observation, width: int | None = None) -> Features:
    """Features of an observation, padded to `width` candidates (None: `candidate_limit`, which always suffices).

    Where there are more candidates than that, those with the shortest paths are kept.
    """
    belief, scenario = observation.belief, observation.scenario
    width = candidate_limit(scenario) if width is None else width
    order = np.lexsort((observation.candidates, np.round(observation.path_lengths, 9)))[:width]
    rows = np.zeros((width, len(CANDIDATE_COLUMNS)), dtype=np.float32)
    if len(order):
        rows[: len(order)] = np.clip(_candidates(observation)[order], -1.0, 1.0)
    own = float(np.trace(belief.pose_covariances[-1, :2, :2]))
    peak = belief.peak_trace
    state = (
        belief.explored,
        belief.uncertainty / scenario.prior_uncertainty,
        math.sqrt(own) / (math.sqrt(own) + 1.0),
        math.sqrt(peak) / (math.sqrt(peak) + 1.0),
        observation.step / scenario.step_limit,
        len(belief.landmarks) / max(scenario.landmarks, 1),
        len(observation.candidates) / candidate_limit(scenario),
    )
    return Features(rows, np.clip(state, 0.0, 1.0).astype(np.float32), order)


def _candidates(observation: Observation) -> Array:
    """Features of the candidates in the observation's order, shape (C, CANDIDATE_COLUMNS)."""
    belief, scenario = observation.belief, observation.scenario
    x, y, heading = observation.pose
    offsets = observation.positions - (x, y)
    distances = np.hypot(*offsets.T)
    bearings = np.arctan2(offsets[:, 1], offsets[:, 0]) - heading
    near = distances / (distances + DISTANCE)
    view = belief.view(observation.positions)
    traces = belief.virtual_traces.reshape(-1) / (2.0 * scenario.virtual_sigma**2)
    seen = view & belief.known.reshape(-1)
    columns = (
        np.ones(len(offsets)),
        near * np.cos(bearings),
        near * np.sin(bearings),
        observation.path_lengths / (observation.path_lengths + DISTANCE),
        _turns(observation),
        (view & ~belief.known.reshape(-1)).sum(axis=1) / _full_view(scenario),
        traces[observation.candidates],
        (seen @ traces) / np.maximum(seen.sum(axis=1), 1),
        _landmark_nearness(observation.positions, belief),
    )
    return np.stack(columns, axis=1)


def _full_view(scenario: Scenario) -> int:
    """Cells within sensor range of a cell's centre, the map's edge aside."""
    reach, size = scenario.sensor_range, scenario.grid.resolution
    around = Grid(2 * math.ceil(reach / size) + 1, 2 * math.ceil(reach / size) + 1, size)
    return int(around.in_reach(np.array([around.centre_of(around.cells // 2)]), reach).sum())


def _turns(observation: Observation) -> Array:
    """Angle from the heading to the first waypoint of each path, magnitude in π, shape (C,)."""
    scenario = observation.scenario
    x, y, heading = observation.pose
    firsts = np.array([path[min(1, len(path) - 1)] for path in observation.paths])
    offsets = scenario.grid.centres(firsts) - (x, y)
    angles = np.arctan2(offsets[:, 1], offsets[:, 0]) - heading
    return np.abs([wrap_angle(angle) for angle in angles]) / math.pi


def _landmark_nearness(positions: Array, belief: Belief) -> Array:
    if not len(belief.landmarks):
        return np.zeros(len(positions))
    nearest = np.linalg.norm(positions[:, None] - belief.landmarks, axis=2).min(axis=1)
    return np.asarray(belief.scenario.sensor_range / (belief.scenario.sensor_range + nearest))
