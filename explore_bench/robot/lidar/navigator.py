"""Where to go on the fine map: candidates from frontiers, the way to each, and when a drive has to end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose, cell_of, centre_of
from explore_bench.robot.lidar.frontiers import MOST_TRIES, Frontier, frontier_mask, frontier_of, frontiers
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.robot.lidar.terrain import Terrain, Ways, length_of
from explore_bench.robot.planning.roads import Roads
from explore_bench.world.lidar.constants import LidarScenario

MARGINS = (0.0, 0.04, 0.08)
"""What is given up of the lethal radius, one after the other, where no frontier can be reached [m]."""

LAST_MARGIN = 0.12
"""Given up where all that is to no avail, along the way that the robot has driven and nowhere else: where it has come
through there is a way, though on a map of coarse cells none is left."""

RELEASES = 3
"""How often withheld frontiers come back because nothing else is left."""

WITHHELD_WITHIN = 1.0
"""Of a frontier that a decision did not resolve, what lies this near to its middle is withheld [m]."""

GONE = 0.5
"""A frontier is resolved when this share of its cells is one no more."""


@dataclass(frozen=True)
class Offer:
    """What a strategy chooses from: a frontier for each candidate, in ascending order of the decision grid's cells.

    Attributes
    ----------
    cells : of the decision grid, in which the middles of the frontiers lie, shape (C,).
    positions : the middles [m], shape (C, 2).
    frontiers : what is looked at.
    routes : for each the cells of the map from the robot's own to where it looks from.
    paths : the same as cells of the decision grid, the candidate's own last.
    lengths : of the routes [m], shape (C,).
    roads : all that can be reached, on the grid of the map.
    """

    cells: NDArray[np.int64]
    positions: Array
    frontiers: tuple[Frontier, ...]
    routes: tuple[NDArray[np.int64], ...]
    paths: tuple[NDArray[np.int64], ...]
    lengths: Array
    roads: Roads


class Navigator:
    """The fine planner of one trial; it remembers which frontiers were looked at in vain.

    Attributes
    ----------
    terrain : the map as it was last looked at.
    margin : what the ways of the last offer give up of the lethal radius [m].
    """

    def __init__(self, scenario: LidarScenario, map_: GridMap) -> None:
        self._scenario, self._map = scenario, map_
        self._tries = np.zeros(map_.grid.shape, dtype=np.uint8)
        self._driven = np.zeros(map_.grid.shape, dtype=bool)
        self._releases = 0
        self.margin = 0.0
        self.look()

    def look(self) -> None:
        """Take in the map as it is now."""
        self.terrain = Terrain(self._map.grid, self._map.known, self._map.obstacles)

    def ways(self, pose: Pose, margin: float | None = None) -> Ways:
        """Cheapest ways from a pose, keeping the lethal radius less a margin [m]; that of the last offer by default."""
        start = self._map.grid.cell_of(pose[0], pose[1])
        given = self.margin if margin is None else margin
        lethal, terrain = self._scenario.lethal_radius, self.terrain
        if given <= MARGINS[-1]:
            return terrain.ways(start, lethal - given)
        return Ways(terrain, start, terrain.free(lethal - MARGINS[-1]) | (self._driven & terrain.free(lethal - given)))

    def offer(self, pose: Pose, driven: Array | None = None) -> Offer | None:
        """Candidates from a pose; None where no frontier can be reached, whatever is given up.

        `driven` are places [m] along the way to the pose, shape (N, 2 or more).
        """
        while True:
            for margin in MARGINS:
                if offer := self._within(pose, margin):
                    return offer
            if self._releases == RELEASES or not self._tries.any():
                break
            self._releases += 1
            self.release()
        if driven is None or len(driven) < 2:
            return None
        self._driven = self._trace(driven)
        return self._within(pose, LAST_MARGIN)

    def release(self) -> None:
        """Withhold nothing any more."""
        self._tries[:] = 0

    def note_in_vain(self, frontier: Frontier) -> None:
        """Note that a frontier was looked at in vain: what is left of it is looked at once more, then withheld."""
        grid = self._map.grid
        around = np.zeros(grid.shape, dtype=bool)
        around.reshape(-1)[frontier.cells] = True
        around = ndimage.binary_dilation(around, iterations=2)
        x, y = grid.centre_of(frontier.middle)
        centres = grid.centres(np.flatnonzero(around))
        near = np.hypot(*(centres - (x, y)).T) <= WITHHELD_WITHIN + 2 * grid.resolution
        tries, noted = self._tries.reshape(-1), np.flatnonzero(around)[near]
        tries[noted] = np.minimum(tries[noted] + 1, MOST_TRIES)

    def resolved(self, frontier: Frontier) -> bool:
        """Whether enough of a frontier is one no more."""
        return bool(frontier_mask(self.terrain).reshape(-1)[frontier.cells].mean() <= 1.0 - GONE)

    def waits(self, frontier: Frontier) -> bool:
        """Whether a frontier is not resolved on the map as it is now, looked at or not."""
        mask = frontier_of(self._map.known, self._map.obstacles)
        return bool(mask.reshape(-1)[frontier.cells].mean() > 1.0 - GONE)

    def blocked(self, route: NDArray[np.int64]) -> bool:
        """Whether what is believed now closes a route."""
        least = self._scenario.lethal_radius - self.margin - 0.02
        return bool(np.any(self.terrain.clearance.reshape(-1)[route[1:]] < least))

    def _trace(self, places: Array) -> NDArray[np.bool_]:
        """Cells along straight lines through places [m], and those around them, shape (rows, columns)."""
        grid = self._map.grid
        along = np.concatenate(([0.0], np.hypot(*np.diff(places[:, :2], axis=0).T).cumsum()))
        every = np.arange(0.0, along[-1], 0.5 * grid.resolution)
        x, y = (np.interp(every, along, places[:, axis]) for axis in (0, 1))
        columns, rows = np.floor((x - grid.x0) / grid.resolution), np.floor((y - grid.y0) / grid.resolution)
        inside = (columns >= 0) & (columns < grid.columns) & (rows >= 0) & (rows < grid.rows)
        driven = np.zeros(grid.shape, dtype=bool)
        driven[rows[inside].astype(int), columns[inside].astype(int)] = True
        return np.asarray(ndimage.binary_dilation(driven, structure=np.ones((3, 3))))

    def _within(self, pose: Pose, margin: float) -> Offer | None:
        ways = self.ways(pose, margin)
        found = frontiers(self.terrain, ways, self._tries)
        if not found:
            return None
        self.margin = margin
        return self._offer(found, ways)

    def _offer(self, found: list[Frontier], ways: Ways) -> Offer:
        grid, decisions = self._map.grid, self._scenario.grid
        best: dict[int, Frontier] = {}
        for frontier in sorted(found, key=lambda f: (f.cost, f.middle)):
            best.setdefault(decisions.cell_of(*grid.centre_of(frontier.middle)), frontier)
        nearest = dict(list(best.items())[: self._scenario.candidates_per_robot])
        cells = np.array(sorted(nearest), dtype=np.int64)
        chosen = tuple(nearest[cell] for cell in cells.tolist())
        routes = tuple(ways.to(frontier.goal) for frontier in chosen)
        return Offer(
            cells=cells,
            positions=grid.centres(np.array([frontier.middle for frontier in chosen])),
            frontiers=chosen,
            routes=routes,
            paths=tuple(
                along(route, cell, grid, decisions) for route, cell in zip(routes, cells.tolist(), strict=True)
            ),
            lengths=np.array([length_of(route, grid.columns, grid.resolution) for route in routes]),
            roads=Roads(grid, ways.free.copy(), ways.start),
        )


@jit
def along(route: NDArray[np.int64], last: int, grid: Grid, decisions: Grid) -> NDArray[np.int64]:
    """Cells of the decision grid along a route of cells of the map, each once in a row, ending in a given one."""
    cells = np.empty(route.shape[0] + 1, dtype=np.int64)
    count = 0
    for k in range(route.shape[0] + 1):
        cell = last
        if k < route.shape[0]:
            x, y = centre_of(grid, route[k])
            cell = cell_of(decisions, x, y)
        if count == 0 or cells[count - 1] != cell:
            cells[count] = cell
            count += 1
    return cells[:count].copy()


def seconds_for(length: float) -> float:
    """Time [s] after which a drive of this length [m] is given up."""
    return 30.0 + 6.0 * length if math.isfinite(length) else math.inf
