"""The importer of gtsam for this kind: key poses, and what odometry, matches and loop closures say between two."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from explore_bench.geometry import Array, Pose
from explore_bench.robot.lidar.filtering import turns_of

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
        turn = turns_of(gtsam.utilities.extractPose2(self._values)[:, 2])
        joint = marginals.jointMarginalCovariance(list(together)).fullMatrix() if together else np.empty((0, 0))
        return np.asarray(turn @ own @ turn.transpose(0, 2, 1)), joint

    def posterior(self) -> Posterior:
        """Joint distribution of all poses as they are now."""
        rows, columns, values = np.asarray(self._graph.linearize(self._values).sparseJacobian_())
        kept = columns <= 3 * self._count  # the one after them is the right-hand side
        places = rows[kept].astype(int) - 1, columns[kept].astype(int) - 1
        model = sparse.csc_matrix((values[kept], places), shape=(int(rows.max()), 3 * self._count))
        return Posterior(model)


class Posterior:
    """Joint covariance of all key poses, of which columns are computed as they are asked for.

    Parameters
    ----------
    model : whitened Jacobian of all factors, shape (F, 3N), in each pose's own frame.
    """

    def __init__(self, model: sparse.csc_matrix) -> None:
        self._factor = splu((model.T @ model).tocsc())
        self._size = model.shape[1]
        self._columns: dict[int, Array] = {}

    def columns(self, numbers: Sequence[int]) -> Array:
        """Covariance of all N poses with K of them, shape (3N, 3K), in each pose's own frame."""
        new = [number for number in numbers if number not in self._columns]
        if new:
            unit = np.zeros((self._size, 3 * len(new)))
            unit[np.add.outer(3 * np.array(new), np.arange(3)).ravel(), np.arange(3 * len(new))] = 1.0
            solved = self._factor.solve(unit)
            self._columns |= {number: solved[:, 3 * i : 3 * i + 3] for i, number in enumerate(new)}
        return np.hstack([self._columns[number] for number in numbers])


def _sigmas(values: tuple[float, ...]) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))
