"""The covariance of the newest key pose, step by step: what full marginals give, at the cost of three poses.

Until something links the newest pose to an earlier visit, it is tied only to the pose before it and to its anchor. So
the joint covariance of these, and of the pose that will be the next anchor, is all that the next step needs: a Kalman
filter whose state is poses, exact for the newest one. Errors are in each pose's own frame, as gtsam's.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Pose, between


class TailFilter:
    """Joint covariance of the poses that links to the next one may start from.

    Attributes
    ----------
    numbers : of these poses, ascending, the newest last.
    joint : their covariance, shape (3K, 3K), in each pose's own frame.
    """

    def __init__(self, numbers: list[int], joint: Array) -> None:
        self.numbers, self.joint = numbers, joint

    def advance(self, motion: Pose, covariance: Array) -> None:
        """Add a pose that odometry leads to from the newest; covariance in the frame of the new one."""
        size = len(self.joint)
        joint = np.empty((size + 3, size + 3))
        joint[:size, :size] = self.joint
        _advance(joint, size, motion, covariance)
        _mirror(joint, size + 3)
        self.joint = joint
        self.numbers.append(self.numbers[-1] + 1)

    def measure(self, earlier: int, motion: Pose, covariance: Array) -> None:
        """Take in where the newest pose is, seen from an earlier one of those that are kept."""
        self.joint = self.joint.copy()
        _measure(self.joint, len(self.joint), 3 * self.numbers.index(earlier), motion, covariance)
        _mirror(self.joint, len(self.joint))

    def keep(self, numbers: list[int]) -> None:
        """Forget all but these poses and the newest."""
        kept = [number for number in self.numbers if number in numbers or number == self.numbers[-1]]
        rows = np.concatenate([3 * self.numbers.index(number) + np.arange(3) for number in kept])
        self.joint, self.numbers = self.joint[np.ix_(rows, rows)], kept

    def newest(self, heading: float) -> Array:
        """Covariance of the newest pose in the world's axes, shape (3, 3)."""
        return rotated(self.joint[-3:, -3:], heading)


@jit
def smoothed(joint: Array, ends: NDArray[np.int64], motions: Array, covariances: Array) -> Array:
    """Joint covariance of poses and of those that follow the last of them, after all links, shape (3(K + M), 3(K + M)).

    Parameters
    ----------
    joint : of K poses before, shape (3K, 3K).
    ends : places of the earlier and the later pose of each link among all, shape (L, 2); links come by their later
        pose, and the first of each leads there from the pose before it.
    motions, covariances : of the links, shapes (L, 3) and (L, 3, 3).
    """
    size = joint.shape[0]
    total = 3 * (ends[-1, 1] + 1)
    result = np.empty((total, total))
    result[:size, :size] = joint
    for k in range(ends.shape[0]):
        motion = (motions[k, 0], motions[k, 1], motions[k, 2])
        if 3 * ends[k, 1] == size:
            _advance(result, size, motion, covariances[k])
            size += 3
        else:
            _measure(result, size, 3 * ends[k, 0], motion, covariances[k])
    _mirror(result, size)
    return result


@jit
def _advance(joint: Array, size: int, motion: Pose, covariance: Array) -> None:
    """Fill the rows of the pose after the newest, as far as the diagonal; the first `size` hold the poses so far.

    Here and in `_measure` only what is on and below the diagonal is read and written: rows lie together in memory.
    """
    carry = adjoint_of_inverse(motion)
    last = size - 3
    for i in range(3):
        for j in range(last):
            joint[size + i, j] = 0.0
            for k in range(3):
                joint[size + i, j] += carry[i, k] * joint[last + k, j]
        for j in range(3):
            joint[size + i, last + j] = 0.0
            for k in range(3):
                joint[size + i, last + j] += carry[i, k] * joint[last + max(j, k), last + min(j, k)]
    for i in range(3):
        for j in range(i + 1):
            joint[size + i, size + j] = covariance[i, j]
            for k in range(3):
                joint[size + i, size + j] += joint[size + i, last + k] * carry[j, k]


@jit
def _measure(joint: Array, size: int, place: int, motion: Pose, covariance: Array) -> None:
    """Condition the first `size` rows on the newest pose as seen from the one whose rows begin at `place`.

    With S = L Lᵀ what is taken off is W Wᵀ, W = spread L⁻ᵀ: symmetric to the last digit, since what is not, grows.
    """
    carry = adjoint_of_inverse(motion)
    last = size - 3
    spread = np.empty((3, size))  # covariance of the surprise with all
    for j in range(3):
        for i in range(size):
            spread[j, i] = joint[last + j, i] if i <= last + j else joint[i, last + j]
        for k in range(3):
            for i in range(place + k + 1):
                spread[j, i] -= carry[j, k] * joint[place + k, i]
            for i in range(place + k + 1, size):
                spread[j, i] -= carry[j, k] * joint[i, place + k]
    surprise = covariance.copy()
    for i in range(3):
        for j in range(3):
            surprise[i, j] += spread[j, last + i]
            for k in range(3):
                surprise[i, j] -= carry[i, k] * spread[j, place + k]
    root = np.linalg.cholesky(surprise)
    for i in range(size):
        spread[0, i] /= root[0, 0]
        spread[1, i] = (spread[1, i] - root[1, 0] * spread[0, i]) / root[1, 1]
        spread[2, i] = (spread[2, i] - root[2, 0] * spread[0, i] - root[2, 1] * spread[1, i]) / root[2, 2]
    for i in range(size):
        a, b, c = spread[0, i], spread[1, i], spread[2, i]
        for j in range(i + 1):
            joint[i, j] -= a * spread[0, j] + b * spread[1, j] + c * spread[2, j]


@jit
def _mirror(joint: Array, size: int) -> None:
    """Fill what is above the diagonal of the first `size` rows."""
    for i in range(size):
        for j in range(i):
            joint[j, i] = joint[i, j]


@jit
def adjoint_of_inverse(motion: Pose) -> Array:
    """Matrix by which an error in the frame before a motion becomes one in the frame after it, shape (3, 3)."""
    x, y, turn = motion
    c, s = math.cos(turn), math.sin(turn)
    # the error (u, v, w) moves the end of the motion by (u, v) + w × (x, y), seen from the turned frame
    return np.array([[c, s, s * x - c * y], [-s, c, s * y + c * x], [0.0, 0.0, 1.0]])


@jit
def betweens(origins: Array, poses: Array) -> Array:
    """Poses as seen from as many origins, `geometry.between` of each pair, shapes (K, 3)."""
    motions = np.empty(poses.shape)
    for k in range(poses.shape[0]):
        origin = (origins[k, 0], origins[k, 1], origins[k, 2])
        motions[k] = np.array(between(origin, (poses[k, 0], poses[k, 1], poses[k, 2])))
    return motions


def rotated(covariance: Array, angle: float) -> Array:
    """Covariance of a pose's error, shape (3, 3), from axes that an angle [rad] turned, in the axes before."""
    turn = turns_of(np.array([angle]))[0]
    return np.asarray(turn @ covariance @ turn.T)


def turns_of(headings: Array) -> Array:
    """Matrices from each pose's own axes to the world's, shape (N, 3, 3)."""
    turns = np.zeros((len(headings), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(headings)
    turns[:, 1, 0] = np.sin(headings)
    turns[:, 0, 1], turns[:, 2, 2] = -turns[:, 1, 0], 1.0
    return turns
