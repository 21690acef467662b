"""True motion: the command plus noise, and the collisions that it causes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Pose, compose
from explore_bench.robot.landmark.driver import Command
from explore_bench.world.landmark.world import World
from explore_bench.world.scenario import Scenario

PROBES = 8  # points along a straight step at which a collision is looked for: 6 cm apart at 0.5 m


class Robot:
    """The true robot in a world.

    Attributes
    ----------
    pose : true pose.
    collisions : entries into an obstacle cell or off the map so far; the motion is never altered.
    """

    def __init__(self, scenario: Scenario, world: World, rng: np.random.Generator) -> None:
        self.pose: Pose = world.start
        self.collisions = 0
        self._rng = rng
        self._obstacles = world.obstacles
        self._cell_size = world.cell_size
        self._straight_sigma = scenario.odometry_sigma
        self._turn_sigma = scenario.turn_sigma
        self._heading_sigma = math.radians(scenario.heading_sigma_deg)

    def move(self, command: Command) -> None:
        """Carry out a command: truth = command ⊕ noise. Three standard normals are drawn whatever the command."""
        turn, forward = command
        along, across, twist = self._rng.standard_normal(3)
        sigma = self._straight_sigma if forward else self._turn_sigma
        start = self.pose
        target = compose(start, (forward, 0.0, turn))
        self.pose = compose(target, (sigma * along, sigma * across, self._heading_sigma * twist))
        self.collisions += _entries(start, self.pose, self._obstacles, self._cell_size)


@jit
def _entries(start: Pose, end: Pose, obstacles: NDArray[np.bool_], cell_size: float) -> int:
    """Count the times that the segment from start to end passes from free to blocked ground."""
    n = obstacles.shape[0]
    count = 0
    was_blocked = True
    for k in range(PROBES + 1):
        x = start[0] + (end[0] - start[0]) * k / PROBES
        y = start[1] + (end[1] - start[1]) * k / PROBES
        column, row = int(math.floor(x / cell_size)), int(math.floor(y / cell_size))
        blocked = not (0 <= column < n and 0 <= row < n)
        if not blocked:
            blocked = obstacles[row, column]
        if k > 0 and blocked and not was_blocked:
            count += 1
        was_blocked = blocked
    return count
