"""A robot that drives: true motion, sensing and SLAM tied together, one command after the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import cell_of, distance_to_segment
from explore_bench.robot.landmark.driver import Command, Driver
from explore_bench.robot.landmark.smoother import Lap, Smoother
from explore_bench.robot.planning.candidates import Ground, any_blocked, waypoints
from explore_bench.trial.spec import Status
from explore_bench.trial.steps import Step
from explore_bench.world.landmark.motion import Robot
from explore_bench.world.landmark.sensor import Sensor
from explore_bench.world.landmark.world import World
from explore_bench.world.scenario import Scenario


class Vehicle:
    """A robot in a world: its true motion, its sensor and its SLAM, moved along paths.

    Attributes
    ----------
    steps, decisions : counted so far.
    arrived : whether the last path was driven to its end.
    smoother : its SLAM.
    """

    def __init__(
        self,
        scenario: Scenario,
        world: World,
        motion: np.random.Generator,
        sensing: np.random.Generator,
        lap: Lap,
    ) -> None:
        self.scenario, self._lap = scenario, lap
        self.steps = self.decisions = 0
        self.arrived = False
        self._length = self._turned = 0.0
        self._robot = Robot(scenario, world, motion)
        self._sensor = Sensor(scenario, world, sensing)
        self._driver = Driver.of(scenario)
        self._truth = world.obstacles.reshape(-1)
        self._counted = world.counted.reshape(-1)
        self._count = int(self._counted.sum())
        self.smoother = Smoother(scenario, world.start, lap)
        self.smoother.update(None, self._sensor.scan(self._robot.pose))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Cells observed, shape (n, n)."""
        return self.smoother.occupancy.known.reshape(self.scenario.cells, self.scenario.cells)

    @property
    def explored(self) -> float:
        """Known share of the cells that count."""
        return float(np.count_nonzero(self.smoother.occupancy.known & self._counted)) / self._count

    @property
    def own_cell(self) -> int:
        """The cell of the estimated position."""
        x, y, _ = self.smoother.pose
        return cell_of(x, y, self.scenario.cells, self.scenario.cell_size)

    def ground(self) -> Ground:
        """The believed grid for planning."""
        n = self.scenario.cells
        return Ground(
            scenario=self.scenario,
            pose=self.smoother.pose,
            known=self.known,
            occupied=self.smoother.occupancy.occupied.reshape(n, n),
            landmarks=self.smoother.landmarks,
        )

    def status(self) -> Status | None:
        """How the trial ends now; None while it goes on."""
        if self.explored >= self.scenario.coverage:
            return Status.EXPLORED
        if self.steps >= self.scenario.step_limit:
            return Status.STEP_LIMIT
        return None

    def drive(self, path: NDArray[np.int64]) -> Iterator[Step]:
        """Follow a path until its end, the end of the trial, a blocked path or a jump off it; ≥ 1 straight step."""
        self.arrived = False
        needed, segment_of = _needed_cells(path, self.scenario.cells)
        previous = self.smoother.pose[:2]
        has_moved = False
        for segment, waypoint in enumerate(waypoints(path, self.scenario)):
            while (command := self._driver.command(self.smoother.pose, waypoint)) is not None:
                self._advance(command)
                yield self.row()
                has_moved = has_moved or command[1] > 0.0
                if self.status() is not None:
                    return
                x, y, _ = self.smoother.pose
                off = distance_to_segment(x, y, *previous, *waypoint) > self.scenario.path_tolerance
                if has_moved and (off or self._any_blocked(needed[segment_of >= segment])):
                    return
            previous = waypoint
        self.arrived = True

    def _advance(self, command: Command) -> None:
        self._lap("driver")
        self.steps += 1
        self._turned += abs(command[0])
        self._length += command[1]
        self._robot.move(command)
        scan = self._sensor.scan(self._robot.pose)
        self._lap("world")
        self.smoother.update(command, scan)

    def _any_blocked(self, cells: NDArray[np.int64]) -> bool:
        n, cell_size = self.scenario.cells, self.scenario.cell_size
        return any_blocked(
            cells, self.own_cell, self.smoother.occupancy.occupied, self.smoother.landmarks, n, cell_size
        )

    def row(self) -> Step:
        """The primitives after the last step."""
        smoother = self.smoother
        covariance = smoother.pose_covariances[-1]
        occupancy = smoother.occupancy
        row = Step._make(
            (
                self.steps,
                self.decisions,
                *self._robot.pose,
                *smoother.pose,
                *covariance[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]].tolist(),
                smoother.virtual_map.uncertainty,
                *smoother.peak_traces,
                self.explored,
                self._length,
                self._turned,
                self._robot.collisions,
                int(np.count_nonzero(occupancy.known & (occupancy.occupied != self._truth))),
                len(smoother.landmarks),
            )
        )
        self._lap("row")
        return row


def _needed_cells(path: NDArray[np.int64], n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cells that must stay free for a path, the sides of its diagonal steps included, and the segment of each."""
    rows, columns = path // n, path % n
    segments = np.arange(len(path) - 1)
    diagonal = (rows[1:] != rows[:-1]) & (columns[1:] != columns[:-1])
    sides = (rows[:-1] * n + columns[1:])[diagonal], (rows[1:] * n + columns[:-1])[diagonal]
    return np.concatenate((path[1:], *sides)), np.concatenate((segments, segments[diagonal], segments[diagonal]))
