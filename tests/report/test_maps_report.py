"""Strategies in given maps: means by map from rows made by hand, and the figure of the ways through them."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from handmade import TINY, record

from explore_bench.analysis.statistics import mean_interval
from explore_bench.report.pages.maps import maps_figure, maps_table, write_map_report
from explore_bench.report.render import _write_ways
from explore_bench.world.landmark.world import LandmarkWorld

ERRORS = np.array([1.0, 2.0, 3.0, 5.0])
MAPS = {"hall": ("......",) * 6, "wall": ("......", "......", "..##..", "......", "......", "......")}


def rows(name, errors, strategy="nearest", status="explored"):
    return [
        {
            "strategy": strategy,
            "training_seed": None,
            "size": 12.0,
            "trial": trial,
            "scenario": name,
            "status": status,
            "trajectory_error": error,
            "exploration_efficiency": 1.0 / error,
            "t90": 100.0 * error,
            "explored": 0.9,
        }
        for trial, error in enumerate(errors)
    ]


@pytest.fixture
def trials():
    made = rows("hall", ERRORS) + rows("wall", 2 * ERRORS, status="stuck") + rows("hall", ERRORS, "random")
    return pd.DataFrame(made)


@pytest.fixture
def records():
    """Two strategies in two maps, two worlds each; the robot of the second strategy never moved in the wall."""
    made = []
    for name, cells in MAPS.items():
        scenario = TINY.replace(map=cells)
        obstacles = np.array([[one == "#" for one in row] for row in cells])[::-1]
        for strategy in ("nearest", "random"):
            for trial in range(2):
                one = record(scenario=scenario, strategy=strategy, trial=trial, true_x=[1.0, 3.0], true_y=[1.0, 1.0])
                spec = dataclasses.replace(one.spec, scenario_name=name)
                start, uncounted = (1.0, 1.0, 0.0), np.array([35])
                world = LandmarkWorld(scenario.grid, obstacles.copy(), np.array([[5.0, 5.0]]), start, uncounted)
                made.append(dataclasses.replace(one, spec=spec, world=world))
    return made


def cells(table, label, metric):
    [row] = [row for row in table.rows if row[:2] == (label, metric)]
    return dict(zip(table.header, row, strict=True))


def test_a_row_holds_the_means_of_a_metric_in_every_map(trials):
    table = maps_table(trials)
    assert table.header == ("Method", "", "hall", "wall")
    row, mean = cells(table, "Nearest", "e [m]"), mean_interval(2 * ERRORS)
    assert row["wall"] == f"{mean.mean:.3f} [{mean.low:.3f}, {mean.high:.3f}]"
    assert cells(table, "Nearest", "T90 [step]")["hall"].startswith("275.0 [")
    assert cells(table, "Nearest", "c")["hall"].startswith("0.900")


def test_what_did_not_run_has_a_dash_and_what_did_not_explore_is_counted(trials):
    trials.loc[:2, "status"] = ["stuck", "step_limit", "failed"]
    table = maps_table(trials)
    assert cells(table, "Random", "e [m]")["wall"] == "–"
    assert cells(table, "Random", "trials not explored")["wall"] == "–"
    assert cells(table, "Nearest", "trials not explored") | {} == {
        "Method": "Nearest",
        "": "trials not explored",
        "hall": "3 of 4",
        "wall": "4 of 4",
    }


def test_a_mean_that_is_not_defined_is_a_dash(trials):
    trials.loc[0, "exploration_efficiency"] = np.nan
    assert cells(maps_table(trials), "Nearest", "η [m²/step]")["hall"] == "–"


def test_the_figure_has_a_panel_a_map_with_a_way_a_strategy(records):
    figure = maps_figure(records)
    panels = [axes for axes in figure.get_axes() if axes.get_title()]
    assert [axes.get_title() for axes in panels] == ["hall", "wall"]
    for axes in panels:
        ways = [line for line in axes.get_lines() if line.get_linestyle() != "None"]
        assert len(ways) == 2, "one world of each strategy"
        assert axes.get_xlim() == (0.0, 12.0)
        uncounted, obstacles = axes.patches
        assert len(uncounted.get_path().vertices) == 5
        assert len(obstacles.get_path().vertices) == (0 if axes.get_title() == "hall" else 10)


def test_without_steps_there_is_no_figure(records):
    empty = [dataclasses.replace(one, steps={**one.steps, "step": np.empty(0)}) for one in records]
    assert maps_figure(empty) is None
    assert maps_figure([]) is None


def test_table_and_figure_are_written_with_the_same_bytes_twice(trials, records, tmp_path):
    first = {path: path.read_bytes() for path in write_map_report(trials, records, tmp_path)}
    assert {path.name for path in first} >= {"maps.md", "maps.csv", "maps.tex", "maps.svg", "maps.png"}
    assert first == {path: path.read_bytes() for path in write_map_report(trials, records, tmp_path)}


def test_the_ways_through_a_map_without_landmarks_have_none_in_the_legend(records):
    bare = [
        dataclasses.replace(one, world=dataclasses.replace(one.world, landmarks=np.empty((0, 2)))) for one in records
    ]
    legends = [[text.get_text() for text in maps_figure(own).legends[0].get_texts()] for own in (records, bare)]
    assert legends == [["Random", "Nearest", "landmark"], ["Random", "Nearest"]]


@pytest.mark.parametrize("count", [1, 2])
def test_a_report_of_one_map_draws_the_ways_through_it_and_one_of_several_does_not(records, tmp_path, count):
    own = [one for one in records if one.spec.scenario_name in list(MAPS)[:count]]
    store = SimpleNamespace(find=lambda spec: next(one for one in own if one.spec == spec))
    files = _write_ways(store, own, tmp_path / "ways")
    assert [file.name for file in files] == (["ways.svg", "ways.png"] if count == 1 else [])
    assert all(file.stat().st_size > 3000 for file in files)
