"""`trials.csv`, `summary.csv` and `worlds.csv`, derived from the records of a results folder."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import KEYS, write_table
from explore_bench.analysis.metrics import METRICS, REGRETS, metrics_of, regret
from explore_bench.analysis.rounding import rounded
from explore_bench.analysis.statistics import mean_intervals
from explore_bench.errors import RequestError
from explore_bench.records.encoding import TrialRecord
from explore_bench.records.provenance import weights_digest
from explore_bench.records.store import Store
from explore_bench.strategies.registry import entry_named, in_order, strategies
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.world.kinds import kind_of

PAPER_SCENARIO = "paper"
"""Name of the scenario that the paper's printed numbers and its claims are about."""

NO_TABLE = "none"
"""What `summary.csv` calls the table of a strategy that is in none."""

FIRST_METRICS = ("path_length", "explored", "uncertainty_reduction", "exploration_efficiency", "trajectory_error")
FURTHER_METRICS = tuple(name for name in METRICS if name not in (*FIRST_METRICS, "decisions"))

TRIAL_COLUMNS = (
    "strategy",
    "training_seed",
    "size",
    "trial",
    "world",
    "status",
    "steps",
    "decisions",
    *FIRST_METRICS,
    *FURTHER_METRICS,
    *REGRETS,
    "scenario",
    "reason",
)
"""Those of trials in every kind of world; the metrics of a kind follow them."""

SUMMARY_COLUMNS = (
    *("table", "strategy", "size", "metric", "n", "failed", "mean", "ci_low", "ci_high", "paper"),
    *("seeds", "seed_low", "seed_high", "scenario"),
)
ESTIMATED = ("mean", "ci_low", "ci_high")
WORLD_COLUMNS = ("scenario", "size", "trial", "world")
"""Those of worlds of every kind; the facts of a kind follow them."""


def read_trials(
    store: Store, records_of: Callable[[Store, Callable[[TrialRecord], Any]], tuple[list[Any], int]] = Store.records
) -> tuple[pd.DataFrame, list[TrialRecord], int]:
    """`trial_table` of a store's current trials, these in brief, and how many stored ones are stale.

    One whole trial is in memory at a time. `records_of` reads them; it gives what `Store.records` does.

    Raises
    ------
    RequestError : as `trial_table`.
    """
    found, stale = records_of(store, in_brief)
    records = [record for record, _ in found]
    return _table_of(records, [row for _, row in found]), records, stale


def trial_table(records: Sequence[TrialRecord]) -> pd.DataFrame:
    """One row a trial, ordered by strategy, training seed, size and trial.

    The columns are TRIAL_COLUMNS and the metrics of the kinds of world that the trials are of. Numbers are `rounded`,
    so that whatever follows from them is the same on another machine.

    Names of strategies are kept as they were when the trial ran; regret is to what the reference said of the world.

    Raises
    ------
    RequestError : where two different strategies, or sets of weights, have the same name.
    """
    return _table_of(records, [trial_row(record) for record in records])


def in_brief(record: TrialRecord) -> tuple[TrialRecord, dict[str, Any]]:
    """A record in brief, and its row."""
    return record.brief(), trial_row(record)


def trial_row(record: TrialRecord) -> dict[str, Any]:
    """What `trial_table` says of a trial by itself: all but the regret."""
    spec, steps = record.spec, record.steps
    values: dict[str, Any] = {
        name: metric.value(record) for name, metric in (METRICS | metrics_of(spec.scenario.kind)).items()
    }
    return values | {
        "strategy": spec.strategy,
        "training_seed": spec.training_seed,
        "size": spec.scenario.size,
        "trial": spec.trial,
        "world": record.world.digest,
        "status": record.status,
        "steps": max(len(steps["step"]) - 1, 0),
        "decisions": int(steps["decisions"][-1]) if len(steps["step"]) else 0,
        "scenario": spec.scenario_name,
        "reason": record.reason,
    }


