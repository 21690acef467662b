"""The marginal covariances of the graph, kept up to date step by step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array
from explore_bench.robot.landmark.block_arrow import (
    CHECKPOINT,
    Elimination,
    add_sightings,
    eliminate,
    invert_corner,
    recover,
    to_world,
)
from explore_bench.robot.landmark.growing import Rows
from explore_bench.robot.landmark.linearization import Linearization, linearize_odometry, relinearize
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.signals import Odometry


class Marginals:
    """Linearized graph, its elimination, and the covariances of all poses and landmarks.

    `solve` computes them at new estimates, setting in where the first of these differs from before; `extend` adds a
    pose that sighted nothing, by which no earlier covariance changes. Both are exact for the graph linearized at the
    estimates given.
    """

    def __init__(self, scenario: LandmarkScenario) -> None:
        noise = self._noise = scenario.noise
        root = self._prior_root = np.diag(1.0 / np.array([noise.prior, noise.prior, noise.prior_heading]))
        self._prior = root.T @ root
        self._motions, self._sigmas = Rows((3,)), Rows((3,))
        self._odometry_from, self._odometry_to = Rows((3, 3)), Rows((3, 3))
        self._sighting_poses, self._sighting_landmarks = Rows((), np.int64), Rows((), np.int64)
        self._of_pose, self._of_landmark = Rows((2, 3)), Rows((2, 2))
        self._pivots, self._gains = Rows((3, 3)), Rows((3, 3))
        self._borders, self._widths = Rows((3, 2 * scenario.landmarks)), Rows((), np.int64)
        self._corner = self._corner_covariance = np.empty((3, 3))
        self._checkpoints = Rows((3 + 2 * scenario.landmarks, 3 + 2 * scenario.landmarks))
        self._eliminated = 0
        self._at: tuple[Array, Array] = np.empty((0, 3)), np.empty((0, 2))
        self._covariances = Rows((3, 3))

    @property
    def pose_covariances(self) -> Array:
        """Marginal of every pose in the world frame, shape (N, 3, 3)."""
        return self._covariances.view

    @property
    def landmark_covariances(self) -> Array:
        """Marginal of every landmark, shape (M, 2, 2)."""
        count = (len(self._corner) - 3) // 2
        blocks = self._corner_covariance[3:, 3:].reshape(count, 2, count, 2)
        return np.ascontiguousarray(np.einsum("iaib->iab", blocks))

    def add(self, odometry: Odometry | None, landmarks: list[int]) -> None:
        """Add the factors of one step: its odometry (None at the start) and the landmarks it sighted."""
        pose = len(self._covariances)
        self._covariances.resize(pose + 1)
        if odometry is not None:
            self._motions.append(odometry.motion)
            self._sigmas.append(odometry.sigmas)
            for rows in (self._odometry_from, self._odometry_to, self._pivots, self._gains):
                rows.resize(pose)
            self._borders.resize(pose)
            self._widths.resize(pose)
            self._checkpoints.resize(pose // CHECKPOINT + 1)
        for landmark in landmarks:
            self._sighting_poses.append(pose)
            self._sighting_landmarks.append(landmark)
        self._of_pose.resize(len(self._sighting_poses))
        self._of_landmark.resize(len(self._sighting_poses))

    def solve(self, poses: Array, landmarks: Array) -> None:
        """Compute everything at these estimates, shapes (N, 3) and (M, 2)."""
        self._corner, self._corner_covariance = _solve(
            poses,
            landmarks,
            self._at[0],
            self._at[1],
            self._prior,
            (self._noise.bearing, self._noise.range),
            self._motions.view,
            self._sigmas.view,
            self._odometry_from.view,
            self._odometry_to.view,
            *self._sightings,
            self._pivots.view,
            self._gains.view,
            self._borders.view,
            self._widths.view,
            self._checkpoints.view,
            self._eliminated,
            self._covariances.view,
        )
        self._at = poses.copy(), landmarks.copy()
        self._eliminated = len(poses) - 1

    def extend(self, poses: Array) -> None:
        """Add the newest of the poses, shape (N, 3), which sighted nothing, to what is there."""
        k = len(poses) - 2
        self._corner_covariance = _extend(
            k,
            poses,
            self._motions.view,
            self._sigmas.view,
            self._odometry_from.view,
            self._odometry_to.view,
            *self._sightings,
            self._corner,
            self._corner_covariance,
            self._pivots.view,
            self._gains.view,
            self._borders.view,
            self._widths.view,
            self._checkpoints.view,
            self._covariances.view,
        )
        self._at = poses.copy(), self._at[1]
        self._eliminated = k + 1

    def linearization(self) -> Linearization:
        """Copy of the Jacobian blocks."""
        return Linearization(
            prior=self._prior_root.copy(),
            odometry_from=self._odometry_from.view.copy(),
            odometry_to=self._odometry_to.view.copy(),
            sighting_poses=self._sighting_poses.view.copy(),
            sighting_landmarks=self._sighting_landmarks.view.copy(),
            bearing_range_pose=self._of_pose.view.copy(),
            bearing_range_landmark=self._of_landmark.view.copy(),
        )

    def elimination(self) -> Elimination:
        """Copy of the elimination."""
        return Elimination(
            pivots=self._pivots.view.copy(),
            gains=self._gains.view.copy(),
            borders=self._borders.view.copy(),
            widths=self._widths.view.copy(),
            corner=self._corner.copy(),
            corner_covariance=self._corner_covariance.copy(),
        )

    @property
    def _sightings(self) -> tuple[NDArray[np.int64], NDArray[np.int64], Array, Array]:
        return (
            self._sighting_poses.view,
            self._sighting_landmarks.view,
            self._of_pose.view,
            self._of_landmark.view,
        )


@jit
def _solve(
    poses: Array,
    landmarks: Array,
    poses_before: Array,
    landmarks_before: Array,
    prior: Array,
    sight_sigmas: tuple[float, float],
    motions: Array,
    sigmas: Array,
    odometry_from: Array,
    odometry_to: Array,
    sighting_poses: NDArray[np.int64],
    sighting_landmarks: NDArray[np.int64],
    of_pose: Array,
    of_landmark: Array,
    pivots: Array,
    gains: Array,
    borders: Array,
    widths: NDArray[np.int64],
    checkpoints: Array,
    eliminated: int,
    covariances: Array,
) -> tuple[Array, Array]:
    """Do all of `Marginals.solve` in one call of compiled code; returns the corner and its inverse.

    `poses_before` and `landmarks_before` are where the graph was linearized, `eliminated` how many poses were.
    """
    intact = relinearize(
        poses,
        landmarks,
        poses_before,
        landmarks_before,
        motions,
        sigmas,
        odometry_from,
        odometry_to,
        sighting_poses,
        sighting_landmarks,
        sight_sigmas[0],
        sight_sigmas[1],
        of_pose,
        of_landmark,
    )
    size, last = 3 + 2 * len(landmarks), len(poses) - 1
    kept = min(intact, eliminated - 1) // CHECKPOINT
    if kept > 0:
        corner = checkpoints[kept, :size, :size].copy()
        first = kept * CHECKPOINT
        row = int(np.searchsorted(sighting_poses, first, side="right"))
    else:
        corner = np.zeros((size, size))
        corner[:3, :3] = prior
        first = 0
        row = add_sightings(corner, 0, 0, sighting_poses, sighting_landmarks, of_pose, of_landmark)
    eliminate(
        first,
        last,
        row,
        odometry_from,
        odometry_to,
        sighting_poses,
        sighting_landmarks,
        of_pose,
        of_landmark,
        corner,
        pivots,
        gains,
        borders,
        widths,
        checkpoints,
    )
    corner_covariance = invert_corner(corner)
    recover(last, corner_covariance, pivots, gains, borders, widths, poses[:, 2].copy(), covariances)
    return corner, corner_covariance


@jit
def _extend(
    k: int,
    poses: Array,
    motions: Array,
    sigmas: Array,
    odometry_from: Array,
    odometry_to: Array,
    sighting_poses: NDArray[np.int64],
    sighting_landmarks: NDArray[np.int64],
    of_pose: Array,
    of_landmark: Array,
    corner: Array,
    corner_covariance: Array,
    pivots: Array,
    gains: Array,
    borders: Array,
    widths: NDArray[np.int64],
    checkpoints: Array,
    covariances: Array,
) -> Array:
    """Do all of `Marginals.extend` by pose k + 1 in one call of compiled code; returns the corner's new inverse."""
    linearize_odometry(k, poses, motions, sigmas, odometry_from, odometry_to)
    eliminate(
        k,
        k + 1,
        len(sighting_poses),
        odometry_from,
        odometry_to,
        sighting_poses,
        sighting_landmarks,
        of_pose,
        of_landmark,
        corner,
        pivots,
        gains,
        borders,
        widths,
        checkpoints,
    )
    # x' = F x + G w, with both blocks whitened: J_to δ' + J_from δ ~ N(0, I)
    noise = np.linalg.solve(odometry_to[k], np.eye(3))  # the inverse, by the routine that numpy takes for it
    transition = -np.dot(noise, odometry_from[k])
    pose, border = np.ascontiguousarray(corner_covariance[:3, :3]), np.ascontiguousarray(corner_covariance[:3, 3:])
    new = corner_covariance.copy()
    new[:3, 3:] = np.dot(transition, border)
    new[3:, :3] = new[:3, 3:].T
    new[:3, :3] = np.dot(np.dot(transition, pose), transition.T) + np.dot(noise, noise.T)
    to_world(new, poses[k + 1, 2], covariances[k + 1])
    return new
