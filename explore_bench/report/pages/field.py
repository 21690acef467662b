"""The rules of others (suites `field` and `field-stage`): which one to use, at what price, and which of its terms help.

What a rule's controls show is a claim like any other; here are all of a folder's in one figure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from explore_bench.analysis.claims import CONTRADICTED, SUPPORTED, Claim, Finding, metric_of
from explore_bench.analysis.metrics import REGRETS, all_metrics
from explore_bench.analysis.ranking import Place, Standing, places_of, ranking_metrics, standings
from explore_bench.analysis.tables import by_world, own_metrics
from explore_bench.analysis.times import every_decision_ms
from explore_bench.report.drawing import entry_of, plain_log, save_all, styled
from explore_bench.report.tables import Scope, Table, heading, mean_text, shown_name
from explore_bench.runs.suites import FAMILIES
from explore_bench.strategies.registry import in_order

LANDMARK_METRICS = ("trajectory_error", "exploration_efficiency", "t90", "path_length")
LIDAR_METRICS = ("l90", "t98_seconds", "t90_seconds", "path_length", "trajectory_error", "absolute_trajectory_error")
FURTHER_METRICS = ("crossings", "round_trips")
TIMES = ("decision, median [ms]", "99 % [ms]", "slowest [ms]")

FAMILY_COLORS = dict(zip(FAMILIES, ("#1f77b4", "#2ca02c", "#9467bd", "#d62728", "#ff7f0e", "#7f7f7f"), strict=True))
NOTE = (
    "Best first: by the mean, over the metrics that rank here, scenarios and sizes, of the logarithm of their means; "
    "references, which are told the true world, come last. Mean over n worlds [95 % BCa bootstrap interval], training "
    "seeds averaged within a world first. Stuck: share of trials in which no candidate could be reached. "
    "Decisions, from times.csv, of one machine, other in another run: the median over the trials of a trial's "
    "median, the time that 99 % of all decisions stayed below, and the slowest of all, often the first of a process."
)
REGRET_NOTE = (
    " R: regret, mean to the fastest tour known and to a lower bound on the time; the regret to the fastest way there "
    "is lies between these."
)


def is_rule(name: str) -> bool:
    """Whether a strategy takes part in the suites of the field and in no table of the paper."""
    entry = entry_of(name)
    return not entry.tables and bool(FAMILIES.keys() & set(entry.suites))


def family_of(name: str) -> str | None:
    """Family of FAMILIES that a strategy belongs to; None for one that takes no part in the suites of the field."""
    return next((suite for suite in entry_of(name).suites if suite in FAMILIES), None)


def terms_of(found: Mapping[Claim, list[Finding]]) -> dict[Claim, list[Finding]]:
    """Claims of rules and what they are measured by, of all of a folder's those that were measured."""
    own = {
        claim: [one for one in findings if one.n]
        for claim, findings in found.items()
        if claim.comparisons and all(is_rule(one.better) for one in claim.comparisons)
    }
    return {claim: findings for claim, findings in own.items() if findings}


def field_tables(trials: pd.DataFrame, times: pd.DataFrame | None) -> dict[str, Table]:
    """Tables by the names of their files; none where no rule of the field ran."""
    if not any(map(is_rule, dict.fromkeys(trials["strategy"]))):
        return {}
    return {"field": field_table(trials, times)}


def write_field_figures(trials: pd.DataFrame, found: Mapping[Claim, list[Finding]], folder: Path) -> list[Path]:
    """Draw `field` and `field-terms` where rules of the field ran, and remove what an earlier report left elsewhere."""
    shown = any(map(is_rule, dict.fromkeys(trials["strategy"])))
    terms = terms_of(found)
    with styled():
        return [
            *save_all(field_figure(trials) if shown else None, folder / "field"),
            *save_all(terms_figure(terms) if terms else None, folder / "field-terms"),
        ]


