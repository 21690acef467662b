"""A reference is told the truth: of what it does not plan for nothing is shown, in whatever a report writes."""

import csv
import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from handmade import record, with_spec

from explore_bench.analysis.metrics import METRICS, REGRETS
from explore_bench.analysis.tables import summary_table, trial_table
from explore_bench.report import render
from explore_bench.report.aggregates import survival_figure
from explore_bench.report.drawing import showing
from explore_bench.report.pages.sensitivity import sensitivity_figure
from explore_bench.report.tables import heading, mean_text, shown_by_world, shown_name
from explore_bench.strategies.registry import strategies
from explore_bench.world.scenario import Scenario

MAP = Scenario(size=20.0)
REFERENCES = ("clairvoyant", "clairvoyant-accurate")
NAMES = (
    "random",
    "uncertainty",
    "entropy",
    "nearest",
    "gcn-obs",
    "gcn-no-obs",
    "graph-stnn",
    "frontier-tour",
    *REFERENCES,
)
"""What Table 2 prints, a rule of others, so that there is a table of these, and both references."""

SHOWN = METRICS | {name: metric for name, (_, metric) in REGRETS.items()}
LABELS = {text: name for name in REFERENCES for text in (shown_name(name), strategies()[name].label)}
FOLDERS = {
    "paper": {"paper": MAP},
    "robustness": {"paper": MAP, "odometry noise × 4": MAP.replace(odometry_sigma=0.28)},
    "maps": {name: MAP.replace(map=("S" + "." * 9, *["." * 10] * 9)) for name in ("hall", "wall")},
}


def ended(name, trial, scenario_name="paper", scenario=MAP):
    """A trial of so many steps, every metric of which is defined."""
    steps = 81 + 10 * trial
    values = {"uncertainty": np.linspace(200.0, 100.0, steps), "peak_trace": np.full(steps, 0.25)}
    values |= {"explored": np.linspace(0.1, 0.95, steps)}
    made = record("explored", scenario, name, trial, **values)
    told = name in REFERENCES
    made = with_spec(made, reference=told, scenario_name=scenario_name)
    return dataclasses.replace(made, notes={"tour": 60.0, "bound": 40.0} if name == "clairvoyant" else {})


def records_of(folder):
    return [ended(name, trial, *item) for item in FOLDERS[folder].items() for name in NAMES for trial in range(3)]


