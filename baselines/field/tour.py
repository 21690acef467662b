"""A tour through all candidates, as planners of the classes of TARE, FUEL and MRTSP plan one over frontiers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from baselines.field.believed import lengths_from, stands
from explore_bench import Array, Observation, jit

EXACT = 12
"""Most candidates for which the tour is the shortest; of more it is one that no exchange shortens."""


class FrontierTour:
    """Goes first to the beginning of the shortest way through all candidates, from where the robot is, not back.

    Cao et al. 2021 (TARE), Zhou et al. 2021 (FUEL), Kulich et al. 2011 and 2019 plan tours over frontiers or views;
    this is what they have in common, an open travelling-salesman tour (from memory). Up to 12 candidates it is solved
    by dynamic programming (Held, Karp 1962), beyond by the nearest insertion, then exchanges (2-opt, or-opt) while one
    shortens it.

    Converted: each candidate is a place to visit, whatever it would show. The control is `nearest`, a tour of one.
    """

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the tour's first candidate."""
        cells = stands(observation)
        return int(open_tour(observation.path_lengths, lengths_from(observation, cells)[:, cells])[0])


def open_tour(begins: Array, between: Array) -> NDArray[np.int64]:
    """Order of the places, shape (C,), of a short way through all: shortest for up to `EXACT` places.

    Parameters
    ----------
    begins : length from the start to each place, shape (C,).
    between : length from one to another, shape (C, C), symmetric; one that cannot be driven is infinite.
    """
    far = 1e6  # two places between which there is no way are visited from one another only where all else is worse
    lengths = np.where(np.isfinite(between), between, far)
    first = np.where(np.isfinite(begins), begins, far)
    if len(first) <= EXACT:
        return np.asarray(_shortest(first, lengths))
    return np.asarray(_improved(first, lengths, _inserted(first, lengths)))


def length_of(order: NDArray[np.int64], begins: Array, between: Array) -> float:
    """Length of the way through all places in an order."""
    return float(begins[order[0]] + between[order[:-1], order[1:]].sum())


@jit
def _shortest(begins: Array, between: Array) -> NDArray[np.int64]:
    """Held and Karp: the cheapest way that visits a set and ends at one of it."""
    count = begins.shape[0]
    cost = np.full((1 << count, count), np.inf)
    before = np.full((1 << count, count), -1, dtype=np.int64)
    for last in range(count):
        cost[1 << last, last] = begins[last]
    for visited in range(1, 1 << count):
        for last in range(count):
            if cost[visited, last] == np.inf:
                continue
            for following in range(count):
                if visited >> following & 1:
                    continue
                more = visited | 1 << following
                through = cost[visited, last] + between[last, following]
                if through < cost[more, following] - 1e-9:
                    cost[more, following], before[more, following] = through, last
    order = np.empty(count, dtype=np.int64)
    visited = (1 << count) - 1
    last = 0
    for end in range(1, count):
        if cost[visited, end] < cost[visited, last] - 1e-9:
            last = end
    for k in range(count - 1, -1, -1):
        order[k] = last
        last, visited = before[visited, last], visited & ~(1 << last)
    return order


@jit
def _inserted(begins: Array, between: Array) -> NDArray[np.int64]:
    """Nearest insertion: the place nearest to the tour is put where it lengthens it least, until all are in."""
    count = begins.shape[0]
    order = np.empty(count, dtype=np.int64)
    away = begins.copy()
    for length in range(count):
        place = int(away.argmin())
        best, at = np.inf, 0
        for k in range(length + 1):
            more = _leg(begins, between, order, k - 1, place)
            if k < length:
                more += between[place, order[k]] - _leg(begins, between, order, k - 1, order[k])
            if more < best - 1e-9:
                best, at = more, k
        order[at + 1 : length + 1] = order[at:length].copy()
        order[at] = place
        away[place] = np.inf
        for other in range(count):
            if away[other] < np.inf:
                away[other] = min(away[other], between[place, other])
    return order


@jit
def _leg(begins: Array, between: Array, order: NDArray[np.int64], k: int, place: int) -> float:
    """Length from the place at k of the order, the start at −1, to another."""
    return begins[place] if k < 0 else between[order[k], place]


@jit
def _improved(begins: Array, between: Array, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """2-opt and or-opt, the first change that shortens the tour, until none does."""
    count = order.shape[0]
    better = True
    while better:
        better = False
        for i in range(count):
            for j in range(i + 1, count):  # the part from i to j is turned round
                now = _leg(begins, between, order, i - 1, order[i])
                then = _leg(begins, between, order, i - 1, order[j])
                if j + 1 < count:
                    now += between[order[j], order[j + 1]]
                    then += between[order[i], order[j + 1]]
                if then < now - 1e-9:
                    order[i : j + 1] = order[i : j + 1][::-1].copy()
                    better = True
        for size in range(1, 4):  # up to three move to another place in the order
            for i in range(count - size + 1):
                part = order[i : i + size].copy()
                rest = np.concatenate((order[:i], order[i + size :]))
                best, at = _total(begins, between, order) - 1e-9, -1
                for k in range(count - size + 1):
                    length = _total(begins, between, np.concatenate((rest[:k], part, rest[k:])))
                    if length < best:
                        best, at = length, k
                if at >= 0:
                    order = np.concatenate((rest[:at], part, rest[at:]))
                    better = True
    return order


@jit
def _total(begins: Array, between: Array, order: NDArray[np.int64]) -> float:
    total = begins[order[0]]
    for k in range(1, order.shape[0]):
        total += between[order[k - 1], order[k]]
    return total
