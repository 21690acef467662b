"""How near a robot came to obstacles, and how smoothly it drove: the truth of every tick, summed up."""

from __future__ import annotations

from explore_bench.geometry import Pose
from explore_bench.geometry.rays import clearance_at
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.world import LidarWorld

SAFE_DISTANCE = 0.1
"""Distance of the hull from an obstacle below which a place is unsafe [m] (ours: MRPB's program asks for one, and its
documentation names none)."""


class Ride:
    """What the safety and smoothness of MRPB are computed from (`computeSafety` and `computeVelocitySmoothness`).

    Attributes
    ----------
    clearance : least distance so far of the hull from an obstacle [m], the start included.
    unsafe_seconds : time so far with the hull nearer to one than SAFE_DISTANCE [s].
    speed_change : sum of the magnitudes of the changes of the forward speed from tick to tick [m/s].
    """

    def __init__(self, scenario: LidarScenario, world: LidarWorld) -> None:
        self._grid, self._clearances = world.grid, world.clearance
        self._hull = (
            scenario.robot_radius + 0.5 * scenario.resolution
        )  # an obstacle begins half a cell before its centre
        self._tick, self._speed = scenario.tick, 0.0
        self.clearance = self._room(world.start)
        self.unsafe_seconds = self.speed_change = 0.0

    def tick(self, pose: Pose, speed: float) -> None:
        """Note the true pose and the forward speed [m/s] after a tick."""
        room = self._room(pose)
        self.clearance = min(self.clearance, room)
        if room < SAFE_DISTANCE:
            self.unsafe_seconds += self._tick
        self.speed_change += abs(speed - self._speed)
        self._speed = speed

    def _room(self, pose: Pose) -> float:
        return clearance_at(self._clearances, self._grid, pose[0], pose[1]) - self._hull
