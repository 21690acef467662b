"""Which earlier key poses a new one may be matched with: chains of them near by, of the same visit or of another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array

NEAR = 4.0
"""Key poses within this distance of the newest may have seen the same [m] (Karto)."""

CHAIN = 6
"""Fewest consecutive key poses to be matched with: fewer show too little of a place."""

LOOP_SPACING, LINK_SPACING = 4, 10
"""Every so many key poses a loop, or a link to a chain that is linked, is looked for: those between say the same."""


class Chain(NamedTuple):
    """Consecutive key poses near the newest one.

    Attributes
    ----------
    first, end : numbers of the first, and one past the last.
    closest : number of the one nearest to the newest.
    linked : whether links that stay near by lead there: a match with it then closes no loop.
    """

    first: int
    end: int
    closest: int
    linked: bool


def due(newest: int) -> tuple[bool, bool]:
    """Whether this key pose is to be matched with chains that are linked, and with those that are not."""
    return newest % LINK_SPACING == 0, newest % LOOP_SPACING == 0


def chains(poses: Array, links: NDArray[np.int64], end: int) -> list[Chain]:
    """Chains of key poses before number `end` that pass near the newest of all, the linked ones first.

    Parameters
    ----------
    poses : of all key poses, shape (N, 3).
    links : numbers of the two poses that each factor joins, the later ones last, shape (L, 2).
    """
    runs = _chains(poses, links, end).tolist()
    found = [Chain(first, stop, closest, linked == 1) for first, stop, closest, linked in runs]
    return sorted(found, key=lambda chain: not chain.linked)


def chains_due(poses: Array, links: NDArray[np.int64], end: int) -> list[Chain]:
    """Those of the `chains` with which the newest pose is to be matched: not every pose looks for all of them."""
    linked, unlinked = due(len(poses) - 1)
    if not (linked or unlinked):
        return []
    return [chain for chain in chains(poses, links, end) if (linked if chain.linked else unlinked)]


@jit
def _chains(poses: Array, links: NDArray[np.int64], end: int) -> NDArray[np.int64]:
    """Compiled part of `chains`, a row each, ascending."""
    newest = poses.shape[0] - 1
    squared = (poses[:, 0] - poses[newest, 0]) ** 2 + (poses[:, 1] - poses[newest, 1]) ** 2
    near = squared <= NEAR * NEAR
    linked = _linked(near, links, newest)
    found = np.empty((end // CHAIN, 4), dtype=np.int64)
    count = first = 0
    for stop in range(1, end + 1):
        if stop < end and near[stop] == near[first] and linked[stop] == linked[first]:
            continue
        if near[first] and stop - first >= CHAIN:
            found[count, 0], found[count, 1], found[count, 3] = first, stop, linked[first]
            found[count, 2] = first + squared[first:stop].argmin()
            count += 1
        first = stop
    return found[:count]


@jit
def _linked(near: NDArray[np.bool_], links: NDArray[np.int64], start: int) -> NDArray[np.bool_]:
    """Which poses can be reached from one by links between poses that are all near, shape (N,)."""
    reached = np.zeros(near.shape[0], dtype=np.bool_)
    reached[start] = True
    spreading = True
    while spreading:
        spreading = False
        for k in range(links.shape[0] - 1, -1, -1):  # from late to early, as most links lead
            one, other = links[k, 0], links[k, 1]
            if reached[one] != reached[other] and near[one] and near[other]:
                reached[one] = reached[other] = spreading = True
    return reached
