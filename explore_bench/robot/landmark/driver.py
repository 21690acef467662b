"""Path following: from an estimated pose and the waypoints ahead to motion commands."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Pose, compose, wrap_angle
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.signals import Command


class Driver(NamedTuple):
    """The rule by which the robot drives: turn when the bearing is off by more than a threshold, else go straight.

    An open loop looks at no estimate on the way: one turn to the waypoint, of 0° even, as many full steps as there is
    room for, and one of the rest ([8]'s planner). A named tuple, so compiled functions take it.

    Attributes
    ----------
    step_length : longest straight command [m].
    turn_threshold : bearing error that asks for a turn in place [rad].
    arrival_radius : distance at which a waypoint is reached [m].
    open_loop : whether it drives so.
    """

    step_length: float
    turn_threshold: float
    arrival_radius: float
    open_loop: bool = False

    @classmethod
    def of(cls, scenario: LandmarkScenario) -> Driver:
        """Return the driver of a scenario."""
        threshold = math.radians(scenario.turn_threshold_deg)
        return cls(scenario.step_length, threshold, scenario.arrival_radius, scenario.planner == "straight")

    def command(self, pose: Pose, waypoint: tuple[float, float]) -> Command | None:
        """Next command towards a waypoint [m] in a closed loop, or None when it is reached."""
        turn, forward = _command(self, pose, waypoint)
        return None if turn == 0.0 and forward == 0.0 else (turn, forward)

    def follow(self, pose: Pose, waypoints: Array) -> Array:
        """Commands that follow waypoints of shape (W, 2) [m] without noise, as rows (turn, forward), shape (K, 2)."""
        return _follow(self, pose, waypoints)


@jit
def _command(driver: Driver, pose: Pose, waypoint: tuple[float, float]) -> Command:
    """Next command towards a waypoint; (0, 0) when it is reached."""
    dx, dy = waypoint[0] - pose[0], waypoint[1] - pose[1]
    distance = math.hypot(dx, dy)
    if distance <= driver.arrival_radius:
        return 0.0, 0.0
    turn = wrap_angle(math.atan2(dy, dx) - pose[2])
    if abs(turn) > driver.turn_threshold:
        return turn, 0.0
    return 0.0, min(driver.step_length, distance)


@jit
def next_command(driver: Driver, pose: Pose, waypoint: tuple[float, float], stage: int) -> tuple[float, float, int]:
    """Next command (turn, forward) towards a waypoint [m], and the stage of the drive after it; −1: it is reached.

    The stage is 0 at first. In a closed loop nothing depends on it; an open loop turns once, and ends after a step that
    is shorter than a full one.
    """
    if not driver.open_loop:
        turn, forward = _command(driver, pose, waypoint)
        return turn, forward, -1 if turn == 0.0 and forward == 0.0 else 0
    dx, dy = waypoint[0] - pose[0], waypoint[1] - pose[1]
    if stage == 0:
        return wrap_angle(math.atan2(dy, dx) - pose[2]), 0.0, 1
    if stage == 1:
        left = math.hypot(dx, dy)
        return 0.0, min(left, driver.step_length), 1 if left >= driver.step_length else 2
    return 0.0, 0.0, -1


@jit
def _follow(driver: Driver, pose: Pose, waypoints: Array) -> Array:
    commands = []
    for w in range(waypoints.shape[0]):
        waypoint, stage = (waypoints[w, 0], waypoints[w, 1]), 0
        while True:
            turn, forward, stage = next_command(driver, pose, waypoint, stage)
            if stage < 0:
                break
            commands.append((turn, forward))
            pose = compose(pose, (forward, 0.0, turn))
    result = np.empty((len(commands), 2))
    for k in range(len(commands)):
        result[k, 0], result[k, 1] = commands[k]
    return result
