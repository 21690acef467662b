"""The graph behind a belief, and the belief propagated along a way not driven yet, with measurements as expected.

J. Wang, B. Englot, "Autonomous exploration with expectation-maximization", ISRR 2017 ([25]).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Pose, compose
from explore_bench.robot.belief import Belief, freeze, peak_traces
from explore_bench.robot.landmark.block_arrow import NO_CHECKPOINTS, Elimination, eliminate, invert_corner, recover
from explore_bench.robot.landmark.driver import Driver
from explore_bench.robot.landmark.linearization import Linearization, linearize_odometry, linearize_sightings
from explore_bench.robot.virtual_map import (
    NOTHING_HIDDEN,
    constants_of,
    fuse_poses,
    key_poses,
    prior_of,
    uncertainty,
)
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.scenario import Scenario

NOTHING_KNOWN = 1e-6
"""Information [1/m²] about a landmark that is expected: a standard deviation of a kilometre."""


@dataclass(frozen=True)
class LandmarkPrediction:
    """A `Prediction` in a landmark world.

    The graph is extended by the steps of the path and by a sighting of every known landmark within range of each,
    and solved exactly: covariances of past poses and of landmarks change as they would.

    Attributes
    ----------
    belief : the belief it starts from.
    poses : predicted steps, shape (K, 3).
    sightings : number of landmark sightings along the way.
    landmark_covariances : marginal of each landmark at the end, shape (M, 2, 2).
    pose_covariances : marginals of the past poses and the predicted ones in the world frame, shape (N + K, 3, 3).
    """

    belief: Belief
    poses: Array
    sightings: int
    landmark_covariances: Array
    pose_covariances: Array

    @cached_property
    def virtual_map(self) -> Array:
        """Covariance (xx, xy, yy) of every virtual landmark at the end, shape (rows, columns, 3).

        On the way nothing hides a cell. Where obstacles occlude, cells keep at least the covariance that they have:
        which past pose saw which of them is not part of a belief.
        """
        belief = self.belief
        scenario, past = _physics(belief), len(belief.poses)
        trajectory = np.concatenate((belief.poses, self.poses))
        used = key_poses(trajectory, scenario.key_pose_spacing)
        virtual = belief.virtual_map.reshape(-1, 3).copy()
        prior = prior_of(scenario)
        seen = np.any(virtual != prior, axis=1)
        first = past
        if self.sightings and not scenario.occlusion:  # past covariances changed: their cells change as well
            virtual[:] = prior
            seen[:] = False
            first = 0
        fuse_poses(
            virtual,
            seen,
            trajectory[first:],
            self.pose_covariances[first:],
            used[first:],
            scenario.grid,
            constants_of(scenario),
            *NOTHING_HIDDEN,
        )
        return virtual.reshape(belief.virtual_map.shape)

    @cached_property
    def uncertainty(self) -> float:
        """U of Eq. 1 at the end of the path [m²]."""
        return uncertainty(self.virtual_map.reshape(-1, 3))

    @cached_property
    def peak_trace(self) -> float:
        """Largest tr Σ (3 × 3) of the trajectory at the end [m² + rad²]."""
        return peak_traces(self.pose_covariances)[0]


@dataclass(frozen=True, slots=True)
class LandmarkGraph:
    """The factor graph behind a belief.

    Attributes
    ----------
    linearization : Jacobian blocks of the graph at the belief's estimates.
    elimination : the same graph eliminated up to the newest pose, from which a prediction goes on.
    """

    linearization: Linearization
    elimination: Elimination

    @property
    def closures(self) -> NDArray[np.int64]:
        """None, shape (0, 2): what is seen again is a landmark, and no pose is joined to another."""
        return np.empty((0, 2), dtype=np.int64)

    def predict(self, belief: Belief, places: Array) -> LandmarkPrediction:
        """Propagate the belief exactly along places [m] to drive through in order, shape (P, 2)."""
        return _predict(belief, self.elimination, places)

    def view(self, scenario: Scenario, places: Array) -> NDArray[np.bool_]:
        """Cells whose centre lies within the sensor's range of places [m], shape (K, 2); gives (K, n_g)."""
        return scenario.grid.in_reach(places, scenario.sensor_range)