@pytest.fixture(scope="module")
def trials():
    return trial_table(records_of("paper"))


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Return a function that reports a folder of handmade trials, without what needs their replays; and its tables."""
    monkeypatch.setattr(render, "write_figures", lambda *_: [])
    monkeypatch.setattr(render, "write_page", lambda _, path: path)
    monkeypatch.setattr(render, "_of_first_world", lambda *_: [])

    def write(folder):
        records = records_of(folder)
        monkeypatch.setattr(render, "read_trials", lambda *_: (trial_table(records), records, 0))
        render.write_report(tmp_path)
        return {path.stem: [*csv.reader(path.open(encoding="utf-8"))] for path in (tmp_path / "tables").glob("*.csv")}

    return write


def metric_of(words):
    """Metric that the words above a column, or before a row, name; None for what is no metric."""
    if words == "R":
        return "regret"
    for name, metric in SHOWN.items():
        for own in (heading(metric), metric.symbol):
            if words == own or words.startswith((f"{own} ", f"{own},")):
                return name
    return None


def cells_of_references(rows):
    """Every (reference, metric, cell) of a table; a reference stands nowhere but in the column of the method."""
    header, *lines = rows
    for line in lines:
        told = {column: LABELS[cell] for column, cell in zip(header, line, strict=True) if cell in LABELS}
        assert not told or list(told) == ["Method"], line
        for i, cell in enumerate(line):
            words = line[header.index("")] if "" in header else header[i - (header[i] == "ours")]
            metric = metric_of(words)
            is_value = "" not in header or i > header.index("")
            if told and metric and is_value and not header[i].endswith("paper"):
                yield told["Method"], metric, cell


@pytest.mark.parametrize(
    ("folder", "least"),
    [
        ("paper", {"table2", "means", "details", "paired", "robust", "wins", "field", "agreement", "order"}),
        ("robustness", {"sensitivity"}),
        ("maps", {"maps"}),
    ],
)
def test_no_table_that_a_report_writes_has_a_value_for_which_a_reference_does_not_plan(written, folder, least):
    tables = written(folder)
    assert least <= tables.keys()
    cells = {key: set(cells_of_references(rows)) for key, rows in tables.items()}
    assert any(cells.values())
    for key, found in cells.items():
        for name, metric, cell in found:
            assert cell == "–" or strategies()[name].fills(metric), (key, name, metric, cell)
    shown = {(key, name, metric) for key, found in cells.items() for name, metric, cell in found if cell != "–"}
    accurate = {
        (key, "clairvoyant-accurate", "trajectory_error") for key in least & {"means", "table2", "robust", "field"}
    }
    timely = {(key, "clairvoyant", "t90") for key in least & {"details", "robust", "field", "maps"}}
    assert accurate | timely <= shown, "what it plans for is there"


def test_the_survival_curves_of_a_reference_are_those_for_which_it_plans(trials):
    figure = survival_figure(trials, 20.0)
    drawn = [{line.get_label() for line in axes.get_lines()} for axes in figure.axes]
    told = set(map(shown_name, REFERENCES))
    assert [own & told for own in drawn] == [set(), set(), {shown_name("clairvoyant")}]
    assert all(shown_name("nearest") in own for own in drawn)
    assert {text.get_text() for text in figure.legends[0].get_texts()} & told == {shown_name("clairvoyant")}
    assert survival_figure(trials[trials["strategy"] == "clairvoyant-accurate"], 20.0) is None


def test_the_figure_of_the_sensitivity_has_the_reference_that_plans_for_it_alone():
    rows = trial_table(records_of("robustness"))
    figure = sensitivity_figure(rows)
    told = set(map(shown_name, REFERENCES))
    for axes in figure.axes:
        assert {line.get_label() for line in axes.get_lines()} & told == {shown_name("clairvoyant-accurate")}
    assert {text.get_text() for text in figure.legends[0].get_texts()} & told == {shown_name("clairvoyant-accurate")}
    assert sensitivity_figure(rows[rows["strategy"] == "clairvoyant"]) is None


def test_a_row_of_the_summary_without_a_mean_counts_the_worlds_of_a_reference(trials):
    """So that it is seen to have run; the paper's table takes its n from there."""
    summary = summary_table(trials).set_index(["strategy", "metric"])
    numbers = ["mean", "ci_low", "ci_high", "seed_low", "seed_high"]
    for name in REFERENCES:
        own = summary.loc[name]
        assert set(own["n"]) == {3} and set(own["failed"]) == {0}
        for metric, line in own.iterrows():
            assert math.isfinite(line["mean"]) == strategies()[name].fills(metric), metric
            assert strategies()[name].fills(metric) or line[numbers].isna().all()
        assert set(strategies()[name].plans) & set(own.index[own["mean"].notna()])
    assert summary.loc["nearest"]["mean"].notna().all()


def test_one_that_is_no_longer_registered_plans_for_nothing(trials):
    """It was told the truth when its trials ran; nobody knows what for."""
    rows = trials[trials["strategy"] == "nearest"].assign(strategy="oracle")
    assert len(shown_by_world(rows, "t90")) == 3
    told = with_spec(record(rows=3, strategy="oracle"), reference=True)
    with showing([told.spec]):
        assert shown_by_world(rows, "t90") == {}
        assert mean_text(rows, "t90") == "–"
    summary = summary_table(rows, {"oracle"})
    own = summary[summary["strategy"] == "oracle"]
    assert set(own["n"]) == {3} and own["mean"].isna().all()
    assert mean_text(pd.DataFrame(rows[:0]), "t90") == "–"
