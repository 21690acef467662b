"""How often two strategies choose the same at the same observations, from what they answered there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
import pandas as pd

from explore_bench.analysis.rounding import rounded
from explore_bench.analysis.statistics import mean_interval

COLUMNS = (
    *("a", "seed_a", "b", "seed_b", "scenario", "size", "n", "observations"),
    *("agreement", "ci_low", "ci_high", "chance"),
)
"""Those of `agreement_table`."""


class Chooser(NamedTuple):
    """A strategy, with the seed of its training where it is learned: each of its networks chooses for itself."""

    strategy: str
    training_seed: int | None

    def __str__(self) -> str:
        return self.strategy if self.training_seed is None else f"{self.strategy}, seed {self.training_seed}"


class Choice(NamedTuple):
    """An answer: the index of a candidate (None for a Target), and the cell of decisions in which it lies."""

    candidate: int | None
    cell: int

    def same(self, other: Choice) -> bool:
        """Whether both are one candidate; where one is a Target, whether both lie in one cell."""
        if self.candidate is not None and other.candidate is not None:
            return self.candidate == other.candidate
        return self.cell == other.cell


@dataclass(frozen=True)
class Trajectory:
    """The observations of one trial, and what was chosen at them.

    Attributes
    ----------
    driver : whose choices were driven.
    scenario, size, trial : its world.
    candidates : how many there were at each observation.
    driven : the driver's choices.
    asked : choices of everybody who answered at all of the observations, the driver, asked once more, among them.
    """

    driver: Chooser
    scenario: str
    size: float
    trial: int
    candidates: tuple[int, ...]
    driven: tuple[Choice, ...]
    asked: Mapping[Chooser, tuple[Choice, ...]]

    def agreement(self, other: Chooser) -> float:
        """Share of the observations at which another one (or the driver, asked again) chose what was driven."""
        pairs = zip(self.driven, self.asked[other], strict=True)
        return float(np.mean([one.same(another) for one, another in pairs]))

    @property
    def chance(self) -> float:
        """Share at which two agree who draw from the candidates: the mean of 1 / C."""
        return float(np.mean(1.0 / np.array(self.candidates)))


def agreement_table(trajectories: Sequence[Trajectory]) -> pd.DataFrame:
    """One row a pair of choosers, each with itself included, and a scenario and size; COLUMNS.

    A pair is compared along the trajectories of its own two, in every world in which both answered at all observations
    of both: a world's value is the mean of the two shares, so that neither's way counts more and nobody else's counts
    at all. `n` counts worlds, the interval is the BCa bootstrap's over them; a pair without a world has NaN.
    """
    known: dict[tuple[str, float], dict[tuple[Chooser, int], Trajectory]] = {}
    for each in trajectories:
        known.setdefault((each.scenario, each.size), {})[each.driver, each.trial] = each
    rows = [
        _row(a, b, scenario, size, list(_shared(a, b, own)))
        for (scenario, size), own in known.items()
        for a, b in combinations_with_replacement(dict.fromkeys(driver for driver, _ in own), 2)
    ]
    return rounded(pd.DataFrame(rows, columns=list(COLUMNS)).astype({"seed_a": "Int64", "seed_b": "Int64"}))


def _shared(
    a: Chooser, b: Chooser, own: Mapping[tuple[Chooser, int], Trajectory]
) -> Iterator[list[tuple[Trajectory, Chooser]]]:
    """Trajectories of a pair in each world that counts, with who is asked along each."""
    for trial in sorted({trial for _, trial in own}):
        both = [(own.get((driver, trial)), asked) for driver, asked in dict.fromkeys(((a, b), (b, a)))]
        seen = [(way, asked) for way, asked in both if way is not None and asked in way.asked]
        if len(seen) == len(both) and any(way.candidates for way, _ in seen):
            yield [(way, asked) for way, asked in seen if way.candidates]


def _row(
    a: Chooser, b: Chooser, scenario: str, size: float, worlds: Sequence[Sequence[tuple[Trajectory, Chooser]]]
) -> tuple[object, ...]:
    shares = np.array([np.mean([way.agreement(asked) for way, asked in world]) for world in worlds])
    by_chance = [np.mean([way.chance for way, _ in world]) for world in worlds]
    estimate = mean_interval(shares)
    return (
        *(*a, *b, scenario, size, estimate.n, sum(len(way.candidates) for world in worlds for way, _ in world)),
        *(estimate.mean, estimate.low, estimate.high, float(np.mean(by_chance)) if by_chance else math.nan),
    )
