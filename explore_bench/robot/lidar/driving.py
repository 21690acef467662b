"""What every local planner asks: where a command takes the robot, how much room is there, what of the path is in sight.

Clearances are those of the robot's own map; nothing here is true.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose, compose
from explore_bench.geometry.rays import clearance_at
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import Velocity

SLACK = (
    0.01  # what a drive may be nearer to a wall than what is in sight, so that a line in sight can be driven [m] (ours)
)
ALIGNED = 0.02  # heading error at which a turn in place has done its work [rad] (ours)


class Limits(NamedTuple):
    """What the robot can do, and how near to what it believes to be a wall it may come; for compiled functions.

    Attributes
    ----------
    max_speed, max_turn_rate : bounds of the speeds [m/s, rad/s].
    acceleration, turn_acceleration : bounds of their change [m/s², rad/s²].
    tick : seconds of a command.
    sight : clearance [m] of a straight line that counts as in sight.
    least : clearance [m] below which no command leads.
    """

    max_speed: float
    max_turn_rate: float
    acceleration: float
    turn_acceleration: float
    tick: float
    sight: float
    least: float

    @classmethod
    def of(cls, scenario: LidarScenario) -> Limits:
        """Return the limits of a scenario."""
        return cls(
            scenario.max_speed,
            scenario.max_turn_rate,
            scenario.acceleration,
            scenario.turn_acceleration,
            scenario.tick,
            scenario.lethal_radius,
            scenario.lethal_radius - SLACK,
        )


@jit
def between_bounds(value: float, low: float, high: float) -> float:
    """Return the value, or the bound that it is beyond."""
    return min(max(value, low), high)


@jit
def roll_out(
    limits: Limits, pose: Pose, velocity: Velocity, command: Velocity, seconds: float, clearance: Array, grid: Grid
) -> tuple[float, Pose]:
    """Where a command held for some seconds (at least a tick) leads, at the accelerations that the robot has.

    Returns
    -------
    The least clearance on the way [m], and the pose at its end.
    """
    v, w = velocity
    least = math.inf
    for _ in range(max(math.ceil(seconds / limits.tick - 1e-9), 1)):
        dv, dw = limits.acceleration * limits.tick, limits.turn_acceleration * limits.tick
        v, w = between_bounds(command[0], v - dv, v + dv), between_bounds(command[1], w - dw, w + dw)
        # The chord of the arc, its length but for (w tick)²/24.
        half = 0.5 * w * limits.tick
        step = v * limits.tick
        pose = compose(pose, (step * math.cos(half), step * math.sin(half), 2.0 * half))
        least = min(least, clearance_at(clearance, grid, pose[0], pose[1]))
    return least, pose


@jit
def least_allowed(limits: Limits, pose: Pose, clearance: Array, grid: Grid) -> float:
    """Least clearance [m] of a drive from a pose: from where there is less, the robot may leave but get no nearer."""
    return min(limits.least, clearance_at(clearance, grid, pose[0], pose[1]))


@jit
def in_sight(start: Pose, x: float, y: float, least: float, clearance: Array, grid: Grid) -> bool:
    """Whether the straight line from a pose to the point (x, y) [m] keeps a clearance of `least` [m]."""
    dx, dy = x - start[0], y - start[1]
    steps = max(math.ceil(2.0 * math.hypot(dx, dy) / grid.resolution), 1)
    for k in range(1, steps + 1):
        if clearance_at(clearance, grid, start[0] + dx * k / steps, start[1] + dy * k / steps) < least:
            return False
    return True


@jit
def nearest_waypoint(path: Array, x: float, y: float, first: int, last: int) -> tuple[int, float]:
    """The waypoint nearest to a point among those from `first` to `last`, and its distance [m]."""
    nearest, least = first, math.inf
    for i in range(first, last + 1):
        square = (path[i, 0] - x) ** 2 + (path[i, 1] - y) ** 2
        if square < least:
            nearest, least = i, square
    return nearest, math.sqrt(least)


@jit
def look_ahead(limits: Limits, pose: Pose, path: Array, reach: float, clearance: Array, grid: Grid) -> tuple[int, int]:
    """What of the path counts now.

    Parameters
    ----------
    path : waypoints [m], shape (W, 2).
    reach : how far along the path to look [m].

    Returns
    -------
    The waypoint nearest to the robot, and the farthest within reach that is in sight: aiming beyond it would cut a
    corner. Where none is, the waypoint after the nearest.

    Raises
    ------
    ValueError : for a path without waypoints.
    """
    if path.shape[0] == 0:
        raise ValueError("a path has at least one waypoint")
    goal = path.shape[0] - 1
    nearest, _ = nearest_waypoint(path, pose[0], pose[1], 0, goal)
    farthest, length = nearest, 0.0
    while farthest < goal:
        length += math.hypot(path[farthest + 1, 0] - path[farthest, 0], path[farthest + 1, 1] - path[farthest, 1])
        if length > reach + 1e-9:
            break
        farthest += 1
    sight = min(limits.sight, clearance_at(clearance, grid, pose[0], pose[1]))
    while farthest > nearest and not in_sight(pose, path[farthest, 0], path[farthest, 1], sight, clearance, grid):
        farthest -= 1
    return nearest, min(max(farthest, nearest + 1), goal)


@jit
def turn_in_place(limits: Limits, velocity: Velocity, angle: float) -> Velocity:
    """Command that turns by an angle [rad] without driving, as fast as the robot can still stop.

    One that rolls brakes first, on the arc that it is on: that this is free was seen when the arc was chosen.
    """
    rolling = velocity[0] - limits.acceleration * limits.tick
    if rolling > 0.0:
        return 0.0, velocity[1] * rolling / velocity[0]
    if abs(angle) <= ALIGNED:
        return 0.0, 0.0
    rate = min(limits.max_turn_rate, math.sqrt(limits.turn_acceleration * abs(angle)), abs(angle) / limits.tick)
    return 0.0, math.copysign(rate, angle)
