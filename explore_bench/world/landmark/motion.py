"""True motion: the command plus noise, and the collisions that it causes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose, compose, place_of
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.signals import Command, Odometry

PROBES = 8  # points along a straight step at which a collision is looked for: 9 cm apart at the paper's 0.7 m


class Robot:
    """The true robot in a world.

    Attributes
    ----------
    pose : true pose.
    collisions : entries into an obstacle cell or off the map so far; the motion is never altered.
    """

    def __init__(self, scenario: LandmarkScenario, world: LandmarkWorld, rng: np.random.Generator) -> None:
        self.pose: Pose = world.start
        self.collisions = 0
        self._rng = rng
        self._obstacles = world.obstacles
        self._grid = world.grid
        self._noise = scenario.noise

    def move(self, command: Command) -> Odometry:
        """Carry out a command; return what the odometry reads, which is the command ([8])."""
        odometry = self._noise.odometry(command)
        self.shift(odometry)
        return odometry

    def shift(self, odometry: Odometry) -> None:
        """Move as the odometry reads, but for its noise: truth = motion ⊕ noise ([8]).

        Three standard normals are drawn whatever the motion.
        """
        normals = self._rng.standard_normal(3)
        self.pose, entries = _shift(self.pose, odometry.motion, odometry.sigmas, normals, self._obstacles, self._grid)
        self.collisions += entries


@jit
def _shift(
    start: Pose, motion: Pose, sigmas: Pose, normals: Array, obstacles: NDArray[np.bool_], grid: Grid
) -> tuple[Pose, int]:
    """Pose after a motion and its noise, and how often the way there enters blocked ground."""
    target = compose(start, motion)
    end = compose(target, (sigmas[0] * normals[0], sigmas[1] * normals[1], sigmas[2] * normals[2]))
    return end, _entries(start, end, obstacles, grid)


@jit
def _entries(start: Pose, end: Pose, obstacles: NDArray[np.bool_], grid: Grid) -> int:
    """Count the times that the segment from start to end passes from free to blocked ground."""
    count = 0
    was_blocked = True
    for k in range(PROBES + 1):
        x = start[0] + (end[0] - start[0]) * k / PROBES
        y = start[1] + (end[1] - start[1]) * k / PROBES
        column, row = place_of(grid, x, y)
        blocked = not (0 <= column < grid.columns and 0 <= row < grid.rows)
        if not blocked:
            blocked = obstacles[row, column]
        if k > 0 and blocked and not was_blocked:
            count += 1
        was_blocked = blocked
    return count
