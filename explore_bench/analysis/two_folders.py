"""Two results folders, paired by world where both have it: what changed, and how sure that is."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import KEYS, plain, read_csv
from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.paired import Paired, paired
from explore_bench.analysis.statistics import LEVEL, Estimate, holm
from explore_bench.analysis.tables import measured
from explore_bench.errors import RequestError
from explore_bench.strategies.registry import entry_named

COMPARED_METRICS = ("trajectory_error", "exploration_efficiency", "t90")
CELL = ["strategy", "size", "scenario"]


@dataclass(frozen=True)
class Difference:
    """One strategy, size and metric in two folders, B against A.

    Attributes
    ----------
    n : worlds that every training seed of both folders tried.
    means : in A and in B.
    difference : B − A, paired by world, with its 95 % BCa bootstrap interval.
    p, p_holm : of "no difference", two-sided; after Holm's correction over the whole comparison.
    effect : mean of the paired differences over their standard deviation, positive where B is better.
    improvement : share of the worlds on which B is better, ties half.
    verdict : "better", "worse" or "no difference shown", of B.
    """

    strategy: str
    size: float
    scenario: str
    metric: str
    n: int
    means: tuple[float, float]
    difference: Estimate
    p: float
    p_holm: float
    effect: float
    improvement: float
    verdict: str


@dataclass(frozen=True)
class FolderComparison:
    """All differences, and in words what could not be compared."""

    differences: tuple[Difference, ...]
    left_out: tuple[str, ...]

    def values(self) -> dict[str, Any]:
        """Return plain values for JSON, not-a-numbers as None."""
        rows = [plain(asdict(difference)) for difference in self.differences]
        return {"differences": rows, "left_out": list(self.left_out)}


def compare_folders(a: Path, b: Path) -> FolderComparison:
    """Compare B with A by their `trials.csv`.

    Raises
    ------
    RequestError : where one of the folders has no trials.csv, or they share no world.
    """
    columns = (*KEYS, "world", "status", *COMPARED_METRICS)
    tables = [measured(read_csv(folder / "trials.csv", columns)) for folder in (a, b)]
    pair, left_out = _common(*tables)
    found = []
    others = dict(list(pair[1].groupby(CELL)))
    for cell, own in pair[0].groupby(CELL):
        for metric in COMPARED_METRICS:
            if not entry_named(str(cell[0])).fills(metric):
                left_out.append(f"{_place(cell)}: {metric} is none that this reference plans for")
                continue
            both = paired(others[cell], own, metric, matched=True)
            if not both.worlds:
                left_out.append(f"{_place(cell)}: no world that every training seed of both tried")
            elif not both.defined:
                left_out.append(f"{_place(cell)}: {metric} is not defined for every trial")
            else:
                found.append(_difference(cell, metric, both))
                tried = own["trial"].nunique()
                if both.worlds < tried:
                    left_out.append(f"{_place(cell)}: {tried - both.worlds} worlds that not every training seed tried")
    left_out = list(dict.fromkeys(left_out))
    if not found and others:
        raise RequestError(f"results folders '{a}' and '{b}' cannot be compared: {'; '.join(left_out)}.")
    if not found:
        raise RequestError(f"results folders '{a}' and '{b}' have no world in common; run the same suite in both.")
    adjusted = holm([difference.p for difference in found])
    judged = tuple(_judged(difference, float(p)) for difference, p in zip(found, adjusted, strict=True))
    return FolderComparison(judged, tuple(left_out))


def _common(a: pd.DataFrame, b: pd.DataFrame) -> tuple[list[pd.DataFrame], list[str]]:
    """Trials of strategies and worlds that both tables have, and in words what only one of them has."""
    place = [*CELL, "trial", "world"]
    keys = [set(map(tuple, table[place].to_numpy().tolist())) for table in (a, b)]
    common = keys[0] & keys[1]
    among = [np.array([tuple(row) in common for row in t[place].to_numpy().tolist()], dtype=bool) for t in (a, b)]
    kept = [table[own] for table, own in zip((a, b), among, strict=True)]
    said = []
    for name, own in zip(("A", "B"), keys, strict=True):
        only = Counter(_place(key) for key in own - common)
        said += [f"{place}: {count} world{'s' * (count > 1)} only in {name}" for place, count in sorted(only.items())]
    for table, name in zip(kept, ("A", "B"), strict=True):
        failed = int((table["status"] != "explored").sum())
        if failed:
            who = (
                f"1 trial of {name} did not explore; it is"
                if failed == 1
                else f"{failed} trials of {name} did not explore; they are"
            )
            said.append(f"{who} scored by the rule for such trials")
    return kept, said + _unlike_seeds(*kept)


def _unlike_seeds(a: pd.DataFrame, b: pd.DataFrame) -> list[str]:
    """Sentences on strategies whose training seeds differ: what differs may be the seeds, not the folders."""
    seeds = [
        {cell: tuple(sorted(set(own["training_seed"].dropna()))) for cell, own in table.groupby(CELL)}
        for table in (a, b)
    ]
    return [
        f"{_place(cell)}: training seeds {_listed(own)} in A, {_listed(seeds[1][cell])} in B; "
        "each is averaged over its own"
        for cell, own in seeds[0].items()
        if own != seeds[1][cell]
    ]


def _listed(seeds: tuple[int, ...]) -> str:
    return ", ".join(map(str, seeds)) or "none"


def _place(cell: Any) -> str:
    strategy, size, scenario, *_ = cell
    return f"{strategy}, {size:g} m, {scenario}"


def _difference(cell: Any, metric: str, pair: Paired) -> Difference:
    sign = 1.0 if METRICS[metric].better == "higher" else -1.0
    return Difference(
        str(cell[0]),
        float(cell[1]),
        str(cell[2]),
        metric,
        pair.worlds,
        (pair.means[1], pair.means[0]),
        pair.difference,
        pair.p,
        math.nan,
        pair.effect(sign),
        pair.improvement(sign),
        "",
    )


def _judged(difference: Difference, p_holm: float) -> Difference:
    verdict = "no difference shown"
    if p_holm <= LEVEL:
        higher = METRICS[difference.metric].better == "higher"
        verdict = "better" if (difference.difference.mean > 0) == higher else "worse"
    return replace(difference, p_holm=p_holm, verdict=verdict)
