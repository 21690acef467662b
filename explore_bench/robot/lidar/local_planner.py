"""What a local planner is, and which there are."""

from __future__ import annotations

from typing import Protocol

from explore_bench.geometry import Array, Grid, Pose
from explore_bench.robot.lidar.dwa import DynamicWindow
from explore_bench.robot.lidar.pursuit import Pursuit
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import Velocity


class LocalPlanner(Protocol):
    """From where the robot believes to be and a path to the next command; it remembers nothing."""

    def command(self, pose: Pose, velocity: Velocity, path: Array, clearance: Array, grid: Grid) -> Velocity:
        """Next command along a path.

        Parameters
        ----------
        pose : estimated pose.
        velocity : speeds now, (forward [m/s], turning [rad/s]).
        path : waypoints [m] from near the robot to the goal, about a cell apart, shape (W, 2), W ≥ 1. It goes on from
            the one nearest to the robot.
        clearance : distance to the nearest obstacle that the robot believes in [m], shape (rows, columns) of `grid`.
        grid : grid of the robot's map.

        Returns
        -------
        Speeds for the next tick. (0, 0) where it knows no way on; when the goal is reached, and when to give up, its
        caller says.
        """
        ...


_PLANNERS: dict[str, type[Pursuit] | type[DynamicWindow]] = {"pursuit": Pursuit, "dwa": DynamicWindow}


def local_planner(scenario: LidarScenario, margin: float = 0.0) -> LocalPlanner:
    """Return the local planner that a scenario names, for ways that come nearer to walls than usual by a margin [m]."""
    planner = _PLANNERS[scenario.local_planner].of(scenario)
    limits = planner.limits
    return planner._replace(limits=limits._replace(sight=limits.sight - margin, least=limits.least - margin))
