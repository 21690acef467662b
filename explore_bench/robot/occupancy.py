"""Occupancy of the cells, a function of the belief and the scans, and the entropies of Eq. 5 and 6 [bit].

A scan is placed through the estimate of its own pose: every cell whose centre is in range there takes the value
that the scan holds at that point. A loop closure that moves the pose moves what was seen from it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, cells_within, room_within
from explore_bench.world.scenario import Scenario
from explore_bench.world.signals import HIDDEN, OCCUPIED

OCCUPIED_ABOVE = 0.5 + 1e-9
"""A cell whose probability exceeds this is believed occupied (§4.1 starts all at 0.5)."""


def log_odds_increments(scenario: Scenario) -> tuple[float, float, float]:
    """Log odds (added by a hit, added by a miss, bound of the magnitude)."""
    return _logit(scenario.hit), _logit(scenario.miss), _logit(1.0 - scenario.occupancy_clamp)


def _logit(probability: float) -> float:
    return math.log(probability / (1.0 - probability))


_LOG_ODDS_ABOVE = _logit(OCCUPIED_ABOVE)


@jit
def point_in_patch(dx: float, dy: float, heading: float, origin: Array) -> tuple[float, float]:
    """Where a point lies in a patch [m], given its offset from the estimated pose in the world.

    `origin` holds the robot's x and y in the patch and the angle from the patch's x axis to the robot's.
    """
    c, s = math.cos(origin[2] - heading), math.sin(origin[2] - heading)
    return origin[0] + c * dx - s * dy, origin[1] + s * dx + c * dy


@jit
def look_up(cells: NDArray[np.uint8], u: float, v: float, resolution: float) -> int:
    """Value that a patch holds at a point of it [m]; the far edge, reached by rounding, counts as inside."""
    side = cells.shape[0]
    return cells[min(max(int(v / resolution), 0), side - 1), min(max(int(u / resolution), 0), side - 1)]


@jit
def place_scans(
    log_odds: Array,
    known: NDArray[np.bool_],
    poses: Array,
    patches: NDArray[np.uint8],
    origins: Array,
    grid: Grid,
    sensor_range: float,
    increments: tuple[float, float, float],
) -> None:
    """Fuse scans into the map in time order.

    Parameters
    ----------
    log_odds, known : map, shape (n_g,) each, updated in place.
    poses : estimates at which the scans were taken, shape (N, 3).
    patches, origins : the scans' look-ups, shapes (N, P, P) and (N, 3); see `point_in_patch`.
    increments : of `log_odds_increments`.
    """
    hit, miss, bound = increments
    cells, ways = room_within(grid, sensor_range)
    for i in range(poses.shape[0]):
        turn = origins[i, 2] - poses[i, 2]
        c, s = math.cos(turn), math.sin(turn)
        for k in range(cells_within(grid, poses[i, 0], poses[i, 1], sensor_range, cells, ways)):
            cell, dx, dy = cells[k], ways[k, 0], ways[k, 1]
            u, v = origins[i, 0] + c * dx - s * dy, origins[i, 1] + s * dx + c * dy
            value = look_up(patches[i], u, v, grid.resolution)
            if value == HIDDEN:
                continue
            known[cell] = True
            change = hit if value == OCCUPIED else miss
            log_odds[cell] = min(max(log_odds[cell] + change, -bound), bound)


class OccupancyMap:
    """Occupancy and knowledge of every cell, rebuilt or extended from the scans.

    Attributes
    ----------
    known : whether a cell was observed, shape (n_g,).
    """

    def __init__(self, scenario: Scenario) -> None:
        self._grid, self._sensor_range = scenario.grid, scenario.sensor_range
        self._increments = log_odds_increments(scenario)
        self.clear()

    def clear(self) -> None:
        """Forget all scans."""
        self._log_odds = np.zeros(self._grid.cells)
        self.known = np.zeros(self._grid.cells, dtype=bool)

    def place(self, poses: Array, patches: NDArray[np.uint8], origins: Array) -> None:
        """Fuse further scans, taken at these estimates; shapes as in `place_scans`."""
        place_scans(
            self._log_odds, self.known, poses, patches, origins, self._grid, self._sensor_range, self._increments
        )

    def occupy(self, cells: NDArray[np.int64]) -> None:
        """Hold cells for hit once, whatever was seen of them."""
        self._log_odds[cells] = self._increments[0]
        self.known[cells] = True

    @property
    def probability(self) -> Array:
        """Probability of being occupied, shape (n_g,)."""
        return probability(self._log_odds)

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """Cells believed occupied, shape (n_g,)."""
        return np.asarray(self._log_odds > _LOG_ODDS_ABOVE)


def probability(log_odds: Array) -> Array:
    """Probability of being occupied, shape as given."""
    return 1.0 / (1.0 + np.exp(-log_odds))


def shannon_entropy(probability: ArrayLike) -> Array:
    """Shannon entropy of a Bernoulli variable [bit], Eq. 5 for one cell (its sum is taken by the caller)."""
    p = np.asarray(probability, dtype=float)
    q = 1.0 - p
    with np.errstate(divide="ignore", invalid="ignore"):
        terms = np.where(p > 0, p * np.log2(p), 0.0) + np.where(q > 0, q * np.log2(q), 0.0)
    return np.asarray(-terms)


def renyi_entropy(probability: ArrayLike, order: ArrayLike) -> Array:
    """Rényi entropy of a Bernoulli variable [bit], Eq. 6: log₂(p^β + (1 − p)^β) / (1 − β).

    `order` β ≥ 0 broadcasts against the probability. Towards β = 1 it becomes Shannon's entropy, and at β = ∞ the
    min-entropy −log₂ max(p, 1 − p).
    """
    p, beta = np.broadcast_arrays(np.asarray(probability, dtype=float), np.asarray(order, dtype=float))
    larger, smaller = np.maximum(p, 1.0 - p), np.minimum(p, 1.0 - p)
    ratio = smaller / larger
    near_one, infinite = np.abs(beta - 1.0) < 1e-6, np.isinf(beta)
    safe = np.where(near_one | infinite, 2.0, beta)
    # p^β + q^β = larger^β (1 + ratio^β): no underflow at large orders
    general = (safe * np.log2(larger) + np.log1p(ratio**safe) / math.log(2.0)) / (1.0 - safe)
    general = np.where(smaller == 0.0, 0.0, general)
    return np.where(near_one, shannon_entropy(p), np.where(infinite, -np.log2(larger), general))
