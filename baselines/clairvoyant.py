"""A reference that knows the truth: how fast could anyone explore this world? Never a competitor.

It plans without noise on the true map, in the steps that the driver takes, by beam search over decisions among the
same kind of candidates as everyone (5 nearest to the robot, 3 nearest to each landmark seen), until the map is
covered, and replans at each decision. A beam is no exhaustive search, so its time is an upper bound of the best one
and a regret to it may be negative.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from explore_bench import (
    Array,
    Driver,
    Grid,
    LandmarkScenario,
    Observation,
    Pose,
    RequestError,
    Scenario,
    World,
    cell_of,
    cells_of,
    centre_of,
    drive_to,
    frontier_cells,
    jit,
    search_grid,
    trace_path,
)

BEAM = 24
"""Plans kept at each depth; docs/clairvoyant.md shows what wider beams gain."""

METRES_PER_CELL = 0.6
"""Path [m] that a plan is expected to need for each cell still unknown: ranks plans of one depth."""


class Clairvoyant:
    """Chooses the first decision of the fastest plan that it finds on the true map."""

    def __init__(self, beam: int = BEAM, metres_per_cell: float = METRES_PER_CELL) -> None:
        self.beam, self.metres_per_cell = beam, metres_per_cell

    def reset_with_world(self, rng: np.random.Generator, world: World) -> None:
        """Begin a trial in a world that is known; there is nothing to draw."""
        self._obstacles = world.obstacles.reshape(-1).copy()
        self._uncounted = np.flatnonzero(~world.counted)
        self._landmarks = world.landmarks.copy()
        self._landmark_cells = cells_of(world.grid, world.landmarks)
        self._view: NDArray[np.int64] | None = None

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate with which the fastest plan begins."""
        scenario, belief = observation.scenario, observation.belief
        if not isinstance(scenario, LandmarkScenario):
            raise RequestError(f"clairvoyant plans in landmark worlds, not in kind '{scenario.kind}'; leave it out.")
        if self._view is None:
            self._view = views(scenario)
        known = belief.known.reshape(-1).copy()
        known[self._uncounted] = True  # as good as known: nobody has to see them
        counted = scenario.cell_count - len(self._uncounted)
        seen = np.zeros(len(self._landmarks), dtype=bool)
        seen[belief.landmark_ids] = True
        task = _Task(
            first_paths=np.concatenate(observation.paths),
            first_starts=np.cumsum([0] + [len(path) for path in observation.paths]),
            obstacles=self._obstacles,
            landmarks=self._landmarks,
            landmark_cells=self._landmark_cells,
            in_view=self._view,
            grid=scenario.grid,
            reach=scenario.sensor_range,
            driver=Driver.of(scenario),
            counts=(scenario.candidates_per_robot, scenario.candidates_per_landmark),
            target=len(self._uncounted) + math.ceil(scenario.coverage * counted - 1e-9),
            steps_per_cell=self.metres_per_cell / scenario.step_length,
        )
        return _plan(task, known, seen, observation.pose, self.beam)


def views(scenario: Scenario) -> NDArray[np.int64]:
    """Cells in range of each cell's centre, shape (n_g, V), filled up with −1."""
    inside = scenario.grid.in_reach(scenario.grid.centres(), scenario.sensor_range)
    result = np.full((scenario.cell_count, int(inside.sum(axis=1).max())), -1, dtype=np.int64)
    for cell, own in enumerate(inside):
        seen = np.flatnonzero(own)
        result[cell, : len(seen)] = seen
    return result


class _Task(NamedTuple):
    """What a search is given: the paths of the first decision one after another, the true map, and the constants."""

    first_paths: NDArray[np.int64]
    first_starts: NDArray[np.int64]
    obstacles: NDArray[np.bool_]
    landmarks: Array
    landmark_cells: NDArray[np.int64]
    in_view: NDArray[np.int64]
    grid: Grid
    reach: float
    driver: Driver
    counts: tuple[int, int]
    target: int
    steps_per_cell: float


class _Plans(NamedTuple):
    """Plans of one depth, a row each: what they know, where they are, how long they took, with what they began."""

    known: NDArray[np.bool_]
    seen: NDArray[np.bool_]
    pose: Array
    time: Array
    total: NDArray[np.int64]
    first: NDArray[np.int64]
    parent: NDArray[np.int64]


class _Children(NamedTuple):
    """Their continuations by one decision: of which plan and whereto, when, how promising, and a hash of the state."""

    plan: NDArray[np.int64]
    goal: NDArray[np.int64]
    time: Array
    score: Array
    code: NDArray[np.uint64]
    first: NDArray[np.int64]


