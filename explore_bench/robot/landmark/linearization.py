"""The factor graph linearized at the current estimate, as whitened Jacobian blocks.

Perturbations are gtsam's: a pose moves in its own frame, x ← x Exp(δ); a landmark moves in the world's. The error
of an odometry factor is the true logarithm Log(z⁻¹ · xᵢ⁻¹ xⱼ), whose derivative enters both blocks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, between, wrap_angle


@dataclass(frozen=True, slots=True)
class Linearization:
    """Whitened Jacobians of N − 1 odometry factors and K sightings; row k of the odometry joins poses k and k + 1.

    Attributes
    ----------
    prior : square root information of the start's prior, shape (3, 3).
    odometry_from, odometry_to : blocks of the earlier and the later pose, shape (N − 1, 3, 3).
    sighting_poses, sighting_landmarks : which pose sighted which landmark, shape (K,), poses ascending.
    bearing_range_pose, bearing_range_landmark : blocks of a sighting, shapes (K, 2, 3) and (K, 2, 2).
    """

    prior: Array
    odometry_from: Array
    odometry_to: Array
    sighting_poses: NDArray[np.int64]
    sighting_landmarks: NDArray[np.int64]
    bearing_range_pose: Array
    bearing_range_landmark: Array


@jit
def linearize_odometry(
    first: int,
    poses: Array,
    motions: Array,
    sigmas: Array,
    odometry_from: Array,
    odometry_to: Array,
) -> None:
    """Fill the blocks of the odometry factors from row `first` to the newest pose.

    `motions` and `sigmas`, shape (N − 1, 3) each, are those of the `Odometry` between poses k and k + 1.
    """
    ad = np.zeros((3, 3))
    for k in range(first, poses.shape[0] - 1):
        _linearize_motion(k, poses, motions, sigmas, odometry_from, odometry_to, ad)


@jit
def _linearize_motion(
    k: int, poses: Array, motions: Array, sigmas: Array, odometry_from: Array, odometry_to: Array, ad: Array
) -> None:
    """Fill row k of `linearize_odometry`; `ad`, shape (3, 3), is room that holds zeros at first."""
    x, y, angle = between((poses[k, 0], poses[k, 1], poses[k, 2]), (poses[k + 1, 0], poses[k + 1, 1], poses[k + 1, 2]))
    # E = z⁻¹ · h with the motion z: its logarithm (u, v, w), and the derivative of the logarithm,
    # I + ad/2 + c ad², since ad³ = −w² ad in SE(2).
    c, s = math.cos(motions[k, 2]), math.sin(motions[k, 2])
    tx = c * (x - motions[k, 0]) + s * (y - motions[k, 1])
    ty = c * (y - motions[k, 1]) - s * (x - motions[k, 0])
    w = wrap_angle(angle - motions[k, 2])
    if abs(w) < 1e-4:
        half_cot = 1.0 - w * w / 12.0
        series = 1.0 / 12.0 + w * w / 720.0
    else:
        half_cot = 0.5 * w / math.tan(0.5 * w)
        series = (1.0 - half_cot) / (w * w)
    u, v = half_cot * tx + 0.5 * w * ty, half_cot * ty - 0.5 * w * tx
    ad[0, 1], ad[0, 2] = -w, v
    ad[1, 0], ad[1, 2] = w, -u
    for i in range(3):
        weight = 1.0 / sigmas[k, i]
        for j in range(3):
            square = ad[i, 0] * ad[0, j] + ad[i, 1] * ad[1, j]
            value = (1.0 if i == j else 0.0) + 0.5 * ad[i, j] + series * square
            odometry_to[k, i, j] = weight * value
    # Ad of h⁻¹ = (R(−angle), −R(−angle) t)
    c, s = math.cos(angle), math.sin(angle)
    inverse_x, inverse_y = -c * x - s * y, s * x - c * y
    for i in range(3):
        a, b, d = odometry_to[k, i, 0], odometry_to[k, i, 1], odometry_to[k, i, 2]
        odometry_from[k, i, 0] = -(a * c - b * s)
        odometry_from[k, i, 1] = -(a * s + b * c)
        odometry_from[k, i, 2] = -(a * inverse_y - b * inverse_x + d)


@jit
def linearize_sightings(
    first: int,
    poses: Array,
    landmarks: Array,
    sighting_poses: NDArray[np.int64],
    sighting_landmarks: NDArray[np.int64],
    bearing_sigma: float,
    range_sigma: float,
    bearing_range_pose: Array,
    bearing_range_landmark: Array,
) -> None:
    """Fill the blocks of the sightings from row `first` on: first row the bearing, second the range."""
    for k in range(first, sighting_poses.shape[0]):
        _linearize_sighting(
            k,
            poses,
            landmarks,
            sighting_poses,
            sighting_landmarks,
            bearing_sigma,
            range_sigma,
            bearing_range_pose,
            bearing_range_landmark,
        )


@jit
def _linearize_sighting(
    k: int,
    poses: Array,
    landmarks: Array,
    sighting_poses: NDArray[np.int64],
    sighting_landmarks: NDArray[np.int64],
    bearing_sigma: float,
    range_sigma: float,
    bearing_range_pose: Array,
    bearing_range_landmark: Array,
) -> None:
    """Fill row k of `linearize_sightings`."""
    p, m = sighting_poses[k], sighting_landmarks[k]
    dx, dy = landmarks[m, 0] - poses[p, 0], landmarks[m, 1] - poses[p, 1]
    c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
    qx, qy = c * dx + s * dy, c * dy - s * dx
    r = math.hypot(dx, dy)
    bearing, distance = 1.0 / (bearing_sigma * r * r), 1.0 / (range_sigma * r)
    bearing_range_pose[k, 0, 0], bearing_range_pose[k, 0, 1] = bearing * qy, -bearing * qx
    bearing_range_pose[k, 0, 2] = -1.0 / bearing_sigma
    bearing_range_pose[k, 1, 0], bearing_range_pose[k, 1, 1] = -distance * qx, -distance * qy
    bearing_range_pose[k, 1, 2] = 0.0
    bearing_range_landmark[k, 0, 0], bearing_range_landmark[k, 0, 1] = -bearing * dy, bearing * dx
    bearing_range_landmark[k, 1, 0], bearing_range_landmark[k, 1, 1] = distance * dx, distance * dy


@jit
def relinearize(
    poses: Array,
    landmarks: Array,
    poses_before: Array,
    landmarks_before: Array,
    motions: Array,
    sigmas: Array,
    odometry_from: Array,
    odometry_to: Array,
    sighting_poses: NDArray[np.int64],
    sighting_landmarks: NDArray[np.int64],
    bearing_sigma: float,
    range_sigma: float,
    bearing_range_pose: Array,
    bearing_range_landmark: Array,
) -> int:
    """Fill the blocks of all factors between estimates of which one is new or another than before.

    Arguments as of `linearize_odometry` and `linearize_sightings`; iSAM2 leaves many estimates where they are. Returns
    the newest pose up to which all blocks are as they were: those of its own sightings, and of the odometry to it.
    """
    moved, shifted = _changed(poses, poses_before), _changed(landmarks, landmarks_before)
    intact = poses.shape[0] - 1
    for k in range(sighting_poses.shape[0] - 1, -1, -1):
        if moved[sighting_poses[k]] or shifted[sighting_landmarks[k]]:
            intact = min(intact, sighting_poses[k] - 1)
            _linearize_sighting(
                k,
                poses,
                landmarks,
                sighting_poses,
                sighting_landmarks,
                bearing_sigma,
                range_sigma,
                bearing_range_pose,
                bearing_range_landmark,
            )
    ad = np.zeros((3, 3))
    for k in range(poses.shape[0] - 1):
        if moved[k] or moved[k + 1]:
            intact = min(intact, k)
            _linearize_motion(k, poses, motions, sigmas, odometry_from, odometry_to, ad)
    return intact


@jit
def _changed(now: Array, before: Array) -> NDArray[np.bool_]:
    """Whether each row is new or in some entry not what it was before, to the last bit."""
    changed = np.ones(now.shape[0], dtype=np.bool_)
    for k in range(before.shape[0]):
        changed[k] = False
        for i in range(now.shape[1]):
            if now[k, i] != before[k, i]:
                changed[k] = True
    return changed
