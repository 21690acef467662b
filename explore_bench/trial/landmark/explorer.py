"""A robot in a landmark world: true motion, sensing and SLAM tied together, one command after the other."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, cell_of, cells_of, distance_to_segment
from explore_bench.robot.belief import Belief
from explore_bench.robot.landmark.driver import Driver
from explore_bench.robot.landmark.smoother import Smoother
from explore_bench.robot.planning.candidates import Ground, Withheld, find_candidates
from explore_bench.robot.planning.frontier import unknown_neighbours
from explore_bench.robot.planning.roads import Roads
from explore_bench.robot.timing import Lap
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.explorer import Patience, StandingError, StuckError, checked
from explore_bench.trial.landmark.step import LandmarkStep
from explore_bench.trial.spec import Status
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.landmark.motion import Robot
from explore_bench.world.landmark.sensor import Sensor
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.signals import Command, Odometry, Scan

ROBOT = 0
"""Number of the robot; there is one."""

_ONE_SEGMENT = np.zeros(1, dtype=np.int64)


class LandmarkExplorer:
    """A robot in a world: its true motion, its sensor and its SLAM, moved along paths.

    Attributes
    ----------
    scenario : what the robot may know of it.
    steps, decisions : counted so far.
    smoother : its SLAM.
    own_cell : the cell of the estimated position.
    explored : known share of the cells that count.
    """

    def __init__(
        self,
        scenario: LandmarkScenario,
        world: LandmarkWorld,
        motion: np.random.Generator,
        sensing: np.random.Generator,
        lap: Lap,
    ) -> None:
        _require_fit(scenario, world)
        self.scenario, self._lap = scenario.blind, lap
        self.steps = self.decisions = 0
        self._length = self._turned = 0.0
        self._robot = Robot(self.scenario, world, motion)
        self._sensor = Sensor(self.scenario, world, sensing)
        self._driver = Driver.of(self.scenario)
        self._truth = world.obstacles.reshape(-1).copy()
        if scenario.landmarks_occupy:
            self._truth[cells_of(world.grid, world.landmarks)] = True
        self._counted = world.counted.reshape(-1)
        self._count = int(self._counted.sum())
        self._withheld, self._patience = Withheld(), Patience(self.scenario)
        self._inside = None if self.scenario.inside.all() else self.scenario.inside
        self._choices: list[NDArray[np.int64]] = []
        self._lengths = np.empty(0)
        self._nearest, self._drives = -1, (0.0, 0.0)
        self._roads: Roads | None = None
        self.smoother = Smoother(self.scenario, world.start, lap)
        self._take_in(None, self._sensor.scan(self._robot.pose))
        for _ in range(self.scenario.start_moves):
            odometry = self.scenario.noise.start_move
            self._robot.shift(odometry)
            self._take_in(odometry, self._sensor.scan(self._robot.pose))

    @property
    def known(self) -> NDArray[np.bool_]:
        """Cells observed, shape (rows, columns)."""
        return self.smoother.occupancy.known.reshape(self.scenario.grid.shape)

    def belief(self) -> Belief:
        """What the robot believes now, frozen."""
        return self.smoother.belief()

    def status(self) -> Status | None:
        """How the trial ends now; None while it goes on."""
        if self.explored >= self.scenario.coverage:
            return Status.EXPLORED
        if self.steps >= self.scenario.step_limit:
            return Status.STEP_LIMIT
        return None

    def observe(self) -> Observation:
        """What the decision that is due may use.

        Raises
        ------
        StuckError : where no frontier can be reached, or too many decisions did not leave a cell.
        """
        found = find_candidates(self._ground(), self._withheld)
        if found is None:
            raise StuckError("no frontier can be reached")
        self._patience.decide(self.own_cell)
        # copies: a strategy that forges its observation changes nothing that is driven
        self._choices = [path.copy() for path in found.paths]
        self._lengths = found.lengths.copy()
        self._roads = replace(found.roads, free=found.roads.free.copy())
        positions = self.scenario.grid.centres(found.cells)
        for array in (found.cells, found.lengths, positions, *found.paths):
            array.setflags(write=False)
        return Observation(
            belief=self.belief(),
            step=self.steps,
            decision=self.decisions,
            candidates=found.cells,
            positions=positions,
            paths=found.paths,
            path_lengths=found.lengths,
            roads=found.roads,
            robot=ROBOT,
        )

    def drive(self, choice: object) -> Generator[LandmarkStep]:
        """Drive to the candidate of an index, or to a Target, and yield the row of each step.

        Raises
        ------
        ChoiceError : where that cannot be driven to.
        """
        assert self._roads is not None
        answer = checked(choice, len(self._choices), self._roads)
        grid = self.scenario.grid
        path = (
            self._roads.path_to(grid.cell_of(*answer.position)) if isinstance(answer, Target) else self._choices[answer]
        )
        waypoints = grid.centres(path[1:])
        if isinstance(answer, Target):
            waypoints[-1] = answer.position
            near = len(waypoints) == 1 and self._driver.command(self.smoother.pose, answer.position) is None
            if near and not self._driver.open_loop:
                x, y = answer.position
                raise StandingError(
                    f"the target ({x:g}, {y:g}) lies where the robot is, so that it would never move; "
                    "choose one farther away"
                )
        self.decisions += 1
        nearest = int(self._lengths.argmin())
        self._nearest = int(self._choices[nearest][-1])
        chosen = self._roads.lengths_to(path[-1:])[0] if isinstance(answer, Target) else self._lengths[answer]
        self._drives = float(self._lengths[nearest]), float(chosen)
        drive = self._dash(waypoints) if self._driver.open_loop else self._follow(path, waypoints)
        if (yield from drive) and self.scenario.withhold:
            self._withheld.add(int(path[-1]), self.known)

    def _dash(self, waypoints: Array) -> Generator[LandmarkStep, None, bool]:
        """Carry out the commands to the waypoints as planned, until their end or that of the trial.

        Returns whether they were carried out to their end.
        """
        for turn, forward in self._driver.follow(self.smoother.pose, waypoints).tolist():
            self._advance((turn, forward))
            yield self.row()
            self._patience.visit(self.own_cell)
            if self.status() is not None:
                return False
        return True

    def _follow(self, path: NDArray[np.int64], waypoints: Array) -> Generator[LandmarkStep, None, bool]:
        """Follow a path until its end, the end of the trial, a blocked path or a jump off it; ≥ 1 straight step.

        Returns whether it was followed to its end.
        """
        needed, segment_of = _needed_cells(path, self.scenario.grid.columns)
        previous = self.smoother.pose[:2]
        has_moved = False
        for segment, (to_x, to_y) in enumerate(waypoints.tolist()):
            while (command := self._driver.command(self.smoother.pose, (to_x, to_y))) is not None:
                self._advance(command)
                yield self.row()
                self._patience.visit(self.own_cell)
                has_moved = has_moved or command[1] > 0.0
                if self.status() is not None:
                    return False
                x, y, _ = self.smoother.pose
                off = distance_to_segment(x, y, *previous, to_x, to_y) > self.scenario.path_tolerance
                if has_moved and (off or self._is_blocked(needed, segment_of, segment)):
                    return False
            previous = to_x, to_y
        return True

    def row(self) -> LandmarkStep:
        """The primitives after the last step."""
        smoother = self.smoother
        xx, xy, xh, _, yy, yh, _, _, hh = smoother.pose_covariances[-1].ravel().tolist()
        values: tuple[Any, ...] = (
            self.steps,
            self.decisions,
            ROBOT,
            *self._robot.pose,
            *smoother.pose,
            *(xx, xy, yy, xh, yh, hh),
            smoother.virtual_map.uncertainty,
            *smoother.peak_traces,
            self.explored,
            self._length,
            self._turned,
            self._robot.collisions,
            self._mislabelled,
            *self._drives,
            int(self._nearest >= 0 and self._waits(self._nearest)),
            len(smoother.landmarks),
        )
        row = LandmarkStep(*values)
        self._lap("row")
        return row

    def _ground(self) -> Ground:
        """The believed grid for planning."""
        return Ground(
            scenario=self.scenario,
            pose=self.smoother.pose,
            known=self.known,
            occupied=self._occupied.reshape(self.scenario.grid.shape),
            landmarks=self.smoother.landmarks,
            inside=self._inside,
            least_unknown=self.scenario.frontier_neighbours,
            straight=self._driver.open_loop,
        )

    def _advance(self, command: Command) -> None:
        self._lap("driver")
        self.steps += 1
        self._turned += abs(command[0])
        self._length += command[1]
        odometry = self._robot.move(command)
        scan = self._sensor.scan(self._robot.pose)
        self._lap("world")
        self._take_in(odometry, scan)

    def _take_in(self, odometry: Odometry | None, scan: Scan) -> None:
        """Let SLAM take in a step, and read out what is asked for several times until the next."""
        self.smoother.update(odometry, scan)
        x, y, _ = self.smoother.pose
        self.own_cell = self.scenario.grid.cell_of(x, y)
        self._occupied = self.smoother.occupancy.occupied
        known, self._mislabelled = _tally(self.smoother.occupancy.known, self._occupied, self._counted, self._truth)
        self.explored = known / self._count

    def _is_blocked(self, cells: NDArray[np.int64], segment_of: NDArray[np.int64], segment: int) -> bool:
        return _any_blocked(
            cells, segment_of, segment, self.own_cell, self._occupied, self.smoother.landmarks, self.scenario.grid
        )

    def _waits(self, cell: int) -> bool:
        """Whether a cell, other than the robot's own, is a frontier still."""
        if cell == self.own_cell or self._is_blocked(np.array([cell]), _ONE_SEGMENT, 0):
            return False
        row, column = divmod(cell, self.scenario.grid.columns)
        return unknown_neighbours(self.known, row, column) >= self.scenario.frontier_neighbours


