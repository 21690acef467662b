"""A lower bound on T: what must be seen, and what a step can show at best.

Without noise the robot's way is made of straight runs with a turn, which takes a step, between every two. A run of k
steps is at most k · λ long, λ the longest step, and shows at most N(k) cells that could not be seen from where it
began: as many points of the lattice of cell centres as its swept crescent holds at best, wherever it begins and
whichever way it leads. And however it bends, a way of length L sweeps at most K + w L, where K is the area of the
sensor's disc widened by half a cell on all sides and w its largest width, so it cannot know more cells than fit in
there. The fewest steps for which both allow what is wanted are the bound. Of the world it needs only how much is known
at the start: obstacles, landmarks, the map's border and noise are left out.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from explore_bench import Grid, jit

PLACES, DIRECTIONS = 24, 120
"""Begins tried along each edge of a cell, and directions tried in an eighth of the circle."""


def least_steps(missing: int, total: int, step: float, reach: float, grid: Grid) -> int:
    """Fewest steps in which `missing` cells of a map can become known, and `total` be known in all.

    Parameters
    ----------
    step : longest straight step [m].
    reach : range of the sensor [m].
    grid : of the cells; no straight run is longer than its diagonal.
    """
    if missing <= 0:
        return 0
    edge = max(grid.rows, grid.columns)
    longest = math.ceil(math.sqrt(2.0) * edge * grid.resolution / step)
    shown = most_shown(step / grid.resolution, reach / grid.resolution, longest)
    least = _least_straight(total, step / grid.resolution, reach / grid.resolution)
    most = np.zeros(1, dtype=np.int64)  # cells that so many straight steps can show in the runs so far
    best = np.iinfo(np.int64).max
    runs = 0
    while runs <= best:
        most, runs = _one_run_more(most, shown), runs + 1
        enough = np.flatnonzero(most >= missing)
        enough = enough[enough >= least]
        if len(enough):
            best = min(best, int(enough[0]) + runs - 1)  # the first run may need no turn
        elif most[-1] >= missing:
            best = min(best, least + runs - 1)
    return best


def _one_run_more(most: NDArray[np.int64], shown: NDArray[np.int64]) -> NDArray[np.int64]:
    """Most cells that so many straight steps can show with another run of 1 or more steps."""
    longer = np.zeros(len(most) + len(shown) - 1, dtype=np.int64)
    for steps in range(1, len(shown)):
        part = slice(steps, steps + len(most))
        longer[part] = np.maximum(longer[part], most + shown[steps])
    return np.maximum.accumulate(longer)


def _least_straight(total: int, step: float, reach: float) -> int:
    """Fewest straight steps after which `total` cells fit into what a way has swept; lengths in cells."""
    disc = math.pi * reach**2 + 4.0 * reach + 1.0  # Steiner's formula for the disc and the square of a cell
    width = 2.0 * reach + math.sqrt(2.0)
    return max(math.ceil((total - disc) / width / step - 1e-9), 0)


@lru_cache
def most_shown(step: float, reach: float, longest: int) -> NDArray[np.int64]:
    """N(k): most cells that a run of k = 0 … `longest` steps can show, shape (longest + 1,); lengths are in cells."""
    shown: NDArray[np.int64] = _most_shown(step, reach, longest)
    return shown


@jit
def _most_shown(step: float, reach: float, longest: int) -> NDArray[np.int64]:
    """Largest count over a grid of begins and directions, with margins for all that lie between them."""
    most = np.zeros(longest + 1, dtype=np.int64)
    counts = np.zeros(longest + 1, dtype=np.int64)
    off = math.sqrt(0.5) / PLACES  # half a diagonal of the grid of begins
    bend = math.pi / 8 / DIRECTIONS
    around = int(math.ceil(reach + off)) + 1
    widest = reach + off + bend * longest * step
    for i in range(PLACES):
        for j in range(PLACES):
            x, y = (i + 0.5) / PLACES, (j + 0.5) / PLACES
            for d in range(DIRECTIONS):
                angle = (d + 0.5) * math.pi / 4 / DIRECTIONS  # the other seven eighths are these, turned and mirrored
                c, s = math.cos(angle), math.sin(angle)
                end_x, end_y = x + longest * step * c, y + longest * step * s
                counts[:] = 0
                for column in range(-around, int(math.ceil(end_x)) + around + 1):
                    for row in range(-around, int(math.ceil(end_y)) + around + 1):
                        dx, dy = column - x, row - y
                        along, across = c * dx + s * dy, abs(c * dy - s * dx)
                        if across > widest or dx * dx + dy * dy <= (reach - off) ** 2:
                            continue  # never in range, or so at the begin already, wherever near (x, y) that is
                        k = max(int((along - widest) / step), 1)
                        while k <= longest:
                            beyond = along - min(max(along, 0.0), k * step)
                            if math.hypot(beyond, across) <= reach + off + bend * k * step:
                                counts[k] += 1
                                break
                            k += 1
                total = 0
                for k in range(1, longest + 1):
                    total += counts[k]
                    most[k] = max(most[k], total)
    return most
