"""Observations to show to a strategy, whatever it answers: those of real rollouts, driven by somebody else.

Nothing is made up: one candidate or sixty, no landmark, a corner, another kind of world are scenarios of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from explore_bench.geometry import Pose
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.loop import rollout
from explore_bench.trial.seeding import Role, stream
from explore_bench.world.kinds import World, draw_world
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER, STAGE


@dataclass(frozen=True)
class Tour:
    """A trial on a calibration world of which the observations are kept, and not the world.

    Attributes
    ----------
    name : what a finding calls it.
    scenario, trial : of its world and its streams.
    start : where it begins instead of the world's own start.
    choices : what is chosen at each decision, to whose end it goes; None: the shortest path, always.
    decisions : after how many it ends at the latest.
    """

    name: str
    scenario: Scenario
    trial: int
    start: Pose | None = None
    choices: tuple[int | Target, ...] | None = None
    decisions: int = 1000

    @property
    def kind(self) -> str:
        """Kind of its world."""
        return self.scenario.kind

    def generator(self, role: Role) -> np.random.Generator:
        """Return the trial's stream of a role."""
        return stream("calibrate", 0, self.scenario.size, self.trial, role)

    def world(self) -> World:
        """Draw its world."""
        drawn: Any = draw_world(self.scenario, self.generator("world"))
        world: World = drawn if self.start is None else replace(drawn, start=self.start)
        return world


@cache
def observations(tour: Tour) -> tuple[Observation, ...]:
    """All observations of a tour in their order; clear the cache when somebody has changed one."""
    shown: list[Observation] = []
    last = tour.decisions if tour.choices is None else len(tour.choices)
    events = rollout(tour.scenario, tour.world(), tour.generator("motion"), tour.generator("sensor"))
    choice: int | Target | None = None
    while len(shown) < last:
        try:
            event = events.send(choice)
        except StopIteration:
            break
        choice = None
        if isinstance(event, Observation):
            choice = int(event.path_lengths.argmin()) if tour.choices is None else tour.choices[len(shown)]
            shown.append(event)
    return tuple(shown)


MANY = 60
_SMALL = PAPER.replace(size=14.0)
_OPEN = _SMALL.replace(obstacle_count=0, landmark_count=8)
_FINE = PAPER.replace(
    size=16.0,
    cell_size=0.5,
    arrival_radius=0.2,
    path_tolerance=0.5,
    candidates_per_robot=MANY,
    candidates_per_landmark=0,
    landmark_count=6,
    obstacle_count=8,
)

LARGE = Tour("20 m", PAPER, trial=0)
SMALL = Tour("14 m", _SMALL, trial=1)
LIDAR = Tour("12 m by lidar", STAGE.replace(size=12.0, sensor_range=5.0, coverage=0.9), trial=7, decisions=12)
ORDINARY = (LARGE, SMALL, LIDAR)

ONE_CANDIDATE = Tour("one candidate", _SMALL.replace(candidates_per_robot=1, candidates_per_landmark=0), trial=1)
MANY_CANDIDATES = Tour(f"{MANY} candidates", _FINE, trial=2, decisions=4)
NO_LANDMARK = Tour("no landmark", _SMALL.replace(landmark_count=0), trial=1)
CORNERS = tuple(
    Tour(f"the corner at ({x:g}, {y:g}) m", _OPEN, trial=3, start=(x, y, 0.3), decisions=2)
    for x in (1.0, 13.0)
    for y in (1.0, 13.0)
)
SITUATIONS = (ONE_CANDIDATE, MANY_CANDIDATES, NO_LANDMARK, *CORNERS)

TRIALS = (
    replace(LARGE, name="a trial of 20 m", trial=10),
    replace(SMALL, name="a trial of 14 m", trial=11),
    replace(LIDAR, name="a trial of 12 m by lidar", trial=12, decisions=1000),
)
"""Worlds of a strategy's own trials: others than those of the tours, of which it may keep something."""
