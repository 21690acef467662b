"""Several rollouts in lockstep, so that one pass of a network serves the decisions of all of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from explore_bench import Observation, Scenario, rollout
from explore_bench.reward import WEIGHTS, RewardWeights, reward
from explore_bench.seeding import Purpose, Role, stream
from explore_bench.simulator.world import draw_world
from explore_bench.spec import Status
from explore_bench.steps import Step

Act = Callable[[list[int], list[Observation]], Sequence[int]]
"""Told which episodes wait for a decision and what they see, it answers with a choice for each."""


@dataclass(frozen=True)
class Course:
    """Where episodes come from, their physics and their random streams, numbered from 0, and what they earn.

    Attributes
    ----------
    root : root seed; for training the training seed.
    weights : of the reward of a decision (Eq. 24).
    """

    scenario: Scenario
    purpose: Purpose
    root: int
    weights: RewardWeights = WEIGHTS

    def generator(self, episode: int, role: Role) -> np.random.Generator:
        """Return the stream of a role in an episode."""
        return stream(self.purpose, self.root, self.scenario.size, episode, role)


@dataclass
class Episode:
    """What an episode was like.

    Attributes
    ----------
    number : of the episode in its course.
    rewards : Eq. 24 of each decision.
    last : row after its last step.
    status : how it ended.
    """

    number: int
    last: Step | None = None
    rewards: list[float] = field(default_factory=list)
    status: Status = Status.FAILED

    def score(self, scenario: Scenario) -> tuple[float, float, float]:
        """T, η (Eq. 2) and e (Eq. 3), by the benchmark's rule for an episode that did not explore its map."""
        assert self.last is not None
        taken, peak = self.last.step, self.last.peak_trace
        if self.status is not Status.EXPLORED:
            taken, peak = scenario.step_limit, max(peak, 2.0 * scenario.virtual_sigma**2)
        taken = max(taken, 1)
        efficiency = (scenario.prior_uncertainty - self.last.uncertainty) / taken
        return float(taken), efficiency, taken / scenario.cell_count * math.sqrt(peak)

    @property
    def steps(self) -> int:
        """T, steps taken."""
        return self.last.step if self.last else 0


class _Running:
    """One rollout, advanced from decision to decision."""

    def __init__(self, course: Course, number: int) -> None:
        world = draw_world(course.scenario, course.generator(number, "world"))
        self._events = rollout(
            course.scenario, world, course.generator(number, "motion"), course.generator(number, "sensor")
        )
        self._course = course
        self.episode = Episode(number)
        self.observation: Observation | None = None

    def advance(self, choice: int | None) -> None:
        """Give a choice (None at the start) and go on to the next decision, or to the end (observation None)."""
        before, self.observation = self.episode.last, None
        try:
            event = self._events.send(choice)
            while isinstance(event, Step):
                self.episode.last = event
                event = next(self._events)
            self.observation = event
        except StopIteration as stop:
            self.episode.status = stop.value.status
        if choice is not None and before is not None and self.episode.last is not None:
            self.episode.rewards.append(reward(before, self.episode.last, self._course.scenario, self._course.weights))


def play(course: Course, numbers: Sequence[int], act: Act) -> list[Episode]:
    """Play episodes in lockstep: `act` is asked for the next decisions of all that still run, until all have ended."""
    running = [_Running(course, number) for number in numbers]
    for one in running:
        one.advance(None)
    while waiting := [i for i, one in enumerate(running) if one.observation is not None]:
        choices = act(waiting, [one.observation for i in waiting if (one := running[i]).observation is not None])
        for i, choice in zip(waiting, choices, strict=True):
            running[i].advance(int(choice))
    return [one.episode for one in running]
