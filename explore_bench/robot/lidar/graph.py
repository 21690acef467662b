"""The pose graph behind a belief, and the belief propagated along a way not driven yet, with matches as expected."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.geometry import Array, Pose, compose, wrap_angle
from explore_bench.geometry.rays import cast, leaps
from explore_bench.robot.belief import Belief, FineMap, peak_traces
from explore_bench.robot.lidar.closures import chains_due, due
from explore_bench.robot.lidar.decision_grid import cells_in_view, patch_reach, seen_patch
from explore_bench.robot.lidar.filtering import betweens, smoothed, turns_of
from explore_bench.robot.lidar.odometry import OdometryModel
from explore_bench.robot.lidar.pose_graph import Link, PoseGraph, Posterior, joins_of, rows_of
from explore_bench.robot.lidar.slam import (
    KEY_DISTANCE,
    KEY_TURN,
    MATCH_COVARIANCE,
    WINDOW,
    anchor_at,
)
from explore_bench.robot.virtual_map import constants_of, fuse_poses, key_poses, prior_of, uncertainty
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.scenario import Scenario

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
        middle = (patch_reach(scenario) + 0.5) * scenario.cell_size
        patches = [self.graph.patch(scenario, _pose(pose)) for pose in self.poses]
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
    poses : estimates of the key poses, shape (N, 3).
    links : factors between them.
    odometry : what is known of it.
    fine : the map that was made of their scans.
    """

    poses: Array
    links: tuple[Link, ...]
    odometry: OdometryModel
    fine: FineMap

    @property
    def closures(self) -> NDArray[np.int64]:
        """Numbers of the two key poses (earlier, later) that each loop closure so far joined, shape (L, 2)."""
        return joins_of([link for link in self.links if link.robust])  # none other may be wrong

    def predict(self, belief: Belief, places: Array) -> LidarPrediction:
        """Propagate the belief along places [m] to drive through in order, shape (P, 2)."""
        poses = _key_poses(belief.pose, places)
        links = self._expected(belief, poses)
        return LidarPrediction(belief, self, poses, links.closures, self._covariances(belief, poses, links))

    @cached_property
    def _posterior(self) -> Posterior:
        graph = PoseGraph(_pose(self.poses[0]))
        for pose in self.poses[1:]:
            graph.add_pose(_pose(pose))
        for link in self.links:
            graph.add_link(link)
        return graph.posterior()

    def _covariances(self, belief: Belief, poses: Array, links: _Expected) -> Array:
        """Marginals in the world frame of the past key poses and the predicted ones, shape (N + K, 3, 3).

        Exact at the cost of a filter over the poses to which a link leads: what these learn is then carried over to
        all others, with which they are correlated.
        """
        past = len(belief.poses)
        tied = np.unique(links.ends[links.ends < past])
        size = 3 * len(tied)
        columns = self._posterior.columns(tied.tolist())
        before = columns[rows_of(tied)]
        places = np.searchsorted(np.concatenate((tied, np.arange(past, past + len(poses)))), links.ends)
        after = smoothed(before, places, links.motions, links.covariances)
        gain = np.linalg.solve(before, columns.T).T
        carried = (gain @ (after[:size, :size] - before)).reshape(past, 3, size)
        learned = np.einsum("pik,pjk->pij", carried, gain.reshape(past, 3, size))
        count = len(poses)
        blocks = after[size:, size:].reshape(count, 3, count, 3)
        new = np.einsum("kikj->kij", blocks)
        turns = turns_of(np.concatenate((belief.poses[:, 2], poses[:, 2])))
        turned = turns @ np.concatenate((learned, new)) @ turns.transpose(0, 2, 1)
        turned[:past] += belief.pose_covariances
        return np.asarray(turned)

    def view(self, scenario: Scenario, places: Array) -> NDArray[np.bool_]:
        """Cells that a scan from places [m], shape (K, 2), would reach if the map was all there is; gives (K, n_g).

        From a place inside a wall it is the view from the nearest free cell of the map.
        """
        fine = self.fine
        columns, rows = np.floor((places.T - [[fine.grid.x0], [fine.grid.y0]]) / fine.grid.resolution).astype(int)
        inside = (columns >= 0) & (columns < fine.grid.columns) & (rows >= 0) & (rows < fine.grid.rows)
        walled = np.zeros(len(places), dtype=bool)
        walled[inside] = fine.occupied[rows[inside], columns[inside]]
        if walled.any():
            nearest = self._nearest_free[:, rows[walled], columns[walled]]
            places = places.copy()
            places[walled] = fine.grid.centres(nearest[0] * fine.grid.columns + nearest[1])
        reach = scenario.sensor_range
        return cells_in_view(places, reach, EXPECTED_BEAMS, fine.occupied, self.leaps, fine.grid, scenario.grid)

    @cached_property
    def _nearest_free(self) -> NDArray[np.int32]:
        """Row and column of the free cell nearest to each cell of the map, shape (2, rows, columns)."""
        walls = ~(self.fine.known & ~self.fine.occupied)
        found: NDArray[np.int32] = ndimage.distance_transform_edt(walls, return_distances=False, return_indices=True)
        return found

    @cached_property
    def leaps(self) -> NDArray[np.float32]:
        """How far a ray goes on from each cell of the map without meeting what is believed to be a wall [m]."""
        return leaps(self.fine.occupied, self.fine.grid)

    @cached_property
    def _joins(self) -> NDArray[np.int64]:
        return joins_of(self.links)

    def _expected(self, belief: Belief, poses: Array) -> _Expected:
        """Links that the predicted key poses would bring."""
        past, total = len(belief.poses), len(belief.poses) + len(poses)
        trajectory = np.concatenate((belief.poses, poses))
        driven = betweens(trajectory[past - 1 : -1], trajectory[past:])
        odometry = self.odometry.covariance(driven, np.hypot(*driven[:, :2].T), np.abs(driven[:, 2]))
        ends: list[tuple[int, int]] = []
        covariances: list[Array] = []

        def add(earlier: int, later: int, covariance: Array) -> None:
            ends.append((earlier, later))
            covariances.append(covariance)

        closures = 0
        for newest in range(past, total):
            add(newest - 1, newest, odometry[newest - past] + MATCH_COVARIANCE)
            add(anchor_at(max(newest - EXPECTED_LAG, 0), newest), newest, MATCH_COVARIANCE)
            if not any(due(newest)):
                continue
            joins = np.concatenate((self._joins, np.array(ends)))
            for chain in chains_due(trajectory[: newest + 1], joins, max(newest - WINDOW, 0)):
                closures += not chain.linked
                add(chain.closest, newest, MATCH_COVARIANCE)
        joins = np.array(ends)
        return _Expected(joins, betweens(*trajectory[joins.T]), np.array(covariances), closures)

    def patch(self, scenario: LidarScenario, pose: Pose) -> NDArray[np.uint8]:
        """Cells around a pose, in its own frame, that a scan there is expected to reach; see `seen_patch`."""
        if pose not in self._patches:  # ways to several candidates begin alike
            reach, fine = scenario.sensor_range, self.fine
            ranges = cast(pose, EXPECTED_BEAMS, reach, fine.occupied, self.leaps, fine.grid)
            self._patches[pose] = seen_patch(ranges, reach, scenario.cell_size, patch_reach(scenario))
        return self._patches[pose]

    @cached_property
    def _patches(self) -> dict[Pose, NDArray[np.uint8]]:
        return {}


class _Expected(NamedTuple):
    """Links that a drive is expected to bring: by their later pose, odometry first.

    Attributes
    ----------
    ends : numbers of the earlier and the later pose, shape (L, 2).
    motions, covariances : as those of a `Link`, shapes (L, 3) and (L, 3, 3).
    closures : how many of them close a loop.
    """

    ends: NDArray[np.int64]
    motions: Array
    covariances: Array
    closures: int


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
