"""A fast tour of a world that is known: in which order to look at it, found by simulated annealing.

A tour is a list of views: cells that the robot visits one after the other, on the shortest paths between them, until
enough of the map is known. It is judged as its steps would go without noise: the driver's own commands, and what is in
range after each of them. The search begins with greedy tours and changes their views: one is put in or left out, moved
to a cell nearby or to another place in the order, or a part of the order is turned round (Kirkpatrick et al. 1983).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import shortest_path
from scipy.spatial.distance import cdist

from explore_bench import (
    Array,
    Driver,
    Grid,
    Pose,
    cell_of,
    cells_within,
    centre_of,
    compose,
    jit,
    next_command,
    room_within,
    search_grid,
)

MISSING = 4.0
"""Steps that a cell short of the coverage costs while a tour does not reach it."""

GREED = (0.0, 0.5, 1.0, 2.0)
"""Values of g in what the greedy tours prefer, new cells / steps^(g + 1/2): with each of them an annealing begins."""

CHANGES = 60_000
"""Changes that an annealing tries."""

HOT, COLD = 6.0, 0.15
"""Temperature [steps] at the beginning and at the end of an annealing; it falls geometrically."""


class Site(NamedTuple):
    """What is to be toured. A named tuple, so compiled functions take it.

    Attributes
    ----------
    grid : of the cells.
    toward : next cell on the shortest path from one cell to another, shape (n_g, n_g), −1 where there is none.
    views : cells in which the robot can stand, shape (V,).
    counted : cells that count towards coverage, shape (n_g,).
    known : cells known before the first step, shape (n_g,).
    target : counted cells that are to be known.
    pose : at the start.
    driver : how the robot drives.
    reach : range of its sensor [m].
    """

    grid: Grid
    toward: NDArray[np.int32]
    views: NDArray[np.int64]
    counted: NDArray[np.bool_]
    known: NDArray[np.bool_]
    target: int
    pose: Pose
    driver: Driver
    reach: float


class Tour(NamedTuple):
    """Views in their order, shape (V,), and the steps that they take without noise; infinite where it never ends."""

    views: NDArray[np.int64]
    steps: float


def toward_all(grid: Grid, free: NDArray[np.bool_], start: int) -> NDArray[np.int32]:
    """Next cell on the shortest path from every cell to every other, shape (n_g, n_g), −1 where there is none.

    `free`, shape (rows, columns), says which cells may be entered; the start's own can be left.
    """
    toward = np.full((grid.cells, grid.cells), -1, dtype=np.int32)
    open_ = free.copy()
    open_.reshape(-1)[start] = True
    for goal in np.flatnonzero(open_).tolist():
        cost, parent = search_grid(open_, goal)  # paths are symmetric: the parent leads to the goal
        reached = np.isfinite(cost)
        toward[reached, goal] = parent[reached]
    return toward


def straight_toward_all(grid: Grid, free: NDArray[np.bool_], driver: Driver, reach: float) -> NDArray[np.int32]:
    """Return the same for a robot that drives straight on: each drive ends at a cell in range, so at a known one."""
    cells = np.flatnonzero(free)
    between = cdist(grid.centres(cells), grid.centres(cells))
    steps = np.where((between > 0.0) & (between <= reach), 2.0 + np.floor(between / driver.step_length), 0.0)
    lengths, before = shortest_path(csr_array(steps), return_predecessors=True)
    toward = np.full((grid.cells, grid.cells), -1, dtype=np.int32)
    reached = np.isfinite(lengths) & (before >= 0)
    toward[np.ix_(cells, cells)] = np.where(reached, cells[np.maximum(before, 0)], -1).T
    return toward


def best_tour(site: Site, rng: np.random.Generator, changes: int = CHANGES) -> Tour:
    """Fastest tour found, with as many changes for each greedy beginning."""
    best = Tour(np.empty(0, dtype=np.int64), math.inf)
    for greed in GREED:
        views = greedy_tour(site, greed)
        views, steps = _anneal(site, views, rng.random((changes, 5)))
        if steps < best.steps:
            best = Tour(views, steps)
    return best


@jit
def steps_of(site: Site, views: NDArray[np.int64]) -> tuple[float, int]:
    """Steps of a tour until enough is known, or to its end, and the counted cells known then."""
    return end_of(site, views)[:2]


@jit
def end_of(site: Site, views: NDArray[np.int64]) -> tuple[float, int, Pose]:
    """Steps and counted cells likewise, and the pose then."""
    seen = np.full(len(site.known), np.inf)
    total = _known_at_start(site, seen)
    return _walk(site, views, 0, site.pose, 0.0, total, seen, np.inf, _no_marks(len(views)))[:3]


@jit
def changed(site: Site, views: NDArray[np.int64], draw: Array) -> NDArray[np.int64]:
    """Views of a tour changed as `draw`, five uniform numbers in [0, 1), says; empty where that changes nothing."""
    other = np.empty(len(views) + 1, dtype=np.int64)
    length, _ = _changed(site, views, len(views), draw, other)
    return other[:length]


@jit
def greedy_tour(site: Site, greed: float) -> NDArray[np.int64]:
    """Tour that goes again and again to the view of most new cells / steps^(greed + 1/2)."""
    seen = np.full(len(site.known), np.inf)
    total = _known_at_start(site, seen)
    pose, steps = site.pose, 0.0
    tour = np.empty(len(site.views), dtype=np.int64)
    count = 0
    one = np.empty(1, dtype=np.int64)
    marks = _no_marks(1)
    while total < site.target and count < len(tour):
        best, best_view = 0.0, -1
        for view in site.views:
            one[0] = view
            scratch = seen.copy()
            until, known, _, _ = _walk(site, one, 0, pose, steps, total, scratch, np.inf, marks)
            worth = (known - total) / max(until - steps, 1.0) ** (greed + 0.5)
            if known > total and worth > best:
                best, best_view = worth, view
        if best_view < 0:
            break
        one[0] = best_view
        steps, total, pose, _ = _walk(site, one, 0, pose, steps, total, seen, np.inf, marks)
        tour[count] = best_view
        count += 1
    return tour[:count].copy()


class _Marks(NamedTuple):
    """How a tour stood before each of its views: pose, steps and known cells."""

    pose: Array
    steps: Array
    total: NDArray[np.int64]


@jit
def _no_marks(count: int) -> _Marks:
    return _Marks(np.zeros((count + 1, 3)), np.zeros(count + 1), np.zeros(count + 1, dtype=np.int64))


@jit
def _known_at_start(site: Site, seen: Array) -> int:
    """Note in `seen`, steps at which cells are first seen, shape (n_g,), what is known at first; how much counts."""
    total = 0
    for cell in range(len(site.known)):
        if site.known[cell]:
            seen[cell] = 0.0
            total += site.counted[cell]
    return total


@jit
def _walk(
    site: Site,
    views: NDArray[np.int64],
    first: int,
    pose: Pose,
    steps: float,
    total: int,
    seen: Array,
    limit: float,
    marks: _Marks,
) -> tuple[float, int, Pose, int]:
    """Walk on from a pose through the views from `first` on, until enough is known or `limit` steps are exceeded.

    Returns steps, counted cells known, the pose and how many views were begun; `seen` and `marks` are filled in.
    """
    grid = site.grid
    cells, ways = room_within(grid, site.reach)
    place = cell_of(grid, pose[0], pose[1])
    for k in range(first, len(views)):
        marks.pose[k, 0], marks.pose[k, 1], marks.pose[k, 2] = pose
        marks.steps[k], marks.total[k] = steps, total
        if total >= site.target or steps > limit:
            return steps, total, pose, k
        goal = views[k]
        while place != goal:
            place = site.toward[place, goal]
            if place < 0:
                return np.inf, total, pose, k
            waypoint = centre_of(grid, place)
            stage = 0
            while True:
                turn, forward, stage = next_command(site.driver, pose, waypoint, stage)
                if stage < 0:
                    break
                pose = compose(pose, (forward, 0.0, turn))
                steps += 1.0
                for i in range(cells_within(grid, pose[0], pose[1], site.reach, cells, ways)):
                    if seen[cells[i]] == np.inf:
                        seen[cells[i]] = steps
                        total += site.counted[cells[i]]
                if total >= site.target:
                    return steps, total, pose, k + 1
    return steps, total, pose, len(views)


@jit
def _anneal(site: Site, views: NDArray[np.int64], draws: Array) -> tuple[NDArray[np.int64], float]:
    """Change a tour again and again; returns the fastest found and its steps, infinite where none knows enough.

    `draws` are uniform in [0, 1), five for each change, shape (changes, 5).
    """
    room = max(2 * len(views), len(views) + 16)
    now, other, best = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64), views.copy()
    count = len(views)
    now[:count] = views
    marks, marks_after = _no_marks(room), _no_marks(room)
    seen, seen_after = np.full(len(site.known), np.inf), np.empty(len(site.known))
    at_start = _known_at_start(site, seen)
    steps, total, _, begun = _walk(site, now[:count], 0, site.pose, 0.0, at_start, seen, np.inf, marks)
    cost = steps + MISSING * max(site.target - total, 0)
    best_steps = steps if total >= site.target else np.inf
    count = begun if total >= site.target else count
    cooling = (COLD / HOT) ** (1.0 / len(draws))
    heat = HOT
    for draw in draws:
        heat *= cooling
        length, first = _changed(site, now, count, draw, other)
        if length == 0:
            continue
        limit = cost - heat * math.log(1.0 - draw[4])  # Metropolis: so much is accepted
        pose = (marks.pose[first, 0], marks.pose[first, 1], marks.pose[first, 2])
        since, known = marks.steps[first], marks.total[first]
        for cell in range(len(site.known)):
            seen_after[cell] = seen[cell] if seen[cell] <= since else np.inf
        after, total, _, begun = _walk(site, other[:length], first, pose, since, known, seen_after, limit, marks_after)
        reached = total >= site.target
        cost_after = after + MISSING * max(site.target - total, 0)
        if not cost_after <= limit:
            continue
        cost = cost_after
        count = begun if reached else length
        now[:count] = other[:count]
        marks.pose[first:count] = marks_after.pose[first:count]
        marks.steps[first:count], marks.total[first:count] = (
            marks_after.steps[first:count],
            marks_after.total[first:count],
        )
        seen[:] = seen_after
        if reached and after < best_steps:
            best_steps, best = after, now[:count].copy()
    return best, best_steps


@jit
def _changed(site: Site, now: NDArray[np.int64], count: int, draw: Array, other: NDArray[np.int64]) -> tuple[int, int]:
    """Write a changed tour into `other`; returns its length and the first view that differs, 0 for none."""
    kind, i = draw[0], int(draw[1] * count)
    if kind < 0.4:  # a view moves to a cell nearby
        view = _nearby(site, now[i], draw[2])
        if view < 0 or view == now[i]:
            return 0, 0
        other[:count] = now[:count]
        other[i] = view
        return count, i
    if kind < 0.55:  # a view is put in, near one that is there or anywhere
        view = _nearby(site, now[i], draw[2]) if kind < 0.5 else site.views[int(draw[2] * len(site.views))]
        if count + 1 > len(other) or view < 0:
            return 0, 0
        other[:i], other[i] = now[:i], view
        other[i + 1 : count + 1] = now[i:count]
        return count + 1, i
    if kind < 0.75:  # one is left out
        if count < 2:
            return 0, 0
        other[:i] = now[:i]
        other[i : count - 1] = now[i + 1 : count]
        return count - 1, i
    j = int(draw[3] * count)
    low, high = min(i, j), max(i, j)
    if low == high:
        return 0, 0
    other[:count] = now[:count]
    if kind < 0.9:  # a part is turned round
        other[low : high + 1] = now[low : high + 1][::-1]
    elif i < j:  # one moves to another place in the order
        other[low:high] = now[low + 1 : high + 1]
        other[high] = now[low]
    else:
        other[low + 1 : high + 1] = now[low:high]
        other[low] = now[high]
    return count, low


@jit
def _nearby(site: Site, view: int, draw: float) -> int:
    """Return a cell within two cells of a view, as drawn from [0, 1); −1 where it is off the grid or out of reach."""
    columns = site.grid.columns
    place = int(25 * draw)
    row, column = view // columns + place // 5 - 2, view % columns + place % 5 - 2
    if not (0 <= row < site.grid.rows and 0 <= column < columns):
        return -1
    cell = row * columns + column
    return cell if cell == view or site.toward[view, cell] >= 0 else -1
