"""Means with bootstrap intervals, differences paired by world, and tests of them. Every random draw has a seed.

Intervals over worlds are 95 % bootstrap intervals, conditional on the weights of a learned strategy: its training
seeds are averaged within a world first. Axes: n worlds, S strategies.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from explore_bench.trial.seeding import stream

LEVEL = 0.05
"""Family-wise error rate of verdicts, and of a gate's false pass."""

CONFIDENCE = 1.0 - LEVEL
RESAMPLES = 5000
AT_ONCE = 64
"""Samples that are resampled together: their resamples take megabytes."""

PERMUTATIONS = 9999


@dataclass(frozen=True)
class Estimate:
    """A mean over n worlds with its interval [low, high]; NaN where it cannot be had."""

    mean: float
    low: float
    high: float
    n: int


def mean_interval(values: np.ndarray, seed: int = 0) -> Estimate:
    """Mean of one value a world, shape (n,), with its BCa bootstrap interval (Efron 1987).

    Values that are NaN are an error, not left out: an average over survivors would flatter.

    Raises
    ------
    ValueError : when a value is not finite.
    """
    return mean_intervals([values], seed)[0]


def mean_intervals(samples: Sequence[np.ndarray], seed: int = 0) -> list[Estimate]:
    """`mean_interval` of many samples, shape (n,) each, in less than half of the time that one after the other takes.

    Raises
    ------
    ValueError : when a value is not finite.
    """
    return _intervals(samples, np.mean, seed)


def interquartile_mean_interval(values: np.ndarray, seed: int = 0) -> Estimate:
    """Mean of the middle half of one value a world, shape (n,), with its BCa bootstrap interval.

    A quarter of the values is cut off at either end (Agarwal et al. 2021, "Deep reinforcement learning at the edge of
    the statistical precipice"); whole values only, as scipy's trimmed mean does.

    Raises
    ------
    ValueError : when a value is not finite.
    """
    from scipy.stats import trim_mean

    def middle(x: np.ndarray, axis: int = -1) -> Any:
        return trim_mean(x, 0.25, axis=axis)

    return _intervals([values], middle, seed)[0]


def _intervals(samples: Sequence[np.ndarray], statistic: Callable[..., Any], seed: int) -> list[Estimate]:
    """A statistic of each sample with its BCa interval, of up to AT_ONCE of the same size at a time."""
    rows = [np.asarray(values, dtype=float) for values in samples]
    for row in rows:
        if not np.isfinite(row).all():
            raise ValueError(f"{np.count_nonzero(~np.isfinite(row))} of {len(row)} values are not finite")
    found: dict[int, Estimate] = {}
    for count in dict.fromkeys(map(len, rows)):
        own = [i for i, row in enumerate(rows) if len(row) == count]
        for first in range(0, len(own), AT_ONCE):
            part = own[first : first + AT_ONCE]
            found |= zip(part, _of_one_size(np.array([rows[i] for i in part]), statistic, seed), strict=True)
    return [found[i] for i in range(len(rows))]


def _of_one_size(samples: np.ndarray, statistic: Callable[..., Any], seed: int) -> list[Estimate]:
    """`_intervals` of samples of shape (S, n)."""
    count = samples.shape[1]
    if not count:
        return [Estimate(math.nan, math.nan, math.nan, 0)] * len(samples)
    means = [float(statistic(sample)) for sample in samples]
    if count == 1:
        return [Estimate(mean, math.nan, math.nan, 1) for mean in means]
    ends = [(mean, mean) for mean in means]
    varied = np.flatnonzero(np.ptp(samples, axis=1) > 0.0)
    if len(varied):
        from scipy.stats import bootstrap

        resamples = _resamples(count, seed)
        resampled = np.array([statistic(samples[i][resamples], axis=-1) for i in varied])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a degenerate bootstrap distribution is answered below
            interval = bootstrap(
                (samples[varied],),
                statistic,
                n_resamples=0,
                confidence_level=CONFIDENCE,
                method="BCa",
                axis=-1,
                vectorized=True,
                bootstrap_result=_Resampled(resampled),  # type: ignore[arg-type]
            ).confidence_interval
        for i, low, high, means_of_i in zip(varied, interval.low, interval.high, resampled, strict=True):
            whole = math.isfinite(low) and math.isfinite(high)
            ends[i] = (float(low), float(high)) if whole else _percentiles(means_of_i)
    return [Estimate(mean, low, high, count) for mean, (low, high) in zip(means, ends, strict=True)]