def _require_fit(scenario: LandmarkScenario, world: LandmarkWorld) -> None:
    """Refuse a world that is not one of the scenario."""
    fewer = scenario.map is not None and len(world.landmarks) < scenario.landmarks  # a map may have no more room
    if world.grid != scenario.grid or (len(world.landmarks) != scenario.landmarks and not fewer):
        raise ValueError(
            f"the world has {world.grid.columns} × {world.grid.rows} cells of {world.grid.resolution:g} m and "
            f"{len(world.landmarks)} landmarks, the scenario {scenario.grid.columns} × {scenario.grid.rows} of "
            f"{scenario.grid.resolution:g} m and {scenario.landmarks}; make them agree"
        )


def _needed_cells(path: NDArray[np.int64], columns: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cells that must stay free for a path, the sides of its diagonal steps included, and the segment of each."""
    up, along = path // columns, path % columns
    segments = np.arange(len(path) - 1)
    diagonal = (up[1:] != up[:-1]) & (along[1:] != along[:-1])
    sides = (up[:-1] * columns + along[1:])[diagonal], (up[1:] * columns + along[:-1])[diagonal]
    return np.concatenate((path[1:], *sides)), np.concatenate((segments, segments[diagonal], segments[diagonal]))


@jit
def _tally(
    known: NDArray[np.bool_], occupied: NDArray[np.bool_], counted: NDArray[np.bool_], truth: NDArray[np.bool_]
) -> tuple[int, int]:
    """Known cells that count, and known cells believed to be what they are not; all of shape (n_g,)."""
    in_count = mislabelled = 0
    for cell in range(len(known)):
        if known[cell]:
            in_count += counted[cell]
            mislabelled += occupied[cell] != truth[cell]
    return in_count, mislabelled


@jit
def _any_blocked(
    cells: NDArray[np.int64],
    segment_of: NDArray[np.int64],
    segment: int,
    own_cell: int,
    occupied: NDArray[np.bool_],
    landmarks: Array,
    grid: Grid,
) -> bool:
    """Whether one of the cells of this segment or a later one, the robot's own aside, is occupied or holds a landmark.

    `occupied` has the shape (n_g,); a landmark is where it is estimated.
    """
    for i in range(len(cells)):
        if segment_of[i] >= segment and cells[i] != own_cell and occupied[cells[i]]:
            return True
    for m in range(landmarks.shape[0]):
        holder = cell_of(grid, landmarks[m, 0], landmarks[m, 1])
        if holder != own_cell:
            for i in range(len(cells)):
                if segment_of[i] >= segment and cells[i] == holder:
                    return True
    return False