def field_table(trials: pd.DataFrame, times: pd.DataFrame | None) -> Table:
    """Every strategy in every scenario and size, best strategy first: how it explored and what its decisions took.

    Parameters
    ----------
    times : rows of `times.csv`; without any, or without a trial's, dashes stand in the place of its times.
    """
    lidar = bool(own_metrics(trials))
    known, places = all_metrics(), places_of(trials)
    several = len({scenario for scenario, _ in places}) > 1
    metrics = LIDAR_METRICS if lidar else LANDMARK_METRICS
    header = ["Method", *(["scenario"] if several else []), "size [m]", "n", "not explored", "stuck [%]"]
    header += [heading(known[name]) for name in metrics] + ([] if lidar else ["R"])
    header += [known[name].symbol for name in FURTHER_METRICS] + list(TIMES)
    groups = dict(list(trials.groupby(["strategy", "scenario", "size"])))
    rows, scopes = [], []
    ranked = [own.strategy for own in _ranking(trials)]
    told = [name for name in in_order(trials["strategy"]) if entry_of(name).reference and name not in ranked]
    for name in (*ranked, *told):
        for scenario, size in places:
            if (cell := groups.get((name, scenario, size))) is None:
                continue
            counts = cell["status"].value_counts()
            row = [shown_name(name), *([scenario] if several else []), f"{size:g}"]
            row += [str(cell["trial"].nunique()), str(len(cell) - counts.get("explored", 0))]
            row.append(f"{100 * counts.get('stuck', 0) / len(cell):.1f}")
            row += [mean_text(cell, metric) for metric in metrics] + ([] if lidar else [_regret(cell)])
            row += [mean_text(cell, metric) for metric in FURTHER_METRICS] + _decisions(cell, times)
            rows.append(tuple(row))
            scopes.append(Scope((name,), size))
    note = NOTE + ("" if lidar else REGRET_NOTE)
    return Table("Rules of others beside the compared methods", tuple(header), tuple(rows), note, tuple(scopes))


def _ranking(trials: pd.DataFrame) -> list[Standing]:
    return standings(trials, {name for name in dict.fromkeys(trials["strategy"]) if entry_of(name).reference})


def _regret(cell: pd.DataFrame) -> str:
    """Mean regret to the fastest tour known and to the lower bound, as docs/clairvoyant.md has it."""
    planned = [name for name in REGRETS if entry_of(str(cell["strategy"].iloc[0])).fills(name)]
    means = [np.mean(list(by_world(cell, name).values())) for name in planned]
    return " to ".join(f"{mean:.2f}" for mean in means if math.isfinite(mean)) or "–"


def _decisions(cell: pd.DataFrame, times: pd.DataFrame | None) -> list[str]:
    """TIMES of some trials."""
    if times is None:
        return ["–"] * len(TIMES)
    first = cell.iloc[0]
    own = times[(times["strategy"] == first["strategy"]) & (times["size"] == first["size"])]
    own = own[(own["scenario"] == first["scenario"]) & own["trial"].isin(cell["trial"])]
    every = every_decision_ms(own)
    values = (own["decision_ms"].median(), np.quantile(every, 0.99) if len(every) else math.nan)
    return [_milliseconds(value) for value in (*values, own["decision_ms_max"].max())]


def _milliseconds(value: float) -> str:
    return "–" if not math.isfinite(value) else f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def field_figure(trials: pd.DataFrame) -> Figure:
    """The strategies, best first, and their means of the metrics that rank, a column a metric, scenario and size."""
    known, shown = all_metrics(), _ranking(trials)
    columns = [(metric, place) for metric in ranking_metrics(trials) for place in places_of(trials)]
    figure, panels = _panels(columns, [shown_name(own.strategy) for own in shown])
    for (metric, place), axes in zip(columns, panels, strict=True):
        for line, own in enumerate(shown):
            mean = own.means.get((place, metric))
            if mean is not None and mean.mean > 0:
                color, marker, filled = _mark(own.strategy)
                _interval(axes, line, (mean.mean, mean.low, mean.high), color, marker, filled=filled)
        axes.set_xlabel("◂ better" if known[metric].better == "lower" else "better ▸", fontsize=8)
    marks = _legend([own.strategy for own in shown])
    figure.legend(handles=marks, loc="outside lower center", ncols=min(len(marks), 5), fontsize=8, handlelength=1.0)
    return figure