class _Resampled(NamedTuple):
    """Of a `scipy.stats` bootstrap result, what another one goes on from."""

    bootstrap_distribution: np.ndarray


@lru_cache(maxsize=8)
def _resamples(count: int, seed: int) -> np.ndarray:
    """Which values stand in each resample, shape (RESAMPLES, count), read-only: the same for as many values."""
    return _fixed(stream("evaluate", seed, 0, 0, "statistics").integers(0, count, (RESAMPLES, count)))


@lru_cache(maxsize=8)
def resample_weights(count: int, seed: int, resamples: int = RESAMPLES) -> np.ndarray:
    """How often each of so many values stands in each resample, shape (resamples, count), read-only."""
    rng = stream("evaluate", seed, 0, 0, "statistics")
    return _fixed(rng.multinomial(count, np.full(count, 1.0 / count), resamples).astype(float))


@lru_cache(maxsize=8)
def _signs(count: int, seed: int) -> np.ndarray:
    """Signs to give to differences: all there are, or PERMUTATIONS random ones, a row each, read-only."""
    if 2**count <= PERMUTATIONS + 1:
        flips = (np.arange(2**count)[:, None] >> np.arange(count)) & 1
    else:
        rng = stream("evaluate", seed, 0, 0, "statistics")
        flips = rng.integers(0, 2, (PERMUTATIONS, count), dtype=np.int8)
    return _fixed(1.0 - 2.0 * flips)


def _fixed(values: np.ndarray) -> np.ndarray:
    values.setflags(write=False)
    return values


def _percentiles(resampled: np.ndarray) -> tuple[float, float]:
    low, high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def paired_difference(a: dict[int, float], b: dict[int, float], seed: int = 0) -> Estimate:
    """Mean of a − b over the worlds that both have, with its interval; keys are worlds.

    Raises
    ------
    ValueError : when a value of such a world is not finite.
    """
    return mean_interval(differences_of(a, b), seed)


def differences_of(a: dict[int, float], b: dict[int, float]) -> np.ndarray:
    """Values of a less those of b in the worlds that both have, ascending; keys are worlds."""
    return np.array([a[world] - b[world] for world in sorted(a.keys() & b.keys())])


def ratio_interval(a: np.ndarray, b: np.ndarray, seed: int = 0) -> Estimate:
    """Mean of a over mean of b, paired by world, shape (n,) each, with its percentile bootstrap interval.

    NaN where the mean of b is 0; without an interval where that of a resample is, or has the other sign.
    """
    count = len(a)
    if not np.mean(b):
        return Estimate(math.nan, math.nan, math.nan, count)
    ratio = float(np.mean(a) / np.mean(b))
    if count < 2:
        return Estimate(ratio, math.nan, math.nan, count)
    weights = resample_weights(count, seed)
    below = weights @ b
    if not (np.all(below > 0) or np.all(below < 0)):
        return Estimate(ratio, math.nan, math.nan, count)
    return Estimate(ratio, *_percentiles((weights @ a) / below), count)


def unpaired_difference(a: np.ndarray, b: np.ndarray) -> tuple[Estimate, float]:
    """Mean of a minus mean of b, shapes (n,) and (m,), with Welch's interval, and his p-value of "equal means" (1947).

    For training seeds, of which there are a handful: exchanging the labels of five and five has no p-value below 2/252,
    so that in a family of seven nothing could ever be shown, and a bootstrap of five covers 89 % for 95.

    `n` of the estimate is that of the smaller sample; with fewer than two in either there are no interval and no p.
    """
    mean, count = float(np.mean(a) - np.mean(b)), min(len(a), len(b))
    if count < 2:
        return Estimate(mean, math.nan, math.nan, count), math.nan
    if np.ptp(a) == np.ptp(b) == 0.0:
        return Estimate(mean, mean, mean, count), 1.0 if mean == 0.0 else 0.0
    from scipy.stats import ttest_ind

    found = ttest_ind(a, b, equal_var=False)
    low, high = found.confidence_interval(CONFIDENCE)
    return Estimate(mean, float(low), float(high), count), float(found.pvalue)


