"""Everything that `explore-bench report` writes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from explore_bench.errors import RequestError, writing
from explore_bench.records import Store
from explore_bench.report.figures import write_figures
from explore_bench.report.html import Content, Section, write_page
from explore_bench.report.tables import report_tables, write_tables
from explore_bench.report.training import write_training_figures
from explore_bench.results import summary_table, trial_table


@dataclass(frozen=True)
class Report:
    """What was written, from how many trials, and how many were left out as stale."""

    files: tuple[Path, ...]
    trials: int
    stale: int


def write_report(folder: Path, sections: Sequence[Section] = ()) -> Report:
    """Write trials.csv, summary.csv, tables, figures and the page of a results folder from its records.

    The page shows `sections` before its tables.

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
    summary = summary_table(trials)
    with writing(folder):
        for name, table in (("trials.csv", trials), ("summary.csv", summary)):
            table.to_csv(folder / name, index=False, lineterminator="\n")
        files = [folder / "trials.csv", folder / "summary.csv"]
        tables = report_tables(trials, summary)
        files += write_tables(tables, folder / "tables")
        files += write_figures(store, records, folder / "figures")
        files += write_training_figures(folder / "figures")
        drawn = [file for file in files if file.suffix == ".svg"]
        content = Content(store, records, trials, tuple(tables.values()), drawn, tuple(sections))
        files.append(write_page(content, folder / "report.html"))
    return Report(tuple(files), len(records), stale)
