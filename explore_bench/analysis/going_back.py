"""Which poses of a way go back where it was: a loop over all pairs of poses, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array


@jit
def going_back(places: Array, way: Array, near: float, away: float) -> NDArray[np.bool_]:
    """Whether each pose lies within `near` [m] of an earlier one, from which it has been off for so much way.

    Of the earlier poses that are so near, the last one counts before the last that was farther off.

    Parameters
    ----------
    places : of the poses [m], shape (N, 2).
    way : driven until each [m], shape (N,).
    near, away : see above [m].

    Returns
    -------
    Shape (N,).
    """
    found = np.zeros(len(places), dtype=np.bool_)
    for now in range(1, len(places)):
        off = False
        for before in range(now - 1, -1, -1):
            dx, dy = places[before, 0] - places[now, 0], places[before, 1] - places[now, 1]
            beside = dx * dx + dy * dy <= near * near
            if beside and off:
                found[now] = way[now] - way[before] >= away
                break
            off = off or not beside
    return found
