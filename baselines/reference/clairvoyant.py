"""A reference that knows the truth: how fast could anyone explore this world? Never a competitor.

It plans once, at leisure: a `tour` of the true map without noise, by annealing, and drives along it. Its notes hold how
many steps the tour takes, and a `bound` below which no way is. Or it plans an `accurate` tour, for e and η. The tours
of the benchmark's worlds were planned once and lie in tours.csv; any other world is planned when its trial begins, in
the same way and for as long. Where the noise left something to see at the end of the tour, the fastest way to see the
rest is planned from there; where that shows nothing new, the nearest candidate is next.
"""

from __future__ import annotations

import csv
import math
from functools import cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.reference.accurate import accurate_tour, cells_along, foreseeing
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
COLUMNS = ("scenario", "world", "size", "trial", "bound", "steps", "views", "accurate_views")
"""Of tours.csv: digests of the scenario and of the world, and views as cells with spaces between."""

AIMS = ("time", "accuracy")

CHANGES_OF_REST = 5_000
"""Changes that an annealing tries for what the tour has left."""

MOST_CELLS = 2601
"""Cells of the largest grid that is planned: every pair of cells has a path, which takes memory."""


class Plan(NamedTuple):
    """What was planned in a world: the fastest tour, the bound below which none is, and the views for e and η."""

    tour: Tour
    bound: int
    accurate: NDArray[np.int64]


class Clairvoyant:
    """Drives along the fastest tour of the true map that was found, or along that with the least log e − log η.

    Parameters
    ----------
    aim : "time" or "accuracy".

    Attributes
    ----------
    notes : of the fastest tour alone: its steps without noise (`tour`) and the lower `bound`; from the first decision.

    Raises
    ------
    ValueError : for another aim.
    """

    def __init__(self, aim: Literal["time", "accuracy"] = "time") -> None:
        if aim not in AIMS:
            raise ValueError(f"there is no aim {aim!r}; choose one of {', '.join(map(repr, AIMS))}")
        self._fast = aim == "time"

    def reset_with_world(self, rng: np.random.Generator, world: World) -> None:
        """Begin a trial in a world that is known. The tour is always the same; what it leaves is planned with `rng`."""
        self.notes: dict[str, float] = {}
        self._world, self._rng = world, rng
        self._way: list[int] = []
        self._known = -1  # cells known when the rest was last planned

    def choose(self, observation: Observation) -> int | Target:
        """Return the next cell of the tour, or the nearest candidate where no tour leads on."""
        scenario = observation.scenario
        if not isinstance(scenario, LandmarkScenario):
            raise RequestError(f"clairvoyant plans in landmark worlds, not in kind '{scenario.kind}'; leave it out.")
        if not observation.decision:
            self._plan(observation, scenario)
        cell = self._next(observation)
        known = int(observation.belief.known.sum())
        if cell is None and known > self._known:  # else what is left hides, and the same would be planned for ever
            self._known = known
            site = site_of(observation, self._world)
            self._way = cells_along(site, best_tour(site, self._rng, CHANGES_OF_REST).views)
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
        if self._fast:
            tour, bound = known[:2] if known else planned(site, scenario)
            self.notes = {"tour": tour.steps, "bound": float(bound)}
            views = tour.views
        else:
            views = known.accurate if known else planned_for_accuracy(site, observation, self._world)
        self._way = cells_along(site, views)


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


def planned_for_accuracy(
    site: Site, observation: Observation, world: World, tour: Tour | None = None
) -> NDArray[np.int64]:
    """Views of an accurate tour of a site, planned from its fastest `tour` on: the same whoever asks."""
    scenario = observation.scenario
    assert isinstance(scenario, LandmarkScenario)
    fast = planned(site, scenario)[0] if tour is None else tour
    rng = stream("evaluate", 0, scenario.size, 0, "strategy")
    return accurate_tour(site, foreseeing(observation.belief, world), fast.views, rng)


@cache
def stored() -> dict[tuple[str, str], Plan]:
    """Plans of tours.csv by the digests of their scenario and world."""
    found = {}
    if TOURS.exists():
        with TOURS.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                views, accurate = (np.array(row[name].split(), dtype=np.int64) for name in COLUMNS[-2:])
                tour = Tour(views, float(row["steps"]))
                found[row["scenario"], row["world"]] = Plan(tour, int(row["bound"]), accurate)
    return found
