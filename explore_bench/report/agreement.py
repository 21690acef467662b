"""Every number that the paper prints beside ours: ratio, interval, and whether the order of the strategies agrees."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pandas as pd

from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.statistics import Estimate, order_agreement
from explore_bench.analysis.tables import of_paper
from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import (
    PAPER_METRICS,
    PAPER_TABLES,
    Scope,
    Table,
    heading,
    interval_text,
    shown_by_world,
    shown_name,
)
from explore_bench.world.scenarios import PAPER


def agreement_tables(trials: pd.DataFrame, summary: pd.DataFrame) -> dict[str, Table]:
    """Tables by the names of their files; none for trials of another scenario than the paper's."""
    if not of_paper(trials):
        return {}
    return {"agreement": agreement_table(summary), "order": order_table(trials), "constants": constants_table()}


def agreement_table(summary: pd.DataFrame) -> Table:
    """Every number that the paper prints, ours with its interval, and the ratio of the two."""
    header = ("table", "Method", "size [m]", "metric", "paper", "ours", "ours / paper", "n")
    rows, scopes = [], []
    for line in summary[summary["paper"].notna()].itertuples():
        planned = entry_of(str(line.strategy)).fills(str(line.metric))
        measured = line.n > 0 and planned
        estimate = Estimate(line.mean, line.ci_low, line.ci_high, line.n)
        ratio = Estimate(line.mean / line.paper, line.ci_low / line.paper, line.ci_high / line.paper, line.n)
        scopes.append(Scope((str(line.strategy),), float(line.size)))
        absent = "–" if not planned else "not run" if entry_of(str(line.strategy)).ready else "not trained"
        rows.append(
            (
                str(line.table).replace("table", "Table "),
                shown_name(str(line.strategy)),
                f"{line.size:g}",
                heading(METRICS[str(line.metric)]),
                f"{line.paper:.4f}",
                interval_text(estimate) if measured else absent,
                interval_text(ratio) if measured else "–",
                str(line.n),
            )
        )
    note = "The interval is that of our mean over worlds; the paper prints none."
    return Table("Paper against measured", header, tuple(rows), note, tuple(scopes))


def order_table(trials: pd.DataFrame) -> Table:
    """Kendall's τ between the order of the strategies in the paper and in our means, by table, size and metric."""
    header = ("table", "size [m]", "metric", "strategies", "Kendall's τ", "paper, best first", "ours, best first")
    rows = []
    for table, metric in itertools.product(PAPER_TABLES, PAPER_METRICS):
        for size in sorted(set(trials["size"])):
            values = _measured(trials, table, size, metric)
            if len(values) < 2:
                continue
            paper = {name: entry_of(name).published[table, size, metric] for name in values}
            sign = 1.0 if METRICS[metric].better == "lower" else -1.0
            ours = {name: sign * float(own.mean()) for name, own in values.items()}
            wanted = {name: sign * value for name, value in paper.items()}
            tau = order_agreement(list(wanted.values()), sign * np.array(list(values.values())))
            orders = (
                ", ".join(entry_of(name).label for name in sorted(of, key=of.__getitem__)) for of in (wanted, ours)
            )
            rows.append(
                (
                    table.replace("table", "Table "),
                    f"{size:g}",
                    heading(METRICS[metric]),
                    str(len(values)),
                    interval_text(tau),
                    *orders,
                )
            )
    note = (
        "Of the strategies that the paper prints and that ran, on the worlds that all of them tried: 1 is the same "
        "order, −1 the reverse [what τ is where every pair whose difference is not shown, by a permutation test paired "
        "by world with Holm's correction over the pairs, stands the other way than in the paper, or as there; it is "
        "itself an end where no such pair could move it further]."
    )
    return Table("Order of the strategies, paper against measured", header, tuple(rows), note)


def _measured(trials: pd.DataFrame, table: str, size: float, metric: str) -> dict[str, np.ndarray]:
    """Values of the strategies that the paper prints there, on the worlds that all of them tried, shape (n,) each."""
    here = trials[trials["size"] == size]
    values = {
        str(name): shown_by_world(own, metric)
        for name, own in here.groupby("strategy")
        if (table, size, metric) in entry_of(str(name)).published
    }
    finite = {name: own for name, own in values.items() if own and all(map(math.isfinite, own.values()))}
    worlds = sorted(set.intersection(*(set(own) for own in finite.values()))) if finite else []
    return {name: np.array([own[world] for world in worlds]) for name, own in finite.items()} if worlds else {}


def constants_table() -> Table:
    """Constants of the simulation that the paper leaves out, with our values and where they come from."""
    rows = tuple(
        (name, str(getattr(PAPER, name)), field.description or "")
        for name, field in type(PAPER).model_fields.items()
        if field.description and "§" not in field.description and getattr(PAPER, name) is not None
    )
    note = (
        "Those marked (calibrated) were fitted to the paper's untrained strategies, see docs/calibration.md; what it "
        "leaves out of the learning, the reward's weights among it, is in docs/learning.md."
    )
    return Table("Constants that the paper leaves out", ("constant", "value", "meaning and source"), rows, note)
