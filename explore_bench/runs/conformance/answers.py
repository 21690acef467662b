"""Asks a strategy about the observations of a tour, while another trial goes on around it."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from explore_bench.errors import RequestError, describe
from explore_bench.runs.conformance.chance import watched
from explore_bench.runs.conformance.digest import changed_part, digests
from explore_bench.runs.conformance.subject import Subject
from explore_bench.runs.conformance.tours import Tour, observations
from explore_bench.strategies.contract import Observation, Target
from explore_bench.strategies.tracing import place_of, with_place
from explore_bench.trial.containment import Signals, time_limit
from explore_bench.trial.explorer import ChoiceError, checked
from explore_bench.trial.loop import rollout
from explore_bench.world.kinds import draw_world

ELSEWHERE = 1000
"""How far the number of the trial that goes on around a tour is from the tour's own."""


@dataclass(frozen=True)
class Stray:
    """A target to which no robot can drive, and why not."""

    reason: str


Answer = int | Target | Stray | str
"""An index, a target, one that cannot be reached, or in words what else it was."""


@dataclass(frozen=True)
class Answers:
    """What a strategy answered to the observations of a tour.

    Attributes
    ----------
    given : each answer.
    counts : number of candidates at each decision of the tour.
    error : what it did instead of the next answer; empty where it answered to the end.
    place : where in its own source that was; empty where that is not known.
    refused : why it runs in no world of this kind, by its entry or in a RequestError before its first answer; empty
        where it did not refuse it.
    late : whether that was for want of time.
    modified : part of an observation that it changed; empty where it changed none.
    drawn : modules from whose global generator it drew.
    """

    given: tuple[Answer, ...]
    counts: tuple[int, ...]
    error: str
    refused: str
    late: bool
    modified: str
    drawn: tuple[str, ...]
    place: str = ""

    @property
    def told(self) -> str:
        """The error with its place."""
        return with_place(self.error, self.place)

    def same_as(self, other: Answers) -> bool:
        """Whether the two answered alike."""
        return (self.given, self.error) == (other.given, other.error)


def play(subject: Subject, tour: Tour, strategy: Any = None, chance: int = 0) -> Answers:
    """Show a tour to a strategy.

    Around it, where a trial keeps its own, are the specification, the world and the rollout of another trial than
    that of the tour: who looks there decides by a world that is not the one observed.

    Parameters
    ----------
    strategy : one that was made before; None for a fresh one.
    chance : number of the state of the global generators.
    """
    if not subject.entry.runs_in(tour.kind):
        return Answers((), (), "", f"its entry names {', '.join(subject.entry.kinds)}", False, "", ())
    shown = observations(tour)
    before = [digests(observation) for observation in shown]
    counts = tuple(len(observation.candidates) for observation in shown)
    spec = subject.spec(replace(tour, trial=tour.trial + ELSEWHERE))
    world = draw_world(spec.scenario, spec.generator("world"))
    events = rollout(spec.scenario, world, spec.generator("motion"), spec.generator("sensor"))
    given: list[Answer] = []
    drawn: list[str] = []
    error, place, refused, own = "", "", "", os.getpid()
    told = Signals()
    try:
        with contextlib.redirect_stdout(sys.stderr), time_limit(subject.timeout) as told:
            strategy = subject.make() if strategy is None else strategy
            with watched(chance, drawn):
                if spec.reference:
                    strategy.reset_with_world(tour.generator("strategy"), tour.world())
                else:
                    strategy.reset(tour.generator("strategy"))
                _ask(events, strategy, shown, given)
    except BaseException as raised:
        error = f"it raised {describe(raised)}"
        place = place_of(raised, spec.factory)
        if isinstance(raised, RequestError) and not given:
            refused = " ".join(str(raised).split()).rstrip(".")
    finally:
        if os.getpid() != own:  # it forked and came back twice
            os._exit(0)
    if told.interrupted:
        raise KeyboardInterrupt
    if told.expired:
        error, refused = f"it took longer than the {subject.timeout:g} s allowed", ""
    modified = next(filter(None, map(changed_part, before, shown)), "")
    if modified:
        observations.cache_clear()
    return Answers(tuple(given), counts, error, refused, told.expired, modified, tuple(drawn), place)


def _ask(events: Generator[Any, Any, Any], strategy: Any, shown: tuple[Observation, ...], given: list[Answer]) -> None:
    """Ask for a choice at each observation, while the rollout around it waits for one, too."""
    while not isinstance(next(events), Observation):
        pass
    for observation in shown:
        given.append(_answer(strategy.choose(observation), observation))  # noqa: PERF401  (kept where it raises)


def _answer(answer: object, observation: Observation) -> Answer:
    if isinstance(answer, Target):
        try:
            return checked(answer, len(observation.candidates), observation.roads)  # the place in plain numbers
        except ChoiceError as error:
            return Stray(str(error))
    if isinstance(answer, int | np.integer) and not isinstance(answer, bool | np.bool_):
        return int(answer)
    return f"{' '.join(repr(answer).split())} of type {type(answer).__name__}"
