"""How strategies degrade: ratios to the unchanged constants, from rows made by hand."""

import math

import numpy as np
import pandas as pd
import pytest

from explore_bench.analysis.statistics import mean_interval, ratio_interval
from explore_bench.report.pages.sensitivity import (
    sensitivity_figure,
    sensitivity_table,
    variations_of,
    write_sensitivity,
)

BASE = np.array([1.0, 2.0, 3.0, 5.0])


def rows(scenario, errors, strategy="nearest", status="explored"):
    return [
        {
            "strategy": strategy,
            "training_seed": None,
            "size": 20.0,
            "trial": trial,
            "scenario": scenario,
            "status": status,
            "trajectory_error": error,
            "exploration_efficiency": 1.0 / error,
        }
        for trial, error in enumerate(errors)
    ]


@pytest.fixture
def trials():
    """The paper's constants, four times the noise with half the worlds, and a scenario that no suite knows."""
    made = rows("paper", BASE) + rows("odometry noise × 4", [4.0, 6.0]) + rows("mine", BASE, status="stuck")
    return pd.DataFrame(made + rows("paper", BASE, "random"))


def cells(table, label, metric):
    [row] = [row for row in table.rows if row[0] == label and row[2] == metric]
    return dict(zip(table.header, row, strict=True))


def test_variations_come_in_the_order_of_the_suite(trials):
    assert variations_of(trials) == ["paper", "odometry noise × 4", "mine"]


def test_a_ratio_is_of_the_worlds_that_both_have(trials):
    row = cells(sensitivity_table(trials), "Nearest", "e [m]")
    base, ratio = mean_interval(BASE), ratio_interval(np.array([4.0, 6.0]), BASE[:2])
    assert row["mean, paper"] == f"{base.mean:.3f} [{base.low:.3f}, {base.high:.3f}]"
    assert row["odometry noise × 4: ratio"] == f"{ratio.mean:.3f} [{ratio.low:.3f}, {ratio.high:.3f}]"
    assert row["mine: ratio"] == "1.000 [1.000, 1.000]"


def test_trials_that_did_not_explore_are_counted_beside(trials):
    trials.loc[:2, "status"] = ["stuck", "step_limit", "failed"]
    row = cells(sensitivity_table(trials), "Nearest", "trials not explored")
    assert [*row.values()][3:] == ["3 of 4", "0 of 2", "4 of 4"]


def test_what_did_not_run_or_is_not_defined_has_a_dash(trials):
    row = cells(sensitivity_table(trials), "Random", "e [m]")
    assert row["mean, paper"] != "–"
    assert row["mine: ratio"] == row["odometry noise × 4: ratio"] == "–"
    trials.loc[0, "exploration_efficiency"] = math.nan
    assert set([*cells(sensitivity_table(trials), "Nearest", "η [m²/step]").values()][3:]) == {"–"}


def test_without_the_unchanged_constants_there_are_no_ratios(trials):
    row = cells(sensitivity_table(trials[trials["scenario"] != "paper"]), "Nearest", "e [m]")
    assert set([*row.values()][3:]) == {"–"}


def test_the_figure_has_a_column_for_every_constant_that_varies(trials):
    figure = sensitivity_figure(trials)
    axes = figure.get_axes()
    assert len(axes) == 2
    [line] = [own for own in axes[0].get_lines() if own.get_label() == "Nearest"]
    np.testing.assert_allclose(line.get_xdata(), [0.07, 0.28])
    np.testing.assert_allclose(line.get_ydata(), [BASE.mean(), 5.0])
    assert sensitivity_figure(trials[trials["scenario"] != "odometry noise × 4"]) is None


def test_table_and_figure_are_written_with_the_same_bytes_twice(trials, tmp_path):
    first = {path: path.read_bytes() for path in write_sensitivity(trials, tmp_path)}
    assert {path.name for path in first} >= {"sensitivity.md", "sensitivity.svg"}
    assert first == {path: path.read_bytes() for path in write_sensitivity(trials, tmp_path)}


def test_the_figure_shows_the_means_that_the_table_tells(trials):
    """Over worlds, however many trials one has, and none where one of them has no value."""
    twice = pd.DataFrame(rows("odometry noise × 4", [4.0]))
    figure = sensitivity_figure(pd.concat((trials, twice), ignore_index=True))
    line = next(line for line in figure.axes[0].lines if line.get_label() == "Nearest")
    assert line.get_ydata().tolist() == [BASE.mean(), 5.0]
    trials.loc[trials["scenario"] == "odometry noise × 4", "trajectory_error"] = [4.0, math.nan]
    line = next(line for line in sensitivity_figure(trials).axes[0].lines if line.get_label() == "Nearest")
    assert math.isnan(line.get_ydata()[1])