def expecting(belief: Belief, landmarks: Array) -> Belief:
    """Belief that expects further landmarks at given places [m], shape (K, 2), with nothing known of where they are.

    Its `predict` says what a way would bring in a world that is known: the first sighting of such a landmark makes it
    known as in a trial. Their ids are −1.

    Raises
    ------
    ValueError : where the belief is that of another kind of world.
    """
    graph = belief.graph
    if not isinstance(graph, LandmarkGraph):
        raise ValueError(f"a belief of kind '{belief.scenario.kind}' expects no landmarks; give one of kind 'landmark'")
    more, done = len(landmarks), graph.elimination
    size = len(done.corner)
    corner = np.zeros((size + 2 * more, size + 2 * more))
    corner[:size, :size] = done.corner
    corner[range(size, len(corner)), range(size, len(corner))] = NOTHING_KNOWN
    covariance = np.zeros_like(corner)
    covariance[:size, :size] = done.corner_covariance
    covariance[range(size, len(corner)), range(size, len(corner))] = 1.0 / NOTHING_KNOWN
    borders = np.zeros((len(done.borders), 3, size - 3 + 2 * more))
    borders[:, :, : size - 3] = done.borders[:, :, : size - 3]
    elimination = replace(done, corner=corner, corner_covariance=covariance, borders=borders)
    expected = replace(
        belief,
        landmarks=np.concatenate((belief.landmarks, landmarks)),
        landmark_covariances=np.concatenate(
            (belief.landmark_covariances, np.tile(np.eye(2) / NOTHING_KNOWN, (more, 1, 1)))
        ),
        landmark_ids=np.concatenate((belief.landmark_ids, np.full(more, -1))),
        graph=replace(graph, elimination=elimination),
    )
    freeze(expected)
    return expected


def _physics(belief: Belief) -> LandmarkScenario:
    scenario = belief.scenario
    assert isinstance(scenario, LandmarkScenario)
    return scenario


def _predict(belief: Belief, done: Elimination, places: Array) -> LandmarkPrediction:
    scenario = _physics(belief)
    commands = Driver.of(scenario).follow(belief.pose, places)
    past, added, count = len(belief.poses), len(commands), len(belief.landmarks)
    noise = scenario.noise
    poses, sighting_poses, sighting_landmarks = _roll_out(
        belief.pose, commands, belief.landmarks.copy(), scenario.min_landmark_range, scenario.sensor_range
    )
    odometry_from, odometry_to = np.empty((added, 3, 3)), np.empty((added, 3, 3))
    motions, sigmas = noise.odometries(commands)
    linearize_odometry(0, poses, motions, sigmas, odometry_from, odometry_to)
    of_pose, of_landmark = np.empty((len(sighting_poses), 2, 3)), np.empty((len(sighting_poses), 2, 2))
    linearize_sightings(
        0,
        poses,
        belief.landmarks.copy(),
        sighting_poses,
        sighting_landmarks,
        noise.bearing,
        noise.range,
        of_pose,
        of_landmark,
    )
    corner = done.corner.copy()
    pivots, gains = np.empty((added, 3, 3)), np.empty((added, 3, 3))
    borders, widths = np.empty((added, 3, 2 * count)), np.empty(added, dtype=np.int64)
    eliminate(
        0,
        added,
        0,
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
        NO_CHECKPOINTS,
    )
    corner_covariance = invert_corner(corner)
    covariances = np.empty((past + added, 3, 3))
    # without a sighting the past keeps its covariances, and the walk back may stop at the newest pose
    from_past = slice(None) if len(sighting_poses) else slice(0, 0)
    kept = 0 if len(sighting_poses) else past - 1
    covariances[:kept] = belief.pose_covariances[:kept]
    trajectory_headings = np.concatenate((belief.poses[kept:, 2], poses[1:, 2]))
    recover(
        past + added - 1 - kept,
        corner_covariance,
        np.concatenate((done.pivots[from_past], pivots)),
        np.concatenate((done.gains[from_past], gains)),
        np.concatenate((done.borders[from_past, :, : 2 * count], borders)),
        np.concatenate((done.widths[from_past], widths)),
        trajectory_headings,
        covariances[kept:],
    )
    blocks = corner_covariance[3:, 3:].reshape(count, 2, count, 2)
    return LandmarkPrediction(
        belief=belief,
        poses=poses[1:],
        sightings=len(sighting_poses),
        landmark_covariances=np.einsum("iaib->iab", blocks),
        pose_covariances=covariances,
    )


@jit
def _roll_out(
    pose: Pose, commands: Array, landmarks: Array, min_range: float, max_range: float
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Poses after each command (row 0: the start), and the sightings (row of the pose, landmark) they would make."""
    steps, count = commands.shape[0], landmarks.shape[0]
    poses = np.empty((steps + 1, 3))
    poses[0] = pose
    sighting_poses = np.empty(steps * count, dtype=np.int64)
    sighting_landmarks = np.empty(steps * count, dtype=np.int64)
    k = 0
    for i in range(1, steps + 1):
        pose = compose(pose, (commands[i - 1, 1], 0.0, commands[i - 1, 0]))
        poses[i] = pose
        for m in range(count):
            dx, dy = landmarks[m, 0] - pose[0], landmarks[m, 1] - pose[1]
            distance2 = dx * dx + dy * dy
            if min_range * min_range <= distance2 <= max_range * max_range:
                sighting_poses[k] = i
                sighting_landmarks[k] = m
                k += 1
    return poses, sighting_poses[:k].copy(), sighting_landmarks[:k].copy()
