"""The dynamic window approach (Fox et al. 1997) with MRPB's constants, the local planner of §4.2.

The costs are those of ROS's `dwa_local_planner`. Its wavefront from the goal needs no search here: the goal is the
farthest waypoint in sight, to which the straight line is the shortest way.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose, between
from explore_bench.robot.lidar.driving import (
    Limits,
    least_allowed,
    look_ahead,
    nearest_waypoint,
    roll_out,
    turn_in_place,
)
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import Velocity


class DynamicWindow(NamedTuple):
    """Constants of the planner, MRPB's; a named tuple, so compiled functions take it.

    Attributes
    ----------
    limits : of the robot.
    seconds : how long each sample is held.
    speeds, turn_rates : samples of each within what one tick can reach; driving straight is one more.
    least_speed, least_turn_rate : a sample is below at most one of them [m/s, rad/s].
    path_weight, goal_weight : costs of a metre off the path, and from the goal [1/m].
    obstacle_weight : cost of a cost of inflation.
    inflation : clearance beyond the robot's radius at which inflation ends [m].
    decay : of its cost [1/m].
    radius : radius of the robot [m].
    front : distance of the point ahead of the robot that is to be on the path and near the goal, too [m].
    reach : how far along the path its goal may lie [m]: to the border of MRPB's local map.
    """

    limits: Limits
    radius: float
    seconds: float = 1.7
    speeds: int = 3
    turn_rates: int = 20
    least_speed: float = 0.1
    least_turn_rate: float = 0.4
    path_weight: float = 32.0
    goal_weight: float = 20.0
    obstacle_weight: float = 0.02
    inflation: float = 0.5
    decay: float = 10.0
    front: float = 0.325
    reach: float = 2.75

    @classmethod
    def of(cls, scenario: LidarScenario) -> DynamicWindow:
        """Return the planner of a scenario."""
        return cls(Limits.of(scenario), scenario.robot_radius)

    def command(self, pose: Pose, velocity: Velocity, path: Array, clearance: Array, grid: Grid) -> Velocity:
        """Next command along a path; see `LocalPlanner.command`."""
        return _command(self, pose, velocity, path, clearance, grid)


@jit
def _command(
    window: DynamicWindow, pose: Pose, velocity: Velocity, path: Array, clearance: Array, grid: Grid
) -> Velocity:
    limits = window.limits
    nearest, goal = look_ahead(limits, pose, path, window.reach, clearance, grid)
    x, y, _ = between(pose, (path[goal, 0], path[goal, 1], 0.0))
    allowed = least_allowed(limits, pose, clearance, grid)
    dv, dw = limits.acceleration * limits.tick, limits.turn_acceleration * limits.tick
    slowest, fastest = max(velocity[0] - dv, 0.0), min(velocity[0] + dv, limits.max_speed)
    left, right = max(velocity[1] - dw, -limits.max_turn_rate), min(velocity[1] + dw, limits.max_turn_rate)
    best, least = turn_in_place(limits, velocity, math.atan2(y, x)), math.inf
    for i in range(window.speeds):
        v = slowest + (fastest - slowest) * i / (window.speeds - 1)
        for j in range(window.turn_rates + 1):
            w = left + (right - left) * j / (window.turn_rates - 1)
            if j == window.turn_rates:
                w = min(max(0.0, left), right)
            if v < window.least_speed and abs(w) < window.least_turn_rate:
                continue
            room, end = roll_out(limits, pose, velocity, (v, w), window.seconds, clearance, grid)
            if v > 0.0 and room < allowed:
                continue
            cost = _cost(window, end, path, nearest, goal, math.hypot(x, y), room)
            if cost < least:
                best, least = (v, w), cost
    return best


@jit
def _cost(
    window: DynamicWindow, end: Pose, path: Array, nearest: int, goal: int, distance: float, room: float
) -> float:
    """Cost of a sample that ends at a pose, with a least clearance of `room` [m] on its way."""
    path_weight, goal_weight = 0.5 * window.path_weight, 0.5 * window.goal_weight  # ROS halves them
    x, y = path[goal, 0], path[goal, 1]
    cost = path_weight * nearest_waypoint(path, end[0], end[1], nearest, goal)[1]
    cost += goal_weight * math.hypot(end[0] - x, end[1] - y)
    front_x, front_y = end[0] + window.front * math.cos(end[2]), end[1] + window.front * math.sin(end[2])
    cost += goal_weight * math.hypot(front_x - x, front_y - y)
    if distance > window.front:  # so near, the point ahead is past the path's end
        cost += path_weight * nearest_waypoint(path, front_x, front_y, nearest, goal)[1]
    if room < window.radius + window.inflation:
        cost += window.obstacle_weight * 252.0 * math.exp(-window.decay * max(room - window.radius, 0.0))
    return cost
