"""Means with bootstrap intervals, and differences paired by world. Every random draw has a seed.

Intervals are 95 % BCa bootstrap intervals over worlds (Efron 1987), conditional on the weights of a learned
strategy: its training seeds are averaged within a world first.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

import numpy as np

from explore_bench.seeding import stream

CONFIDENCE = 0.95
RESAMPLES = 5000


@dataclass(frozen=True)
class Estimate:
    """A mean over n worlds with its interval [low, high]; NaN where it cannot be had."""

    mean: float
    low: float
    high: float
    n: int


def mean_interval(values: np.ndarray, seed: int = 0) -> Estimate:
    """Mean of one value a world, shape (n,), with its bootstrap interval.

    Values that are NaN are an error, not left out: an average over survivors would flatter.

    Raises
    ------
    ValueError : when a value is not finite.
    """
    values = np.asarray(values, dtype=float)
    if not np.isfinite(values).all():
        raise ValueError(f"{np.count_nonzero(~np.isfinite(values))} of {len(values)} values are not finite")
    if not len(values):
        return Estimate(math.nan, math.nan, math.nan, 0)
    mean = float(values.mean())
    if len(values) == 1:
        return Estimate(mean, math.nan, math.nan, 1)
    if np.ptp(values) == 0.0:
        return Estimate(mean, mean, mean, len(values))
    from scipy.stats import bootstrap

    rng = stream("evaluate", seed, 0, 0, "statistics")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a degenerate bootstrap distribution is answered below
        interval = bootstrap(
            (values,),
            np.mean,
            n_resamples=RESAMPLES,
            confidence_level=CONFIDENCE,
            method="BCa",
            vectorized=True,
            rng=rng,
        ).confidence_interval
    low, high = float(interval.low), float(interval.high)
    if not (math.isfinite(low) and math.isfinite(high)):
        resampled = rng.choice(values, (RESAMPLES, len(values))).mean(axis=1)
        low, high = (float(q) for q in np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]))
    return Estimate(mean, low, high, len(values))


def paired_difference(a: dict[int, float], b: dict[int, float], seed: int = 0) -> Estimate:
    """Mean of a − b over the worlds that both have, with its interval; keys are worlds.

    Raises
    ------
    ValueError : when a value of such a world is not finite.
    """
    worlds = sorted(a.keys() & b.keys())
    return mean_interval(np.array([a[world] - b[world] for world in worlds]), seed)
