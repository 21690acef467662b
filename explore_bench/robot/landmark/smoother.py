"""SLAM step by step: estimates, all covariances, virtual map and occupancy after every scan.

A step that sights a landmark moves the whole trajectory, so everything is computed anew. A step that does not
leaves all but the newest pose as it was, and each part is extended by that pose alone; both give the same numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Array, Pose, cells_of
from explore_bench.robot.belief import Belief, freeze, peak_traces
from explore_bench.robot.landmark.factor_graph import FactorGraph
from explore_bench.robot.landmark.graph import LandmarkGraph
from explore_bench.robot.landmark.growing import Rows
from explore_bench.robot.landmark.marginals import Marginals
from explore_bench.robot.occupancy import OccupancyMap
from explore_bench.robot.timing import Lap, no_lap
from explore_bench.robot.virtual_map import NOTHING_HIDDEN, VirtualMap, key_poses
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.signals import Odometry, Patch, Scan


class Smoother:
    """The robot's SLAM: one `update` a step; `belief` freezes what is known after it.

    Attributes
    ----------
    landmarks : estimates [m] in the order of first sighting, shape (M, 2).
    virtual_map, occupancy : maps as functions of the estimates.
    """

    def __init__(self, scenario: LandmarkScenario, start: Pose, lap: Lap = no_lap) -> None:
        self.scenario = scenario
        self._lap = lap
        self._graph = FactorGraph(scenario, start)
        self._marginals = Marginals(scenario)
        self._poses = Rows((3,))
        self._patches: Rows | None = None
        self._origins = Rows((3,))
        self._peak = (0.0, 0.0)
        self.landmarks: Array = np.empty((0, 2))
        self.virtual_map = VirtualMap(scenario)
        self.occupancy = OccupancyMap(scenario)

    def update(self, odometry: Odometry | None, scan: Scan) -> None:
        """Take in one step: the odometry of it (None at the start) and the scan taken after it."""
        moved = self._graph.add(odometry, scan.sightings)
        self._lap("isam2")
        if moved:
            poses, self.landmarks = self._graph.estimate()
            self._poses.resize(len(poses))
            self._poses.view[:] = poses
        else:
            self._poses.append(self._graph.newest_pose())
        self._lap("estimate")
        self._marginals.add(odometry, self._graph.numbers(scan.sightings.landmarks))
        if moved:
            self._marginals.solve(self.poses, self.landmarks)
        else:
            self._marginals.extend(self.poses)
        self._lap("covariances")
        self._keep(scan.view)
        first = 0 if moved else len(self.poses) - 1
        if moved:
            self.virtual_map.clear()
            self.occupancy.clear()
            self._peak = (0.0, 0.0)
        self._fuse(first)
        self._lap("virtual map")
        self.occupancy.place(self.poses[first:], self._scans[0][first:], self._scans[1][first:])
        if self.scenario.landmarks_occupy:
            self.occupancy.occupy(cells_of(self.scenario.grid, self.landmarks))
        self._peak = peak_traces(self.pose_covariances[first:], *self._peak)
        self._lap("occupancy")

    @property
    def poses(self) -> Array:
        """Estimated trajectory, shape (N, 3)."""
        return self._poses.view

    @property
    def pose(self) -> Pose:
        """Newest estimated pose."""
        return self._graph.pose

    @property
    def pose_covariances(self) -> Array:
        """Marginal of every pose in the world frame, shape (N, 3, 3)."""
        return self._marginals.pose_covariances

    @property
    def landmark_covariances(self) -> Array:
        """Marginal of every landmark, shape (M, 2, 2)."""
        return self._marginals.landmark_covariances

    @property
    def peak_traces(self) -> tuple[float, float]:
        """Largest trace over the trajectory of the 3 × 3 covariance [m² + rad²] and of its position block [m²]."""
        return self._peak

    def belief(self) -> Belief:
        """Freeze what is known; later updates leave it untouched."""
        shape = self.scenario.grid.shape
        belief = Belief(
            scenario=self.scenario.twin,
            poses=self.poses.copy(),
            pose_covariances=self.pose_covariances.copy(),
            landmarks=self.landmarks.copy(),
            landmark_covariances=self.landmark_covariances.copy(),
            landmark_ids=np.array(self._graph.landmark_ids, dtype=np.int64),
            occupancy=self.occupancy.probability.reshape(shape),
            known=self.occupancy.known.copy().reshape(shape),
            virtual_map=self.virtual_map.covariances.copy().reshape(*shape, 3),
            uncertainty=self.virtual_map.uncertainty,
            peak_trace=self._peak[0],
            graph=LandmarkGraph(self._marginals.linearization(), self._marginals.elimination()),
        )
        freeze(belief)
        return belief

    def _keep(self, patch: Patch) -> None:
        if self._patches is None:
            self._patches = Rows(patch.cells.shape, np.uint8)
        self._patches.append(patch.cells)
        self._origins.append((*patch.origin, patch.heading))

    @property
    def _scans(self) -> tuple[NDArray[Any], NDArray[Any]]:
        assert self._patches is not None
        return self._patches.view, self._origins.view

    def _fuse(self, first: int) -> None:
        used = key_poses(self.poses, self.scenario.key_pose_spacing)[first:]
        scans = NOTHING_HIDDEN
        if self.scenario.occlusion:
            scans = self._scans[0][first:], self._scans[1][first:]
        self.virtual_map.fuse(self.poses[first:], self.pose_covariances[first:], used, scans)
