"""The strategy under test."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from typing import Any

from explore_bench.runs.conformance.tours import SMALL, Tour
from explore_bench.strategies.entry import Entry
from explore_bench.strategies.loading import make_strategy
from explore_bench.strategies.registry import lookup_ready
from explore_bench.trial.spec import TrialSpec

TIMEOUT = 60.0
"""Seconds that the import, a trial, or the decisions of a tour may take."""


@dataclass(frozen=True)
class Subject:
    """A strategy under test.

    Attributes
    ----------
    name, entry : as the registry knows it.
    timeout : seconds that its import, a trial, or the decisions of a tour may take.
    """

    name: str
    entry: Entry = field(repr=False)
    timeout: float = TIMEOUT

    @classmethod
    def of(cls, strategy: str, timeout: float) -> Subject:
        """Look a strategy up.

        Raises
        ------
        RequestError : where there is none of this name, or it is not trained.
        """
        return cls(*lookup_ready(strategy), timeout)

    def spec(self, tour: Tour) -> TrialSpec:
        """Return its own trial in the world of a tour, with the weights of the first training seed."""
        seed, weights = next(iter(self.entry.weights.items()), (None, None))
        return TrialSpec(
            strategy=self.name,
            factory=self.entry.factory,
            scenario=tour.scenario,
            trial=tour.trial,
            parameters=dict(self.entry.parameters),
            reference=self.entry.reference,
            purpose="calibrate",
            training_seed=seed,
            weights=weights,
        )

    def make(self) -> Any:
        """Return a fresh one; what it is made of does not depend on the tour."""
        spec = self.spec(SMALL)
        with redirect_stdout(sys.stderr):
            return make_strategy(spec.factory, spec.arguments)
