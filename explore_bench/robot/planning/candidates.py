"""Frontiers and the candidates among them (§4.1): 5 nearest to the robot, 3 nearest to each landmark seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Pose, cell_of, centre_of
from explore_bench.robot.planning.astar import shortest_path
from explore_bench.world.scenario import Scenario


@dataclass(frozen=True)
class Ground:
    """The grid that the robot believes in, as far as planning needs it; built anew where it is needed.

    Attributes
    ----------
    scenario, pose : physical constants, estimated pose.
    known, occupied : cells observed, and cells believed occupied, shape (n, n).
    landmarks : estimates [m], shape (M, 2).
    """

    scenario: Scenario
    pose: Pose
    known: NDArray[np.bool_]
    occupied: NDArray[np.bool_]
    landmarks: Array

    @property
    def own_cell(self) -> int:
        """The robot's cell."""
        return cell_of(self.pose[0], self.pose[1], self.scenario.cells, self.scenario.cell_size)

    @property
    def landmark_cells(self) -> NDArray[np.int64]:
        """Cells that hold a landmark's estimate, shape (M,)."""
        n, size = self.scenario.cells, self.scenario.cell_size
        return np.array([cell_of(x, y, n, size) for x, y in self.landmarks], dtype=np.int64)

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """Cells that no path enters, shape (n, n)."""
        blocked = self.occupied.copy()
        blocked.reshape(-1)[self.landmark_cells] = True
        return blocked


@dataclass(frozen=True)
class Candidates:
    """What a strategy chooses from, in ascending order of cells.

    Attributes
    ----------
    cells : target cells, shape (C,).
    paths : for each the cells of its path, from the robot's own to the target.
    lengths : length of each path [m], shape (C,).
    """

    cells: NDArray[np.int64]
    paths: tuple[NDArray[np.int64], ...]
    lengths: Array


class Withheld:
    """Frontiers at which a decision ended, withheld until the unknown cells around them change (no ping-pong)."""

    def __init__(self) -> None:
        self._surroundings: dict[int, bytes] = {}

    def add(self, cell: int, known: NDArray[np.bool_]) -> None:
        """Withhold a cell for as long as its surroundings stay as they are."""
        self._surroundings[cell] = _surroundings(cell, known)

    def holds(self, cell: int, known: NDArray[np.bool_]) -> bool:
        """Whether a cell is withheld now."""
        return self._surroundings.get(cell) == _surroundings(cell, known)


def find_candidates(ground: Ground, withheld: Withheld) -> Candidates:
    """Candidates of the present belief; none where no frontier can be reached.

    Frontiers are known free cells with an unknown cell among their 8 neighbours, reachable through known free
    cells. Where there is none, unknown cells count as free; where there is still none, withheld ones return. A robot
    that its own misplaced obstacles wall in drives through them: every free cell can be reached, so its map is wrong.
    """
    free_known = ground.known & ~ground.blocked
    free_all = ~ground.blocked
    anything = np.ones_like(free_all)
    for free, allow_withheld in (
        (free_known, False),
        (free_all, False),
        (free_known, True),
        (free_all, True),
        (anything, True),
    ):
        frontier = frontier_cells(ground.known, free_known, free, ground.own_cell)
        if not allow_withheld:
            frontier = np.array([c for c in frontier.tolist() if not withheld.holds(c, ground.known)], dtype=np.int64)
        if len(frontier):
            return _plan(ground, free, _select(ground, frontier))
    return Candidates(np.empty(0, dtype=np.int64), (), np.empty(0))


def _select(ground: Ground, frontier: NDArray[np.int64]) -> NDArray[np.int64]:
    scenario = ground.scenario
    n, size = scenario.cells, scenario.cell_size
    centres = np.stack(((frontier % n + 0.5) * size, (frontier // n + 0.5) * size), axis=1)

    def nearest(point: Array, count: int) -> NDArray[np.int64]:
        squared = np.round(((centres - point) ** 2).sum(axis=1), 9)
        return frontier[np.lexsort((frontier, squared))[:count]]

    chosen = [nearest(np.array(ground.pose[:2]), scenario.candidates_per_robot)]
    chosen += [nearest(point, scenario.candidates_per_landmark) for point in ground.landmarks]
    return np.unique(np.concatenate(chosen))


def _plan(ground: Ground, free: NDArray[np.bool_], cells: NDArray[np.int64]) -> Candidates:
    planned = [shortest_path(free, ground.own_cell, cell) for cell in cells.tolist()]
    lengths = np.array([length for _, length in planned]) * ground.scenario.cell_size
    return Candidates(cells, tuple(path for path, _ in planned), lengths)


@jit
def frontier_cells(
    known: NDArray[np.bool_], free_known: NDArray[np.bool_], free: NDArray[np.bool_], start: int
) -> NDArray[np.int64]:
    """Frontier cells reachable from `start` through `free`, without the start itself, ascending.

    Without corner cutting the cells reachable by 8-connected paths are those reachable by 4-connected ones.
    """
    n = known.shape[0]
    reached = np.zeros(n * n, dtype=np.bool_)
    stack = np.empty(n * n, dtype=np.int64)
    reached[start] = True
    stack[0] = start
    size = 1
    while size > 0:
        size -= 1
        row, column = stack[size] // n, stack[size] % n
        for to_row, to_column in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            if 0 <= to_row < n and 0 <= to_column < n and free[to_row, to_column]:
                cell = to_row * n + to_column
                if not reached[cell]:
                    reached[cell] = True
                    stack[size] = cell
                    size += 1
    found = np.empty(n * n, dtype=np.int64)
    count = 0
    for cell in range(n * n):
        row, column = cell // n, cell % n
        if cell == start or not reached[cell] or not free_known[row, column]:
            continue
        if _has_unknown_neighbour(known, row, column):
            found[count] = cell
            count += 1
    return found[:count].copy()


@jit
def _has_unknown_neighbour(known: NDArray[np.bool_], row: int, column: int) -> bool:
    n = known.shape[0]
    for to_row in range(max(row - 1, 0), min(row + 2, n)):
        for to_column in range(max(column - 1, 0), min(column + 2, n)):
            if not known[to_row, to_column]:
                return True
    return False


def _surroundings(cell: int, known: NDArray[np.bool_]) -> bytes:
    n = known.shape[0]
    row, column = divmod(cell, n)
    return known[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].tobytes()


@jit
def any_blocked(
    cells: NDArray[np.int64],
    own_cell: int,
    occupied: NDArray[np.bool_],
    landmarks: Array,
    n: int,
    cell_size: float,
) -> bool:
    """Whether one of the cells, the robot's own aside, is occupied (shape (n²,)) or holds a landmark's estimate."""
    for cell in cells:
        if cell != own_cell and occupied[cell]:
            return True
    for m in range(landmarks.shape[0]):
        holder = cell_of(landmarks[m, 0], landmarks[m, 1], n, cell_size)
        if holder != own_cell:
            for cell in cells:
                if cell == holder:
                    return True
    return False


def waypoints(path: NDArray[np.int64], scenario: Scenario) -> list[tuple[float, float]]:
    """Centres [m] of the cells that a path enters: all but the first."""
    return [centre_of(cell, scenario.cells, scenario.cell_size) for cell in path[1:].tolist()]
