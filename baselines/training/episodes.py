"""Several rollouts in lockstep, so that one pass of a network serves the decisions of all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from explore_bench import Course, DecisionProcess, Observation, Scenario, Status, Step, score

Act = Callable[[list[int], list[Observation]], Sequence[int]]
"""Told which episodes wait for a decision and what they see, it answers with a choice for each."""


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
        final = score(self.status, max(self.last.step, 1), self.last.uncertainty, self.last.peak_trace, scenario)
        return float(final.time), final.exploration_efficiency, final.trajectory_error

    @property
    def steps(self) -> int:
        """T, steps taken."""
        return self.last.step if self.last else 0


def play(course: Course, numbers: Sequence[int], act: Act) -> list[Episode]:
    """Play episodes in lockstep: `act` is asked for the next decisions of all that still run, until all have ended."""
    running = [course.begin(number) for number in numbers]
    rewards: list[list[float]] = [[] for _ in numbers]
    while waiting := {i: one.observation for i, one in enumerate(running) if one.observation is not None}:
        choices = act(list(waiting), list(waiting.values()))
        for i, choice in zip(waiting, choices, strict=True):
            rewards[i].append(running[i].decide(int(choice)))
    return [_episode(*one) for one in zip(numbers, running, rewards, strict=True)]


def _episode(number: int, process: DecisionProcess, rewards: list[float]) -> Episode:
    assert process.ending is not None
    return Episode(number, process.rows[-1], rewards, process.ending.status)
