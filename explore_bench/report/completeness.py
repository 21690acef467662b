"""What a reader must not overlook: trials that did not explore, and what was not run."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from explore_bench.analysis.metrics import explored, finished
from explore_bench.analysis.tables import of_paper
from explore_bench.records.encoding import TrialRecord
from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import PAPER_TABLES, Scope, Table, shown_name
from explore_bench.runs.suites import SUITES
from explore_bench.strategies.registry import strategies


def endings_table(records: Sequence[TrialRecord]) -> Table:
    """Every trial that did not explore, with how it ended and why."""
    own = [record for record in records if not finished(record)]
    header = ("Method", "size [m]", "world", "training seed", "status", "steps", "known [%]", "reason")
    rows, scopes = [], []
    for record in own:
        spec = record.spec
        seed = "–" if spec.training_seed is None else str(spec.training_seed)
        steps = str(max(len(record.steps["step"]) - 1, 0))
        known = f"{100 * explored(record):.1f}"
        row = (shown_name(spec.strategy), f"{spec.scenario.size:g}", str(spec.trial), seed)
        rows.append((*row, record.status.replace("_", " "), steps, known, record.reason or "–"))
        scopes.append(Scope((spec.strategy,), spec.scenario.size))
    title = f"{len(own)} of {len(records)} trials did not explore their map"
    table = Table(title, header, tuple(rows), scopes=tuple(scopes))
    return table.naming_each([record.spec.scenario_name for record in own])


def gaps(trials: pd.DataFrame, stale: int = 0) -> list[str]:
    """Sentences on what a reader does not see here.

    Strategies that are missing in a table of the paper, worlds that not all of them tried, and how many stored trials
    are left out as `stale`.
    """
    known, complete = strategies(), of_paper(trials)
    absent = _absent(set(trials["strategy"])) if complete else []
    untrained = [entry_of(name).label for name in absent if not known[name].ready]
    unrun = [entry_of(name).label for name in absent if known[name].ready]
    found = []
    if stale:
        what = "stored trial was" if stale == 1 else "stored trials were"
        found.append(f"{stale} {what} run by older code or libraries and not counted; run the suite again.")
    if unrun:
        found.append(f"Not run: {'; '.join(unrun)}.")
    if untrained:
        found.append(f"Not trained, hence not run: {'; '.join(untrained)}.")
    for size, here in trials.groupby("size"):
        found += _unequal(float(str(size)), here)
    found += _skipped(trials) if complete else []
    if not any(finite >= 2 for finite in trials.groupby(["strategy", "size"])["trial"].nunique()):
        found.append("Each strategy tried one world only, so there are no intervals.")
    return found


def _absent(tried: set[str]) -> list[str]:
    """Strategies that did not run of those tables of the paper of which most did: who runs a few misses none."""
    known = strategies()
    members = [{name for name, entry in known.items() if table in entry.tables} for table in PAPER_TABLES]
    begun = set().union(*(own for own in members if 2 * len(own & tried) > len(own)))
    return [name for name in known if name in begun - tried]


def _skipped(trials: pd.DataFrame) -> list[str]:
    """Sentences on strategies and training seeds that ran, but not at a size at which others did and they belong."""
    found = []
    known, suite = strategies(), SUITES["paper"]
    ran = {
        (str(name), seed, size) for name, seed, size in trials[["strategy", "training_seed", "size"]].values.tolist()
    }
    for name in dict.fromkeys(trials["strategy"]):
        if name not in known:
            continue
        for size in sorted(set(suite.sizes_of(known[name])) & set(trials["size"])):
            here = {seed for own, seed, at in ran if own == name and at == size}
            lacking = [seed for seed in known[name].weights if seed not in here]
            if not here:
                found.append(f"{entry_of(name).label} has no trials of {size:g} m.")
            elif lacking and not all(map(pd.isna, here)):
                which = ", ".join(map(str, lacking))
                found.append(f"{entry_of(name).label} has no trials of {size:g} m of training seeds {which}.")
    return found


def _unequal(size: float, here: pd.DataFrame) -> list[str]:
    """Sentences on the strategies and training seeds that lack worlds of a size which others tried."""
    worlds = set(here["trial"])
    found = []
    for (name, seed), own in here.groupby(["strategy", "training_seed"], dropna=False):
        lacking = len(worlds - set(own["trial"]))
        if lacking:
            which = "" if pd.isna(seed) else f" (training seed {seed})"
            found.append(f"{entry_of(str(name)).label}{which} lacks {lacking} of {len(worlds)} worlds of {size:g} m.")
    return found
