"""Block-arrow elimination: the compiled kernels behind the marginal covariances.

The information matrix of the linearized graph is an arrow: the poses form a block-tridiagonal chain, the landmarks
its border. Eliminating the poses in time order leaves the *corner*, the information of the newest pose and of the
landmarks; its inverse starts the walk back along the chain (Takahashi's recursion), which gives every marginal
exactly. With N poses and M landmarks both passes cost O(N M²) time and O(N M) memory.

Eliminating pose i leaves the conditional  xᵢ = −Gᵢ xᵢ₊₁ − Kᵢ l + N(0, Pᵢ)  with the pivot P, the gain G and the
border K. A corner is ordered (x, y, heading of the newest pose, then x, y of each landmark).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array

CHECKPOINT = 32
"""Poses between two corners that are kept, for an elimination to set in again there."""

NO_CHECKPOINTS = np.empty((0, 0, 0))
"""Checkpoints of an elimination that none sets in again."""


@dataclass(frozen=True, slots=True)
class Elimination:
    """The linearized graph with all poses but the newest eliminated.

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


@jit
def add_sightings(
    corner: Array,
    pose: int,
    row: int,
    sighting_poses: NDArray[np.int64],
    sighting_landmarks: NDArray[np.int64],
    of_pose: Array,
    of_landmark: Array,
) -> int:
    """Add to the corner the sightings of `pose`, which start at `row`; return the row after them."""
    while row < sighting_poses.shape[0] and sighting_poses[row] == pose:
        m = 3 + 2 * sighting_landmarks[row]
        for e in range(2):
            for i in range(3):
                for j in range(3):
                    corner[i, j] += of_pose[row, e, i] * of_pose[row, e, j]
                for j in range(2):
                    product = of_pose[row, e, i] * of_landmark[row, e, j]
                    corner[i, m + j] += product
                    corner[m + j, i] += product
            for i in range(2):
                for j in range(2):
                    corner[m + i, m + j] += of_landmark[row, e, i] * of_landmark[row, e, j]
        row += 1
    return row


