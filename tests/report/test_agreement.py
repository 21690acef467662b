"""Paper against measured: ratios, the order of the strategies, and the constants that the paper leaves out."""

import math

import numpy as np
import pandas as pd
import pytest

from explore_bench.analysis.tables import SUMMARY_COLUMNS
from explore_bench.report.agreement import agreement_table, agreement_tables, constants_table, order_table
from explore_bench.strategies.registry import strategies
from explore_bench.world.landmark.constants import LandmarkScenario

PAPER = {name: strategies()[name].published["table2", 20.0, "trajectory_error"] for name in ("entropy", "random")}


def summary(strategy="random", n=50, mean=1.0, paper=2.0):
    values = (
        "table2",
        strategy,
        20.0,
        "trajectory_error",
        n,
        0,
        mean,
        0.9 * mean,
        1.2 * mean,
        paper,
        0,
        math.nan,
        math.nan,
        "paper",
    )
    return dict(zip(SUMMARY_COLUMNS, values, strict=True))


def trials(scenario="paper", **values):
    """Trials with these values of e, one a world, and η the reverse."""
    rows = [
        {
            "strategy": name,
            "scenario": scenario,
            "size": 20.0,
            "trial": i,
            "trajectory_error": e,
            "exploration_efficiency": 1.0 / e,
        }
        for name, own in values.items()
        for i, e in enumerate(own)
    ]
    return pd.DataFrame(rows)


def test_a_number_of_the_paper_stands_beside_ours_and_their_ratio():
    [row] = agreement_table(pd.DataFrame([summary()])).rows
    assert row == ("Table 2", "Random", "20", "e [m]", "2.0000", "1.000 [0.900, 1.200]", "0.500 [0.450, 0.600]", "50")


def test_what_did_not_run_is_named_and_what_the_paper_does_not_print_is_left_out():
    table = agreement_table(pd.DataFrame([summary(n=0, mean=math.nan), summary("nearest", paper=math.nan)]))
    assert [row[1:2] + row[5:] for row in table.rows] == [("Random", "not run", "–", "0")]


def test_what_was_not_trained_is_named(untrained):
    untrained("gcn-obs")
    [row] = agreement_table(pd.DataFrame([summary("gcn-obs", n=0, mean=math.nan)])).rows
    assert row[5:] == ("not trained", "–", "0")


@pytest.mark.parametrize("agrees", [True, False])
def test_the_order_is_that_of_the_means_best_first(agrees):
    """In the paper entropy has less e than random and more η."""
    assert PAPER["entropy"] < PAPER["random"]
    better, worse = np.full(9, 1.0), np.full(9, 2.0)
    rows = order_table(trials(entropy=better if agrees else worse, random=worse if agrees else better)).rows
    assert {row[2] for row in rows} == {"e [m]", "η [m²/step]"}
    for row in rows:
        assert row[4] == ("1.000 [1.000, 1.000]" if agrees else "−1.000 [−1.000, −1.000]")
        assert row[5] == "Entropy, Random"
        assert row[6] == ("Entropy, Random" if agrees else "Random, Entropy")


def test_only_worlds_that_all_tried_and_strategies_that_the_paper_prints_are_ordered():
    rows = order_table(trials(entropy=[1.0, 9.0], random=[2.0], nearest=[0.5, 0.5])).rows
    assert all(row[3] == "2" and row[6] == "Entropy, Random" for row in rows)
    assert order_table(trials(entropy=[1.0], nearest=[1.0])).rows == ()


def test_the_constants_are_those_that_no_section_of_the_paper_gives():
    names = {row[0] for row in constants_table().rows}
    assert {"step_length", "odometry_sigma", "obstacle_density", "steps_per_cell"} <= names
    assert not names & {"size", "cell_size", "sensor_range", "landmark_density"}
    assert names <= LandmarkScenario.model_fields.keys() - {"kind"}


def test_the_tables_have_a_name_each():
    made = agreement_tables(trials(entropy=[1.0], random=[2.0]), pd.DataFrame([summary()]))
    assert list(made) == ["agreement", "order", "constants"]
    assert [scope.strategies for scope in made["agreement"].scopes] == [("random",)]


@pytest.mark.parametrize("scenario", ["stage", "chen2020"])
def test_trials_of_another_scenario_are_not_held_against_the_paper(scenario):
    assert agreement_tables(trials(scenario, entropy=[1.0], random=[2.0]), pd.DataFrame([summary()])) == {}
