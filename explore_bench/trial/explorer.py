"""What the simulation loop needs of a robot in a world, whatever their kind."""

from __future__ import annotations

import itertools
import math
import reprlib
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from explore_bench.errors import one_line
from explore_bench.robot.belief import Belief
from explore_bench.robot.planning.roads import Roads
from explore_bench.robot.timing import Lap
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.spec import Status
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import World, kind_of
from explore_bench.world.scenario import Scenario


class Explorer(Protocol):
    """A robot in a world: it knows its truth, its SLAM and how it drives."""

    def status(self) -> Status | None:
        """How the trial ends now; None while it goes on."""

    def row(self) -> Step:
        """The primitives after the last step."""

    def observe(self) -> Observation:
        """What the decision that is due may use.

        Raises
        ------
        StuckError : where there is nothing to decide any more.
        """

    def drive(self, choice: object) -> Iterator[Step]:
        """Carry out a decision, yielding the row of each step.

        Raises
        ------
        ChoiceError : where the choice is neither a candidate's index nor a Target that can be reached.
        """

    def belief(self) -> Belief:
        """What the robot believes now, frozen."""


class StuckError(Exception):
    """The trial cannot go on; says why."""


class ChoiceError(ValueError):
    """A strategy answered something that can be neither chosen nor driven to."""


class StandingError(ChoiceError):
    """A strategy answered where the robot already is: asked again, it would do so for ever."""


def explorer_of(
    scenario: Scenario, world: World, motion: np.random.Generator, sensing: np.random.Generator, lap: Lap
) -> Explorer:
    """Robot of the scenario's kind in a world, after its first scan.

    Raises
    ------
    ValueError : when the world does not fit the scenario.
    """
    explorer: Explorer = kind_of(scenario.kind).load("explorer")(scenario, world, motion, sensing, lap)
    return explorer


class Patience:
    """Counts decisions that do not leave a cell; more than `stuck_decisions` of them end a trial."""

    def __init__(self, scenario: Scenario) -> None:
        self._limit = scenario.stuck_decisions
        self._cell, self._decisions = -1, 0

    def decide(self, cell: int) -> None:
        """Note that a decision is due in a cell.

        Raises
        ------
        StuckError : where it is one too many.
        """
        self._decisions = self._decisions + 1 if cell == self._cell else 1
        self._cell = cell
        if self._decisions > self._limit:
            raise StuckError(f"{self._limit} decisions did not leave cell {cell}")

    def visit(self, cell: int) -> None:
        """Note where a step led."""
        if cell != self._cell:
            self._cell = -1


def answer_of(choice: object, count: int) -> int | Target:
    """Return an answer to `count` candidates in plain numbers, whatever type of its own a strategy made of it.

    Raises
    ------
    ChoiceError : where it is neither an integer nor a Target with a place.
    """
    if isinstance(choice, Target):
        return Target(place_of(choice))
    if isinstance(choice, bool | np.bool_) or not isinstance(choice, int | np.integer):
        raise ChoiceError(
            f"the answer {_shown(choice)} is of type {type(choice).__name__}; "
            f"answer an integer index, 0 to {count - 1}, or a Target"
        )
    return int.__int__(choice) if isinstance(choice, int) else int(np.integer.__int__(choice))


def checked(choice: object, count: int, roads: Roads) -> int | Target:
    """Return a choice as it may be carried out: the index of one of `count` candidates, or a Target on the roads.

    Raises
    ------
    ChoiceError : for anything else.
    """
    answer = answer_of(choice, count)
    if isinstance(answer, Target):
        return _on_roads(answer.position, roads)
    if not 0 <= answer < count:
        raise ChoiceError(f"the answer {_shown(answer)} is not the index of a candidate; answer 0 to {count - 1}")
    return answer


def place_of(target: Target) -> tuple[float, float]:
    """Return the place (x, y) of a target in plain numbers [m].

    Raises
    ------
    ChoiceError : where it is no place, or not a finite one.
    """
    try:
        x, y = (_number(value) for value in itertools.islice(iter(target.position), 3))
    except BaseException:
        raise ChoiceError(f"the target {_shown_place(target)} is no place; give its x and y in metres") from None
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ChoiceError(f"the target {_shown_place(target)} is not finite; give its x and y in metres")
    return x, y


def _number(value: object) -> float:
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError
    return float(value)


def _on_roads(place: tuple[float, float], roads: Roads) -> Target:
    shown, grid = f"the target ({place[0]:g}, {place[1]:g})", roads.grid
    if not grid.holds(*place):
        raise ChoiceError(
            f"{shown} lies outside the map of {grid.columns * grid.resolution:g} × {grid.rows * grid.resolution:g} m; "
            "choose one of observation.reachable"
        )
    cell = grid.cell_of(*place)
    if cell == roads.start:
        raise StandingError(
            f"{shown} lies in the robot's own cell {cell}, so that it would never move; choose another one of "
            "observation.reachable"
        )
    if not roads.free.reshape(-1)[cell]:
        raise ChoiceError(
            f"{shown} lies in cell {cell}, which is blocked or not known to be free; "
            "choose one of observation.reachable"
        )
    if not len(roads.path_to(cell)):
        raise ChoiceError(f"{shown} lies in cell {cell}, to which no way leads; choose one of observation.reachable")
    return Target(place)


def _shown_place(target: Target) -> str:
    try:
        return _shown(target.position)
    except BaseException:
        return "without a position"


def _shown(value: object) -> str:
    """Return a value in a few words on one line, whatever a strategy made of it."""
    try:
        return one_line(reprlib.repr(value), 100)
    except BaseException:
        return "that cannot be shown"
