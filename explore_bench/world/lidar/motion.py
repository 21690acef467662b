"""True motion on two wheels: speeds that follow the command, walls that stop it, and the odometry's errors (Stage)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose, compose
from explore_bench.geometry.rays import clearance_at
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.world import LidarWorld

BLOCK = 256  # ticks whose normals are drawn at once: a draw of three costs as much as the tick


class Wheels(NamedTuple):
    """Constants of the robot's motion, which compiled functions take.

    Attributes
    ----------
    max_speed, max_turn_rate : bounds of the speeds [m/s, rad/s].
    acceleration, turn_acceleration : bounds of their change [m/s², rad/s²].
    tick : seconds of a command.
    touch : clearance [m] at which the robot touches an obstacle.
    noise, heading_noise : white noise of the odometry [m/√m, rad/√(m + rad)].
    """

    max_speed: float
    max_turn_rate: float
    acceleration: float
    turn_acceleration: float
    tick: float
    touch: float
    noise: float
    heading_noise: float

    @classmethod
    def of(cls, scenario: LidarScenario) -> Wheels:
        """Return the wheels of a scenario; an obstacle begins half a cell before the centre to which clearance is."""
        return cls(
            scenario.max_speed,
            scenario.max_turn_rate,
            scenario.acceleration,
            scenario.turn_acceleration,
            scenario.tick,
            scenario.robot_radius + 0.5 * scenario.resolution,
            scenario.odometry_noise,
            scenario.heading_noise,
        )


class Vehicle:
    """The true robot in a world.

    Attributes
    ----------
    pose : true pose.
    velocity : true speeds (forward [m/s], turning [rad/s]).
    length : metres driven.
    turned : radians turned, whichever way.
    collisions : contacts so far.
    contact : whether an obstacle has stopped the robot, and it has not moved away since.
    bias : the odometry's scale errors (along, across, heading) of this trial.
    """

    def __init__(self, scenario: LidarScenario, world: LidarWorld, rng: np.random.Generator) -> None:
        self.pose: Pose = world.start
        self.velocity = (0.0, 0.0)
        self.length = 0.0
        self.turned = 0.0
        self.collisions = 0
        self.contact = False
        along, across, heading = (rng.random(3) - 0.5).tolist()
        self.bias = (
            scenario.odometry_bias * along,
            scenario.odometry_bias * across,
            scenario.heading_bias * heading,
        )
        self._wheels = Wheels.of(scenario)
        self._grid = world.grid
        self._clearance = world.clearance
        self._rng = rng
        self._normals = np.empty((BLOCK, 3))
        self._ticks = 0

    def move(self, command: tuple[float, float]) -> Pose:
        """Follow a command for one tick; return the motion that the odometry measures.

        The speeds go towards the command as far as the accelerations allow and then stay for the tick, so the robot
        drives an arc. A tick that would take it nearer to an obstacle than its radius drives nowhere: it only turns.

        Parameters
        ----------
        command : speeds (forward [m/s], turning [rad/s]).

        Returns
        -------
        The pose after the tick in the frame of the pose before, as measured: what truly happened, blocked wheels
        included (they do not slip), with this trial's bias and white noise. Three standard normals are used a tick,
        whatever the command.
        """
        k = self._ticks % BLOCK
        if k == 0:
            self._rng.standard_normal(out=self._normals)
        self._ticks += 1
        touched = self.contact
        self.pose, self.velocity, motion, self.contact, driven = _tick(
            self._wheels,
            self.pose,
            self.velocity,
            touched,
            command,
            self._clearance,
            self._grid,
            self.bias,
            self._normals,
            k,
        )
        self.collisions += self.contact and not touched
        self.length += driven
        self.turned += abs(self.velocity[1]) * self._wheels.tick
        return motion


@jit
def _tick(
    wheels: Wheels,
    pose: Pose,
    velocity: tuple[float, float],
    contact: bool,
    command: tuple[float, float],
    clearance: Array,
    grid: Grid,
    bias: tuple[float, float, float],
    normals: Array,
    k: int,
) -> tuple[Pose, tuple[float, float], Pose, bool, float]:
    """Pose and velocity after a tick, the motion measured, whether the robot is in contact, and the metres driven."""
    v = _follow(velocity[0], command[0], wheels.max_speed, wheels.acceleration * wheels.tick)
    w = _follow(velocity[1], command[1], wheels.max_turn_rate, wheels.turn_acceleration * wheels.tick)
    length, turn = v * wheels.tick, w * wheels.tick
    motion = _arc(length, turn)
    after = compose(pose, motion)
    room = clearance_at(clearance, grid, pose[0], pose[1])
    room_after = clearance_at(clearance, grid, after[0], after[1])
    blocked = room_after < wheels.touch and room_after < room  # one that was put too near may leave
    if blocked:
        v = length = 0.0
        motion = (0.0, 0.0, turn)
        after = compose(pose, motion)
    contact = blocked or (contact and room_after <= room)
    sigma = wheels.noise * math.sqrt(abs(length))
    heading_sigma = wheels.heading_noise * math.sqrt(abs(length) + abs(turn))
    measured = (
        (1.0 + bias[0]) * motion[0] + sigma * normals[k, 0],
        (1.0 + bias[1]) * motion[1] + sigma * normals[k, 1],
        (1.0 + bias[2]) * motion[2] + heading_sigma * normals[k, 2],
    )
    return after, (v, w), measured, contact, abs(length)


@jit
def _follow(speed: float, command: float, most: float, change: float) -> float:
    """Speed after a tick in which it changes by no more than `change` towards a command within ± `most`."""
    wanted = min(max(command, -most), most)
    return min(max(wanted, speed - change), speed + change)


@jit
def _arc(length: float, turn: float) -> Pose:
    """Motion along an arc of a length [m] that turns by an angle [rad]."""
    half = 0.5 * turn
    chord = length * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
    return chord * math.cos(half), chord * math.sin(half), turn
