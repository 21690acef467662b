"""The paper's tables with ours beside them, and those of any scenario, as Markdown, CSV and LaTeX."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from explore_bench.analysis.metrics import METRICS, REGRETS, Metric
from explore_bench.analysis.statistics import Estimate, differences_of, mean_interval, mean_intervals
from explore_bench.analysis.tables import by_world, of_paper
from explore_bench.files import write_whole
from explore_bench.records.encoding import TrialRecord
from explore_bench.report.drawing import entry_of
from explore_bench.strategies.registry import in_order, strategies
from explore_bench.world.kinds import kind_of

PAPER_TABLES = {
    "table2": "Table 2. Trajectory error e and exploration efficiency η of the compared methods",
    "table3": "Table 3. Trajectory error e and exploration efficiency η of Graph-STNN and its ablations",
}
SUFFIXES = (".md", ".csv", ".tex")
PAPER_METRICS = ("trajectory_error", "exploration_efficiency")
PAIRED_METRICS = (*PAPER_METRICS, "t90")
DETAIL_METRICS = (
    "position_error",
    "decisions",
    "path_length",
    "t50",
    "t80",
    "t90",
    *REGRETS,
    "absolute_trajectory_error",
    "pose_nees",
    "collisions",
    "mislabelled",
    "crossings",
    "round_trips",
)
STATUSES = ("explored", "step_limit", "stuck", "failed")

NOTE = (
    "Mean over n worlds [95 % BCa bootstrap interval], conditional on the weights of a learned strategy: its training "
    "seeds are averaged within a world first (smallest–largest mean of a single seed). A trial that did not explore is "
    "scored with T = n_a = the step limit, its last U and at least a max trace of 2 σ₀². A reference is told the true "
    "world and fills the columns for which it plans."
)
_LATEX = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_"}
_LATEX |= {"{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
_LATEX |= {"η": r"$\eta$", "σ": r"$\sigma$", "²": r"$^2$", "₀": r"$_0$", "Σ": r"$\Sigma$", "Δ": r"$\Delta$"}
_LATEX |= {"−": r"$-$", "≥": r"$\geq$", "≤": r"$\leq$", "×": r"$\times$", "–": "--"}


@dataclass(frozen=True)
class Scope:
    """What a row or a column speaks of, for a reader who filters: strategies by name, a size [m] or all sizes."""

    strategies: tuple[str, ...] = ()
    size: float | None = None


@dataclass(frozen=True)
class Table:
    """A table of text.

    Attributes
    ----------
    title, note : above and below it.
    header : names of the columns.
    rows : cells, as many in each row as in the header.
    scopes, columns : what each row and each column speaks of; empty where the table is not to be filtered so.
    scenario : name of the scenario of all its trials, a column of the CSV file; empty where the table names none.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""
    scopes: tuple[Scope, ...] = ()
    columns: tuple[Scope, ...] = ()
    scenario: str = ""

    def naming(self, scenario: str) -> Table:
        """Copy that names the scenario of all its trials: in the note, and in a column of the CSV file."""
        return replace(self, note=f"Scenario: {scenario}. {self.note}".strip(), scenario=scenario)

    def naming_each(self, scenarios: Sequence[str]) -> Table:
        """Copy that names the scenario of every row: in the note where all are of one, else in a second column."""
        if len(set(scenarios)) <= 1:
            return self.naming(scenarios[0]) if scenarios else self
        rows = tuple((row[0], own, *row[1:]) for row, own in zip(self.rows, scenarios, strict=True))
        columns = (*self.columns[:1], Scope(), *self.columns[1:]) if self.columns else ()
        return replace(self, header=(self.header[0], "scenario", *self.header[1:]), rows=rows, columns=columns)

    def markdown(self) -> str:
        """Return the table as GitHub Markdown."""
        lines = [f"**{self.title}**", "", _pipes(self.header), _pipes(["---"] * len(self.header))]
        lines += [_pipes(row) for row in self.rows]
        return "\n".join(lines + (["", self.note] if self.note else [])) + "\n"

    def csv(self) -> str:
        """Return the table as CSV."""
        text = io.StringIO()
        named = [("scenario",), *[(self.scenario,)] * len(self.rows)] if self.scenario else [()] * (len(self.rows) + 1)
        lines = ((*row, *more) for row, more in zip((self.header, *self.rows), named, strict=True))
        csv.writer(text, lineterminator="\n").writerows(lines)
        return text.getvalue()

    def latex(self) -> str:
        """Return the table as LaTeX, every special character escaped; needs the package booktabs."""
        lines = [r"\begin{table}", r"\centering", rf"\caption{{{escape(self.title)}. {escape(self.note)}}}"]
        lines += [rf"\begin{{tabular}}{{l{'r' * (len(self.header) - 1)}}}", r"\toprule"]
        lines += [" & ".join(map(escape, self.header)) + r" \\", r"\midrule"]
        lines += [" & ".join(map(escape, row)) + r" \\" for row in self.rows]
        return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}"]) + "\n"

    def write(self, folder: Path, name: str) -> list[Path]:
        """Write name.md, name.csv and name.tex."""
        folder.mkdir(parents=True, exist_ok=True)
        texts = self.markdown(), self.csv(), self.latex()
        return [write_whole(folder / f"{name}{suffix}", text) for suffix, text in zip(SUFFIXES, texts, strict=True)]


