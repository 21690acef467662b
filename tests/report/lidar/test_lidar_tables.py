"""The tables of lidar trials: a row a strategy and scenario, differences to the baseline, and what a reader sees."""

import numpy as np
import pytest
from handmade import with_spec
from handmade_lidar import lidar_record, perfect_map
from lidar_worlds import drawn
from matplotlib.colors import same_color

from explore_bench.analysis.statistics import mean_interval
from explore_bench.analysis.tables import TRIAL_COLUMNS, summary_table, trial_table
from explore_bench.report.aggregates import aggregate_tables
from explore_bench.report.agreement import agreement_tables
from explore_bench.report.drawing import entry_of
from explore_bench.report.lidar.figures import ranking
from explore_bench.report.lidar.tables import paired_table, stage_table, tables
from explore_bench.report.tables import kind_tables, report_tables

WORLD = drawn(8.0, (3.0, 4.0, 0.1, 5.0), start=(1.0, 1.0, 0.0))


def trial(seconds, strategy="nearest", number=0, name="stage", status="explored", **options):
    """A trial of four rows that knows 90 % after half of its time and all after it."""
    times = np.array([0.0, 0.25, 0.5, 1.0]) * seconds
    way = 0.5 * times
    made = lidar_record(
        status,
        strategy=strategy,
        trial=number,
        name=name,
        world=WORLD,
        fine_map=perfect_map(WORLD),
        **{
            "explored": [0.2, 0.5, 0.92, 0.99],
            "seconds": times,
            "path_length": way,
            "true_x": way,
            "x": [1.0] * 4,
            "y": [1.0] * 4,
            "decisions": [0, 1, 2, 4],
            "final": {"final_x": way, "final_y": [0.0] * 4, "final_heading": [0.0] * 4},
        }
        | options,
    )
    return with_spec(made, reference=False)


def row(table, *key):
    [found] = [dict(zip(table.header, own, strict=True)) for own in table.rows if own[: len(key)] == key]
    return found


@pytest.fixture(scope="module")
def trials():
    made = [trial(100 + 20 * n, number=n) for n in range(3)]
    made += [trial(150 + 30 * n, "random", n) for n in range(3)]
    made += [trial(60 + 20 * n, number=n, name="range 5 m") for n in range(3)]
    made += [trial(60, "random", 0, name="range 5 m")]
    return trial_table(made)


def test_there_is_a_row_a_strategy_and_scenario_with_means_and_intervals(trials):
    table = stage_table(trials)
    assert sorted(own[:2] for own in table.rows) == [
        ("Nearest", "range 5 m"),
        ("Nearest", "stage"),
        ("Random", "range 5 m"),
        ("Random", "stage"),
    ]
    own, expected = row(table, "Nearest", "stage"), mean_interval(np.array([100.0, 120.0, 140.0]))
    assert (own["n"], own["not explored"]) == ("3", "0")
    assert own["T98 [s]"] == f"120.0 [{expected.low:.1f}, {expected.high:.1f}]"
    assert own["T90 [s]"].startswith("60.00 [")
    assert own["L90 [m]"].startswith("30.00 [")
    assert own["wall F1, 1 cell"] == "1.000 [1.000, 1.000]"
    assert row(table, "Random", "range 5 m")["T98 [s]"] == "60.00", "one world has no interval"


def test_differences_are_to_the_baseline_by_scenario_over_the_worlds_that_both_tried(trials):
    table = paired_table(trials)
    assert [own[:5] for own in table.rows] == [
        ("Random", "Nearest", "range 5 m", "8", "1"),
        ("Random", "Nearest", "stage", "8", "3"),
    ]
    expected = mean_interval(np.array([50.0, 60.0, 70.0]))
    assert row(table, "Random", "Nearest", "stage")["T98 [s]"] == (
        f"{expected.mean:.2f} [{expected.low:.2f}, {expected.high:.2f}]"
    )
    assert row(table, "Random", "Nearest", "range 5 m")["T98 [s]"] == "0.000"


