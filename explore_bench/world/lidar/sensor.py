"""The lidar: exact ranges to the true cells by ray casting, with noise."""

from __future__ import annotations

import numpy as np

from explore_bench.geometry import Pose
from explore_bench.geometry.rays import cast, leaps
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.world import LidarWorld
from explore_bench.world.signals import RangeScan


class Lidar:
    """A lidar that turns once around at every scan; between two key frames it is not read."""

    def __init__(self, scenario: LidarScenario, world: LidarWorld, rng: np.random.Generator) -> None:
        self._rng = rng
        self._obstacles, self._grid = world.obstacles, world.grid
        self._leaps = leaps(world.obstacles, world.grid)
        self._beams, self._range, self._sigma = scenario.beams, scenario.sensor_range, scenario.range_sigma

    def scan(self, pose: Pose) -> RangeScan:
        """Scan taken at a true pose. A standard normal a beam is drawn, whatever the beam meets."""
        ranges = cast(pose, self._beams, self._range, self._obstacles, self._leaps, self._grid)
        noisy = ranges + self._sigma * self._rng.standard_normal(self._beams)
        return RangeScan(np.maximum(noisy, 0.0))
