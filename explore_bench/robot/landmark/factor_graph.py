"""The only importer of gtsam: incremental smoothing (iSAM2) over prior, odometry and bearing-range factors."""

from __future__ import annotations

import math

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Pose, compose
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.signals import Odometry, Sightings

UNMOVED = 1e-9
"""Change of an estimate [m, rad] that counts as none."""

TORN = 20.0
"""Standard deviations of its odometry beyond which a step of the estimate is none that a robot took."""


class FactorGraph:
    """The SLAM graph and its current estimate.

    Landmarks are numbered in the order of their first sighting; `landmark_ids` maps back to the sensor's ids.

    Attributes
    ----------
    pose : newest estimated pose, as read last.
    """

    def __init__(self, scenario: LandmarkScenario, start: Pose) -> None:
        self._start = start
        self._parameters = gtsam.ISAM2Params()
        self._parameters.setRelinearizeThreshold(scenario.relinearize_threshold)
        self._parameters.relinearizeSkip = scenario.relinearize_interval
        self._isam = gtsam.ISAM2(self._parameters)
        noise = scenario.noise
        self._prior = _sigmas(noise.prior, noise.prior, noise.prior_heading)
        self._sighting = _sigmas(noise.bearing, noise.range)
        self._noise: dict[tuple[float, float, float], gtsam.noiseModel.Diagonal] = {}
        self._number: dict[int, int] = {}
        self._steps = -1
        self._reach = 0.0
        self._settled: tuple[Array, Array] = np.empty((0, 3)), np.empty((0, 2))
        self._guesses: tuple[list[Pose], list[Array]] = [], []
        self.pose: Pose = start

    @property
    def landmark_ids(self) -> list[int]:
        """Sensor's id of each landmark, in the order of first sighting."""
        return list(self._number)

    def numbers(self, ids: np.ndarray) -> list[int]:
        """Numbers, by first sighting, of landmarks already in the graph."""
        return [self._number[int(i)] for i in ids]

    def add(self, odometry: Odometry | None, sightings: Sightings) -> bool:
        """Add a step: its odometry factor (the prior at the first, where there is none) and its sightings.

        Returns whether estimates of earlier variables changed. Without a sighting the new pose is a leaf whose
        factor the estimate satisfies, so nothing else moves unless iSAM2 goes on to converge.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._steps += 1
        key = X(self._steps)
        if odometry is None:
            guess = self._start
            graph.add(gtsam.PriorFactorPose2(key, gtsam.Pose2(*guess), self._prior))
        else:
            guess = compose(self.pose, odometry.motion)
            motion = gtsam.Pose2(*odometry.motion)
            if odometry.sigmas not in self._noise:
                self._noise[odometry.sigmas] = _sigmas(*odometry.sigmas)
            graph.add(gtsam.BetweenFactorPose2(X(self._steps - 1), key, motion, self._noise[odometry.sigmas]))
            reach = math.hypot(*odometry.motion[:2]) + TORN * math.hypot(*odometry.sigmas[:2])
            self._reach = max(self._reach, reach)
        values.insert(key, gtsam.Pose2(*guess))
        self._guesses[0].append(guess)
        for landmark, bearing, distance in zip(
            sightings.landmarks.tolist(), sightings.bearings.tolist(), sightings.ranges.tolist(), strict=True
        ):
            number = self._number.get(landmark)
            if number is None:
                number = self._number[landmark] = len(self._number)
                angle = guess[2] + bearing
                point = np.array([guess[0] + distance * math.cos(angle), guess[1] + distance * math.sin(angle)])
                values.insert(L(number), point)
                self._guesses[1].append(point)
            graph.add(gtsam.BearingRangeFactor2D(key, L(number), gtsam.Rot2(bearing), distance, self._sighting))
        solved_anew = self._update(graph, values)
        return odometry is None or len(sightings.landmarks) > 0 or solved_anew or self._has_moved(self._steps - 1)

    def _update(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> bool:
        """Give iSAM2 new factors and variables; returns whether the whole graph was solved anew.

        gtsam's Cholesky gives up where the last two pivots of a clique differ by 2¹², which a long drive without a
        landmark reaches though nothing is undetermined. QR has no such rule, at some cost, so it takes over from there.
        """
        try:
            self._isam.update(graph, values)
        except RuntimeError:
            if self._isam.params().getFactorization() == "QR":
                raise
            taken_in, at = self._isam.getFactorsUnsafe(), self._isam.getLinearizationPoint()
            self._parameters.setFactorization("QR")
            self._isam = gtsam.ISAM2(self._parameters)
            self._isam.update(taken_in, at)
            return True
        return False

    def newest_pose(self) -> Pose:
        """Estimate of the newest pose."""
        self.pose = self._pose_estimate(self._steps)
        return self.pose

    def _pose_estimate(self, step: int) -> Pose:
        pose = self._isam.calculateEstimatePose2(X(step))
        return pose.x(), pose.y(), pose.theta()

    def _has_moved(self, step: int) -> bool:
        """Whether the pose that was the newest before this step is no longer where it was.

        iSAM2 solves from the root of its Bayes tree, which holds the newest poses, downwards: while they stand
        still, so does everything below.
        """
        now = self._pose_estimate(step)
        return max(abs(a - b) for a, b in zip(now, self.pose, strict=True)) > UNMOVED

    def estimate(self) -> tuple[Array, Array]:
        """Estimates of all poses, shape (N, 3), and landmarks, shape (M, 2), in order.

        Raises
        ------
        RuntimeError : where they do not converge.
        """
        poses, landmarks = self._read()
        if self._is_torn(poses):
            self._solve_anew()
            poses, landmarks = self._read()
            if self._is_torn(poses):
                raise RuntimeError("the estimate of the trajectory does not converge")
        self._settled, self._guesses = (poses, landmarks), ([], [])
        x, y, heading = poses[-1].tolist()
        self.pose = (x, y, heading)
        return poses, landmarks

    def _read(self) -> tuple[Array, Array]:
        values = self._isam.calculateEstimate()
        poses = gtsam.utilities.extractPose2(values)
        landmarks = np.empty((len(self._number), 2))
        for number in range(len(landmarks)):  # few: `extractPoint2` goes through all poses again
            landmarks[number] = values.atPoint2(L(number))
        return poses, landmarks

    def _is_torn(self, poses: Array) -> bool:
        """Whether two poses in a row lie farther apart than the longest step and TORN of its deviations."""
        return _longest_step(poses) > self._reach

    def _solve_anew(self) -> None:
        """Solve the whole graph from the estimates before, and let iSAM2 go on from there.

        A Gauss-Newton step, which is what iSAM2 takes, may go too far where a loop is closed after a long way, and from
        there on ever farther. Levenberg and Marquardt's are damped; they cost as much as some hundred updates.
        """
        values = gtsam.Values()
        for step, pose in enumerate([*self._settled[0].tolist(), *self._guesses[0]]):
            values.insert(X(step), gtsam.Pose2(*pose))
        for number, point in enumerate([*self._settled[1], *self._guesses[1]]):
            values.insert(L(number), point)
        graph, parameters = self._isam.getFactorsUnsafe(), gtsam.LevenbergMarquardtParams()
        parameters.setLinearSolverType(f"MULTIFRONTAL_{self._parameters.getFactorization()}")
        found = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
        self._isam = gtsam.ISAM2(self._parameters)
        self._update(graph, found)


def _sigmas(*values: float) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))


@jit
def _longest_step(poses: Array) -> float:
    """Longest way from a pose to the next [m], 0 where there is none."""
    longest = 0.0
    for k in range(poses.shape[0] - 1):
        longest = max(longest, math.hypot(poses[k + 1, 0] - poses[k, 0], poses[k + 1, 1] - poses[k, 1]))
    return longest