@jit
def _plan(task: _Task, known: NDArray[np.bool_], seen: NDArray[np.bool_], pose: Pose, beam: int) -> int:
    """Beam search to the end of the exploration; returns the first choice of the fastest plan."""
    plans, others = _no_plans(beam, known.shape[0], seen.shape[0]), _no_plans(beam, known.shape[0], seen.shape[0])
    plans.known[0], plans.seen[0], plans.total[0] = known, seen, known.sum()
    plans.pose[0, 0], plans.pose[0, 1], plans.pose[0, 2] = pose
    choices = min(task.counts[0] + task.counts[1] * task.landmarks.shape[0], known.shape[0])
    children = _no_children(beam * max(choices, 1) + task.first_starts.shape[0])
    alive, depth, best_time, best_first = 1, 0, np.inf, 0
    while alive > 0:
        if depth > 0 and best_time == np.inf:
            best_first = plans.first[0]  # should no plan reach the target, the most promising one is followed
        count, best_time, best_first = _continue(task, plans, alive, depth, children, best_time, best_first)
        alive = _keep(task, plans, children, count, depth, best_time, others)
        plans, others = others, plans
        depth += 1
    return best_first


@jit
def _no_plans(beam: int, cells: int, landmarks: int) -> _Plans:
    return _Plans(
        np.zeros((beam, cells), dtype=np.bool_),
        np.zeros((beam, landmarks), dtype=np.bool_),
        np.zeros((beam, 3)),
        np.zeros(beam),
        np.zeros(beam, dtype=np.int64),
        np.zeros(beam, dtype=np.int64),
        np.full((beam, cells), -1, dtype=np.int64),
    )


@jit
def _no_children(room: int) -> _Children:
    return _Children(
        np.zeros(room, dtype=np.int64),
        np.zeros(room, dtype=np.int64),
        np.zeros(room),
        np.zeros(room),
        np.zeros(room, dtype=np.uint64),
        np.zeros(room, dtype=np.int64),
    )


@jit
def _continue(
    task: _Task, plans: _Plans, alive: int, depth: int, children: _Children, best_time: float, best_first: int
) -> tuple[int, float, int]:
    """Fill in the children of all plans; returns their number, and time and first choice of the fastest to arrive."""
    count, stamp = 0, 0
    mark = np.zeros(plans.known.shape[1], dtype=np.int64)
    for b in range(alive):
        for goal in _goals(task, plans, b, depth):
            path = _path_to(task, plans, b, goal, depth)
            stamp += 1
            time, total = _look_ahead(task, path, plans, b, mark, stamp)
            time += plans.time[b]
            first = goal if depth == 0 else plans.first[b]
            if total >= task.target:
                if time < best_time:
                    best_time, best_first = time, first
                continue
            if total == plans.total[b] or time >= best_time:
                continue
            children.plan[count], children.goal[count] = b, goal
            children.time[count], children.first[count] = time, first
            children.score[count] = time + task.steps_per_cell * (task.target - total)
            children.code[count] = _code(path[-1], plans.known[b], mark, stamp)
            count += 1
    return count, best_time, best_first


@jit
def _keep(
    task: _Task, plans: _Plans, children: _Children, count: int, depth: int, best_time: float, into: _Plans
) -> int:
    """Make the most promising children the plans of the next depth, each state once; returns how many there are."""
    beam = into.time.shape[0]
    codes = np.zeros(beam, dtype=np.uint64)
    alive = 0
    for c in np.argsort(children.score[:count], kind="mergesort"):
        if alive == beam or children.time[c] >= best_time:
            break
        if np.any(codes[:alive] == children.code[c]):
            continue
        b = children.plan[c]
        path = _path_to(task, plans, b, children.goal[c], depth)
        into.known[alive], into.seen[alive] = plans.known[b], plans.seen[b]
        into.pose[alive, 0], into.pose[alive, 1], into.pose[alive, 2] = _reveal(
            task, path, plans, b, into.known[alive], into.seen[alive]
        )
        into.time[alive], into.first[alive] = children.time[c], children.first[c]
        into.total[alive] = into.known[alive].sum()
        codes[alive] = children.code[c]
        alive += 1
    return alive


