"""A reference that knows the truth: how fast could anyone explore this world? Never a competitor.

It plans without noise on the true map, by beam search over decisions among the same kind of candidates as everyone
(5 nearest to the robot, 3 nearest to each landmark seen), until the map is covered, and replans at each decision.
A beam is no exhaustive search, so its time is an upper bound of the best one and a regret to it may be negative.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench import (
    Array,
    Grid,
    LandmarkScenario,
    Observation,
    Scenario,
    World,
    cells_of,
    centre_of,
    frontier_cells,
    jit,
    search_grid,
    trace_path,
    wrap_angle,
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
        assert isinstance(scenario, LandmarkScenario)
        if self._view is None:
            self._view = views(scenario)
        known = belief.known.reshape(-1).copy()
        known[self._uncounted] = True  # as good as known: nobody has to see them
        counted = scenario.cell_count - len(self._uncounted)
        seen = np.zeros(len(self._landmarks), dtype=bool)
        seen[belief.landmark_ids] = True
        starts = np.cumsum([0] + [len(path) for path in observation.paths])
        return _plan(
            known,
            seen,
            observation.pose[2],
            np.concatenate(observation.paths),
            starts,
            self._obstacles,
            self._landmarks,
            self._landmark_cells,
            self._view,
            scenario.grid,
            scenario.sensor_range,
            (scenario.step_length, math.radians(scenario.turn_threshold_deg)),
            (scenario.candidates_per_robot, scenario.candidates_per_landmark),
            len(self._uncounted) + math.ceil(scenario.coverage * counted - 1e-9),
            self.beam,
            self.metres_per_cell / scenario.step_length,
        )


def views(scenario: Scenario) -> NDArray[np.int64]:
    """Cells in range of each cell's centre, shape (n_g, V), filled up with −1."""
    inside = scenario.grid.in_reach(scenario.grid.centres(), scenario.sensor_range)
    result = np.full((scenario.cell_count, int(inside.sum(axis=1).max())), -1, dtype=np.int64)
    for cell, own in enumerate(inside):
        seen = np.flatnonzero(own)
        result[cell, : len(seen)] = seen
    return result


@jit
def _plan(
    known: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    heading: float,
    first_paths: NDArray[np.int64],
    first_starts: NDArray[np.int64],
    obstacles: NDArray[np.bool_],
    landmarks: Array,
    landmark_cells: NDArray[np.int64],
    view: NDArray[np.int64],
    grid: Grid,
    reach: float,
    motion: tuple[float, float],
    counts: tuple[int, int],
    target: int,
    beam: int,
    steps_per_cell: float,
) -> int:
    """Beam search to the end of the exploration; returns the first choice of the fastest plan."""
    cells = grid.rows * grid.columns
    shape = grid.rows, grid.columns
    choices = min(counts[0] + counts[1] * landmarks.shape[0], cells)
    room = beam * max(choices, 1) + first_starts.shape[0]
    # plans of this depth: what they know, where they are, how long they took, and with what they began
    knowns, seens = np.zeros((beam, cells), dtype=np.bool_), np.zeros((beam, seen.shape[0]), dtype=np.bool_)
    places, headings = np.zeros(beam, dtype=np.int64), np.zeros(beam)
    times, totals, firsts = np.zeros(beam), np.zeros(beam, dtype=np.int64), np.zeros(beam, dtype=np.int64)
    parents = np.full((beam, cells), -1, dtype=np.int64)
    # their continuations
    child_from, child_goal = np.zeros(room, dtype=np.int64), np.zeros(room, dtype=np.int64)
    child_time, child_score = np.zeros(room), np.zeros(room)
    child_hash, child_first = np.zeros(room, dtype=np.uint64), np.zeros(room, dtype=np.int64)
    mark = np.zeros(cells, dtype=np.int64)
    stamp = 0
    knowns[0], seens[0], headings[0], totals[0] = known, seen, heading, known.sum()
    alive, depth, best_time, best_first = 1, 0, np.inf, 0
    while alive > 0:
        if depth > 0 and best_time == np.inf:
            best_first = firsts[0]  # should no plan reach the target, the most promising one is followed
        children = 0
        for b in range(alive):
            if depth == 0:
                goals = np.arange(first_starts.shape[0] - 1)
            else:
                free = _known_free(knowns[b], seens[b], obstacles, landmark_cells).reshape(shape)
                _, parents[b] = search_grid(free, places[b], -1)
                frontier = frontier_cells(knowns[b].reshape(shape), free, free, places[b])
                goals = _select(frontier, places[b], landmarks[seens[b]], grid, counts)
            for goal in goals:
                path = _path_to(goal, depth, first_paths, first_starts, parents[b])
                stamp += 1
                time, total = _look_ahead(
                    path, knowns[b], headings[b], totals[b], target, view, mark, stamp, grid, motion
                )
                time += times[b]
                first = goal if depth == 0 else firsts[b]
                if total >= target:
                    if time < best_time:
                        best_time, best_first = time, first
                    continue
                if total == totals[b] or time >= best_time:
                    continue
                code = _mix(np.uint64(path[-1]))
                for cell in range(cells):
                    if knowns[b, cell] or mark[cell] == stamp:
                        code ^= _mix(np.uint64(cell + cells))
                child_from[children], child_goal[children] = b, goal
                child_time[children], child_first[children] = time, first
                child_score[children] = time + steps_per_cell * (target - total)
                child_hash[children] = code
                children += 1
        order = np.argsort(child_score[:children], kind="mergesort")
        next_knowns, next_seens = knowns.copy(), seens.copy()
        next_places, next_headings = places.copy(), headings.copy()
        next_times, next_totals, next_firsts = times.copy(), totals.copy(), firsts.copy()
        hashes = np.zeros(beam, dtype=np.uint64)
        alive = 0
        for c in order:
            if alive == beam or child_time[c] >= best_time:
                break
            if np.any(hashes[:alive] == child_hash[c]):
                continue
            b, goal = child_from[c], child_goal[c]
            path = _path_to(goal, depth, first_paths, first_starts, parents[b])
            next_knowns[alive], next_seens[alive] = knowns[b], seens[b]
            direction = _reveal(
                path, headings[b], next_knowns[alive], next_seens[alive], view, landmarks, grid, reach, motion
            )
            next_places[alive], next_headings[alive] = path[-1], direction
            next_times[alive], next_firsts[alive] = child_time[c], child_first[c]
            next_totals[alive] = next_knowns[alive].sum()
            hashes[alive] = child_hash[c]
            alive += 1
        knowns, seens, places, headings = next_knowns, next_seens, next_places, next_headings
        times, totals, firsts = next_times, next_totals, next_firsts
        depth += 1
    return best_first


