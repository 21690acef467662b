"""Everything that `explore-bench report` writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from explore_bench.errors import RequestError, writing
from explore_bench.records import Store, TrialRecord
from explore_bench.report.aggregates import write_aggregates
from explore_bench.report.agreement import write_agreement
from explore_bench.report.claims import examined, write_claims
from explore_bench.report.figures import write_figures
from explore_bench.report.sensitivity import write_sensitivity
from explore_bench.report.tables import write_tables
from explore_bench.report.training import write_training_figures
from explore_bench.results import summary_table, trial_table


@dataclass(frozen=True)
class Report:
    """What was written, from how many trials, and how many were left out as stale."""

    files: tuple[Path, ...]
    trials: int
    stale: int


def write_report(folder: Path) -> Report:
    """Write trials.csv, summary.csv, tables and figures of a results folder from its records.

    Raises
    ------
    RequestError : where the folder holds no current trial, or cannot be written.
    """
    store = Store(folder)
    records, stale = store.records()
    if not records:
        what = f"{stale} trials of older code or libraries" if stale else "no trials"
        raise RequestError(f"results folder '{folder}' holds {what}; run some with 'explore-bench run SUITE'.")
    trials = trial_table(records)
    with writing(folder):
        files = [_write_csv(trials, folder / "trials.csv")]
        if trials["scenario"].nunique() > 1:  # a mean over different physics would mean nothing
            files += write_sensitivity(trials, folder)
        else:
            files += _write_all(store, records, trials, folder)
    return Report(tuple(files), len(records), stale)


def _write_all(store: Store, records: list[TrialRecord], trials: pd.DataFrame, folder: Path) -> list[Path]:
    """Write everything but trials.csv of a folder with one set of physical constants."""
    summary = summary_table(trials)
    files = [_write_csv(summary, folder / "summary.csv")]
    files += write_tables(trials, summary, folder / "tables")
    files += write_agreement(trials, summary, folder / "tables")
    files += write_aggregates(trials, folder / "tables", folder / "figures")
    files += write_claims(examined(trials), folder)
    files += write_figures(store, records, folder / "figures")
    return files + write_training_figures(folder / "figures")


def _write_csv(table: pd.DataFrame, path: Path) -> Path:
    table.to_csv(path, index=False, lineterminator="\n")
    return path