def test_the_figure_has_the_mean_of_every_strategy_in_its_colour_and_an_interval_where_two_worlds_tell_one(trials):
    figure = ranking(trials[trials["trial"] < 2])
    names = [label.get_text().lower() for label in figure.axes[0].get_yticklabels()]
    axes = {axes.get_title(): axes for axes in figure.axes}
    for title, wanted in (
        ("stage, 8 m", {"nearest": (27.5, True), "random": (41.25, True)}),
        ("range 5 m, 8 m", {"nearest": (17.5, True), "random": (15.0, False)}),
    ):
        for bar, name in zip(axes[title].containers, names, strict=True):
            assert (bar[0].get_xdata()[0], bar.has_xerr) == wanted[name]
            assert same_color(bar[0].get_color(), entry_of(name).color)


def test_without_the_baseline_there_is_no_table_of_differences(trials):
    assert list(tables(trials)) == ["stage", "stage-paired"]
    assert list(tables(trials[trials["strategy"] == "random"])) == ["stage"]


def test_a_reference_is_measured_by_nobody(trials, monkeypatch):
    from explore_bench.report import drawing

    with drawing.showing([with_spec(trial(60, "random"), reference=True).spec]):
        assert paired_table(trials).rows == ()
        assert "Random (reference)" in {own[0] for own in stage_table(trials).rows}


def test_what_is_missing_is_a_dash_and_never_nan():
    """A trial that broke off, one without a map, and one that shares no world with the baseline."""
    made = [
        *(trial(100, number=n) for n in range(2)),
        trial(100, number=2, status="stuck"),
        trial(100, number=3, status="step_limit"),
        lidar_record("failed", rows=0, strategy="random", trial=7, world=WORLD),
    ]
    rows = trial_table(made)
    shown = tables(rows)
    assert row(shown["stage"], "Nearest")["ATE [m]"] == "–"
    assert row(shown["stage"], "Random")["wall F1, 1 cell"] == "–"
    assert row(shown["stage"], "Nearest")["not explored"] == "2"
    assert row(shown["stage"], "Random")["not explored"] == "1"
    assert set(row(shown["stage-paired"], "Random").values()) == {"Random", "Nearest", "stage", "8", "0", "–"}
    for table in every_table(made).values():
        assert "nan" not in table.markdown() + table.csv()


def every_table(records):
    rows = trial_table(records)
    summary = summary_table(rows)
    return (
        kind_tables(records, rows)
        | report_tables(rows, summary)
        | agreement_tables(rows, summary)
        | aggregate_tables(rows)
    )


def test_no_table_shows_a_trajectory_error_without_the_way_it_was_made_on():
    found = every_table([trial(100 + n, name_, n) for n in range(2) for name_ in ("nearest", "random")])
    with_ate = [table for table in found.values() if "ATE [m]" in table.header]
    assert len(with_ate) >= 3
    assert all("L [m]" in table.header for table in with_ate)


def test_what_the_paper_prints_stands_nowhere_beside_trials_in_lidar_worlds():
    found = every_table([trial(100 + n, name_, n) for n in range(2) for name_ in ("nearest", "random")])
    assert not found.keys() & {"table2", "table3", "agreement", "order", "constants"}
    text = "".join(table.markdown() for table in found.values())
    assert "1.9614" not in text
    assert "paper" not in text.lower()


def test_a_row_of_trials_csv_has_the_metrics_of_the_kind_after_the_common_columns(trials):
    own = len(TRIAL_COLUMNS)
    assert list(trials.columns)[own - 1 : own + 2] == ["reason", "simulated_seconds", "t90_seconds"]
    assert {"crossings", "round_trips"} <= set(TRIAL_COLUMNS)
    assert trials["wall_f1_1"].notna().all()


def test_all_of_it_can_be_written_as_latex(trials):
    for table in tables(trials).values():
        assert table.latex().isascii(), sorted({c for c in table.latex() if not c.isascii()})
