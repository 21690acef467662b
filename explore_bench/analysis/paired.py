"""Two strategies on the worlds that both tried: what differs, how sure that is, and of what it is true.

A difference is true of the weights at hand where it would hold in other worlds, and of an architecture where it would
hold after another training, too. The first is a question about n worlds; the second one about S training seeds crossed
with them. Axes: A, B training seeds of the two, one row for what is not learned; n worlds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from explore_bench.analysis.rounding import ROUNDING
from explore_bench.analysis.statistics import (
    Estimate,
    effect_size,
    improvement_probability,
    mean_interval,
    ratio_interval,
    sign_flip_p,
    win_tie_loss,
)


@dataclass(frozen=True, eq=False)
class Paired:
    """Values of a metric of two strategies on common worlds.

    Attributes
    ----------
    a, b : by training seed and world, shapes (A, n) and (B, n).
    seeds : training seeds of the two, empty for what is not learned.
    matched : whether the two have the same weights, seed by seed.
    """

    a: np.ndarray
    b: np.ndarray
    seeds: tuple[tuple[int, ...], tuple[int, ...]]
    matched: bool = False

    @property
    def worlds(self) -> int:
        """Number of worlds that every seed of both tried."""
        return self.a.shape[1]

    @property
    def defined(self) -> bool:
        """Whether there are worlds, and a value of every trial."""
        return self.worlds > 0 and bool(np.isfinite(self.a).all() and np.isfinite(self.b).all())

    @property
    def means(self) -> tuple[float, float]:
        """Means over seeds and worlds."""
        return float(self.a.mean()), float(self.b.mean())

    @cached_property
    def differences(self) -> np.ndarray:
        """A minus B by world, training seeds averaged, shape (n,)."""
        return np.asarray(self.a.mean(axis=0) - self.b.mean(axis=0))

    @property
    def difference(self) -> Estimate:
        """Mean of the differences with its interval over worlds, for these weights."""
        return mean_interval(self.differences)

    @property
    def relative(self) -> Estimate:
        """Difference over the size of B's mean, with an interval that knows that this mean is uncertain, too."""
        ratio = ratio_interval(self.a.mean(axis=0), self.b.mean(axis=0))
        sign = math.copysign(1.0, self.means[1])
        low, high = (sign * (end - 1.0) for end in ((ratio.low, ratio.high) if sign > 0 else (ratio.high, ratio.low)))
        return Estimate(sign * (ratio.mean - 1.0), low, high, ratio.n)

    @property
    def p(self) -> float:
        """Of "no difference in other worlds, with these weights"."""
        return sign_flip_p(self.differences)

    @property
    def p_architecture(self) -> float:
        """Of "no difference after other trainings in other worlds"; NaN where the seeds are too few to say."""
        a, b = ((own if seeds else None) for own, seeds in zip((self.a, self.b), self.seeds, strict=True))
        return self.p if a is None and b is None else crossed_p(self.differences, a, b)

    def effect(self, sign: float) -> float:
        """Mean of the paired differences over their standard deviation; positive where A is better."""
        return float(self._of_seeds(effect_size, sign))

    def improvement(self, sign: float) -> float:
        """Share of the worlds on which A is better, ties half."""
        return float(self._of_seeds(improvement_probability, sign))

    def wins(self, sign: float) -> tuple[float, float, float]:
        """Worlds on which A is better, ties and is worse; fractions where seeds differ."""
        won, tied, lost = self._of_seeds(win_tie_loss, sign)
        return float(won), float(tied), float(lost)

    def _of_seeds(self, statistic: Callable[[np.ndarray], Any], sign: float) -> Any:
        """Mean over the pairs of seeds of a statistic, one or more numbers, of gains, shape (n,).

        Averaging over seeds first would make every statistic larger, the more seeds there are. Matched seeds are paired
        each with itself, others every one with every other.
        """
        pairs = zip(self.a, self.b, strict=True) if self.matched else itertools.product(self.a, self.b)
        with np.errstate(invalid="ignore"):  # seeds without any spread, for and against
            return np.mean([statistic(sign * gains_of(one, other)) for one, other in pairs], axis=0)


