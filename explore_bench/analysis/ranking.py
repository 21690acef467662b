"""Who explores best: the compared strategies in order, and how sure the first place is.

Strategies are ranked by metrics that rank (`Metric.ranks`), in every scenario and size of the trials: by the mean of
the logarithms of their means, so that a tenth more is worth the same of every metric. Axes: worlds, with training seeds
averaged within a world first.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from explore_bench.analysis.metrics import METRICS, all_metrics
from explore_bench.analysis.paired import paired
from explore_bench.analysis.statistics import LEVEL, Estimate, holm, mean_interval
from explore_bench.analysis.tables import by_world, own_metrics
from explore_bench.strategies.registry import entry_named, in_order

COMPARED = "table2"
"""Table whose strategies are ranked, beside those of no table: ablations would bury them."""

Place = tuple[str, float]
"""Scenario and size [m] of some trials."""


@dataclass(frozen=True)
class Standing:
    """A strategy in the ranking.

    Attributes
    ----------
    strategy : its name.
    means : by place and metric, with their intervals; without those that are not defined for all of its trials.
    score : mean over places and metrics of the logarithm of the mean, a higher metric's negative; less is better.
    """

    strategy: str
    means: dict[tuple[Place, str], Estimate]
    score: float


@dataclass(frozen=True)
class Duel:
    """The first of a ranking against another strategy in one metric at one place, paired by world.

    Attributes
    ----------
    other, place, metric : what is compared.
    relative : difference of the first to the other, over the other's mean, with its interval.
    worlds : that both tried.
    gain : how much better the first is in the direction of the metric; negative where it is worse.
    p : of "no difference with these weights", after Holm's correction over all duels.
    p_architecture : of "no difference after other trainings", likewise; NaN where the seeds are too few to say.
    """

    other: str
    place: Place
    metric: str
    relative: Estimate
    worlds: int
    gain: float
    p: float
    p_architecture: float

    @property
    def won(self) -> bool:
        """Whether the first is shown to be better."""
        return self.p <= LEVEL and self.gain > 0

    @property
    def won_after_other_trainings(self) -> bool:
        """Whether the first would be shown to be better with other weights of the same architecture, too."""
        return self.won and self.p_architecture <= LEVEL

    @property
    def lost(self) -> bool:
        """Whether the other is shown to be better."""
        return self.p <= LEVEL and self.gain < 0


def ranking_metrics(trials: pd.DataFrame) -> tuple[str, ...]:
    """Names of the metrics by which the strategies of some trials are ranked: their kind's own, or the common ones."""
    known = all_metrics()
    own = [
        name for name in own_metrics(trials) if name in known and known[name].ranks and np.isfinite(trials[name]).all()
    ]
    return tuple(own or (name for name, metric in METRICS.items() if metric.ranks))


def places_of(trials: pd.DataFrame) -> list[Place]:
    """Scenarios and sizes of some trials, in the order in which they come, smaller sizes first."""
    found = dict.fromkeys(zip(trials["scenario"].tolist(), trials["size"].tolist(), strict=True))
    return sorted(found, key=lambda place: place[1])


def standings(trials: pd.DataFrame, references: Collection[str]) -> list[Standing]:
    """Rank the compared strategies of some trials, best first; `references`, told the truth, come after all others.

    Where none but ablations ran, all are ranked. One that lacks a place comes after those that lack none.
    """
    names = in_order(trials["strategy"])
    compared = [name for name in names if _is_compared(name)]
    shown = compared if set(compared) - set(references) else names
    metrics, places = ranking_metrics(trials), places_of(trials)
    groups = dict(list(trials.groupby(["strategy", "scenario", "size"])))
    found = []
    for name in shown:
        means = {}
        for place in places:
            cell = groups.get((name, *place))
            for metric in metrics if cell is not None else ():
                values = np.array(list(by_world(cell, metric).values()))
                if np.isfinite(values).all() and entry_named(name, references).fills(metric):
                    means[place, metric] = mean_interval(values)
        if means:
            found.append(Standing(name, means, _score(means)))
    complete = len(places) * len(metrics)
    return sorted(found, key=lambda own: (own.strategy in references, len(own.means) < complete, own.score))


def _is_compared(name: str) -> bool:
    tables = entry_named(name).tables
    return COMPARED in tables or not tables


def _score(means: dict[tuple[Place, str], Estimate]) -> float:
    known = all_metrics()
    signs = [-1.0 if known[metric].better == "higher" else 1.0 for _, metric in means]
    smallest = np.finfo(float).tiny  # a mean of 0 is better or worse than any other
    logs = [math.log(max(own.mean, smallest)) for own in means.values()]
    return float(np.mean([sign * log for sign, log in zip(signs, logs, strict=True)]))


def duels(trials: pd.DataFrame, names: Sequence[str]) -> list[Duel]:
    """Compare the first of some strategies with each of the others, in every metric that ranks, at every place."""
    first, *others = names
    known, metrics = all_metrics(), ranking_metrics(trials)
    groups = dict(list(trials.groupby(["strategy", "scenario", "size"])))
    found = []
    for other in others:
        for place in places_of(trials):
            own, its = groups.get((first, *place)), groups.get((other, *place))
            for metric in metrics if own is not None and its is not None else ():
                pair = paired(own, its, metric)
                if pair.defined:
                    gain = float(pair.differences.mean()) * (1.0 if known[metric].better == "higher" else -1.0)
                    own_p = pair.p, pair.p_architecture
                    found.append(Duel(other, place, metric, pair.relative, pair.worlds, gain, *own_p))
    of_weights, of_architecture = (
        holm([getattr(duel, name) for duel in found]).tolist() for name in ("p", "p_architecture")
    )
    return [
        replace(duel, p=p, p_architecture=other)
        for duel, p, other in zip(found, of_weights, of_architecture, strict=True)
    ]
