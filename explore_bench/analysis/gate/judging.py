"""The gate: which metrics have become worse than is tolerated.

Losses shown to be above their tolerance are regressions, corrected by Holm over the declared family: a false alarm of
any of them has at most the chance LEVEL. So are gains above it. A pass needs the loss shown to be below the tolerance,
uncorrected, for the gate passes only where all pairs do (an intersection–union test, Berger 1982).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import plain
from explore_bench.analysis.gate.margins import beyond_p, holm_levels, lower_bound, power, upper_bound
from explore_bench.analysis.gate.pairs import Pair, pair_up
from explore_bench.analysis.gate.thresholds import Threshold
from explore_bench.analysis.statistics import LEVEL, holm

STATED_LOSS = 0.10
"""Loss for which the power is stated."""


class Verdict(StrEnum):
    """What the gate says of a pair; of a whole family it says the first of these that one of its pairs has."""

    MISSING = "missing"
    REGRESSED = "regressed"
    INCONCLUSIVE = "inconclusive"
    IMPROVED = "improved"
    PASS = "pass"


@dataclass(frozen=True)
class Decision:
    """What the losses of a pair say.

    Attributes
    ----------
    loss : mean over the worlds; a gain is negative, NaN where trials are missing.
    at_least : its lower bound at the level at which Holm's method tests it; above the tolerance where it regressed.
    at_most : its upper bound at LEVEL; below the tolerance where it passes.
    p, p_holm : one-sided, of "no worse than tolerated"; after Holm's correction.
    """

    loss: float
    at_least: float
    at_most: float
    p: float
    p_holm: float
    verdict: Verdict


@dataclass(frozen=True)
class Judgement:
    """A pair, the decision on it, and the chance that a loss of STATED_LOSS is called a regression of it.

    The power is that of a test at LEVEL over the size of the family: of the only member that has become worse.
    """

    pair: Pair
    decision: Decision
    power: float

    def values(self) -> dict[str, Any]:
        """Return plain values for JSON, numbers that are not finite as None."""
        pair = self.pair
        numbers = {
            "n": len(pair.before),
            "reference": float(pair.before.mean()),
            "now": float(pair.now.mean()) if len(pair.now) else math.nan,
            "unexplored": pair.unexplored,
            "missing": pair.missing,
            "spread": pair.spread,
            "power": self.power,
        }
        return dict(plain(pair.threshold.model_dump(exclude_none=True) | numbers | asdict(self.decision)))


@dataclass(frozen=True)
class Gate:
    """The judgements of a declared family, in its order."""

    judgements: tuple[Judgement, ...]

    @property
    def verdict(self) -> Verdict:
        """Verdict on the whole family."""
        return next(verdict for verdict in Verdict if self.of(verdict))

    def of(self, verdict: Verdict) -> list[Judgement]:
        """Judgements with a verdict."""
        return [own for own in self.judgements if own.decision.verdict is verdict]

    def values(self) -> dict[str, Any]:
        """Return plain values for JSON, numbers that are not finite as None."""
        rows = [own.values() for own in self.judgements]
        return {"verdict": self.verdict, "level": LEVEL, "stated_loss": STATED_LOSS, "pairs": rows}


def judge(family: Sequence[Threshold], reference: pd.DataFrame, results: pd.DataFrame) -> Gate:
    """Compare the trials of a declared family with those of the reference.

    Parameters
    ----------
    reference : rows of a `trials.csv` that has every pair of the family, its metrics defined and not 0 in the mean.
    results : rows of another.
    """
    pairs = [pair_up(one, reference, results) for one in family]
    decisions = decide([pair.losses for pair in pairs], [one.tolerance for one in family])
    level = LEVEL / len(family)
    powers = [power(STATED_LOSS - pair.threshold.tolerance, pair.spread, len(pair.before), level) for pair in pairs]
    return Gate(tuple(map(Judgement, pairs, decisions, powers)))


def decide(losses: Sequence[np.ndarray], tolerances: Sequence[float]) -> list[Decision]:
    """Decide on a family by its losses, one a world, shape (n,) each; an empty array is missing."""
    p = [beyond_p(own, most) for own, most in zip(losses, tolerances, strict=True)]
    of_gains = holm([beyond_p(-own, most) for own, most in zip(losses, tolerances, strict=True)])
    found = []
    for i, (own, p_holm, level) in enumerate(zip(losses, holm(p), holm_levels(p, LEVEL), strict=True)):
        at_least, at_most = lower_bound(own, float(level)), upper_bound(own, LEVEL)
        if not len(own):
            verdict = Verdict.MISSING
        elif p_holm <= LEVEL:
            verdict = Verdict.REGRESSED
        elif of_gains[i] <= LEVEL:
            verdict = Verdict.IMPROVED
        else:
            verdict = Verdict.PASS if at_most < tolerances[i] else Verdict.INCONCLUSIVE
        mean = float(own.mean()) if len(own) else math.nan
        found.append(Decision(mean, at_least, at_most, p[i], float(p_holm), verdict))
    return found
