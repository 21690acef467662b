"""SLAM, the virtual map and the grid of decisions tied together: one `update` a key pose, and the belief after it."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Pose
from explore_bench.robot.belief import Belief, freeze, peak_traces
from explore_bench.robot.lidar.decision_grid import known, occupancy, patch_reach, seen_patch
from explore_bench.robot.lidar.graph import LidarGraph
from explore_bench.robot.lidar.pose_graph import Link
from explore_bench.robot.lidar.slam import Slam
from explore_bench.robot.timing import Lap, no_lap
from explore_bench.robot.virtual_map import VirtualMap, key_poses
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import RangeScan


class Mapper:
    """What the robot makes of its scans.

    Attributes
    ----------
    slam : poses, their covariances and the fine map.
    virtual_map : on the grid of decisions; a cell that a scan did not reach is not fused.
    peak_traces : largest trace over the trajectory of the 3 × 3 covariance [m² + rad²], and of its position block [m²].
    """

    def __init__(self, scenario: LidarScenario, start: Pose, scan: RangeScan, lap: Lap = no_lap) -> None:
        self.scenario, self._lap = scenario, lap
        self.slam = Slam(scenario, start, scan, lap)
        self.virtual_map = VirtualMap(scenario)
        self.peak_traces = (0.0, 0.0)
        self._reach = patch_reach(scenario)
        middle = (self._reach + 0.5) * scenario.cell_size
        self._origin = np.array([middle, middle, 0.0])
        self._patches = [self._patch(scan)]
        self._fuse(0)

    def update(self, motion: Pose, length: float, turned: float, scan: RangeScan) -> float:
        """Take in a key pose; see `Slam.update`."""
        refreshed = self.slam.refreshed
        shift = self.slam.update(motion, length, turned, scan)
        self._patches.append(self._patch(scan))
        anew = self.slam.refreshed > refreshed
        if anew:
            self.virtual_map.clear()
            self.peak_traces = (0.0, 0.0)
        self._fuse(0 if anew else len(self._patches) - 1)
        self._lap("virtual map")
        return shift

    def belief(self) -> Belief:
        """Freeze what is known; later updates leave it untouched."""
        scenario, slam = self.scenario, self.slam
        shape, fine = scenario.grid.shape, slam.map.frozen()
        belief = Belief(
            scenario=scenario.twin,
            poses=slam.poses.copy(),
            pose_covariances=slam.covariances.copy(),
            landmarks=np.empty((0, 2)),
            landmark_covariances=np.empty((0, 2, 2)),
            landmark_ids=np.empty(0, dtype=np.int64),
            occupancy=occupancy(slam.map, scenario),
            known=known(slam.map, scenario),
            virtual_map=self.virtual_map.covariances.copy().reshape(*shape, 3),
            uncertainty=self.virtual_map.uncertainty,
            peak_trace=self.peak_traces[0],
            graph=LidarGraph(slam.poses.copy(), tuple(map(_own, slam.links)), deepcopy(slam.odometry), fine),
            fine=fine,
        )
        freeze(belief)
        return belief

    def _patch(self, scan: RangeScan) -> NDArray[np.uint8]:
        return seen_patch(scan.ranges, self.scenario.sensor_range, self.scenario.cell_size, self._reach)

    def _fuse(self, first: int) -> None:
        slam = self.slam
        used = key_poses(slam.poses, self.scenario.key_pose_spacing)[first:]
        patches = np.stack(self._patches[first:])
        origins = np.tile(self._origin, (len(patches), 1))
        self.virtual_map.fuse(slam.poses[first:], slam.covariances[first:], used, (patches, origins))
        self.peak_traces = peak_traces(slam.covariances[first:], *self.peak_traces)


def _own(link: Link) -> Link:
    """Link whose covariance nobody shares, and nobody writes."""
    covariance = link.covariance.copy()
    covariance.setflags(write=False)
    return link._replace(covariance=covariance)
