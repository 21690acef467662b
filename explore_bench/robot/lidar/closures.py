"""Which earlier key poses a new one may be matched with: chains of them near by, of the same visit or of another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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


def chains(poses: Array, links: Sequence[Sequence[int]], end: int) -> list[Chain]:
    """Chains of key poses before number `end` that pass near the newest pose, of poses of shape (N, 3).

    `links` holds, for each pose, the numbers of those that a factor joins to it.
    """
    return _chains(poses, links, end, (True, False))


def chains_due(poses: Array, links: Sequence[Sequence[int]], end: int) -> list[Chain]:
    """Those of the `chains` with which the newest pose is to be matched: not every pose looks for all of them."""
    newest = len(poses) - 1
    due = tuple(linked for linked, spacing in ((True, LINK_SPACING), (False, LOOP_SPACING)) if newest % spacing == 0)
    return _chains(poses, links, end, due) if due else []


def _chains(poses: Array, links: Sequence[Sequence[int]], end: int, kinds: tuple[bool, ...]) -> list[Chain]:
    newest = len(poses) - 1
    distances = np.hypot(*(poses[:, :2] - poses[newest, :2]).T)
    near = distances <= NEAR
    if not near[:end].any():
        return []
    linked = _linked(near, links, newest)
    found = []
    for kind in kinds:
        for first, stop in _runs(near[:end] & (linked[:end] == kind)):
            if stop - first >= CHAIN:
                found.append(Chain(first, stop, first + int(distances[first:stop].argmin()), kind))
    return found


def _linked(near: NDArray[np.bool_], links: Sequence[Sequence[int]], start: int) -> NDArray[np.bool_]:
    """Which poses can be reached from one by links between poses that are all near, shape (N,)."""
    reached = np.zeros(len(near), dtype=bool)
    reached[start] = True
    open_ = [start]
    while open_:
        for other in links[open_.pop()]:
            if near[other] and not reached[other]:
                reached[other] = True
                open_.append(other)
    return reached


def _runs(members: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and one past the last of each run of consecutive members."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], members, [False])).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
