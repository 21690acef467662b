"""Everything that `explore-bench report` writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from explore_bench.analysis.csv_files import write_table
from explore_bench.analysis.metrics import counts
from explore_bench.analysis.tables import measured, of_paper, read_trials, summary_table, world_table
from explore_bench.analysis.times import read_times
from explore_bench.errors import RequestError, writing
from explore_bench.records.encoding import TrialRecord
from explore_bench.records.store import Store
from explore_bench.report.aggregates import aggregate_tables, write_survival_figures
from explore_bench.report.agreement import agreement_tables
from explore_bench.report.drawing import entry_of, save_all, showing, styled
from explore_bench.report.figures import write_figures
from explore_bench.report.html import Content, write_page
from explore_bench.report.pages.claims import claims_section, examined, overview, tried, verdicts, write_claims
from explore_bench.report.pages.field import field_tables, write_field_figures
from explore_bench.report.pages.maps import maps_figure, write_map_report
from explore_bench.report.pages.sensitivity import write_sensitivity
from explore_bench.report.pages.training import write_training_figures
from explore_bench.report.sharing import figures_aside, shared_records
from explore_bench.report.tables import PAPER_TABLES, SUFFIXES, Table, kind_tables, report_tables, write_tables
from explore_bench.world.kinds import kind_of


@dataclass(frozen=True)
class Report:
    """What was written, from how many trials, how many were left out as stale, and the damaged ones, moved aside."""

    files: tuple[Path, ...]
    trials: int
    stale: int
    damaged: tuple[Path, ...] = ()


def write_report(folder: Path) -> Report:
    """Write everything that follows from the records of a results folder.

    A folder of one set of physical constants gets trials.csv, summary.csv, tables, figures, claims and the page. One of
    several gets trials.csv and how the strategies degrade, or how they do in each of several given maps; or the tables,
    figures, claims and the page of a kind of world that has more to say of its trials, which gets worlds.csv, too.

    Raises
    ------
    RequestError : where the folder holds no current trial, or cannot be written.
    """
    store = Store(folder)
    every, records, stale = read_trials(store, shared_records)
    if not records:
        what = f"{stale} trials of older code or libraries" if stale else "no trials"
        raise RequestError(f"results folder '{folder}' holds {what}; run some with 'explore-bench run SUITE'.")
    trials = measured(every)
    if not len(trials):
        raise RequestError(
            f"in all {len(records)} trials of results folder '{folder}' the simulator broke down; report that."
        )
    with writing(folder), showing(record.spec for record in records):
        files = [write_table(every, folder / "trials.csv")]
        counted = [record for record in records if counts(record)]
        worlds, own = world_table(records), kind_tables(counted, trials)
        files += [write_table(worlds, folder / "worlds.csv")] if len(worlds) else []
        drawn = _write_kind_figures(counted, trials, folder / "figures")
        if trials["scenario"].nunique() > 1 and all(record.spec.scenario.map for record in records):
            files += (
                write_tables(own, folder / "tables")
                + drawn
                + write_map_report(trials, _of_first_world(store, counted), folder)
            )
        elif trials["scenario"].nunique() == 1 or own:
            files += _write_all(store, records, trials, own, drawn, stale, folder)
        else:  # a mean over different physics would mean nothing
            files += write_sensitivity(trials, folder)
    return Report(tuple(files), len(records), stale, tuple(store.damaged))


def _write_all(
    store: Store,
    records: list[TrialRecord],
    trials: pd.DataFrame,
    own: dict[str, Table],
    drawn: list[Path],
    stale: int,
    folder: Path,
) -> list[Path]:
    """Write claims, tables, figures and the page; `own` and `drawn` are the tables and the figures of a kind of world.

    Means over worlds, and what follows from them, are written where all trials ran with one set of physical constants.
    """
    found, counted = examined(trials), [record for record in records if counts(record)]
    alone = trials["scenario"].nunique() == 1

    def figures() -> list[Path]:
        place = folder / "figures"
        return [
            *write_field_figures(trials, found, place),
            *(write_survival_figures(trials, place) if alone else ()),
            *write_figures(store, counted, place),
            *_write_ways(store, records, place / "ways"),
            *(write_training_figures(place, set(trials["strategy"])) if of_paper(trials) else ()),
        ]

    with figures_aside(len(records), figures) as others:
        files = [*write_claims(found, folder), *drawn, *others]
        tables = field_tables(trials, read_times(folder)) | own
        if alone:
            summary = summary_table(trials, {name for name in set(trials["strategy"]) if entry_of(name).reference})
            files.append(write_table(summary, folder / "summary.csv"))
            tables |= report_tables(trials, summary) | agreement_tables(trials, summary) | aggregate_tables(trials)
            only = str(trials["scenario"].iloc[0])
            tables = {key: table.naming(only) for key, table in tables.items()}
        claims = {"claims": overview(found)} if found else {}
        earlier = {"claims", "field", "means", *PAPER_TABLES} - tables.keys() - claims.keys()
        for other in earlier:  # of a report of other trials
            for suffix in SUFFIXES:
                (folder / "tables" / f"{other}{suffix}").unlink(missing_ok=True)
        files += write_tables(claims | tables, folder / "tables")
    svgs = [file for file in files if file.suffix == ".svg"]
    sections = (claims_section(found),) if found else ()
    said = verdicts(tried(found, trials))
    page = Content(store, records, trials, tuple(tables.values()), svgs, sections, stale, said)
    return [*files, write_page(page, folder / "report.html")]


def _write_ways(store: Store, records: list[TrialRecord], stem: Path) -> list[Path]:
    """Draw the ways through a given map, if all trials ran in one."""
    one = records[0].spec.scenario.map is not None and len({record.spec.scenario.map for record in records}) == 1
    counted = [record for record in records if counts(record)]
    with styled():
        return save_all(maps_figure(_of_first_world(store, counted)) if one else None, stem)


def _of_first_world(store: Store, records: list[TrialRecord]) -> list[TrialRecord]:
    """Whole records of those of the first world, whose ways are drawn."""
    first = min((record.spec.trial for record in records), default=0)
    return [store.find(record.spec) for record in records if record.spec.trial == first]


def _write_kind_figures(records: list[TrialRecord], trials: pd.DataFrame, folder: Path) -> list[Path]:
    """Draw the figures of their own of the kinds of world that some trials are of."""
    written: list[Path] = []
    with styled():
        for kind in dict.fromkeys(record.spec.scenario.kind for record in records):
            draw = kind_of(kind).load("figures")
            for name, figure in (draw(trials) if draw is not None else {}).items():
                written += save_all(figure, folder / name)
    return written
