"""What `belief-attention` sees of an observation: each candidate and the state, in numbers that matter for e and η.

Beside what the exploration graph tells of a frontier this says how long the way there is, what it would reveal, how
large the unknown region behind it is, and what the belief would become: `belief.predict` along the path.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from baselines.learned.graph import sums_in_view
from explore_bench import Array, Grid, Observation, centre_of, jit, wrap_angle

CANDIDATE_COLUMNS = (
    "length",  # of the path [10 m]
    "excess_length",  # beyond the shortest path [10 m]
    "steps",  # to drive it, turns included [10 steps]
    "turn",  # angle from the heading to the path's first waypoint, magnitude [π rad]
    "revealed",  # unknown cells in view along the path [10 cells]
    "revealed_at_end",  # unknown cells in view from its end [10 cells]
    "revealed_a_step",  # unknown cells in view along the path, a step
    "finishing",  # share of the cells still to be explored that the path reveals, at most 1
    "region",  # cells of the unknown regions that it reveals a part of [share of the map]
    "region_closed",  # share of those regions that it reveals
    "pocket",  # whether what is left of one of those regions would be small, exp(−cells left / 5)
    "around",  # unknown cells within twice the sensor range of the candidate [50 cells]
    "apart",  # distance to the nearest other candidate, at most 20 [10 m]
    "edge",  # distance from the candidate to the edge of the map [10 m]
    "reduction",  # of U along the path [10 m²]
    "reduction_a_step",  # the same, a step [m²]
    "sigma",  # sqrt(tr Σ) of the robot there [m]
    "peak",  # log of the largest sqrt(tr Σ) of the trajectory then over now
    "sightings",  # landmarks sighted on the way, log(1 + n)
)
STATE_COLUMNS = (
    "explored",  # known share of the map
    "remaining",  # cells still to be explored [10 cells], at most 10
    "uncertainty",  # U / U₀
    "sigma",  # sqrt(tr Σ) of the robot [m]
    "peak",  # log of the largest sqrt(tr Σ) of the trajectory [m]
    "slack",  # log of that over the robot's own
    "landmarks",  # seen, a hundred cells
    "time",  # steps so far per cell of the map
    "candidates",  # number of them [10]
)
BLOCK_COLUMNS = (
    "unknown",  # share of the block's cells that are
    "cells",  # of the block, unknown or not [16]
    "distance",  # of its middle from the robot [10 m]
)
BLOCK = 4
"""Cells along the edge of a block, the coarse view of what is unknown."""


@dataclass(frozen=True, eq=False)
class CandidateSet:
    """What the network reads of one observation.

    Attributes
    ----------
    candidates, blocks : features of the candidates (C, CANDIDATE_COLUMNS) and of the blocks of the map that hold
        unknown cells (K, BLOCK_COLUMNS).
    places : of the candidates and then of the blocks [10 m], shape (C + K, 2).
    state : features of the state (STATE_COLUMNS,).
    """

    candidates: NDArray[np.float32]
    blocks: NDArray[np.float32]
    places: NDArray[np.float32]
    state: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class CandidateBatch:
    """Sets padded to one size.

    Attributes
    ----------
    candidates, blocks : features, shapes (B, C, F) and (B, K, F), zero where padded.
    places : [10 m], shape (B, C + K, 2).
    state : features, shape (B, G).
    choices, present : whether a row is a candidate (B, C), a candidate or a block (B, C + K).
    """

    candidates: Tensor
    blocks: Tensor
    places: Tensor
    state: Tensor
    choices: Tensor
    present: Tensor

    @classmethod
    def of(cls, sets: Sequence[CandidateSet]) -> CandidateBatch:
        """Pad sets into a batch."""
        width = max(len(one.candidates) for one in sets)
        size = width + max(len(one.blocks) for one in sets)
        candidates = np.zeros((len(sets), width, len(CANDIDATE_COLUMNS)), dtype=np.float32)
        blocks = np.zeros((len(sets), size - width, len(BLOCK_COLUMNS)), dtype=np.float32)
        places = np.zeros((len(sets), size, 2), dtype=np.float32)
        present = np.zeros((len(sets), size), dtype=bool)
        for i, one in enumerate(sets):
            count, more = len(one.candidates), len(one.blocks)
            candidates[i, :count], blocks[i, :more] = one.candidates, one.blocks
            places[i, :count], places[i, width : width + more] = one.places[:count], one.places[count:]
            present[i, :count] = present[i, width : width + more] = True
        state = np.stack([one.state for one in sets])
        return cls(*map(torch.from_numpy, (candidates, blocks, places, state, present[:, :width].copy(), present)))

    def masked(self, values: Tensor) -> Tensor:
        """Values of the candidates, shape (B, C), −∞ where there is none."""
        return values.masked_fill(~self.choices, -math.inf)


def candidate_set(observation: Observation) -> CandidateSet:
    """Compute the features of an observation; a prediction along every path makes most of the cost."""
    belief, scenario = observation.belief, observation.scenario
    grid = scenario.grid
    x, y, heading = observation.pose
    target = math.ceil(scenario.coverage * scenario.cell_count - 1e-9)
    remaining = max(target - int(belief.known.sum()), 1)
    regions, sizes = _regions(belief.known)
    rows = np.empty((len(observation.candidates), len(CANDIDATE_COLUMNS)), dtype=np.float32)
    shortest = observation.path_lengths.min()
    apart = np.hypot(*(observation.positions[:, None] - observation.positions).transpose(2, 0, 1))
    np.fill_diagonal(apart, 20.0)
    unknown = ~belief.known.reshape(-1)
    around = sums_in_view(grid.in_reach(observation.positions, 2.0 * scenario.sensor_range), unknown.astype(float))
    driven = np.unique(np.concatenate(observation.paths))
    view = belief.view(grid.centres(driven))
    for i, path in enumerate(observation.paths):
        prediction = belief.predict(path)
        steps = max(len(prediction.poses), 1)
        revealed, at_end, region, closed, pocket = _revealed(
            np.searchsorted(driven, path), view, unknown, regions, sizes
        )
        first = path[1] if len(path) > 1 else path[0]
        first_x, first_y = centre_of(grid, first)
        angle = math.atan2(first_y - y, first_x - x)
        px, py = observation.positions[i]
        reduction = belief.uncertainty - prediction.uncertainty
        rows[i] = (
            observation.path_lengths[i] / 10.0,
            (observation.path_lengths[i] - shortest) / 10.0,
            steps / 10.0,
            abs(wrap_angle(angle - heading)) / math.pi,
            revealed / 10.0,
            at_end / 10.0,
            revealed / steps,
            min(revealed / remaining, 1.0),
            region / scenario.cell_count,
            closed,
            pocket,
            around[i] / 50.0,
            min(apart[i].min(), 20.0) / 10.0,
            min(px, py, scenario.size - px, scenario.size - py) / 10.0,
            reduction / 10.0,
            reduction / steps,
            math.sqrt(np.trace(prediction.pose_covariances[-1])),
            0.5 * math.log(prediction.peak_trace / belief.peak_trace),
            math.log1p(prediction.sightings),
        )
    own = float(np.trace(belief.pose_covariances[-1]))
    state = (
        belief.explored,
        min(remaining / 10.0, 10.0),
        belief.uncertainty / scenario.prior_uncertainty,
        math.sqrt(own),
        0.5 * math.log(belief.peak_trace),
        0.5 * math.log(belief.peak_trace / own),
        100.0 * len(belief.landmarks) / scenario.cell_count,
        observation.step / scenario.cell_count,
        len(rows) / 10.0,
    )
    blocks, middles = _blocks(belief.known, grid, x, y)
    places = np.concatenate((observation.positions, middles)) / 10.0
    return CandidateSet(rows, blocks, places.astype(np.float32), np.array(state, dtype=np.float32))


@jit
def _blocks(known: NDArray[np.bool_], grid: Grid, x: float, y: float) -> tuple[NDArray[np.float32], Array]:
    """Features and middles [m] of the blocks that hold unknown cells; (x, y) is the robot's place."""
    down, across = (grid.rows + BLOCK - 1) // BLOCK, (grid.columns + BLOCK - 1) // BLOCK
    features = np.empty((down * across, 3), dtype=np.float32)
    middles = np.empty((down * across, 2))
    count = 0
    for row in range(0, grid.rows, BLOCK):
        for column in range(0, grid.columns, BLOCK):
            part = known[row : row + BLOCK, column : column + BLOCK]
            unknown = part.size - part.sum()
            if unknown > 0:
                middle_x = grid.x0 + (column + 0.5 * part.shape[1]) * grid.resolution
                middle_y = grid.y0 + (row + 0.5 * part.shape[0]) * grid.resolution
                features[count, 0] = unknown / part.size
                features[count, 1] = part.size / 16.0
                features[count, 2] = math.hypot(middle_x - x, middle_y - y) / 10.0
                middles[count, 0], middles[count, 1] = middle_x, middle_y
                count += 1
    return features[:count].copy(), middles[:count].copy()


