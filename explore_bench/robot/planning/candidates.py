"""The candidates of a decision (§4.1): of the frontiers, the 5 nearest to the robot, and 3 to each landmark seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Array, Pose, cells_of
from explore_bench.robot.planning.frontier import frontier_cells
from explore_bench.robot.planning.roads import Roads
from explore_bench.world.scenario import Scenario


@dataclass(frozen=True)
class Ground:
    """The grid that the robot believes in, as far as planning needs it; built anew where it is needed.

    Attributes
    ----------
    scenario, pose : physical constants, estimated pose.
    known, occupied : cells observed, and cells believed occupied, shape (rows, columns).
    landmarks : estimates [m], shape (M, 2).
    inside : cells that a decision may lead to, shape (rows, columns); None for all.
    least_unknown : unknown neighbours that make a known free cell a frontier.
    straight : whether the robot drives straight to its target, whatever lies between.
    """

    scenario: Scenario
    pose: Pose
    known: NDArray[np.bool_]
    occupied: NDArray[np.bool_]
    landmarks: Array
    inside: NDArray[np.bool_] | None = None
    least_unknown: int = 1
    straight: bool = False

    @property
    def own_cell(self) -> int:
        """The robot's cell."""
        return self.scenario.grid.cell_of(self.pose[0], self.pose[1])

    @property
    def landmark_cells(self) -> NDArray[np.int64]:
        """Cells that hold a landmark's estimate, shape (M,)."""
        return cells_of(self.scenario.grid, self.landmarks)

    @property
    def blocked(self) -> NDArray[np.bool_]:
        """Cells that no path enters, shape (rows, columns)."""
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
    roads : where else the robot could drive.
    """

    cells: NDArray[np.int64]
    paths: tuple[NDArray[np.int64], ...]
    lengths: Array
    roads: Roads


class Withheld:
    """Frontiers at which a decision ended, withheld until the unknown cells around them change (no ping-pong).

    A frontier of which some unknown neighbour cannot be seen (it is out of range, or hidden) stays one for ever; a
    robot that went there once would be sent there again and again. What is kept is what was known around it then: as
    soon as that has changed, going there can be worth something again.
    """

    def __init__(self) -> None:
        self._surroundings: dict[int, bytes] = {}

    def add(self, cell: int, known: NDArray[np.bool_]) -> None:
        """Withhold a cell for as long as its surroundings stay as they are."""
        self._surroundings[cell] = _surroundings(cell, known)

    def holds(self, cell: int, known: NDArray[np.bool_]) -> bool:
        """Whether a cell is withheld now."""
        return self._surroundings.get(cell) == _surroundings(cell, known)


def find_candidates(ground: Ground, withheld: Withheld) -> Candidates | None:
    """Candidates of the present belief; None where no frontier can be reached.

    Frontiers are known free cells with an unknown cell among their 8 neighbours, reachable through known free
    cells. Where there is none, unknown cells count as free; where there is still none, withheld ones return. A robot
    that its own misplaced obstacles wall in drives through them: every free cell can be reached, so its map is wrong.
    A robot that drives straight to its target reaches all of them.
    """
    known_free = ground.known & ~ground.blocked
    if ground.inside is not None:
        known_free &= ground.inside
    not_blocked = ~ground.blocked
    anything = np.ones_like(not_blocked)
    # Each line gives up one thing of the line before, the cheapest first. Going where it has just been is worth less to
    # a robot than driving into the unknown, so withheld frontiers come back only after the unknown was tried; and only
    # a robot that nothing else can move takes its believed obstacles for errors.
    for free, with_withheld in (
        (known_free, False),
        (not_blocked, False),
        (known_free, True),
        (not_blocked, True),
        (anything, True),
    ):
        driven = anything if ground.straight else free
        frontier = frontier_cells(ground.known, known_free, driven, ground.own_cell, ground.least_unknown)
        if not with_withheld:
            frontier = np.array([c for c in frontier.tolist() if not withheld.holds(c, ground.known)], dtype=np.int64)
        if len(frontier):
            chosen = _select(ground, frontier)
            return _plan(ground, free, chosen) if len(chosen) else None
    return None


def _select(ground: Ground, frontier: NDArray[np.int64]) -> NDArray[np.int64]:
    """The 5 frontiers nearest to the robot and the 3 nearest to each landmark seen (§4.1), ascending."""
    scenario = ground.scenario
    centres = scenario.grid.centres(frontier)

    def nearest(point: Array, count: int) -> NDArray[np.int64]:
        squared = np.round(((centres - point) ** 2).sum(axis=1), 9)
        return frontier[np.lexsort((frontier, squared))[:count]]

    chosen = [nearest(np.array(ground.pose[:2]), scenario.candidates_per_robot)]
    chosen += [nearest(point, scenario.candidates_per_landmark) for point in ground.landmarks]
    return np.unique(np.concatenate(chosen))


def _plan(ground: Ground, free: NDArray[np.bool_], cells: NDArray[np.int64]) -> Candidates:
    roads = Roads(ground.scenario.grid, free, ground.own_cell, ground.pose[:2] if ground.straight else None)
    return Candidates(cells, tuple(roads.path_to(cell) for cell in cells.tolist()), roads.lengths_to(cells), roads)


def _surroundings(cell: int, known: NDArray[np.bool_]) -> bytes:
    row, column = divmod(cell, known.shape[1])
    return known[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].tobytes()
