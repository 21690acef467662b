"""Is a mean beyond a margin? Student's one-sided bounds on paired values, Holm's levels, and the power to tell.

One value a world, shape (n,). With some fifty worlds or more a mean is close enough to normal; a simulation on the
spread of real trials is among the tests.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import stdtr, stdtrit

from explore_bench.analysis.statistics import holm

NO_SPREAD = 1e-12
"""Least standard deviation that counts as one: rounding is no evidence."""

CERTAIN = 1e3
"""Shift in standard errors from which on scipy's non-central t distribution may fail, and nothing changes any more."""


def beyond_p(values: np.ndarray, margin: float) -> float:
    """One-sided p-value of "the mean is not above the margin", by Student's t test; 1 for fewer than two values."""
    if len(values) < 2:
        return 1.0
    return float(stdtr(len(values) - 1, (margin - np.mean(values)) / _standard_error(values)))


def lower_bound(values: np.ndarray, level: float) -> float:
    """Margin that the mean is above with confidence 1 − level: `beyond_p` of it is the level; −∞ for n < 2."""
    if len(values) < 2:
        return -math.inf
    return float(np.mean(values) - stdtrit(len(values) - 1, 1.0 - level) * _standard_error(values))


def upper_bound(values: np.ndarray, level: float) -> float:
    """Margin that the mean is below with confidence 1 − level; ∞ for n < 2."""
    return -lower_bound(-np.asarray(values), level)


def holm_levels(p_values: Sequence[float], level: float) -> np.ndarray:
    """Level at which Holm's method tests each member of a family, shape as given.

    A member is rejected where its p-value is at most that, which is the same as an adjusted one of at most `level`:
    with r of m rejected, the smallest p-value was tested at level / m, and what is left at level / (m − r).
    """
    adjusted = holm(p_values)
    rank = np.empty(len(adjusted), dtype=int)
    rank[np.argsort(p_values, kind="stable")] = np.arange(len(adjusted))
    return level / (len(adjusted) - np.minimum(rank, np.count_nonzero(adjusted <= level)))


def power(excess: float, spread: float, n: int, level: float) -> float:
    """Chance that a mean which is `excess` above the margin is shown to be above it.

    Parameters
    ----------
    spread : standard deviation of a value.
    n : number of values; fewer than two show nothing.
    level : of the one-sided test.
    """
    from scipy.stats import nct

    if n < 2:
        return 0.0
    shift = excess / (max(spread, NO_SPREAD) / math.sqrt(n))
    return float(nct.sf(stdtrit(n - 1, 1.0 - level), n - 1, np.clip(shift, -CERTAIN, CERTAIN)))


def _standard_error(values: np.ndarray) -> float:
    return max(float(np.std(values, ddof=1)), NO_SPREAD) / math.sqrt(len(values))