@jit
def _regions(known: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Label of the 8-connected unknown region of every cell, shape (n_g,), −1 where known, and their sizes."""
    rows, columns = known.shape
    labels = np.full(rows * columns, -1, dtype=np.int64)
    sizes = np.zeros(rows * columns, dtype=np.int64)
    stack = np.empty(rows * columns, dtype=np.int64)
    count = 0
    for start in range(rows * columns):
        if known[start // columns, start % columns] or labels[start] >= 0:
            continue
        labels[start] = count
        stack[0], height = start, 1
        while height > 0:
            height -= 1
            cell = stack[height]
            sizes[count] += 1
            for row in range(max(cell // columns - 1, 0), min(cell // columns + 2, rows)):
                for column in range(max(cell % columns - 1, 0), min(cell % columns + 2, columns)):
                    to = row * columns + column
                    if labels[to] < 0 and not known[row, column]:
                        labels[to] = count
                        stack[height] = to
                        height += 1
        count += 1
    return labels, sizes[:count].copy()


@jit
def _revealed(
    path: NDArray[np.int64],
    view: NDArray[np.bool_],
    unknown: NDArray[np.bool_],
    regions: NDArray[np.int64],
    sizes: NDArray[np.int64],
) -> tuple[int, int, int, float, float]:
    """Unknown cells in view along a path and from its end; of their regions the size, share revealed, and pockets.

    The path is rows of `view`, whose columns are the cells.
    """
    mark = np.zeros(unknown.size, dtype=np.bool_)
    taken = np.zeros(sizes.shape[0], dtype=np.int64)
    revealed, at_end = 0, 0
    for k in range(path.shape[0]):
        for cell in range(unknown.size):
            if not (unknown[cell] and view[path[k], cell]):
                continue
            if k == path.shape[0] - 1:
                at_end += 1
            if not mark[cell]:
                mark[cell] = True
                revealed += 1
                taken[regions[cell]] += 1
    region, pocket = 0, 0.0
    for label in range(sizes.shape[0]):
        if taken[label] > 0:
            region += sizes[label]
            left = sizes[label] - taken[label]
            if left > 0:
                pocket = max(pocket, np.exp(-left / 5.0))
    return revealed, at_end, region, revealed / max(region, 1), pocket