def escape(text: str) -> str:
    """Text for LaTeX, with special characters and the notation of the tables written as LaTeX."""
    return "".join(_LATEX.get(character, character) for character in text)


def report_tables(trials: pd.DataFrame, summary: pd.DataFrame) -> dict[str, Table]:
    """Tables by the names of their files: e and η, the details of every strategy and the paired differences.

    e and η stand in a table of the paper, beside what it prints, where all methods that it prints ran in its scenario
    (those without weights aside); in one of what was run where there is none, or a strategy belongs to no table.
    """
    ran = set(trials["strategy"])
    complete = [name for name in PAPER_TABLES if of_paper(trials) and _printed(name) <= ran]
    made = {name: paper_table(name, PAPER_TABLES[name], summary) for name in complete}
    if not complete or any(not entry_of(name).tables for name in ran):
        made["means"] = means_table(trials, summary)
    return made | {"details": details_table(trials, summary), "paired": paired_table(trials)}


def _printed(table: str) -> set[str]:
    """Strategies that can run, and of which a table of the paper prints values."""
    return {
        name
        for name, entry in strategies().items()
        if entry.ready and any(printed == table for printed, _, _ in entry.published)
    }


def kind_tables(records: Iterable[TrialRecord], trials: pd.DataFrame) -> dict[str, Table]:
    """Tables of their own of the kinds of world that some trials are of, by the names of their files."""
    made: dict[str, Table] = {}
    for kind in dict.fromkeys(record.spec.scenario.kind for record in records):
        tables = kind_of(kind).load("tables")
        made |= tables(trials) if tables is not None else {}
    return made


def write_tables(tables: Mapping[str, Table], folder: Path) -> list[Path]:
    """Write tables by the names of their files; returns the files."""
    return [file for name, table in tables.items() for file in table.write(folder, name)]


def paper_table(name: str, title: str, summary: pd.DataFrame) -> Table:
    """Table of the paper: for every metric and size the paper's value and ours with its interval.

    A strategy of the table without weights reads `not trained`, one without trials `not run`.
    """
    own = summary[summary["table"] == name]
    sizes = sorted({size for entry in strategies().values() for t, size, _ in entry.published if t == name})
    columns = list(itertools.product(PAPER_METRICS, sizes))
    header = ["Method", "n", "seeds", "trials not explored"]
    for metric, size in columns:
        header += [f"{heading(METRICS[metric])} {size:g} m: paper", "ours"]
    rows = []
    names = in_order([*(n for n, entry in strategies().items() if name in entry.tables), *own["strategy"]])
    for strategy in names:
        entry = entry_of(strategy)
        lines = own[own["strategy"] == strategy].set_index(["metric", "size"])
        absent = "not run" if entry.ready else "not trained"
        worlds = [_value(lines, PAPER_METRICS[0], size, "n") for size in sizes]
        unfinished = [_value(lines, PAPER_METRICS[0], size, "failed") for size in sizes]
        seeds = [_value(lines, PAPER_METRICS[0], size, "seeds") for size in sizes]
        row = [shown_name(strategy), _slashes(worlds), _slashes(seeds) if any(seeds) else "–"]
        row.append(_slashes(unfinished) if any(worlds) else "–")
        for metric, size in columns:
            paper = _value(lines, metric, size, "paper")
            row.append(f"{paper:.4f}" if paper and not math.isnan(paper) else "–")
            row.append((_measured(lines, metric, size) or absent) if entry.fills(metric) else "–")
        rows.append(tuple(row))
    scopes = tuple(Scope((strategy,)) for strategy in names)
    of_columns = [Scope()] * 4 + [Scope(size=size) for _, size in columns for _ in ("paper", "ours")]
    return Table(title, tuple(header), tuple(rows), NOTE, scopes, tuple(of_columns))


