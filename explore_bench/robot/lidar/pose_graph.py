"""The importer of gtsam for this kind: key poses, and what odometry, matches and loop closures say between two."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np

from explore_bench.geometry import Array, Pose

START_SIGMAS = 0.001, 0.001, 0.0002
"""Prior of the first pose [m, m, rad]: the map begins where the robot does."""

CAUCHY = 1.0
"""Scale of the loss on loop closures, in standard deviations: a wrong one bends nothing for long."""


class Link(NamedTuple):
    """What is known of a key pose in the frame of another.

    Attributes
    ----------
    earlier, later : their numbers.
    motion : pose `later` as seen from `earlier`.
    covariance : of its error in the frame of `later`, shape (3, 3).
    robust : whether it may be altogether wrong.
    """

    earlier: int
    later: int
    motion: Pose
    covariance: Array
    robust: bool = False


class PoseGraph:
    """Key poses, numbered from 0, and the factors between them."""

    def __init__(self, start: Pose) -> None:
        self._graph = gtsam.NonlinearFactorGraph()
        self._values = gtsam.Values()
        self._graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*start), _sigmas(START_SIGMAS)))
        self._values.insert(0, gtsam.Pose2(*start))
        self._count = 1

    def add_pose(self, estimate: Pose) -> int:
        """Add a key pose; returns its number."""
        self._values.insert(self._count, gtsam.Pose2(*estimate))
        self._count += 1
        return self._count - 1

    def add_link(self, link: Link) -> None:
        """Add a factor between two poses."""
        noise: gtsam.noiseModel.Base = gtsam.noiseModel.Gaussian.Covariance(link.covariance)
        if link.robust:
            noise = gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY), noise)
        self._graph.add(gtsam.BetweenFactorPose2(link.earlier, link.later, gtsam.Pose2(*link.motion), noise))

    def optimize(self) -> Array:
        """Move the poses to where all factors are best satisfied; returns them, shape (N, 3)."""
        self._values = gtsam.LevenbergMarquardtOptimizer(self._graph, self._values).optimize()
        return np.asarray(gtsam.utilities.extractPose2(self._values))

    def covariances(self, together: Sequence[int] = ()) -> tuple[Array, Array]:
        """Marginal of each pose in the world frame, shape (N, 3, 3), and the joint one of some.

        The joint covariance of K poses, ascending, has the shape (3K, 3K) and is in each pose's own frame.
        """
        marginals = gtsam.Marginals(self._graph, self._values)
        own = np.array([marginals.marginalCovariance(number) for number in range(self._count)])
        poses = gtsam.utilities.extractPose2(self._values)
        turn = np.zeros_like(own)
        turn[:, 0, 0] = turn[:, 1, 1] = np.cos(poses[:, 2])
        turn[:, 1, 0] = np.sin(poses[:, 2])
        turn[:, 0, 1], turn[:, 2, 2] = -turn[:, 1, 0], 1.0
        joint = marginals.jointMarginalCovariance(list(together)).fullMatrix() if together else np.empty((0, 0))
        return np.asarray(turn @ own @ turn.transpose(0, 2, 1)), joint


def _sigmas(values: tuple[float, ...]) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))