@jit
def _goals(task: _Task, plans: _Plans, b: int, depth: int) -> NDArray[np.int64]:
    """Where a plan may go next: the observation's candidates by number, later the cells of its own frontiers."""
    if depth == 0:
        return np.arange(task.first_starts.shape[0] - 1)
    shape = task.grid.rows, task.grid.columns
    place = cell_of(task.grid, plans.pose[b, 0], plans.pose[b, 1])
    free = _known_free(plans.known[b], plans.seen[b], task.obstacles, task.landmark_cells).reshape(shape)
    _, plans.parent[b] = search_grid(free, place)
    frontier = frontier_cells(plans.known[b].reshape(shape), free, free, place)
    return _select(frontier, place, task.landmarks[plans.seen[b]], task.grid, task.counts)


@jit
def _path_to(task: _Task, plans: _Plans, b: int, goal: int, depth: int) -> NDArray[np.int64]:
    """Cells of a plan's next path: one of the observation's at depth 0, else traced back in a search."""
    if depth == 0:
        return task.first_paths[task.first_starts[goal] : task.first_starts[goal + 1]].copy()
    return trace_path(plans.parent[b], goal)


@jit
def _look_ahead(
    task: _Task, path: NDArray[np.int64], plans: _Plans, b: int, mark: NDArray[np.int64], stamp: int
) -> tuple[float, int]:
    """Steps along a path until its end or until the target is known, and the number of cells known then.

    Cells that become known are marked with the stamp.
    """
    steps, total = 0.0, plans.total[b]
    pose = (plans.pose[b, 0], plans.pose[b, 1], plans.pose[b, 2])
    for k in range(path.shape[0]):
        if k > 0:
            taken, pose = drive_to(task.driver, pose, centre_of(task.grid, path[k]))
            steps += taken
        for cell in task.in_view[path[k]]:
            if cell < 0:
                break
            if not plans.known[b, cell] and mark[cell] != stamp:
                mark[cell] = stamp
                total += 1
        if total >= task.target:
            break
    return steps, total


@jit
def _reveal(
    task: _Task, path: NDArray[np.int64], plans: _Plans, b: int, known: NDArray[np.bool_], seen: NDArray[np.bool_]
) -> Pose:
    """Add to `known` and `seen` what a path reveals; returns the pose at its end."""
    pose = (plans.pose[b, 0], plans.pose[b, 1], plans.pose[b, 2])
    for k in range(path.shape[0]):
        x, y = centre_of(task.grid, path[k])
        if k > 0:
            _, pose = drive_to(task.driver, pose, (x, y))
        for cell in task.in_view[path[k]]:
            if cell >= 0:
                known[cell] = True
        for m in range(task.landmarks.shape[0]):
            if math.hypot(task.landmarks[m, 0] - x, task.landmarks[m, 1] - y) <= task.reach:
                seen[m] = True
    return pose


@jit
def _code(place: int, known: NDArray[np.bool_], mark: NDArray[np.int64], stamp: int) -> np.uint64:
    """Hash of where a plan is and of the cells that it knows."""
    code = _mix(np.uint64(place))
    for cell in range(known.shape[0]):
        if known[cell] or mark[cell] == stamp:
            code ^= _mix(np.uint64(cell + known.shape[0]))
    return code


@jit
def _known_free(
    known: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    obstacles: NDArray[np.bool_],
    landmark_cells: NDArray[np.int64],
) -> NDArray[np.bool_]:
    free = known & ~obstacles
    for m in range(seen.shape[0]):
        if seen[m]:
            free[landmark_cells[m]] = False
    return free


@jit
def _select(
    frontier: NDArray[np.int64],
    place: int,
    landmarks: Array,
    grid: Grid,
    counts: tuple[int, int],
) -> NDArray[np.int64]:
    """Frontier cells nearest to the robot and to each landmark, as the benchmark's candidates, ascending."""
    chosen = np.zeros(frontier.shape[0], dtype=np.bool_)
    for source in range(landmarks.shape[0] + 1):
        if source == 0:
            x, y = centre_of(grid, place)
        else:
            x, y = landmarks[source - 1, 0], landmarks[source - 1, 1]
        squared = np.empty(frontier.shape[0])
        for i in range(frontier.shape[0]):
            frontier_x, frontier_y = centre_of(grid, frontier[i])
            squared[i] = round((frontier_x - x) ** 2 + (frontier_y - y) ** 2, 9)
        order = np.argsort(squared, kind="mergesort")
        chosen[order[: counts[min(source, 1)]]] = True
    return frontier[chosen]


@jit
def _mix(value: np.uint64) -> np.uint64:
    """Scramble an integer (the finalizer of splitmix64), to hash sets of cells by exclusive or."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))