def means_table(trials: pd.DataFrame, summary: pd.DataFrame) -> Table:
    """E and η of every strategy and size that was run."""
    header = ("Method", "size [m]", "n", "trials not explored", *(heading(METRICS[name]) for name in PAPER_METRICS))
    rows, scopes = [], []
    unique = summary.drop_duplicates(["strategy", "size", "metric"])
    for (strategy, size), cell in groups_of(trials):
        lines = unique[unique["strategy"] == strategy].set_index(["metric", "size"])
        unfinished = int((cell["status"] != "explored").sum())
        row = (shown_name(strategy), f"{size:g}", str(cell["trial"].nunique()), str(unfinished))
        rows.append((*row, *(_shown(strategy, lines, name, size) for name in PAPER_METRICS)))
        scopes.append(Scope((strategy,), size))
    title = "Trajectory error e and exploration efficiency η of every strategy and size"
    return Table(title, header, tuple(rows), NOTE, tuple(scopes))


def details_table(trials: pd.DataFrame, summary: pd.DataFrame) -> Table:
    """How the trials of every strategy and size ended, and what else was measured."""
    units = METRICS | {name: metric for name, (_, metric) in REGRETS.items()}
    header = ["Method", "size [m]", "trials", *(status.replace("_", " ") for status in STATUSES), "stuck [%]"]
    header += [heading(units[name]) for name in DETAIL_METRICS]
    rows = []
    unique = summary.drop_duplicates(["strategy", "size", "metric"])
    for (strategy, size), cell in groups_of(trials):
        lines = unique[unique["strategy"] == strategy].set_index(["metric", "size"])
        counts = cell["status"].value_counts()
        row = [shown_name(strategy), f"{size:g}", str(len(cell))]
        row += [str(counts.get(status, 0)) for status in STATUSES]
        row.append(f"{100 * counts.get('stuck', 0) / len(cell):.1f}")
        row += [_shown(strategy, lines, name, size) for name in DETAIL_METRICS]
        rows.append(tuple(row))
    scopes = tuple(Scope((strategy,), size) for (strategy, size), _ in groups_of(trials))
    return Table("Endings and further metrics of every strategy and size", tuple(header), tuple(rows), NOTE, scopes)


def paired_table(trials: pd.DataFrame) -> Table:
    """Differences between every two strategies, paired by world; references are compared with nobody."""
    header = ["size [m]", "A", "B", "n", *(f"{heading(METRICS[name])}: A − B" for name in PAIRED_METRICS)]
    heads, scopes = [], []
    pairs: list[tuple[dict[int, float], dict[int, float]]] = []
    for size in sorted(set(trials["size"])):
        cells = {name: cell for (name, s), cell in groups_of(trials) if s == size and not entry_of(name).reference}
        values = {name: [by_world(cell, metric) for metric in PAIRED_METRICS] for name, cell in cells.items()}
        for a, b in itertools.combinations(cells, 2):
            both = values[a][0].keys() & values[b][0].keys()
            heads.append((f"{size:g}", entry_of(a).label, entry_of(b).label, str(len(both))))
            pairs += zip(values[a], values[b], strict=True)
            scopes.append(Scope((a, b), size))
    texts, many = paired_texts(pairs), len(PAIRED_METRICS)
    rows = [(*head, *texts[many * i : many * (i + 1)]) for i, head in enumerate(heads)]
    note = "Mean difference over the worlds that both tried, scored as above [95 % BCa bootstrap interval]."
    title = "Differences between strategies, paired by world"
    return Table(title, tuple(header), tuple(rows), note, tuple(scopes))