@jit
def _path_to(
    goal: int,
    depth: int,
    first_paths: NDArray[np.int64],
    first_starts: NDArray[np.int64],
    parent: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Cells of a plan's next path: one of the observation's at depth 0, else traced back in a search."""
    if depth == 0:
        return first_paths[first_starts[goal] : first_starts[goal + 1]].copy()
    return trace_path(parent, goal)


@jit
def _look_ahead(
    path: NDArray[np.int64],
    known: NDArray[np.bool_],
    heading: float,
    total: int,
    target: int,
    view: NDArray[np.int64],
    mark: NDArray[np.int64],
    stamp: int,
    grid: Grid,
    motion: tuple[float, float],
) -> tuple[float, int]:
    """Steps along a path until its end or until `target` cells are known, and the number known then.

    Cells that become known are marked with the stamp.
    """
    steps = 0.0
    for k in range(path.shape[0]):
        if k > 0:
            elapsed, heading = _drive(path[k - 1], path[k], heading, grid, motion)
            steps += elapsed
        for cell in view[path[k]]:
            if cell < 0:
                break
            if not known[cell] and mark[cell] != stamp:
                mark[cell] = stamp
                total += 1
        if total >= target:
            break
    return steps, total


@jit
def _reveal(
    path: NDArray[np.int64],
    heading: float,
    known: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    view: NDArray[np.int64],
    landmarks: Array,
    grid: Grid,
    reach: float,
    motion: tuple[float, float],
) -> float:
    """Add to `known` and `seen` what a path reveals; returns the heading at its end."""
    for k in range(path.shape[0]):
        if k > 0:
            _, heading = _drive(path[k - 1], path[k], heading, grid, motion)
        for cell in view[path[k]]:
            if cell >= 0:
                known[cell] = True
        x, y = centre_of(grid, path[k])
        for m in range(landmarks.shape[0]):
            if math.hypot(landmarks[m, 0] - x, landmarks[m, 1] - y) <= reach:
                seen[m] = True
    return heading


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
def _drive(start: int, end: int, heading: float, grid: Grid, motion: tuple[float, float]) -> tuple[float, float]:
    """Steps from one cell's centre to the next, a turn in place included, and the heading afterwards."""
    step_length, turn_threshold = motion
    columns, size = grid.columns, grid.resolution
    dx, dy = (end % columns - start % columns) * size, (end // columns - start // columns) * size
    direction = math.atan2(dy, dx)
    steps = math.ceil(math.hypot(dx, dy) / step_length - 1e-9)
    if abs(wrap_angle(direction - heading)) > turn_threshold:
        return steps + 1.0, direction
    return float(steps), heading


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
