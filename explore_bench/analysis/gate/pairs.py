"""One strategy and metric in two tables of trials, paired by world: its loss in every world, or what is missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import KEYS
from explore_bench.analysis.gate.thresholds import Threshold
from explore_bench.analysis.tables import by_world


@dataclass(frozen=True, eq=False)
class Pair:
    """A declared strategy and metric, reference and now.

    Attributes
    ----------
    before, now : one value a world, training seeds averaged, shape (n,); `now` is empty where trials are missing.
    unexplored : trials that did not explore, of the reference and now.
    missing : what is, in words; empty where nothing.
    """

    threshold: Threshold
    before: np.ndarray
    now: np.ndarray
    unexplored: tuple[int, int]
    missing: str = ""

    @property
    def losses(self) -> np.ndarray:
        """Change for the worse of each world, shape (n,), whose mean is that of the ratio of the two means.

        They are linearized: a world of which the reference has more than in the mean has more to lose, so that the
        spread of these is that of the ratio, whose denominator varies from draw to draw of the worlds, too. Empty where
        trials are missing.
        """
        if not len(self.now):
            return self.now
        changes = self.threshold.sign * (self.now - self.before) / abs(self.before.mean())
        linear: np.ndarray = changes - changes.mean() * (self.before / self.before.mean() - 1.0)
        return linear

    @property
    def spread(self) -> float:
        """Standard deviation of a world's loss, for the power: what it is, but at least the reference's over worlds.

        A change that leaves every path as it was has no spread; the next one may move all of them, and then a world
        keeps about as much of its value as two training seeds of one strategy share: half of the variance or more.
        """
        own = self.losses
        of_worlds = float(self.before.std(ddof=1)) / abs(float(self.before.mean()))
        return max(of_worlds, float(own.std(ddof=1)) if len(own) else 0.0)


def belongs(trials: pd.DataFrame, one: Threshold) -> pd.Series:
    """Whether each trial is of a threshold's strategy, size and scenario."""
    return (trials["strategy"] == one.strategy) & (trials["size"] == one.size) & (trials["scenario"] == one.scenario)


def pair_up(one: Threshold, reference: pd.DataFrame, results: pd.DataFrame) -> Pair:
    """Pair a threshold's trials by training seed and world; what the reference does not have is left out."""
    before = reference[belongs(reference, one)]
    now = before[[*KEYS, "world"]].merge(results, on=KEYS, how="left", suffixes=("_before", ""))
    missing = _missing(one.metric, now)
    return Pair(
        threshold=one,
        before=_values(before, one.metric),
        now=np.empty(0) if missing else _values(now, one.metric),
        unexplored=(_unexplored(before), _unexplored(now)),
        missing=missing,
    )


def _values(trials: pd.DataFrame, metric: str) -> np.ndarray:
    """One value a world, in the order of the worlds, shape (n,)."""
    own = by_world(trials, metric)
    return np.array([own[world] for world in sorted(own)])


def _missing(metric: str, now: pd.DataFrame) -> str:
    """Say what is missing of a pair's trials, one a row of the reference's; empty where nothing."""
    absent, count = int(now["world"].isna().sum()), len(now)
    if absent:
        return f"{absent} of its {count} trials were not run, or by older code"
    others = int((now["world"] != now["world_before"]).sum())
    if others:
        return f"{others} of its {count} trials are in other worlds (another --seed, or worlds are drawn otherwise now)"
    undefined = int((~np.isfinite(now[metric])).sum())
    return f"{metric} is not defined in {undefined} of its {count} trials, which broke off" if undefined else ""


def _unexplored(trials: pd.DataFrame) -> int:
    return int((trials["status"].dropna() != "explored").sum())