def sign_flip_p(differences: np.ndarray, seed: int = 0) -> float:
    """Two-sided p-value of "no difference" by flipping signs, for one paired difference a world, shape (n,).

    Exact where all 2ⁿ flips are fewer than PERMUTATIONS, else from as many random ones with the observed one counted
    in (Phipson and Smyth 2010). NaN without differences.

    Raises
    ------
    ValueError : when a value is not finite.
    """
    differences = np.asarray(differences, dtype=float)
    if not np.isfinite(differences).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(differences))} differences are not finite")
    n = len(differences)
    if not n:
        return math.nan
    signs = _signs(n, seed)
    sums = np.abs(signs @ differences)
    observed = abs(differences.sum())
    extreme = np.count_nonzero(sums >= observed - 1e-12 * np.abs(differences).sum())
    return float(extreme / 2**n if len(signs) == 2**n else (extreme + 1) / (PERMUTATIONS + 1))


def holm(p_values: Sequence[float]) -> np.ndarray:
    """p-values adjusted for their family by Holm's step-down method (1979), shape as given; NaN belongs to none."""
    p = np.asarray(p_values, dtype=float)
    adjusted = np.full(p.shape, math.nan)
    order = np.argsort(p)[: np.count_nonzero(np.isfinite(p))]
    adjusted[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1)), 1.0)
    return adjusted


def effect_size(differences: np.ndarray) -> float:
    """Mean of paired differences over their standard deviation, Cohen's d_z (1988); NaN for fewer than two."""
    if len(differences) < 2:
        return math.nan
    mean, deviation = float(np.mean(differences)), float(np.std(differences, ddof=1))
    return mean / deviation if deviation else math.copysign(math.inf, mean) if mean else 0.0


def win_tie_loss(gains: np.ndarray) -> tuple[int, int, int]:
    """Worlds with a gain above, of and below zero, for one paired gain a world, shape (n,)."""
    return int((gains > 0).sum()), int((gains == 0).sum()), int((gains < 0).sum())


def improvement_probability(gains: np.ndarray) -> float:
    """Share of the worlds with a gain above zero, ties counted half; NaN without worlds."""
    wins, ties, losses = win_tie_loss(gains)
    total = wins + ties + losses
    return (wins + 0.5 * ties) / total if total else math.nan


def order_agreement(reference: Sequence[float], values: np.ndarray) -> Estimate:
    """Agreement of the order of S strategies with a reference, Kendall's τ-a, and what it may be where pairs are open.

    The interval is of what the worlds leave open: a pair whose difference is shown, with Holm's correction over all
    pairs, stands as it is; every other one may be either way, whatever the others do. (Resampled means are more
    disordered than the means are, so that τ may stand at the end of a bootstrap interval, or outside.)

    Parameters
    ----------
    reference : one number a strategy, shape (S,).
    values : one number a strategy and world, shape (S, n); strategies are ordered by their means over worlds.
    """
    values = np.asarray(values, dtype=float)
    pairs = list(itertools.combinations(range(len(reference)), 2))
    differences = [values[i] - values[j] for i, j in pairs]
    shown = holm([sign_flip_p(own) for own in differences]) <= LEVEL
    wanted = [np.sign(reference[i] - reference[j]) for i, j in pairs]
    agree = np.sign([own.mean() for own in differences]) * wanted
    sure, open_, total = agree[shown].sum(), np.abs(wanted)[~shown].sum(), len(pairs)
    tau, low, high = (float(agreeing) / total for agreeing in (agree.sum(), sure - open_, sure + open_))
    return Estimate(tau, low, high, values.shape[1])


@dataclass(frozen=True, eq=False)
class Survival:
    """Share of trials that have not reached a goal, as a step function of time.

    Attributes
    ----------
    times : steps at which a trial reached it, ascending, shape (K,).
    shares : share left after each of them, shape (K,).
    median : first time by which half of the trials have reached it; infinite where fewer ever do.
    """

    times: np.ndarray
    shares: np.ndarray
    median: float


def survival(times: np.ndarray) -> Survival:
    """Share of n trials left without a goal over time.

    What ended without it never reached it. It is not censored there, as it would be in a study of who is still alive:
    a robot that crashes early would then count as one of which nothing is known.

    Parameters
    ----------
    times : when each trial reached the goal, infinite for one that did not, shape (n,).
    """
    times = np.sort(np.asarray(times, dtype=float))
    reached = np.unique(times[np.isfinite(times)])
    shares = 1.0 - np.searchsorted(times, reached, side="right") / len(times)
    halved = np.flatnonzero(shares <= 0.5)
    return Survival(reached, shares, float(reached[halved[0]]) if len(halved) else math.inf)
