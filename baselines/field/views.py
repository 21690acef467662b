"""What is visible from a place on the believed map, computed once for all rules.

Believed walls hide what is behind them; unknown cells do not, they count as open. On the grid of decisions of a
landmark world nothing hides anything: there it is what is in range (`Belief.view`). `expected_reach` is of rays that
end in unknown cells, too, with a given probability in each.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from baselines.field.believed import finest_map
from explore_bench import Array, Grid, Observation, cast, cells_within, jit, leaps, room_within

BEAMS = 360
"""Beams of a view, as a lidar of the benchmark has."""

LEAST_CHANCE = 1e-3
"""A ray that gets on with less probability has ended."""


def in_view(observation: Observation, places: Array, wanted: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
    """Cells of the finest map that are in view from places [m], shape (K, 2); gives (K, cells).

    A cell is in view where its centre is in range and no believed wall lies on the beam there; so no wall is. Only
    `wanted` cells, shape (rows, columns), are looked at where they are given.
    """
    fine = observation.belief.fine
    if fine is None:
        view = observation.belief.view(places)
        return view if wanted is None else view & wanted.reshape(-1)
    asked = np.ones(fine.grid.shape, dtype=bool) if wanted is None else wanted
    return np.asarray(
        _in_view(
            np.ascontiguousarray(places, dtype=np.float64),
            observation.scenario.sensor_range,
            asked,
            fine.occupied,
            leaps(fine.occupied, fine.grid),
            fine.grid,
        )
    )


def unknown_in_view(observation: Observation, places: Array) -> NDArray[np.bool_]:
    """Unknown cells of the finest map that are in view from places [m], shape (K, 2); gives (K, cells)."""
    return in_view(observation, places, ~finest_map(observation).known)


def expected_reach(observation: Observation, places: Array, prior: float) -> Array:
    """Probability that a scan from places [m], shape (K, 2), reaches each unknown cell; gives (K, cells).

    Along each ray an unknown cell is a wall with probability `prior` on its own, and the first wall is the last cell
    that the ray sees; of several rays into a cell the likeliest counts. Where nothing hides anything it is 1 in range.
    """
    fine = observation.belief.fine
    if fine is None:
        return unknown_in_view(observation, places).astype(np.float64)
    return np.asarray(
        _reach(
            np.ascontiguousarray(places, dtype=np.float64),
            observation.scenario.sensor_range,
            prior,
            fine.known,
            fine.occupied,
            fine.grid,
        )
    )


@jit
def _in_view(
    places: Array,
    reach: float,
    wanted: NDArray[np.bool_],
    occupied: NDArray[np.bool_],
    free_way: NDArray[np.float32],
    grid: Grid,
) -> NDArray[np.bool_]:
    view = np.zeros((places.shape[0], grid.rows * grid.columns), dtype=np.bool_)
    cells, ways = room_within(grid, reach)
    per_angle = BEAMS / (2.0 * math.pi)
    for i in range(places.shape[0]):
        x, y = places[i, 0], places[i, 1]
        ranges = cast((x, y, 0.0), BEAMS, reach, occupied, free_way, grid)
        for k in range(cells_within(grid, x, y, reach, cells, ways)):
            cell = cells[k]
            if wanted[cell // grid.columns, cell % grid.columns]:
                beam = int(round(math.atan2(ways[k, 1], ways[k, 0]) * per_angle)) % BEAMS
                view[i, cell] = ranges[beam] >= math.hypot(ways[k, 0], ways[k, 1])
    return view


@jit
def _reach(
    places: Array,
    reach: float,
    prior: float,
    known: NDArray[np.bool_],
    occupied: NDArray[np.bool_],
    grid: Grid,
) -> Array:
    chances = np.zeros((places.shape[0], grid.rows * grid.columns))
    step = 0.5 * grid.resolution  # a ray that skips a cell's corner is one of several into the cells around
    for i in range(places.shape[0]):
        for beam in range(BEAMS):
            angle = 2.0 * math.pi * beam / BEAMS
            along_x, along_y = math.cos(angle), math.sin(angle)
            chance, last, travelled = 1.0, -1, 0.0
            while travelled <= reach and chance >= LEAST_CHANCE:
                column = int(math.floor((places[i, 0] + along_x * travelled - grid.x0) / grid.resolution))
                row = int(math.floor((places[i, 1] + along_y * travelled - grid.y0) / grid.resolution))
                travelled += step
                if not (0 <= row < grid.rows and 0 <= column < grid.columns):
                    break
                cell = row * grid.columns + column
                if cell == last:
                    continue
                last = cell
                if known[row, column]:
                    if occupied[row, column]:
                        break
                    continue
                chances[i, cell] = max(chances[i, cell], chance)
                chance *= 1.0 - prior
    return chances