def paired_texts(pairs: Sequence[tuple[dict[int, float], dict[int, float]]]) -> list[str]:
    """Difference of two strategies each; a dash without a common world or where a trial lacks the metric."""
    shown = [bool(a.keys() & b.keys()) and all(map(math.isfinite, (*a.values(), *b.values()))) for a, b in pairs]
    found = iter(mean_intervals([differences_of(*pair) for pair, own in zip(pairs, shown, strict=True) if own]))
    return [interval_text(next(found)) if own else "–" for own in shown]


def groups_of(trials: pd.DataFrame) -> list[tuple[tuple[str, float], pd.DataFrame]]:
    """Trials of each strategy and size, in the registered order."""
    cells = {(str(name), float(size)): cell for (name, size), cell in trials.groupby(["strategy", "size"])}
    order = {name: place for place, name in enumerate(in_order(name for name, _ in cells))}
    return sorted(cells.items(), key=lambda item: (order[item[0][0]], item[0][1]))


def shown_by_world(cell: pd.DataFrame, metric: str) -> dict[int, float]:
    """`by_world` of the trials of one strategy; no world where that is a reference that does not plan for the metric.

    Whatever is shown of trials by strategy begins here.
    """
    planned = len(cell) and entry_of(str(cell["strategy"].iloc[0])).fills(metric)
    return by_world(cell, metric) if planned else {}


def mean_text(cell: pd.DataFrame, metric: str) -> str:
    """Mean over worlds with its interval; a dash where a trial lacks the metric or a reference does not plan for it."""
    values = np.array(list(shown_by_world(cell, metric).values()))
    return interval_text(mean_interval(values)) if len(values) and np.isfinite(values).all() else "–"


def heading(metric: Metric) -> str:
    """Symbol and unit of a metric."""
    return metric.symbol if metric.unit == "1" else f"{metric.symbol} [{metric.unit}]"


def shown_name(strategy: str) -> str:
    """Label of a strategy, references marked."""
    entry = entry_of(strategy)
    return f"{entry.label} (reference)" if entry.reference else entry.label


def _value(lines: pd.DataFrame, metric: str, size: float, column: str) -> float:
    return float(lines.loc[(metric, size), column]) if (metric, size) in lines.index else 0.0


def _shown(strategy: str, lines: pd.DataFrame, metric: str, size: float) -> str:
    """What was measured; a dash where nothing was, or a reference did not plan for it."""
    return (_measured(lines, metric, size) if entry_of(strategy).fills(metric) else "") or "–"


def _measured(lines: pd.DataFrame, metric: str, size: float) -> str:
    if (metric, size) not in lines.index or not lines.loc[(metric, size), "n"]:
        return ""
    line = lines.loc[(metric, size)]
    text = interval_text(Estimate(line["mean"], line["ci_low"], line["ci_high"], int(line["n"])))
    low, high = (number_text(line[f"seed_{end}"], line["mean"]) for end in ("low", "high"))
    return f"{text} ({low}–{high})" if line["seeds"] > 1 else text


def interval_text(estimate: Estimate) -> str:
    """Mean with its interval."""
    mean, low, high = (number_text(value, estimate.mean) for value in (estimate.mean, estimate.low, estimate.high))
    return mean if math.isnan(estimate.low) else f"{mean} [{low}, {high}]"


def number_text(value: float, mean: float) -> str:
    """Value with as many digits as suit a mean of this size, as all tables show it."""
    digits = 1 if abs(mean) >= 100 else 2 if abs(mean) >= 10 else 3
    return f"{value:.{digits}f}".replace("-", "−")


def signed_text(value: float, digits: int = 0) -> str:
    """Value with its sign; a dash where it is no number."""
    return f"{value:+.{digits}f}".replace("-", "−") if math.isfinite(value) else "–"


def percent_text(share: Estimate) -> str:
    """A relative difference with its interval, in whole percent."""
    mean, low, high = (signed_text(100 * value) for value in (share.mean, share.low, share.high))
    return mean if math.isnan(share.low) else f"{mean} [{low}, {high}]"


def p_text(p: float) -> str:
    """A p-value; none is 0."""
    return "–" if math.isnan(p) else f"{p:.4f}" if p >= 0.00005 else "< 0.0001"


def _slashes(values: Sequence[float]) -> str:
    """One count where all are equal, else one a size."""
    return f"{values[0]:g}" if len(set(values)) == 1 else "/".join(f"{value:g}" for value in values)


def _pipes(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"
