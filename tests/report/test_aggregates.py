"""Interquartile means, times to coverage and wins, from rows made by hand."""

import math

import numpy as np
import pandas as pd

from explore_bench.analysis.statistics import interquartile_mean_interval
from explore_bench.report.aggregates import (
    aggregate_tables,
    coverage_survival,
    robust_table,
    wins_table,
    write_survival_figures,
)

LIMIT = 1000


def trial(strategy, number, t90=100, explored=0.9, steps=None, error=1.0, efficiency=1.0, seed=None):
    return {
        "strategy": strategy,
        "training_seed": seed,
        "size": 20.0,
        "trial": number,
        "explored": explored,
        "steps": t90 if steps is None else steps,
        "t50": 10.0,
        "t80": min(50.0, float(t90)),
        "t90": float(t90),
        "trajectory_error": error,
        "exploration_efficiency": efficiency,
    }


def frame(*rows):
    return pd.DataFrame(rows).astype({"training_seed": "Int64"})


STUCK = {"t90": LIMIT, "explored": 0.85, "steps": 60}
"""A trial that got stuck after 60 steps knowing 85 % of the map."""


def test_a_trial_that_ended_before_never_reached_it():
    """Of 40, stuck at 60, 80 and 100: at 40 a quarter is done, at 80 half, and the stuck one never."""
    cell = frame(
        trial("nearest", 0, 40), trial("nearest", 1, **STUCK), trial("nearest", 2, 80), trial("nearest", 3, 100)
    )
    curve = coverage_survival(cell, "t90")
    assert dict(zip(curve.times.tolist(), curve.shares.tolist(), strict=True)) == {40.0: 0.75, 80.0: 0.5, 100.0: 0.25}
    assert curve.median == 80.0
    assert coverage_survival(cell, "t80").median == 50.0


def test_a_strategy_that_crashes_four_times_of_five_has_no_median_time():
    cell = frame(
        *(trial("nearest", i, LIMIT, 0.1, 10) for i in range(40)), *(trial("nearest", i) for i in range(40, 50))
    )
    assert coverage_survival(cell, "t90").median == math.inf
    assert robust_table(cell).rows[0][-2:] == ("–", "40 of 50")


def test_a_trial_that_reached_it_at_its_very_last_step_counts_as_having_reached_it():
    assert coverage_survival(frame(trial("nearest", 0, 100, explored=0.9, steps=100)), "t90").median == 100.0


def test_a_trial_that_ended_at_the_step_limit_below_it_never_reached_it():
    cell = frame(trial("nearest", 0, LIMIT, explored=0.85))
    assert coverage_survival(cell, "t90").median == math.inf
    assert robust_table(cell).rows[0][-1] == "1 of 1"
    assert coverage_survival(cell, "t80").median == 50.0


def test_the_robust_table_has_interquartile_means_medians_and_failures():
    rows = [trial("nearest", i, 100 + i, error=e) for i, e in enumerate((9.0, 1.0, 2.0, 3.0))]
    rows += [trial("random", i, **STUCK) for i in range(3)]
    by_label = {row[0]: row for row in robust_table(frame(*rows)).rows}
    nearest, random = by_label["Nearest"], by_label["Random"]
    expected = interquartile_mean_interval(np.array([9.0, 1.0, 2.0, 3.0]))
    assert nearest[3] == f"{expected.mean:.3f} [{expected.low:.3f}, {expected.high:.3f}]"
    assert nearest[5:] == ("10", "50", "101", "0 of 4")
    assert random[5:] == ("10", "50", "–", "3 of 3")


def test_wins_are_by_world_and_in_the_direction_of_the_metric():
    """Of three worlds nearest has less e on one, equal e on one, more η on two; the reference does not compete."""
    rows = [trial("nearest", i, error=e, efficiency=n) for i, (e, n) in enumerate([(1, 3), (2, 3), (3, 1)])]
    rows += [trial("random", i, error=2, efficiency=2) for i in range(4)]
    rows += [trial("clairvoyant", i) for i in range(3)]
    [row] = wins_table(frame(*rows)).rows
    assert row == ("20", "Random", "Nearest", "1/1/1", "1/0/2")


def test_wins_are_those_of_single_training_seeds_averaged():
    """One seed wins three worlds of four, one a single one; their averages would win all."""
    rows = [trial("graph-stnn", i, error=e, seed=0) for i, e in enumerate((1, 1, 1, 2.5))]
    rows += [trial("graph-stnn", i, error=e, seed=1) for i, e in enumerate((2.5, 2.5, 2.5, 1))]
    rows += [trial("random", i, error=2) for i in range(4)]
    [row] = wins_table(frame(*rows)).rows
    assert row[3] == "2/0/2"


def test_values_that_differ_by_rounding_tie():
    rows = [trial("nearest", i, error=0.3) for i in range(3)]
    rows += [trial("random", i, error=e) for i, e in enumerate((0.1 + 0.2, 0.3 - 1e-16, 0.3 + 1e-6))]
    [row] = wins_table(frame(*rows)).rows
    assert row[3] == "0/2/1"


def test_a_value_that_is_not_defined_gives_a_dash():
    rows = [trial("nearest", 0, efficiency=math.nan), trial("random", 0)]
    [row] = wins_table(frame(*rows)).rows
    assert row[3:] == ("0/1/0", "–")
    assert {row[0]: row[4] for row in robust_table(frame(*rows)).rows}["Nearest"] == "–"


def test_a_figure_a_size_is_written_with_the_same_bytes_twice(tmp_path):
    made = [trial(name, i, 100 + i) for name in ("nearest", "random") for i in range(3)]
    rows = frame(*made, trial("random", 3, **STUCK))
    first = {path: path.read_bytes() for path in write_survival_figures(rows, tmp_path)}
    assert {path.name for path in first} == {"times-20m.svg", "times-20m.png"}
    assert first == {path: path.read_bytes() for path in write_survival_figures(rows, tmp_path)}
    assert list(aggregate_tables(rows)) == ["robust", "wins"]


def test_ablations_alone_have_no_figure(tmp_path):
    assert write_survival_figures(frame(trial("no-state", 0)), tmp_path) == []
