"""The covariance of the newest key pose, step by step: what full marginals give, at the cost of three poses.

Until something links the newest pose to an earlier visit, it is tied only to the pose before it and to its anchor. So
the joint covariance of these, and of the pose that will be the next anchor, is all that the next step needs: a Kalman
filter whose state is poses, exact for the newest one. Errors are in each pose's own frame, as gtsam's.
"""

from __future__ import annotations

import math

import numpy as np

from explore_bench.geometry import Array, Pose


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
        carry = adjoint_of_inverse(motion)
        size = len(self.joint)
        joint = np.empty((size + 3, size + 3))
        joint[:size, :size] = self.joint
        joint[size:, :size] = carry @ self.joint[size - 3 :]
        joint[:size, size:] = joint[size:, :size].T
        joint[size:, size:] = carry @ self.joint[size - 3 :, size - 3 :] @ carry.T + covariance
        self.joint = joint
        self.numbers.append(self.numbers[-1] + 1)

    def measure(self, earlier: int, motion: Pose, covariance: Array) -> None:
        """Take in where the newest pose is, seen from an earlier one of those that are kept."""
        place = slice(3 * self.numbers.index(earlier), 3 * self.numbers.index(earlier) + 3)
        carry = adjoint_of_inverse(motion)
        spread = self.joint[:, -3:] - self.joint[:, place] @ carry.T
        surprise = spread[-3:] - carry @ spread[place] + covariance
        whitened = np.linalg.solve(np.linalg.cholesky(surprise), spread.T)
        self.joint = self.joint - whitened.T @ whitened  # symmetric to the last digit: what is not, grows

    def keep(self, numbers: list[int]) -> None:
        """Forget all but these poses and the newest."""
        kept = [number for number in self.numbers if number in numbers or number == self.numbers[-1]]
        rows = np.concatenate([3 * self.numbers.index(number) + np.arange(3) for number in kept])
        self.joint, self.numbers = self.joint[np.ix_(rows, rows)], kept

    def newest(self, heading: float) -> Array:
        """Covariance of the newest pose in the world's axes, shape (3, 3)."""
        return rotated(self.joint[-3:, -3:], heading)


def adjoint_of_inverse(motion: Pose) -> Array:
    """Matrix by which an error in the frame before a motion becomes one in the frame after it, shape (3, 3)."""
    x, y, turn = motion
    c, s = math.cos(turn), math.sin(turn)
    # the error (u, v, w) moves the end of the motion by (u, v) + w × (x, y), seen from the turned frame
    return np.array([[c, s, s * x - c * y], [-s, c, s * y + c * x], [0.0, 0.0, 1.0]])


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