@jit
def eliminate(
    first: int,
    last: int,
    row: int,
    odometry_from: Array,
    odometry_to: Array,
    sighting_poses: NDArray[np.int64],
    sighting_landmarks: NDArray[np.int64],
    of_pose: Array,
    of_landmark: Array,
    corner: Array,
    pivots: Array,
    gains: Array,
    borders: Array,
    widths: NDArray[np.int64],
    checkpoints: Array,
) -> int:
    """Eliminate poses first … last − 1 of the chain, moving the corner from pose `first` to pose `last`.

    `row` is the first sighting of pose first + 1. Fills pivots and gains, shape (·, 3, 3), borders, shape
    (·, 3, 2M), and widths, the border columns that are not zero, shape (·,). The corner of every `CHECKPOINT`-th pose
    is kept in `checkpoints`, shape (·, ≥ 3 + 2M, ≥ 3 + 2M), as far as there is room. Returns the row after the last
    sighting used.
    """
    border = corner.shape[0] - 3
    block = np.empty((3, 3))
    # landmarks come in the order of first sighting, so the poses up to one sighted none of the later ones: its border
    # is zero beyond a width that only grows, and early poses of a long trajectory cost next to nothing
    width = 0
    for c in range(border):
        if corner[0, 3 + c] != 0.0 or corner[1, 3 + c] != 0.0 or corner[2, 3 + c] != 0.0:
            width = c + 1
    for k in range(first, last):
        if k % CHECKPOINT == 0 and k // CHECKPOINT < checkpoints.shape[0]:
            checkpoints[k // CHECKPOINT] = 0.0
            checkpoints[k // CHECKPOINT, : border + 3, : border + 3] = corner
        widths[k] = width
        # information of pose k with its odometry factor ahead, and its coupling J to pose k + 1
        for i in range(3):
            f0, f1, f2 = odometry_from[k, 0, i], odometry_from[k, 1, i], odometry_from[k, 2, i]
            for j in range(3):
                block[i, j] = (
                    corner[i, j]
                    + f0 * odometry_from[k, 0, j]
                    + f1 * odometry_from[k, 1, j]
                    + f2 * odometry_from[k, 2, j]
                )
                gains[k, i, j] = f0 * odometry_to[k, 0, j] + f1 * odometry_to[k, 1, j] + f2 * odometry_to[k, 2, j]
        _invert3(block, pivots, k)
        for c in range(3):  # G = P J in place, keeping J in `block`
            j0, j1, j2 = gains[k, 0, c], gains[k, 1, c], gains[k, 2, c]
            block[0, c], block[1, c], block[2, c] = j0, j1, j2
            for i in range(3):
                gains[k, i, c] = pivots[k, i, 0] * j0 + pivots[k, i, 1] * j1 + pivots[k, i, 2] * j2
        for i in range(3):  # K = P B
            p0, p1, p2 = pivots[k, i, 0], pivots[k, i, 1], pivots[k, i, 2]
            for c in range(width):
                borders[k, i, c] = p0 * corner[0, 3 + c] + p1 * corner[1, 3 + c] + p2 * corner[2, 3 + c]
        for a in range(width):  # landmarks: S − Bᵀ K
            x, y, z = corner[0, 3 + a], corner[1, 3 + a], corner[2, 3 + a]
            for c in range(width):
                corner[3 + a, 3 + c] -= x * borders[k, 0, c] + y * borders[k, 1, c] + z * borders[k, 2, c]
        for i in range(3):  # pose k + 1: JₜᵀJₜ − Jᵀ G and −Jᵀ K
            j0, j1, j2 = block[0, i], block[1, i], block[2, i]
            t0, t1, t2 = odometry_to[k, 0, i], odometry_to[k, 1, i], odometry_to[k, 2, i]
            for j in range(3):
                corner[i, j] = (
                    t0 * odometry_to[k, 0, j]
                    + t1 * odometry_to[k, 1, j]
                    + t2 * odometry_to[k, 2, j]
                    - (j0 * gains[k, 0, j] + j1 * gains[k, 1, j] + j2 * gains[k, 2, j])
                )
            for c in range(width):
                corner[i, 3 + c] = -(j0 * borders[k, 0, c] + j1 * borders[k, 1, c] + j2 * borders[k, 2, c])
        for i in range(3):
            for c in range(width):
                corner[3 + c, i] = corner[i, 3 + c]
        before = row
        row = add_sightings(corner, k + 1, row, sighting_poses, sighting_landmarks, of_pose, of_landmark)
        for s in range(before, row):
            width = max(width, 2 * sighting_landmarks[s] + 2)
    return row


@jit
def recover(
    last: int,
    corner_covariance: Array,
    pivots: Array,
    gains: Array,
    borders: Array,
    widths: NDArray[np.int64],
    headings: Array,
    covariances: Array,
) -> None:
    """Walk back from pose `last`, filling its covariance and those of all earlier poses, shape (last + 1, 3, 3).

    `corner_covariance` is the joint covariance of pose `last` (in its own frame) and the landmarks; what is
    written is that of (x, y, heading) in the world frame.
    """
    border = corner_covariance.shape[0] - 3
    own = corner_covariance[:3, :3].copy()
    cross = corner_covariance[:3, 3:].copy()
    landmarks = corner_covariance[3:, 3:].copy()
    next_cross = np.empty((3, border))
    step = np.empty((3, 3))
    to_world(own, headings[last], covariances[last])
    # Σ(k, ·) of a landmark that no pose up to k sighted is needed no more
    needed = np.empty(last, dtype=np.int64)
    for k in range(last):
        needed[k] = max(widths[k], needed[k - 1] if k > 0 else 0)
    for k in range(last - 1, -1, -1):
        width, columns = widths[k], needed[k]
        for i in range(3):  # Σ(k, landmarks) = −G Σ(k + 1, landmarks) − K Σ(landmarks)
            g0, g1, g2 = gains[k, i, 0], gains[k, i, 1], gains[k, i, 2]
            for c in range(columns):
                next_cross[i, c] = -(g0 * cross[0, c] + g1 * cross[1, c] + g2 * cross[2, c])
        for a in range(width):
            e0, e1, e2 = borders[k, 0, a], borders[k, 1, a], borders[k, 2, a]
            for c in range(columns):
                entry = landmarks[a, c]
                next_cross[0, c] -= e0 * entry
                next_cross[1, c] -= e1 * entry
                next_cross[2, c] -= e2 * entry
        for i in range(3):  # Σ(k, k + 1) = −G Σ(k + 1) − K Σ(landmarks, k + 1)
            g0, g1, g2 = gains[k, i, 0], gains[k, i, 1], gains[k, i, 2]
            s0 = g0 * own[0, 0] + g1 * own[1, 0] + g2 * own[2, 0]
            s1 = g0 * own[0, 1] + g1 * own[1, 1] + g2 * own[2, 1]
            s2 = g0 * own[0, 2] + g1 * own[1, 2] + g2 * own[2, 2]
            for a in range(width):
                edge = borders[k, i, a]
                s0 += edge * cross[0, a]
                s1 += edge * cross[1, a]
                s2 += edge * cross[2, a]
            step[i, 0], step[i, 1], step[i, 2] = -s0, -s1, -s2
        for i in range(3):  # Σ(k) = P − Σ(k, k + 1) Gᵀ − Σ(k, landmarks) Kᵀ
            for j in range(i, 3):
                total = pivots[k, i, j] - (
                    step[i, 0] * gains[k, j, 0] + step[i, 1] * gains[k, j, 1] + step[i, 2] * gains[k, j, 2]
                )
                for a in range(width):
                    total -= next_cross[i, a] * borders[k, j, a]
                own[i, j] = total
                own[j, i] = total
        cross, next_cross = next_cross, cross
        to_world(own, headings[k], covariances[k])


@jit
def to_world(own: Array, heading: float, world: Array) -> None:
    """Turn a pose covariance from the robot's frame into the world's."""
    c, s = math.cos(heading), math.sin(heading)
    xx, xy, yy = own[0, 0], own[0, 1], own[1, 1]
    world[0, 0] = c * c * xx - 2.0 * c * s * xy + s * s * yy
    world[1, 1] = s * s * xx + 2.0 * c * s * xy + c * c * yy
    world[0, 1] = world[1, 0] = c * s * (xx - yy) + (c * c - s * s) * xy
    world[0, 2] = world[2, 0] = c * own[0, 2] - s * own[1, 2]
    world[1, 2] = world[2, 1] = s * own[0, 2] + c * own[1, 2]
    world[2, 2] = own[2, 2]


@jit
def invert_corner(corner: Array) -> Array:
    """Inverse of a symmetric positive definite matrix by Cholesky factorization, exactly symmetric."""
    n = corner.shape[0]
    inverse_root = np.linalg.inv(np.linalg.cholesky(corner))
    result = np.empty((n, n))
    for i in range(n):
        for j in range(i, n):
            total = 0.0
            for k in range(j, n):
                total += inverse_root[k, i] * inverse_root[k, j]
            result[i, j] = total
            result[j, i] = total
    return result


@jit
def _invert3(a: Array, out: Array, k: int) -> None:
    """Inverse of a symmetric positive definite 3 × 3 matrix through its Cholesky factor, into out[k]."""
    l00 = math.sqrt(a[0, 0])
    l10, l20 = a[1, 0] / l00, a[2, 0] / l00
    l11 = math.sqrt(a[1, 1] - l10 * l10)
    l21 = (a[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(a[2, 2] - l20 * l20 - l21 * l21)
    m00, m11, m22 = 1.0 / l00, 1.0 / l11, 1.0 / l22
    m10 = -l10 * m00 * m11
    m21 = -l21 * m11 * m22
    m20 = -(l20 * m00 + l21 * m10) * m22
    out[k, 0, 0] = m00 * m00 + m10 * m10 + m20 * m20
    out[k, 0, 1] = out[k, 1, 0] = m10 * m11 + m20 * m21
    out[k, 0, 2] = out[k, 2, 0] = m20 * m22
    out[k, 1, 1] = m11 * m11 + m21 * m21
    out[k, 1, 2] = out[k, 2, 1] = m21 * m22
    out[k, 2, 2] = m22 * m22
