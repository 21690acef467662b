"""The marginal covariances of the graph, kept up to date step by step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
        self._prior = np.diag(1.0 / np.array([noise.prior, noise.prior, noise.prior_heading]))
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
        intact = relinearize(
            poses,
            landmarks,
            *self._at,
            self._motions.view,
            self._sigmas.view,
            self._odometry_from.view,
            self._odometry_to.view,
            self._sighting_poses.view,
            self._sighting_landmarks.view,
            self._noise.bearing,
            self._noise.range,
            self._of_pose.view,
            self._of_landmark.view,
        )
        self._at = poses.copy(), landmarks.copy()
        size = 3 + 2 * len(landmarks)
        kept = min(intact, self._eliminated - 1) // CHECKPOINT
        if kept > 0:
            first = CHECKPOINT * kept
            self._corner = self._checkpoints.view[kept, :size, :size].copy()
            row = int(np.searchsorted(self._sighting_poses.view, first, side="right"))
        else:
            first = 0
            self._corner = np.zeros((size, size))
            self._corner[:3, :3] = self._prior.T @ self._prior
            row = add_sightings(self._corner, 0, 0, *self._sightings)
        self._eliminate(first, row)
        self._corner_covariance = invert_corner(self._corner)
        recover(
            len(poses) - 1,
            self._corner_covariance,
            self._pivots.view,
            self._gains.view,
            self._borders.view,
            self._widths.view,
            poses[:, 2].copy(),
            self._covariances.view,
        )

    def extend(self, poses: Array) -> None:
        """Add the newest of the poses, shape (N, 3), which sighted nothing, to what is there."""
        k = len(poses) - 2
        linearize_odometry(
            k, poses, self._motions.view, self._sigmas.view, self._odometry_from.view, self._odometry_to.view
        )
        self._at = poses.copy(), self._at[1]
        self._eliminate(k, len(self._sighting_poses))
        # x' = F x + G w, with both blocks whitened: J_to δ' + J_from δ ~ N(0, I)
        noise = np.linalg.inv(self._odometry_to.view[k])
        transition = -noise @ self._odometry_from.view[k]
        old = self._corner_covariance
        new = old.copy()
        new[:3, 3:] = transition @ old[:3, 3:]
        new[3:, :3] = new[:3, 3:].T
        new[:3, :3] = transition @ old[:3, :3] @ transition.T + noise @ noise.T
        self._corner_covariance = new
        to_world(new, poses[-1, 2], self._covariances.view[-1])

    def linearization(self) -> Linearization:
        """Copy of the Jacobian blocks."""
        return Linearization(
            prior=self._prior.copy(),
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

    def _eliminate(self, first: int, row: int) -> None:
        eliminate(
            first,
            len(self._covariances) - 1,
            row,
            self._odometry_from.view,
            self._odometry_to.view,
            *self._sightings,
            self._corner,
            self._pivots.view,
            self._gains.view,
            self._borders.view,
            self._widths.view,
            self._checkpoints.view,
        )
        self._eliminated = len(self._covariances) - 1
