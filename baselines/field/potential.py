"""MMPF: a potential field of frontiers, Explore-Bench's own baseline (Yu et al. 2021, "SMMR-Explore")."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from baselines.field.believed import finest_map, frontiers, lengths_from, stands
from baselines.field.constants import at_least
from explore_bench import Array, Observation, jit

CLOSE = 2
"""Frontier cells of a Manhattan distance up to this belong together (mmpf_node.cpp: below 3)."""

MOST_STEPS = 3000
"""Steps of a descent (mmpf_node.cpp)."""


class PotentialField:
    """Descends the potential −Σ n / d from cell to cell, revisits costing 5, and goes to the frontier that it comes to.

    As mmpf_node.cpp of Explore-Bench has it for one robot: n is the number of cells of a frontier, d the length of the
    way from a cell to it, in cells, and the sum is over frontiers; a cell that "has been passed before" costs 5 each
    time. Where none of 4 neighbours is lower the path ends, and the robot drives to its end.

    Its code begins the list of what was passed anew with each descent, which never comes back to a cell, so that there
    the 5 have no effect: the control without revisits is what the code computes, this is what its comment says.

    Converted: frontiers that hold a candidate count, each with the candidate nearest to its middle at d = 0; lengths
    are of drives, 8 neighbours. The robot drives to the candidate where the original ends a cell before; where a path
    ends elsewhere, to the frontier that attracts most there. What was passed is where the
    estimated poses were. Frontier cells less than 6 cells from an obstacle, or in the costmap's inflation, do not count
    there; candidates can be driven to. n and d are of the finest map, and n / d has no unit. Control: without revisits.

    Parameters
    ----------
    revisit : cost of a cell for each time that it was passed.
    """

    def __init__(self, revisit: float = 5.0) -> None:
        self.revisit = at_least(0.0, revisit, "revisit of the potential field")

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate at the descent's end, of the nearest where it has none."""
        grid = observation.roads.grid
        centres, sizes = self._clusters(observation)
        cells = stands(observation)[centres]
        distances = lengths_from(observation, cells) / grid.resolution
        passed = np.zeros(grid.cells, dtype=np.int64)
        previous = -1
        for x, y, _ in observation.belief.poses.tolist():
            cell = grid.cell_of(x, y)
            passed[cell] += cell != previous
            previous = cell
        reached = _descend(distances, sizes, passed, self.revisit, observation.roads.start, grid.columns)
        return int(observation.path_lengths.argmin()) if reached < 0 else int(centres[reached])

    def _clusters(self, observation: Observation) -> tuple[NDArray[np.int64], Array]:
        """Candidate at the middle of each frontier that holds one, shape (F,), and the number of its cells, (F,)."""
        found = frontiers(observation)
        edge = finest_map(observation).grid.resolution
        cells = np.rint(observation.positions / edge - 0.5)
        apart = np.abs(cells[:, None] - cells[None]).sum(axis=2)
        joined = (apart <= CLOSE) | ((found.number[:, None] == found.number) & (found.number > 0))
        numbers = _components(joined)
        centres, sizes = [], []
        for number in range(int(numbers.max()) + 1):
            own = np.flatnonzero(numbers == number)
            middle = observation.positions[own].mean(axis=0)
            centres.append(own[((observation.positions[own] - middle) ** 2).sum(axis=1).argmin()])
            _, first = np.unique(found.number[own], return_index=True)
            sizes.append(found.length[own][first].sum() / edge)
        return np.array(centres, dtype=np.int64), np.array(sizes)


@jit
def _components(joined: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of the group of each, what is joined being in one, shape (C,)."""
    count = joined.shape[0]
    numbers = np.full(count, -1, dtype=np.int64)
    stack = np.empty(count, dtype=np.int64)
    groups = 0
    for begin in range(count):
        if numbers[begin] >= 0:
            continue
        numbers[begin], stack[0] = groups, begin
        size = 1
        while size > 0:
            size -= 1
            one = stack[size]
            for other in range(count):
                if joined[one, other] and numbers[other] < 0:
                    numbers[other], stack[size] = groups, other
                    size += 1
        groups += 1
    return numbers


@jit
def _descend(
    distances: Array, sizes: Array, passed: NDArray[np.int64], revisit: float, start: int, columns: int
) -> int:
    """Frontier to within a cell of which the descent comes, or that attracts most where it ends; −1 for none.

    `distances` are from each frontier to each cell [cells], shape (F, cells), `passed` how often a cell was passed.
    """
    count = distances.shape[0]
    cell, current = start, np.inf
    for _ in range(MOST_STEPS):
        for f in range(count):
            if distances[f, cell] <= 1.5:  # a cell away, or across a corner
                return f
        lowest, best = np.inf, -1
        row, column = cell // columns, cell % columns
        for k in range(4):
            to_row, to_column = row + (k == 0) - (k == 1), column + (k == 2) - (k == 3)
            to = to_row * columns + to_column
            if to_row < 0 or to >= distances.shape[1] or not 0 <= to_column < columns:
                continue
            potential, reachable = revisit * passed[to], False
            for f in range(count):
                if 0.0 < distances[f, to] < np.inf:
                    potential -= sizes[f] / distances[f, to]
                    reachable = True
            if reachable and potential < lowest - 1e-12:
                lowest, best = potential, to
        if best < 0 or not lowest < current:
            break
        cell, current = best, lowest
        passed[cell] += 1
    strongest, found = 0.0, -1
    for f in range(count):
        if 0.0 < distances[f, cell] < np.inf and sizes[f] / distances[f, cell] > strongest:
            strongest, found = sizes[f] / distances[f, cell], f
    return found
