"""Regulated pure pursuit (Macenski et al. 2023, with nav2's constants), whose look-ahead is in sight."""

from __future__ import annotations

import math
from typing import NamedTuple

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose, between
from explore_bench.geometry.rays import clearance_at
from explore_bench.robot.lidar.driving import (
    Limits,
    least_allowed,
    look_ahead,
    roll_out,
    turn_in_place,
)
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import Velocity


class Pursuit(NamedTuple):
    """Constants of the planner, nav2's defaults; a named tuple, so compiled functions take it.

    Attributes
    ----------
    limits : of the robot.
    reach : look-ahead along the path [m].
    turn_above : heading error above which the robot turns in place [rad].
    tight_radius : radius of curves [m] below which it slows down in proportion.
    near : clearance [m] below which it slows down in proportion.
    slow : speed [m/s] below which neither of the two slows it down.
    approach : length of path left [m] below which it slows down in proportion.
    creep : speed [m/s] at which it reaches the goal.
    foresight : seconds for which a command must be safe.
    """

    limits: Limits
    reach: float = 0.6
    turn_above: float = 0.785
    tight_radius: float = 0.9
    near: float = 0.6
    slow: float = 0.25
    approach: float = 0.6
    creep: float = 0.05
    foresight: float = 1.0

    @classmethod
    def of(cls, scenario: LidarScenario) -> Pursuit:
        """Return the planner of a scenario."""
        return cls(Limits.of(scenario))

    def command(self, pose: Pose, velocity: Velocity, path: Array, clearance: Array, grid: Grid) -> Velocity:
        """Next command along a path; see `LocalPlanner.command`."""
        return _command(self, pose, velocity, path, clearance, grid)


@jit
def _command(pursuit: Pursuit, pose: Pose, velocity: Velocity, path: Array, clearance: Array, grid: Grid) -> Velocity:
    limits = pursuit.limits
    nearest, ahead = look_ahead(limits, pose, path, pursuit.reach, clearance, grid)
    x, y, _ = between(pose, (path[ahead, 0], path[ahead, 1], 0.0))
    distance2 = x * x + y * y
    if distance2 < 1e-4:
        return 0.0, 0.0
    angle = math.atan2(y, x)
    if abs(angle) > pursuit.turn_above:
        return turn_in_place(limits, velocity, angle)
    curvature = 2.0 * y / distance2
    speed = _regulated(pursuit, curvature, clearance_at(clearance, grid, pose[0], pose[1]))
    speed = min(speed, _approaching(pursuit, path, nearest))
    # What lies beyond the point aimed at is another command's; of two speeds that are too fast the slower may be safe.
    allowed = least_allowed(limits, pose, clearance, grid)
    for _ in range(3):
        command = (speed, curvature * speed)
        seconds = min(pursuit.foresight, math.sqrt(distance2) / speed)
        if roll_out(limits, pose, velocity, command, seconds, clearance, grid)[0] >= allowed:
            return command
        speed *= 0.5
    return turn_in_place(limits, velocity, angle)


@jit
def _regulated(pursuit: Pursuit, curvature: float, room: float) -> float:
    """Speed [m/s] on an arc of a curvature [1/m] where the clearance is `room` [m]."""
    limits = pursuit.limits
    in_curve = limits.max_speed * min(1.0, 1.0 / max(abs(curvature) * pursuit.tight_radius, 1e-9))
    in_room = limits.max_speed * min(1.0, room / pursuit.near)
    speed = max(min(in_curve, in_room), min(pursuit.slow, limits.max_speed))
    return min(speed, limits.max_turn_rate / max(abs(curvature), 1e-9))


@jit
def _approaching(pursuit: Pursuit, path: Array, nearest: int) -> float:
    """Speed [m/s] that the length of the path from a waypoint to its end leaves."""
    left = 0.0
    for i in range(nearest, path.shape[0] - 1):
        left += math.hypot(path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1])
        if left >= pursuit.approach:
            return math.inf
    return max(pursuit.limits.max_speed * left / pursuit.approach, pursuit.creep)