def paired(a: pd.DataFrame, b: pd.DataFrame, metric: str, matched: bool = False) -> Paired:
    """Pair the trials of two strategies, rows of `trials.csv`, on the worlds that every training seed of both tried.

    With `matched`, equal seeds are the same weights; where the two have not the same ones, every one meets every other.
    """
    own = [_by_seed(trials, metric) for trials in (a, b)]
    tried = [set(values) for of in own for values in of.values()]
    worlds = sorted(set.intersection(*tried)) if all(own) else []
    rows = []
    for of in own:
        values = np.empty((len(of), len(worlds)))
        for row, by_world in zip(values, of.values(), strict=True):
            row[:] = [by_world[world] for world in worlds]
        rows.append(values)
    seeds = tuple(seed for seed in own[0] if seed is not None), tuple(seed for seed in own[1] if seed is not None)
    return Paired(rows[0], rows[1], seeds, matched and seeds[0] == seeds[1] and len(rows[0]) == len(rows[1]))


def _by_seed(trials: pd.DataFrame, metric: str) -> dict[int | None, dict[int, float]]:
    """Values by training seed, None for what is not learned, and world."""
    found: dict[int | None, dict[int, float]] = {}
    seeds = trials["training_seed"].to_numpy(dtype=float, na_value=np.nan).tolist()
    for seed, world, value in zip(seeds, trials["trial"].tolist(), trials[metric].tolist(), strict=True):
        found.setdefault(None if math.isnan(seed) else int(seed), {})[world] = value
    return {seed: found[seed] for seed in sorted(found, key=lambda seed: (seed is None, seed))}


def crossed_p(differences: np.ndarray, a: np.ndarray | None, b: np.ndarray | None) -> float:
    """Two-sided p-value of "no difference after other trainings in other worlds".

    A value is its architecture's mean, plus an effect of the training seed, one of the world, and one of both, all
    random: seeds are crossed with worlds. The variance of the mean difference is put together from what worlds, seeds
    and the rest say of it, and Satterthwaite's degrees of freedom (1946) from theirs. A side with a single seed is
    taken to vary with it as the other side does. NaN where too few tell what a training matters: two of either side are
    needed, or three of one.

    Parameters
    ----------
    differences : by world, seeds averaged, shape (n,).
    a, b : values by training seed and world of each side, shapes (A, n) and (B, n); None for what is not learned.
    """
    from scipy.stats import t

    count = len(differences)
    sides = [side for side in (a, b) if side is not None]
    seeds_of = [len(side) for side in sides]
    if count < 2 or not (max(seeds_of) >= 3 or seeds_of == [2, 2]):
        return math.nan
    variance = float(np.var(differences, ddof=1)) / count  # of worlds, and of what a seed does in each
    squares = variance**2 / (count - 1)
    alone = sum(len(side) == 1 for side in sides)
    for side in sides:
        seeds = len(side)
        if seeds < 2:
            continue
        share = 1.0 / seeds + alone
        means = side.mean(axis=1, keepdims=True)
        rest = side - means - side.mean(axis=0) + side.mean()
        of_means, of_rest = float(np.var(means, ddof=1)), float((rest**2).sum()) / ((seeds - 1) * (count - 1)) / count
        variance += max(share * (of_means - of_rest), 0.0)
        squares += (share * of_means) ** 2 / (seeds - 1) + (share * of_rest) ** 2 / ((seeds - 1) * (count - 1))
    mean = float(np.mean(differences))
    if variance == 0.0:
        return 1.0 if mean == 0.0 else 0.0
    return float(2.0 * t.sf(abs(mean) / math.sqrt(variance), variance**2 / squares))


def gains_of(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """One minus other, shape (n,) each; 0 where that is no more than rounding."""
    gains = one - other
    return np.where(np.abs(gains) <= ROUNDING * np.maximum(np.abs(one), np.abs(other)), 0.0, gains)
