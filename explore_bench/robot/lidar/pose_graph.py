"""The importer of gtsam for this kind: key poses, and what odometry, matches and loop closures say between two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Pose
from explore_bench.robot.lidar.filtering import turns_of

START_SIGMAS = 0.001, 0.001, 0.0002
"""Prior of the first pose [m, m, rad]: the map begins where the robot does."""

CAUCHY = 1.0
"""Scale of the loss on loop closures, in standard deviations: a wrong one bends nothing for long."""


LEAST_STEP, MOST_STEPS = 0.0005, 10
"""Optimizing ends with a step of this root mean square [m or rad]: the next is its square, with a robust loss half."""


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


def joins_of(links: Sequence[Link]) -> NDArray[np.int64]:
    """Numbers of the two poses that each link joins, shape (L, 2)."""
    return np.array([(link.earlier, link.later) for link in links], dtype=np.int64).reshape(-1, 2)


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
        """Move the poses to where all factors are best satisfied; returns them, shape (N, 3).

        A link that is like those before it moves them by millimetres, so one step of Gauss and Newton will do; where it
        takes many, Levenberg and Marquardt find the way.
        """
        values = self._values
        for _ in range(MOST_STEPS):
            step = self._graph.linearize(values).optimize()
            values = values.retract(step)
            if step.norm() <= LEAST_STEP * math.sqrt(self._count):
                break
        else:
            values = gtsam.LevenbergMarquardtOptimizer(self._graph, self._values).optimize()
        self._values = values
        return np.asarray(gtsam.utilities.extractPose2(values))

    def covariances(self, together: Sequence[int] = ()) -> tuple[Array, Array]:
        """Marginal of each pose in the world frame, shape (N, 3, 3), and the joint one of some.

        The joint covariance of K poses, ascending, has the shape (3K, 3K) and is in each pose's own frame.
        """
        posterior = self.posterior()
        turn = turns_of(gtsam.utilities.extractPose2(self._values)[:, 2])
        joint = posterior.joint(together) if together else np.empty((0, 0))
        return np.asarray(turn @ posterior.marginals() @ turn.transpose(0, 2, 1)), joint

    def posterior(self) -> Posterior:
        """Joint distribution of all poses as they are now."""
        rows, columns, values = np.asarray(self._graph.linearize(self._values).sparseJacobian_())
        kept = columns <= 3 * self._count  # the one after them is the right-hand side
        places = rows[kept].astype(int) - 1, columns[kept].astype(int) - 1
        model = sparse.csc_matrix((values[kept], places), shape=(int(rows.max()), 3 * self._count))
        return Posterior(model)


class Posterior:
    """Joint covariance of all key poses, of which parts are computed as they are asked for; in each pose's own frame.

    Parameters
    ----------
    model : whitened Jacobian of all factors, shape (F, 3N).
    """

    def __init__(self, model: sparse.csc_matrix) -> None:
        information = (model.T @ model).tocsc()
        # no pivoting is needed, and none keeps the factor symmetric and the order one that leaves it sparse
        symmetric = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        self._factor = splu(information, **symmetric)
        self._size = model.shape[1]
        self._columns: dict[int, Array] = {}

    def columns(self, numbers: Sequence[int]) -> Array:
        """Covariance of all N poses with K of them, shape (3N, 3K)."""
        new = [number for number in numbers if number not in self._columns]
        if new:
            unit = np.zeros((self._size, 3 * len(new)))
            unit[rows_of(new), np.arange(3 * len(new))] = 1.0
            solved = self._factor.solve(unit)
            self._columns |= {number: solved[:, 3 * i : 3 * i + 3] for i, number in enumerate(new)}
        return np.hstack([self._columns[number] for number in numbers])

    def joint(self, numbers: Sequence[int]) -> Array:
        """Covariance of K poses, shape (3K, 3K)."""
        block = self.columns(numbers)[rows_of(numbers)]
        return np.asarray(0.5 * (block + block.T))

    def marginals(self) -> Array:
        """Covariance of each pose, shape (N, 3, 3)."""
        lower = self._factor.L.tocsc()
        lower.sort_indices()
        inverse = selected_inverse(lower.indptr, lower.indices, lower.data, self._factor.U.diagonal())
        blocks = blocks_of(lower.indptr, lower.indices, inverse, self._factor.perm_c.astype(np.int64))
        for number in np.flatnonzero(np.isnan(blocks).any(axis=(1, 2))).tolist():
            blocks[number] = self.joint([number])
        return blocks


def rows_of(numbers: ArrayLike) -> NDArray[np.int64]:
    """Rows of K poses in a joint covariance, shape (3K,)."""
    return np.asarray(np.add.outer(3 * np.asarray(numbers, dtype=np.int64), np.arange(3)).ravel())


@jit
def selected_inverse(starts: NDArray[np.int32], rows: NDArray[np.int32], lower: Array, pivots: Array) -> Array:
    """Entries of (L D Lᵀ)⁻¹ where L has some: Takahashi, Fagan and Chen 1973, from the last column to the first.

    NaN is what one becomes that needs another where L has none, as may be where axes are independent of one another.

    Parameters
    ----------
    starts, rows, lower : L in compressed columns, 1 on its diagonal, rows ascending.
    pivots : D, shape (n,).
    """
    inverse = np.zeros(lower.shape[0])
    place = np.full(pivots.shape[0], -1, dtype=np.int64)  # of a row among those of the column at hand
    sums = np.empty(pivots.shape[0])
    for column in range(pivots.shape[0] - 1, -1, -1):
        first, count = starts[column] + 1, starts[column + 1] - starts[column] - 1
        for a in range(count):
            place[rows[first + a]] = a
            sums[a] = 0.0
        for b in range(count):
            other, found = rows[first + b], 0
            for entry in range(starts[other], starts[other + 1]):
                a = place[rows[entry]]
                if a < 0:
                    continue
                found += 1
                sums[a] += lower[first + b] * inverse[entry]
                if a != b:
                    sums[b] += lower[first + a] * inverse[entry]
            if found < count - b:
                sums[b] = np.nan
        own = 1.0 / pivots[column]
        for a in range(count):
            inverse[first + a] = -sums[a]
            own += lower[first + a] * sums[a]
            place[rows[first + a]] = -1
        inverse[starts[column]] = own
    return inverse


@jit
def blocks_of(starts: NDArray[np.int32], rows: NDArray[np.int32], inverse: Array, places: NDArray[np.int64]) -> Array:
    """Blocks on the diagonal, shape (n / 3, 3, 3), NaN where L has no entry; row i of the matrix is row `places[i]`."""
    blocks = np.full((places.shape[0] // 3, 3, 3), np.nan)
    for number in range(blocks.shape[0]):
        for i in range(3):
            for j in range(i + 1):
                one, other = places[3 * number + i], places[3 * number + j]
                row, column = max(one, other), min(one, other)
                for entry in range(starts[column], starts[column + 1]):
                    if rows[entry] == row:
                        blocks[number, i, j] = blocks[number, j, i] = inverse[entry]
    return blocks


def _sigmas(values: tuple[float, ...]) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))
