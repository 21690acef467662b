"""A reference that knows the truth: how fast could anyone explore this world? Never a competitor.

It plans once, at leisure: a `tour` of the true map without noise, by annealing, and drives along it. Its notes hold how
many steps the tour takes, and a `bound` below which no way is. The tours of the benchmark's worlds were planned once
and lie in tours.csv; any other world is planned when its trial begins, in the same way and for as long. Where the noise
left something to see at the end of the tour, the rest is planned from there.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from baselines.reference.bound import least_steps
from baselines.reference.tour import Site, Tour, best_tour, straight_toward_all, toward_all
from explore_bench import (
    Driver,
    LandmarkScenario,
    Observation,
    RequestError,
    Target,
    World,
    cells_of,
    scenario_digest,
    stream,
)

TOURS = Path(__file__).with_name("tours.csv")
COLUMNS = ("scenario", "world", "size", "trial", "bound", "steps", "views")
"""Of tours.csv: digests of the scenario and of the world, and the views as cells with spaces between."""

CHANGES_OF_REST = 5_000
"""Changes that an annealing tries for what the tour has left."""

MOST_CELLS = 2601
"""Cells of the largest grid that is planned: every pair of cells has a path, which takes memory."""


class Clairvoyant:
    """Drives along the fastest tour of the true map that was found.

    Attributes
    ----------
    notes : steps of its `tour` without noise, and the lower `bound`; from the first decision on.
    """

    def reset_with_world(self, rng: np.random.Generator, world: World) -> None:
        """Begin a trial in a world that is known. The tour is always the same; what it leaves is planned with `rng`."""
        self.notes: dict[str, float] = {}
        self._world, self._rng = world, rng
        self._way: list[int] = []

    def choose(self, observation: Observation) -> int | Target:
        """Return the next cell of the tour, or the nearest candidate where no tour leads on."""
        scenario = observation.scenario
        if not isinstance(scenario, LandmarkScenario):
            raise RequestError(f"clairvoyant plans in landmark worlds, not in kind '{scenario.kind}'; leave it out.")
        if not self.notes:
            self._plan(observation, scenario)
        cell = self._next(observation)
        if cell is None:
            site = site_of(observation, self._world)
            self._way = _cells_along(site, best_tour(site, self._rng, CHANGES_OF_REST).views)
            cell = self._next(observation)
        return int(observation.path_lengths.argmin()) if cell is None else Target(scenario.grid.centre_of(cell))

    def _next(self, observation: Observation) -> int | None:
        """Next cell of the way that is not the robot's own and to which a road leads; None at its end."""
        while self._way:
            cell = self._way[0]
            if cell != observation.roads.start and len(observation.roads.path_to(cell)):
                return cell
            del self._way[0]
        return None

    def _plan(self, observation: Observation, scenario: LandmarkScenario) -> None:
        site = site_of(observation, self._world)
        known = stored().get((scenario_digest(scenario), self._world.digest)) if observation.step == 0 else None
        tour, bound = known or planned(site, scenario)
        self.notes = {"tour": tour.steps, "bound": float(bound)}
        self._way = _cells_along(site, tour.views)


def site_of(observation: Observation, world: World) -> Site:
    """What there is to tour, as the robot stands at its first decision.

    Raises
    ------
    RequestError : for a grid with more than MOST_CELLS cells.
    """
    scenario = observation.scenario
    assert isinstance(scenario, LandmarkScenario)
    if scenario.cell_count > MOST_CELLS:
        raise RequestError(
            f"clairvoyant plans on grids of up to {MOST_CELLS} cells, not {scenario.cell_count}; leave it out."
        )
    free = ~world.obstacles & scenario.inside
    free.reshape(-1)[cells_of(world.grid, world.landmarks)] = False
    start, driver = observation.roads.start, Driver.of(scenario)
    if driver.open_loop:
        toward = straight_toward_all(world.grid, free, driver, scenario.sensor_range)
    else:
        toward = toward_all(world.grid, free, start)
    counted = world.counted.reshape(-1)
    return Site(
        grid=world.grid,
        toward=toward,
        views=np.flatnonzero((toward[start] >= 0) & free.reshape(-1)),
        counted=counted,
        known=observation.belief.known.reshape(-1).copy(),
        target=math.ceil(scenario.coverage * counted.sum() - 1e-9),
        pose=observation.pose,
        driver=driver,
        reach=scenario.sensor_range,
    )


def planned(site: Site, scenario: LandmarkScenario) -> tuple[Tour, int]:
    """Tour of a site and the bound below which none is: the same whoever asks."""
    missing = site.target - int((site.known & site.counted).sum())
    bound = least_steps(missing, site.target, scenario.step_length, site.reach, site.grid)
    return best_tour(site, stream("evaluate", 0, scenario.size, 0, "strategy")), bound


@cache
def stored() -> dict[tuple[str, str], tuple[Tour, int]]:
    """Tours and bounds of tours.csv by the digests of their scenario and world."""
    found = {}
    if TOURS.exists():
        with TOURS.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                views = np.array(row["views"].split(), dtype=np.int64)
                found[row["scenario"], row["world"]] = Tour(views, float(row["steps"])), int(row["bound"])
    return found


def _cells_along(site: Site, views: Iterable[int] | NDArray[np.int64]) -> list[int]:
    """Cells on the way through the views, one after the other, without the first."""
    place = site.grid.cell_of(site.pose[0], site.pose[1])
    way: list[int] = []
    for view in views:
        while place != int(view):
            place = int(site.toward[place, int(view)])
            way.append(place)
    return way