def _table_of(records: Sequence[TrialRecord], rows: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Table of the rows of some trials, in brief or whole, with their regret."""
    refuse_shared_names(record.spec for record in records)
    references = {(record.spec.scenario, record.spec.trial): record for record in records if record.notes}
    for record, row in zip(records, rows, strict=True):
        reference = references.get((record.spec.scenario, record.spec.trial))
        row |= {name: regret(record, reference, note) for name, (note, _) in REGRETS.items()}
    own = [name for kind in dict.fromkeys(record.spec.scenario.kind for record in records) for name in metrics_of(kind)]
    table = pd.DataFrame(rows, columns=[*TRIAL_COLUMNS, *dict.fromkeys(own)])
    table = table.astype({"training_seed": "Int64", "size": float})
    return rounded(table.sort_values(KEYS, kind="stable", ignore_index=True, na_position="first"))


def own_metrics(trials: pd.DataFrame) -> list[str]:
    """Names of the metrics that a kind of world has beside the common ones, as the rows of its trials have them."""
    return [str(name) for name in trials.columns if name not in TRIAL_COLUMNS]


def of_paper(trials: pd.DataFrame) -> bool:
    """Whether all trials are of the paper's own scenario, so that what it prints may stand beside them."""
    return set(trials["scenario"]) <= {PAPER_SCENARIO}


def world_table(records: Iterable[TrialRecord]) -> pd.DataFrame:
    """One row a world with WORLD_COLUMNS and what its kind says of it; no row for a kind that says nothing."""
    rows: dict[Any, dict[str, Any]] = {}
    for record in records:
        spec = record.spec
        facts = kind_of(spec.scenario.kind).load("facts")
        key = spec.scenario_name, spec.scenario.size, spec.trial, record.world.digest
        if facts is not None and key not in rows:
            rows[key] = {**dict(zip(WORLD_COLUMNS, key, strict=True)), **facts(record)}
    return rounded(pd.DataFrame([rows[key] for key in sorted(rows)], columns=None if rows else list(WORLD_COLUMNS)))


def refuse_shared_names(specs: Iterable[TrialSpec]) -> None:
    """Refuse specifications that mean different things by one name.

    Raises
    ------
    RequestError : with the name and both of its meanings.
    """
    makers: dict[Any, tuple[Any, str]] = {}
    for spec in specs:
        made = (spec.factory, dict(spec.parameters)), spec.factory
        weights = weights_digest(spec.weights) if spec.weights else None, f"the weights {spec.weights}"
        for key, own in ((spec.strategy, made), ((spec.strategy, spec.training_seed), weights)):
            known = makers.setdefault(key, own)
            if known[0] != own[0]:
                raise RequestError(
                    f"the name '{spec.strategy}' stands for {known[1]} and for {own[1]} in one folder; "
                    "rename one of them, or give each a folder with --results."
                )


def write_trials(store: Store) -> pd.DataFrame:
    """Write `trials.csv` from the current records of a folder and return its rows."""
    table, _, _ = read_trials(store)
    write_table(table, store.folder / "trials.csv")
    return table


def measured(trials: pd.DataFrame) -> pd.DataFrame:
    """Trials that say something of their strategies.

    Where the simulator broke down in a trial, that strategy has none in that world, with any training seed.
    """
    place = ["scenario", "strategy", "size", "trial"]
    broken = set(map(tuple, trials.loc[trials["status"] == Status.BROKEN.value, place].to_numpy().tolist()))
    if not broken:
        return trials
    return trials[[tuple(row) not in broken for row in trials[place].to_numpy().tolist()]].reset_index(drop=True)


def select(table: pd.DataFrame, specs: Sequence[TrialSpec]) -> pd.DataFrame:
    """Rows of the trials of a plan."""
    wanted = {(spec.strategy, spec.training_seed, spec.scenario.size, spec.trial, spec.scenario_name) for spec in specs}
    seeds = [None if pd.isna(seed) else int(seed) for seed in table["training_seed"]]
    keys = zip(table["strategy"], seeds, table["size"], table["trial"], table["scenario"], strict=True)
    return table[[key in wanted for key in keys]].reset_index(drop=True)


def by_world(table: pd.DataFrame, metric: str) -> dict[int, float]:
    """Values of a metric by world, training seeds averaged within a world; NaN where one of them is."""
    trials, place = np.unique(table["trial"].to_numpy(dtype=int), return_inverse=True)
    means = np.bincount(place, table[metric].to_numpy(dtype=float)) / np.bincount(place)
    return dict(zip(trials.tolist(), means.tolist(), strict=True))


def seed_means(table: pd.DataFrame, metric: str) -> list[float]:
    """Mean of a metric over the worlds, one for each training seed in their order; none for what is not learned."""
    return [float(own.mean(skipna=False)) for _, own in table.groupby("training_seed")[metric]]


def summary_table(trials: pd.DataFrame, references: Collection[str] = ()) -> pd.DataFrame:
    """Means with intervals of every table, strategy, size and metric; the paper's value where that table prints one.

    The trials are of one scenario. `n` counts worlds, `failed` trials that did not explore; `seed_low` and `seed_high`
    are the smallest and the largest mean of a single one of the `seeds` training seeds.

    A strategy without trials stands in it with n = 0 where the paper prints a value; a metric that is not defined for
    every trial of a cell is left out. A reference (a registered one, and `references`, told the truth when their trials
    ran) has no mean of a metric for which it does not plan, but its n and its failed trials. What the paper prints
    stands beside trials of its own scenario alone.
    """
    rows: list[dict[str, Any]] = []
    samples: dict[int, np.ndarray] = {}  # of a row's metric
    metrics = [*FIRST_METRICS, "decisions", *FURTHER_METRICS, *REGRETS, *own_metrics(trials)]
    printed = of_paper(trials)
    scenario = str(trials["scenario"].iloc[0]) if len(trials) else PAPER_SCENARIO
    for name in in_order([*strategies(), *trials["strategy"]]):
        own = trials[trials["strategy"] == name]
        entry = entry_named(name, references)
        published = entry.published if printed else {}
        for table in entry.tables or (NO_TABLE,):
            sizes = {float(size) for size in own["size"]} | {s for t, s, _ in published if t == table}
            for size in sorted(sizes):
                cell = own[own["size"] == size]
                for metric in metrics:
                    paper = published.get((table, size, metric), math.nan)
                    if not len(cell) and math.isnan(paper):
                        continue
                    values = np.array(list(by_world(cell, metric).values()))
                    if np.isnan(values).any():
                        continue  # not defined for every trial: no mean over those for which it is
                    of_seeds = seed_means(cell, metric)
                    if entry.fills(metric):
                        samples[len(rows)] = values
                    else:
                        of_seeds = [math.nan] * len(of_seeds)
                    rows.append(
                        {
                            "table": table,
                            "strategy": name,
                            "size": size,
                            "metric": metric,
                            "n": len(values),
                            "failed": int((cell["status"] != "explored").sum()),
                            "paper": paper,
                            "seeds": len(of_seeds),
                            "seed_low": min(of_seeds, default=math.nan),
                            "seed_high": max(of_seeds, default=math.nan),
                            "scenario": scenario,
                        }
                    )
    for row, estimate in zip(samples, mean_intervals(list(samples.values())), strict=True):
        rows[row] |= {"mean": estimate.mean, "ci_low": estimate.low, "ci_high": estimate.high}
    return rounded(pd.DataFrame(rows, columns=list(SUMMARY_COLUMNS)).astype(dict.fromkeys(ESTIMATED, float)))
