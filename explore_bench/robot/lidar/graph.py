"""The pose graph behind a belief, and the belief propagated along a way not driven yet, with matches as expected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Array, Pose, between, compose, wrap_angle
from explore_bench.geometry.rays import cast, leaps
from explore_bench.robot.belief import Belief, FineMap, peak_traces
from explore_bench.robot.lidar.closures import chains
from explore_bench.robot.lidar.decision_grid import patch_reach, seen_patch
from explore_bench.robot.lidar.pose_graph import Link, PoseGraph
from explore_bench.robot.lidar.slam import (
    KEY_DISTANCE,
    KEY_TURN,
    LINK_SPACING,
    LOOP_SPACING,
    WINDOW,
    anchor_at,
    odometry_covariance,
)
from explore_bench.robot.virtual_map import constants_of, fuse_poses, key_poses, prior_of, uncertainty
from explore_bench.world.lidar.scenario import LidarScenario

EXPECTED = np.diag((0.003**2, 0.003**2, 0.0008**2))
"""Covariance of a match that is expected [m, rad]: about the median of those that are made."""

EXPECTED_LAG = 20
"""A match that is expected is measured from the surfaces of so many key poses before."""

EXPECTED_BEAMS = 90
"""Beams of a scan that is expected: what it shows is asked of cells of 2 m."""


@dataclass(frozen=True)
class LidarPrediction:
    """A `Prediction` in a lidar world: the pose graph with the key poses of the way and the links expected there.

    Attributes
    ----------
    belief : the belief it starts from.
    graph : the graph behind that.
    poses : predicted key poses, shape (K, 3).
    sightings : loops that are expected to be closed along the way.
    pose_covariances : marginals of the past poses and the predicted ones in the world frame, shape (N + K, 3, 3).
    """

    belief: Belief
    graph: LidarGraph
    poses: Array
    sightings: int
    pose_covariances: Array

    @property
    def landmark_covariances(self) -> Array:
        """None: there are no landmarks, shape (0, 2, 2)."""
        return np.empty((0, 2, 2))

    @cached_property
    def virtual_map(self) -> Array:
        """Covariance (xx, xy, yy) of every virtual landmark at the end, shape (rows, columns, 3).

        What a predicted pose sees is what the walls that are believed in leave open. Cells keep at least the covariance
        that they have: which past pose saw which of them is not part of a belief.
        """
        belief = self.belief
        scenario = _physics(belief)
        virtual = belief.virtual_map.reshape(-1, 3).copy()
        seen = np.any(virtual != prior_of(scenario), axis=1)
        used = key_poses(np.concatenate((belief.poses, self.poses)), scenario.key_pose_spacing)
        past = len(belief.poses)
        reach = patch_reach(scenario)
        middle = (reach + 0.5) * scenario.cell_size
        patches = [seen_patch(ranges, scenario.sensor_range, scenario.cell_size, reach) for ranges in self._scans()]
        fuse_poses(
            virtual,
            seen,
            self.poses,
            self.pose_covariances[past:],
            used[past:],
            scenario.grid,
            constants_of(scenario),
            np.stack(patches),
            np.tile((middle, middle, 0.0), (len(patches), 1)),
        )
        return virtual.reshape(belief.virtual_map.shape)

    def _scans(self) -> list[Array]:
        reach, fine = self.belief.scenario.sensor_range, self.graph.fine
        return [
            cast((x, y, heading), EXPECTED_BEAMS, reach, fine.occupied, self.graph.leaps, fine.grid)
            for x, y, heading in self.poses.tolist()
        ]

    @cached_property
    def uncertainty(self) -> float:
        """U of Eq. 1 at the end of the path [m²]."""
        return uncertainty(self.virtual_map.reshape(-1, 3))

    @cached_property
    def peak_trace(self) -> float:
        """Largest tr Σ (3 × 3) of the trajectory at the end [m² + rad²]."""
        return peak_traces(self.pose_covariances)[0]


@dataclass(frozen=True, eq=False)
class LidarGraph:
    """The pose graph behind a belief.

    Attributes
    ----------
    links : factors between key poses.
    fine : the map that was made of their scans.
    """

    links: tuple[Link, ...]
    fine: FineMap

    def predict(self, belief: Belief, places: Array) -> LidarPrediction:
        """Propagate the belief along places [m] to drive through in order, shape (P, 2)."""
        poses = _key_poses(belief.pose, places)
        links, closures = self._expected(belief, poses)
        graph = PoseGraph(_pose(belief.poses[0]))
        for pose in (*belief.poses[1:], *poses):
            graph.add_pose(_pose(pose))
        for link in (*self.links, *links):
            graph.add_link(link)
        return LidarPrediction(belief, self, poses, closures, graph.covariances()[0])

    @cached_property
    def leaps(self) -> NDArray[np.float32]:
        """How far a ray goes on from each cell of the map without meeting what is believed to be a wall [m]."""
        return leaps(self.fine.occupied, self.fine.grid)

    def _expected(self, belief: Belief, poses: Array) -> tuple[list[Link], int]:
        """Links that the predicted key poses would bring, and how many of them close a loop."""
        scenario = _physics(belief)
        past = len(belief.poses)
        trajectory = np.concatenate((belief.poses, poses))
        joined: list[list[int]] = [[] for _ in trajectory]
        for link in self.links:
            joined[link.earlier].append(link.later)
            joined[link.later].append(link.earlier)
        links: list[Link] = []

        def add(earlier: int, later: int, covariance: Array, robust: bool = False) -> None:
            motion = between(_pose(trajectory[earlier]), _pose(trajectory[later]))
            links.append(Link(earlier, later, motion, covariance, robust))
            joined[earlier].append(later)
            joined[later].append(earlier)

        closures = 0
        for newest in range(past, len(trajectory)):
            motion = between(_pose(trajectory[newest - 1]), _pose(trajectory[newest]))
            length, turned = math.hypot(motion[0], motion[1]), abs(motion[2])
            add(newest - 1, newest, odometry_covariance(scenario, motion, length, turned))
            add(anchor_at(max(newest - EXPECTED_LAG, 0), newest), newest, EXPECTED)
            for chain in chains(trajectory[: newest + 1], joined, max(newest - WINDOW, 0)):
                if newest % (LINK_SPACING if chain.linked else LOOP_SPACING) == 0:
                    closures += not chain.linked
                    add(chain.closest, newest, EXPECTED, not chain.linked)
        return links, closures


def _physics(belief: Belief) -> LidarScenario:
    scenario = belief.scenario
    assert isinstance(scenario, LidarScenario)
    return scenario


def _pose(row: Array) -> Pose:
    x, y, heading = row.tolist()
    return x, y, heading


def _key_poses(pose: Pose, places: Array) -> Array:
    """Key poses of a drive along straight lines through places, turning in place at each, shape (K, 3), K ≥ 1."""
    found: list[Pose] = []
    for x, y in places.tolist():
        length = math.hypot(x - pose[0], y - pose[1])
        if length < 1e-9:
            continue
        turn = wrap_angle(math.atan2(y - pose[1], x - pose[0]) - pose[2])
        turns = int(abs(turn) // KEY_TURN)
        found += [(pose[0], pose[1], wrap_angle(pose[2] + turn * k / turns)) for k in range(1, turns + 1)]
        pose = (pose[0], pose[1], wrap_angle(pose[2] + turn))
        pieces = max(math.ceil(length / KEY_DISTANCE - 1e-9), 1)
        for _ in range(pieces):
            pose = compose(pose, (length / pieces, 0.0, 0.0))
            found.append(pose)
    return np.array(found or [pose])
