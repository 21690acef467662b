"""A robot in a lidar world: true motion, scans and SLAM tied together, one tick after the other."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Pose, compose
from explore_bench.robot.belief import Belief
from explore_bench.robot.lidar.frontiers import Frontier
from explore_bench.robot.lidar.local_planner import local_planner
from explore_bench.robot.lidar.mapper import Mapper
from explore_bench.robot.lidar.navigator import LAST_MARGIN, MARGINS, Navigator, Offer, seconds_for
from explore_bench.robot.lidar.slam import KEY_DISTANCE, KEY_TURN
from explore_bench.robot.lidar.terrain import length_of
from explore_bench.robot.planning.roads import Roads
from explore_bench.robot.timing import Lap
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.explorer import Patience, StuckError, checked
from explore_bench.trial.lidar.loops import Loops
from explore_bench.trial.lidar.ride import Ride
from explore_bench.trial.lidar.step import LidarStep
from explore_bench.trial.spec import Status
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.motion import Vehicle
from explore_bench.world.lidar.sensor import Lidar
from explore_bench.world.lidar.world import LidarWorld

ROBOT = 0
"""Number of the robot; there is one."""

ARRIVED = 0.25
"""Distance at which a goal is reached [m] (nav2)."""

STALL_SECONDS, STALL_DISTANCE = 10.0, 0.3
"""A robot that does not get this far in that time is stalled [s, m]."""

JUMP = 0.25
"""A loop closure that moves the robot farther than this ends its drive [m]; a lesser one only mends the route."""

RELEASE_SHIFT = 0.1
"""A link that moves a key pose farther than this brings withheld frontiers back [m]: they may be others now."""

BLIND_SECONDS, LOST_DISTANCE = 60.0, 2.0
"""A trial ends when no scan has matched for so long [s], or the robot is so far from where it believes to be [m]."""


class LidarExplorer:
    """A robot in a world: its true motion, its lidar and its SLAM, moved along routes.

    Attributes
    ----------
    scenario : what the robot may know of it.
    steps, decisions : counted so far; a step is a key pose.
    mapper : its SLAM and maps.
    """

    def __init__(
        self,
        scenario: LidarScenario,
        world: LidarWorld,
        motion: np.random.Generator,
        sensing: np.random.Generator,
        lap: Lap,
    ) -> None:
        if world.grid != scenario.truth_grid:
            raise ValueError(
                f"the world has {world.grid.columns} × {world.grid.rows} cells of {world.grid.resolution:g} m, the "
                f"scenario {scenario.truth_grid.columns} × {scenario.truth_grid.rows} of "
                f"{scenario.truth_grid.resolution:g} m; make them agree"
            )
        self.scenario: LidarScenario = scenario.blind
        self._lap = lap
        self.steps = self.decisions = 0
        self._seconds = self._matched_at = 0.0
        self._vehicle = Vehicle(self.scenario, world, motion)
        self._lidar = Lidar(self.scenario, world, sensing)
        self._truth = _Truth(self.scenario, world)
        self._loops, self._ride = Loops(self.scenario, world), Ride(self.scenario, world)
        self._in_vain = 0
        self._local = {margin: local_planner(self.scenario, margin) for margin in (*MARGINS, LAST_MARGIN)}
        self.mapper = Mapper(self.scenario, world.start, self._lidar.scan(world.start), lap)
        self._navigator = Navigator(self.scenario, self.mapper.slam.map)
        self._patience = Patience(self.scenario)
        self._offer: Offer | None = None
        self._nearest: Frontier | None = None
        self._drives = 0.0, 0.0
        self._roads: Roads | None = None
        self._since: tuple[Pose, float, float] = ((0.0, 0.0, 0.0), 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        """Estimated pose: the newest key pose, and what odometry measured since."""
        return compose(self.mapper.slam.pose, self._since[0])

    @property
    def explored(self) -> float:
        """Known share of the places that count."""
        return self._truth.explored(self.mapper.slam.map.known)

    def belief(self) -> Belief:
        """What the robot believes now, frozen."""
        return self.mapper.belief()

    def status(self) -> Status | None:
        """How the trial ends now; None while it goes on."""
        if self.explored >= self.scenario.coverage:
            return Status.EXPLORED
        if self.steps >= self.scenario.step_limit or self._seconds >= self.scenario.time_limit:
            return Status.STEP_LIMIT
        return None

    def observe(self) -> Observation:
        """What the decision that is due may use.

        Raises
        ------
        StuckError : where no frontier can be reached, too many decisions did not leave a cell, or SLAM has failed.
        """
        if trouble := self._trouble():
            raise StuckError(trouble)
        self._navigator.look()
        offer = self._navigator.offer(self.mapper.slam.pose, self.mapper.slam.poses)
        self._lap("frontiers")
        if offer is None:
            raise StuckError("no frontier can be reached")
        self._patience.decide(self._own_cell)
        self._roads = Roads(offer.roads.grid, offer.roads.free.copy(), offer.roads.start)
        self._offer = replace(offer, roads=self._roads)
        shown = tuple(path.copy() for path in offer.paths)
        arrays = (cells, positions, lengths) = offer.cells.copy(), offer.positions.copy(), offer.lengths.copy()
        for array in (*arrays, *shown):
            array.setflags(write=False)
        return Observation(
            belief=self.belief(),
            step=self.steps,
            decision=self.decisions,
            candidates=cells,
            positions=positions,
            paths=shown,
            path_lengths=lengths,
            roads=offer.roads,
            robot=ROBOT,
        )

    def drive(self, choice: object) -> Generator[LidarStep]:
        """Drive to where a candidate can be looked at, or to a Target, and yield the row of each key pose.

        Raises
        ------
        ChoiceError : where that cannot be driven to.
        """
        assert self._roads is not None
        assert self._offer is not None
        answer = checked(choice, len(self._offer.cells), self._roads)
        grid = self._roads.grid
        if isinstance(answer, Target):
            frontier, goal = None, grid.cell_of(*answer.position)
            route = self._navigator.ways(self.pose).to(goal)
        else:
            frontier, route = self._offer.frontiers[answer], self._offer.routes[answer]
        nearest = int(self._offer.lengths.argmin())
        self._nearest = self._offer.frontiers[nearest]
        self._drives = float(self._offer.lengths[nearest]), length_of(route, grid.columns, grid.resolution)
        self.decisions += 1
        yield from self._follow(route, frontier)
        if frontier is not None and not self._navigator.resolved(frontier):
            self._navigator.note_in_vain(frontier)
            self._in_vain += 1

    def row(self) -> LidarStep:
        """The primitives after the last key pose."""
        slam = self.mapper.slam
        self._loops.compare(slam.closures)
        values: tuple[Any, ...] = (
            self.steps,
            self.decisions,
            ROBOT,
            *self._vehicle.pose,
            *slam.pose,
            *slam.covariances[-1][[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]].tolist(),
            self.mapper.virtual_map.uncertainty,
            *self.mapper.peak_traces,
            self.explored,
            self._vehicle.length,
            self._vehicle.turned,
            self._vehicle.collisions,
            self._truth.mislabelled(slam.map.known, slam.map.occupied),
            *self._drives,
            int(self._nearest is not None and self._navigator.waits(self._nearest)),
            self._seconds,
            len(slam.closures),
            self._loops.false,
            self._loops.missed,
            self._in_vain,
            self._ride.clearance,
            self._ride.unsafe_seconds,
            self._ride.speed_change,
        )
        row = LidarStep(*values)
        self._lap("row")
        return row

    @property
    def _own_cell(self) -> int:
        """Cell of the decision grid."""
        return self.scenario.grid.cell_of(self.pose[0], self.pose[1])

    def _follow(self, route: NDArray[np.int64], frontier: Frontier | None) -> Generator[LidarStep]:
        """Follow a route to its end, or until the trial ends, the frontier is resolved, or no way leads on."""
        grid, navigator = self.scenario.map_grid, self._navigator
        goal = int(route[-1])
        path, end = grid.centres(route), grid.centre_of(goal)
        begin = self._seconds
        limit = seconds_for(float(np.hypot(*np.diff(path, axis=0).T).sum()))
        mark, mark_seconds = self.pose, begin
        while True:
            pose = self.pose
            arrived = math.hypot(end[0] - pose[0], end[1] - pose[1]) <= ARRIVED
            stalled = False
            if math.hypot(pose[0] - mark[0], pose[1] - mark[1]) >= STALL_DISTANCE:
                mark, mark_seconds = pose, self._seconds
            else:
                stalled = self._seconds - mark_seconds >= STALL_SECONDS
            given_up = arrived or stalled or self._seconds - begin >= limit
            if not given_up:
                command = self._local[navigator.margin].command(
                    pose, self._vehicle.velocity, path, navigator.terrain.clearance, grid
                )
                self._tick(command)
                if self._since[1] < KEY_DISTANCE and self._since[2] < KEY_TURN:
                    continue
            before = self.pose
            shift = self._take()
            yield self.row()
            self._patience.visit(self._own_cell)
            if given_up or self.status() is not None or self._trouble():
                return
            navigator.look()
            if frontier is not None and navigator.resolved(frontier):
                return
            if shift > RELEASE_SHIFT:
                navigator.release()
            now = self.pose
            if shift > 0.0 and math.hypot(now[0] - before[0], now[1] - before[1]) > JUMP:
                return
            if shift > 0.5 * grid.resolution or navigator.blocked(route):
                ways = navigator.ways(self.pose)
                if not math.isfinite(ways.cost[goal]):
                    return
                route = ways.to(goal)
                path = grid.centres(route)
            self._lap("route")

    def _trouble(self) -> str:
        """Why SLAM has failed for good, in a sentence; empty while it works."""
        blind = self._seconds - self._matched_at
        if blind >= BLIND_SECONDS:
            return f"no scan has matched what was seen before for {blind:.0f} s"
        away = math.hypot(self.pose[0] - self._vehicle.pose[0], self.pose[1] - self._vehicle.pose[1])
        if away > LOST_DISTANCE:
            return f"the robot is lost: it is {away:.1f} m from where it believes to be"
        return ""

    def _tick(self, command: tuple[float, float]) -> None:
        motion = self._vehicle.move(command)
        self._ride.tick(self._vehicle.pose, self._vehicle.velocity[0])
        self._seconds += self.scenario.tick
        so_far, length, turned = self._since
        self._since = compose(so_far, motion), length + math.hypot(motion[0], motion[1]), turned + abs(motion[2])

    def _take(self) -> float:
        """Take a scan in as a key pose; returns how far it moved the past [m], see `Slam.update`."""
        self._lap("driver")
        self.steps += 1
        scan = self._lidar.scan(self._vehicle.pose)
        self._lap("world")
        shift = self.mapper.update(*self._since, scan)
        self._loops.visit(self._vehicle.pose, self.mapper.slam.links)
        self._lap("judging")
        if not self.mapper.slam.unmatched:
            self._matched_at = self._seconds
        self._since = ((0.0, 0.0, 0.0), 0.0, 0.0)
        return shift


class _Truth:
    """What a map of the robot's grid is compared with."""

    def __init__(self, scenario: LidarScenario, world: LidarWorld) -> None:
        grid = scenario.map_grid
        share = round(scenario.map_resolution / scenario.resolution)

        def blocks(cells: NDArray[np.bool_]) -> NDArray[np.int64]:
            return np.asarray(cells.reshape(grid.rows, share, grid.columns, share).sum(axis=(1, 3)), dtype=np.int64)

        self._counted = blocks(world.counted)
        self._total = int(self._counted.sum())
        obstacles = blocks(world.obstacles)
        self._solid, self._open = obstacles == share * share, obstacles == 0

    def explored(self, known: NDArray[np.bool_]) -> float:
        return float(covered(known, self._counted) / self._total)

    def mislabelled(self, known: NDArray[np.bool_], occupied: NDArray[np.bool_]) -> int:
        return int(mislabelled(known, occupied, self._solid, self._open))


@jit
def covered(known: NDArray[np.bool_], counted: NDArray[np.int64]) -> int:
    """Sum of what known cells count; shapes are the same."""
    total = 0
    for row in range(known.shape[0]):
        for column in range(known.shape[1]):
            total += counted[row, column] if known[row, column] else 0
    return total


@jit
def mislabelled(
    known: NDArray[np.bool_], occupied: NDArray[np.bool_], solid: NDArray[np.bool_], open_: NDArray[np.bool_]
) -> int:
    """Known cells that are believed occupied but open in truth, or free but solid; shapes are the same."""
    total = 0
    for row in range(known.shape[0]):
        for column in range(known.shape[1]):
            wrong = open_[row, column] if occupied[row, column] else solid[row, column]
            total += known[row, column] and wrong
    return total
