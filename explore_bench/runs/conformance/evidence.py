"""What a strategy was made to do: each thing once, when a rule first looks at it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from explore_bench.runs.conformance.answers import Answers, play
from explore_bench.runs.conformance.apart import Examination, Played, examine, run_in_workers
from explore_bench.runs.conformance.subject import Subject
from explore_bench.runs.conformance.tours import TRIALS, Tour


@dataclass(frozen=True)
class Evidence:
    """The record of a strategy under test."""

    subject: Subject
    _answers: dict[Tour, Answers] = field(default_factory=dict)

    @cached_property
    def examination(self) -> Examination:
        """What it did in a process of its own; nothing else is asked of it before it came through that."""
        return examine(self.subject)

    @cached_property
    def in_workers(self) -> dict[Tour, Played]:
        """How its trials went in the runner's worker processes."""
        return run_in_workers(self.subject, self.examination.accepted(TRIALS))

    def answers(self, tour: Tour) -> Answers:
        """What a fresh one answers to the observations of a tour, in this process."""
        if tour not in self._answers:
            self._answers[tour] = play(self.subject, tour)
        return self._answers[tour]
