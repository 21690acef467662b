"""What the robot believes at one moment, frozen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Array, Pose
from explore_bench.robot.landmark.linearization import Linearization
from explore_bench.world.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Elimination:
    """The linearized graph with all poses but the newest eliminated; see `marginals` for the symbols.

    Attributes
    ----------
    pivots, gains, borders, widths : of the eliminated poses, shapes (N − 1, 3, 3), (N − 1, 3, 3), (N − 1, 3, ≥ 2M)
        and (N − 1,); a border holds nothing beyond its width.
    corner : information of the newest pose and the landmarks, shape (3 + 2M, 3 + 2M).
    corner_covariance : its inverse; the pose in its own frame.
    """

    pivots: Array
    gains: Array
    borders: Array
    widths: NDArray[np.int64]
    corner: Array
    corner_covariance: Array


@dataclass(frozen=True, slots=True)
class Belief:
    """Estimates, covariances and maps after a step, as read-only arrays. Nothing in it leads to the truth.

    Attributes
    ----------
    scenario : the physical constants, which the robot knows.
    poses : estimated trajectory (x, y, heading) [m, m, rad], shape (N, 3), the newest last.
    pose_covariances : marginal of each in the world frame, shape (N, 3, 3).
    landmarks : estimates [m] in the order of first sighting, shape (M, 2).
    landmark_covariances : marginal of each [m²], shape (M, 2, 2).
    landmark_ids : the sensor's id of each, shape (M,).
    occupancy : probability that a cell is occupied, shape (n, n), rows along y.
    known : whether a cell was observed, shape (n, n).
    virtual_map : covariance (xx, xy, yy) of each cell's virtual landmark [m²], shape (n, n, 3).
    uncertainty : U of Eq. 1 [m²].
    linearization : Jacobian blocks of the graph at these estimates.
    elimination : the same graph eliminated up to the newest pose, from which `predict` goes on.
    """

    scenario: Scenario
    poses: Array
    pose_covariances: Array
    landmarks: Array
    landmark_covariances: Array
    landmark_ids: NDArray[np.int64]
    occupancy: Array
    known: NDArray[np.bool_]
    virtual_map: Array
    uncertainty: float
    linearization: Linearization
    elimination: Elimination

    @property
    def pose(self) -> Pose:
        """Newest estimated pose."""
        x, y, heading = self.poses[-1].tolist()
        return x, y, heading

    @property
    def explored(self) -> float:
        """Known share of all cells; which of them count in a given map, the robot does not know."""
        return float(self.known.mean())

    @property
    def virtual_traces(self) -> Array:
        """Trace of each virtual landmark's covariance [m²], shape (n, n)."""
        return np.asarray(self.virtual_map[..., 0] + self.virtual_map[..., 2])