def _panels(
    columns: Sequence[tuple[str, Place]], labels: Sequence[str], *, sharex: bool = False
) -> tuple[Figure, list[Axes]]:
    """Figure with a line for each label, on the left, and a panel for each metric and place."""
    figure, grid = plt.subplots(
        *(1, len(columns)),
        figsize=(4.0 + 1.7 * len(columns), 1.6 + 0.22 * len(labels)),
        sharex=sharex,
        sharey=True,
        squeeze=False,
    )
    several = len({scenario for _, (scenario, _) in columns}) > 1
    for axes, (metric, (scenario, size)) in zip(grid[0], columns, strict=True):
        where = scenario if several else f"{size:g} m"
        axes.set(title=f"{all_metrics()[metric].symbol}, {where}", xscale="log")
        plain_log(axes.xaxis)
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
        axes.xaxis.set_tick_params(labelsize=7)
    grid[0, 0].set_yticks(range(len(labels)), labels)
    grid[0, 0].set_ylim(len(labels) - 0.5, -0.5)
    return figure, list(grid[0])


def _interval(
    axes: Axes, line: int, ends: tuple[float, float, float], color: str, marker: str = "o", *, filled: bool
) -> None:
    """A mean and the ends of its interval, NaN where it has none, on a line."""
    mean, low, high = ends
    axes.errorbar(
        *([mean], [line]),
        xerr=[[mean - low], [high - mean]] if math.isfinite(low) else None,
        fmt=marker,
        ms=4.5,
        color=color,
        mfc=color if filled else "white",
        elinewidth=1.0,
    )


def _mark(name: str) -> tuple[str, str, bool]:
    """Colour of a strategy's family, marker of where it is from, and whether it is filled."""
    entry = entry_of(name)
    color = FAMILY_COLORS.get(family_of(name) or "", "#000000")
    if entry.reference:
        return color, "*", True
    if not entry.tables:
        return color, "o", False
    return (color, "s", True) if entry.published or entry.baseline else (color, "D", True)


def _legend(names: list[str]) -> list[Line2D]:
    """What colours and markers mean, of those that are there."""
    ran = {family_of(name) for name in names}
    colors = [
        Line2D([], [], linestyle="none", marker="o", color=FAMILY_COLORS[family], label=words)
        for family, words in FAMILIES.items()
        if family in ran
    ]
    words = {("s", True): "the paper's, and the nearest", ("D", True): "ours", ("o", False): "of others"}
    words[("*", True)] = "told the true world"
    used = dict.fromkeys(_mark(name)[1:] for name in names)
    return colors + [
        Line2D([], [], linestyle="none", marker=mark[0], color="#444", mfc="#444" if mark[1] else "white", label=text)
        for mark, text in words.items()
        if mark in used
    ]


def terms_figure(found: Mapping[Claim, list[Finding]]) -> Figure:
    """How many times as good each rule is as each of its controls, with 95 % intervals, a column a metric and size.

    The claims are of one scenario a column. Filled where it is shown after Holm's correction over the rule's claim.
    """
    cells: dict[tuple[str, str], dict[tuple[str, Place], Finding]] = {}
    for claim, findings in found.items():
        for one in findings:
            asked = one.comparison
            if asked.size is not None:
                row = cells.setdefault((asked.better, asked.worse), {})
                row[asked.metric, (claim.scenario, asked.size)] = one
    columns = list(dict.fromkeys(key for row in cells.values() for key in row))
    figure, panels = _panels(columns, [_beside(rule, control) for rule, control in cells], sharex=True)
    for axes, key in zip(panels, columns, strict=True):
        axes.axvline(1.0, color="#444", linewidth=0.9)
        for line, ((rule, _), row) in enumerate(cells.items()):
            if key in row:
                _gain(axes, line, row[key], FAMILY_COLORS[family_of(rule) or next(iter(FAMILY_COLORS))])
    figure.supxlabel("times as good as what it is measured by: right of 1 it is better", fontsize=9)
    return figure


def _beside(rule: str, control: str) -> str:
    """Labels of a rule and its control, what they have in common once."""
    label = shown_name(rule)
    return f"{label} : {shown_name(control).removeprefix(label + ', ')}"


def _gain(axes: Axes, line: int, finding: Finding, color: str) -> None:
    """How many times as good a rule is as a control, from the ratio of their means."""
    share = finding.relative
    ends = np.array([1.0 + share.mean, 1.0 + share.low, 1.0 + share.high])
    if not np.isfinite(ends).all() or (ends <= 0).any():
        return
    mean, *reach = ends if metric_of(finding.comparison).better == "higher" else 1.0 / ends
    shown = finding.verdict.startswith((SUPPORTED, CONTRADICTED))
    _interval(axes, line, (mean, *sorted(reach)), color, filled=shown)
