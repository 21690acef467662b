"""Claims about strategies as explicit, directional comparisons, and what stored records say of them.

A claim is data: an installed package names some in the entry point group `explore_bench.claims`. A comparison over
worlds is paired by world; one of training curves is between training seeds. Holm's correction runs over the
comparisons of a claim. A claim about an architecture asks what would be so after another training in other worlds;
where only the weights at hand are shown to differ, its verdict is one "for these weights".
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterable, Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass, replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import plain
from explore_bench.analysis.metrics import Metric, all_metrics
from explore_bench.analysis.paired import paired
from explore_bench.analysis.statistics import (
    LEVEL,
    Estimate,
    effect_size,
    holm,
    improvement_probability,
    unpaired_difference,
)
from explore_bench.analysis.tables import PAPER_SCENARIO
from explore_bench.analysis.training_curve import TRAINING_METRICS, training_values
from explore_bench.errors import RequestError, describe
from explore_bench.strategies.registry import strategies

GROUP = "explore_bench.claims"
SUPPORTED, NOT_SHOWN, CONTRADICTED, NOT_MEASURED = "supported", "not shown", "contradicted", "not measured"
THESE_WEIGHTS = " for these weights"


@dataclass(frozen=True)
class Comparison:
    """One strategy is said to be better than another in a metric.

    Attributes
    ----------
    better, worse : names of the strategies.
    metric : of `all_metrics`, at `size` [m]; or of TRAINING_METRICS, with `size` None.
    """

    better: str
    worse: str
    metric: str
    size: float | None = None


@dataclass(frozen=True)
class Claim:
    """What is claimed, and the comparisons that would have to come out for it to hold.

    Attributes
    ----------
    name : short, as its source numbers it.
    statement : in words.
    comparisons : all of them have to hold.
    architecture : whether it is about an architecture rather than about given weights.
    scenario : name of the one whose trials it is about; trials of another say nothing of it.
    """

    name: str
    statement: str
    comparisons: tuple[Comparison, ...]
    architecture: bool = True
    scenario: str = PAPER_SCENARIO


@dataclass(frozen=True)
class Finding:
    """What the records say of a comparison.

    Attributes
    ----------
    n : worlds that both strategies tried, or training seeds of the smaller side.
    means : of the two strategies.
    difference : of the strategy said to be better, minus the other's, with its 95 % interval.
    relative : difference over the other's mean, with its interval.
    p, p_holm : of "no difference with these weights", two-sided; after Holm's correction over the claim.
    p_architecture, p_architecture_holm : of "no difference after other trainings", likewise; NaN where the seeds are
        too few to say. Where neither side is learned, and of training curves, it is the same as p.
    effect : mean of the paired differences over their standard deviation, positive where the claim would have it.
    improvement : share of the worlds on which the claim holds, ties half.
    seeds, ranges : training seeds of the two and the smallest and largest mean of a single one; 0 and NaN where none.
    verdict : SUPPORTED, NOT_SHOWN, CONTRADICTED or NOT_MEASURED, with THESE_WEIGHTS where a claim about an architecture
        is shown for the weights alone.
    """

    comparison: Comparison
    n: int
    means: tuple[float, float]
    difference: Estimate
    relative: Estimate
    p: float
    p_architecture: float
    effect: float
    improvement: float
    seeds: tuple[int, int]
    ranges: tuple[tuple[float, float], tuple[float, float]]
    p_holm: float = math.nan
    p_architecture_holm: float = math.nan
    verdict: str = ""


def comparisons(
    better: str, worse: Iterable[str], metrics: Iterable[str], sizes: Iterable[float | None] = (None,)
) -> tuple[Comparison, ...]:
    """Every comparison of one strategy with several others, in several metrics at several sizes [m]."""
    return tuple(Comparison(better, *rest) for rest in itertools.product(worse, metrics, sizes))


def metric_of(comparison: Comparison) -> Metric:
    """Metric of a comparison.

    Raises
    ------
    RequestError : where it names none.
    """
    known = all_metrics() if comparison.size is not None else TRAINING_METRICS
    if comparison.metric not in known or known[comparison.metric].better is None:
        raise RequestError(
            f"a claim compares '{comparison.better}' and '{comparison.worse}' in '{comparison.metric}'; name a metric "
            f"with a direction: {', '.join(name for name, metric in known.items() if metric.better)}."
        )
    return known[comparison.metric]


@cache
def claims() -> tuple[Claim, ...]:
    """Claims of all installed packages, this project's first.

    An entry point that cannot be used is a claim without comparisons, under its name, that says why.
    """
    found: list[Claim] = []
    for point in sorted(entry_points(group=GROUP), key=lambda point: (point.name != "baselines", point.name)):
        try:
            found += _loaded(point)
        except (Exception, SystemExit) as error:
            sentence = f"Entry point '{point.name}' of {GROUP} ({point.value}) cannot be used: {describe(error)}"
            found.append(Claim(point.name, f"{sentence}; mend or uninstall it.", ()))
    return tuple(found)


def _loaded(point: EntryPoint) -> tuple[Claim, ...]:
    """Claims that an entry point names, every metric known."""
    with redirect_stdout(sys.stderr):
        own = tuple(point.load())
    for claim in own:
        if not isinstance(claim, Claim):
            raise TypeError(f"{claim!r} is no Claim")
        for comparison in claim.comparisons:
            metric_of(comparison)
    return own


def claims_about(trials: pd.DataFrame) -> tuple[Claim, ...]:
    """Claims that the rows of `trials.csv` can say something of.

    They are about the scenarios of these, and a strategy that they say is better ran. A claim without comparisons,
    of which something is wrong, is said in its scenario whatever ran.
    """
    ran = trials.groupby("scenario")["strategy"].agg(set)
    return tuple(
        claim
        for claim in claims()
        if claim.scenario in ran.index
        and (not claim.comparisons or any(one.better in ran[claim.scenario] for one in claim.comparisons))
    )


def examine(claim: Claim, trials: pd.DataFrame) -> list[Finding]:
    """Compare what a claim compares, from the rows of `trials.csv` and the training curves beside the weights."""
    own = trials[trials["scenario"] == claim.scenario]
    found = [_measure(comparison, own) for comparison in claim.comparisons]
    of_weights, of_architecture = (
        holm([getattr(finding, name) for finding in found]).tolist() for name in ("p", "p_architecture")
    )
    found = [
        replace(finding, p_holm=p, p_architecture_holm=other)
        for finding, p, other in zip(found, of_weights, of_architecture, strict=True)
    ]
    return [replace(finding, verdict=_verdict(finding, claim.architecture)) for finding in found]


def verdict(findings: Sequence[Finding]) -> str:
    """Verdict on a claim: supported where all its comparisons are, contradicted where one is, else not shown."""
    verdicts = {finding.verdict for finding in findings}
    for word in (CONTRADICTED, CONTRADICTED + THESE_WEIGHTS):
        if word in verdicts:
            return word
    if verdicts <= {SUPPORTED, SUPPORTED + THESE_WEIGHTS} and verdicts:
        return SUPPORTED + THESE_WEIGHTS if SUPPORTED + THESE_WEIGHTS in verdicts else SUPPORTED
    return NOT_MEASURED if verdicts <= {NOT_MEASURED} else NOT_SHOWN


def _measure(comparison: Comparison, trials: pd.DataFrame) -> Finding:
    sign = 1.0 if metric_of(comparison).better == "higher" else -1.0
    if comparison.size is None:
        return _of_training(comparison, sign)
    if comparison.metric not in trials:  # of another kind of world
        return _nothing(comparison)
    here = trials[trials["size"] == comparison.size]
    own = [here[here["strategy"] == name] for name in (comparison.better, comparison.worse)]
    pair = paired(own[0], own[1], comparison.metric)
    if not pair.defined:
        return _nothing(comparison)
    sides = zip((pair.a, pair.b), pair.seeds, strict=True)
    of_seeds = [values.mean(axis=1) if seeds else np.empty(0) for values, seeds in sides]
    return Finding(
        comparison,
        n=pair.worlds,
        means=pair.means,
        difference=pair.difference,
        relative=pair.relative,
        p=pair.p,
        p_architecture=pair.p_architecture,
        effect=pair.effect(sign),
        improvement=pair.improvement(sign),
        seeds=(len(of_seeds[0]), len(of_seeds[1])),
        ranges=(_range(of_seeds[0]), _range(of_seeds[1])),
    )


def _of_training(comparison: Comparison, sign: float) -> Finding:
    """Compare training seeds; they are not paired, their number may differ."""
    known = strategies()
    a, b = (
        np.array(list(training_values(known[name], comparison.metric).values()) if name in known else [])
        for name in (comparison.better, comparison.worse)
    )
    if not len(a) or not len(b) or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return _nothing(comparison)
    gains, mean = sign * np.subtract.outer(a, b).reshape(-1), float(b.mean())
    difference, p = unpaired_difference(a, b)
    share = difference.mean / abs(mean) if mean and not comparison.metric.endswith("validation") else math.nan
    return Finding(
        comparison,
        n=min(len(a), len(b)),
        means=(float(a.mean()), mean),
        difference=difference,
        relative=Estimate(share, math.nan, math.nan, difference.n),  # of a logarithm it says nothing
        p=p,
        p_architecture=p,
        effect=effect_size(gains),
        improvement=improvement_probability(gains),
        seeds=(len(a), len(b)),
        ranges=(_range(a), _range(b)),
    )


def _range(values: np.ndarray) -> tuple[float, float]:
    return (float(values.min()), float(values.max())) if len(values) else (math.nan, math.nan)


def _nothing(comparison: Comparison) -> Finding:
    nan, none = math.nan, (math.nan, math.nan)
    nothing = Estimate(nan, nan, nan, 0)
    return Finding(comparison, 0, none, nothing, nothing, nan, nan, nan, nan, (0, 0), (none, none))


def _verdict(finding: Finding, architecture: bool) -> str:
    better = metric_of(finding.comparison).better
    if not finding.n:
        return NOT_MEASURED
    held = finding.difference.mean > 0 if better == "higher" else finding.difference.mean < 0
    word = SUPPORTED if held else CONTRADICTED
    if not finding.p_holm <= LEVEL:
        return NOT_SHOWN
    return word if not architecture or finding.p_architecture_holm <= LEVEL else word + THESE_WEIGHTS


def as_values(claim: Claim, findings: Sequence[Finding]) -> dict[str, Any]:
    """A claim and its findings as plain values, not-a-numbers as None."""
    return {
        "claim": claim.name,
        "statement": claim.statement,
        "verdict": verdict(findings),
        "comparisons": [plain(asdict(finding)) for finding in findings],
    }
