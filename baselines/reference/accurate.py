"""A tour of a world that is known for a small e and a large η, with the belief propagated along it.

It is judged by log e − log η as it would go without noise: the belief that expects every landmark of the true map is
propagated along the driver's own steps, exactly, to the step at which enough is known. The search goes on from the
fastest tour, with the same changes as there.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from baselines.reference.tour import Site, changed, end_of
from explore_bench import Belief, Score, World, expecting

CHANGES = 12_000
"""Changes that the annealing tries."""

HOT, COLD = 0.05, 0.002
"""Temperature, in log e − log η, at the beginning and at the end; it falls geometrically."""


def cells_along(site: Site, views: Iterable[int] | NDArray[np.int64]) -> list[int]:
    """Cells on the way through the views, one after the other, without the first."""
    place = site.grid.cell_of(site.pose[0], site.pose[1])
    way: list[int] = []
    for view in views:
        while place != int(view):
            place = int(site.toward[place, int(view)])
            way.append(place)
    return way


def foreseeing(belief: Belief, world: World) -> Belief:
    """Belief that expects every landmark of the world that it does not know yet."""
    unknown = np.ones(len(world.landmarks), dtype=bool)
    unknown[belief.landmark_ids] = False
    return expecting(belief, world.landmarks[unknown])


def foretold(site: Site, belief: Belief, views: NDArray[np.int64]) -> Score | None:
    """What Eq. 2 and 3 say of a tour without noise; None where it does not explore enough. `belief` foresees."""
    steps, total, (x, y, _) = end_of(site, views)
    if total < site.target or not steps:
        return None
    places = site.grid.centres(np.array(cells_along(site, views), dtype=np.int64))
    # the trial ends on the way to a cell: everything after that step is cut off
    needed = bisect_left(
        range(len(places)), int(steps), key=lambda last: len(site.driver.follow(site.pose, places[: last + 1]))
    )
    places = places[: needed + 1].copy()
    places[-1] = x, y
    prediction = belief.predict(places)
    return Score(belief.scenario, int(steps), prediction.uncertainty, prediction.peak_trace)


def objective(score: Score | None) -> float:
    """Log e − log η, infinite for a tour that does not explore enough."""
    if score is None or score.exploration_efficiency <= 0.0:
        return math.inf
    return math.log(score.trajectory_error) - math.log(score.exploration_efficiency)


def accurate_tour(
    site: Site, belief: Belief, views: NDArray[np.int64], rng: np.random.Generator, changes: int = CHANGES
) -> NDArray[np.int64]:
    """Views of the tour with the least log e − log η found from the views of another on, shape (V,)."""
    now, best = views, views
    cost = least = objective(foretold(site, belief, views))
    heat, cooling = HOT, (COLD / HOT) ** (1.0 / changes)
    for draw in rng.random((changes, 5)):
        heat *= cooling
        other = changed(site, now, draw)
        if not len(other):
            continue
        after = objective(foretold(site, belief, other))
        if after <= cost - heat * math.log(1.0 - draw[4]):  # Metropolis
            now, cost = other, after
            if cost < least:
                best, least = now, cost
    return best
