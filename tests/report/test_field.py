"""The rules of others: the table best first with what decisions took, the figures, and which claims are about terms."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from handmade import trial_rows

from explore_bench.analysis.claims import examine
from explore_bench.report.pages.claims import examined
from explore_bench.report.pages.field import (
    FAMILY_COLORS,
    field_figure,
    field_table,
    field_tables,
    is_rule,
    terms_figure,
    terms_of,
    write_field_figures,
)

NOISE = np.random.default_rng(0).normal(0.0, 0.02, 20)
FURTHER = dict.fromkeys(("t90", "path_length", "crossings", "round_trips"), 1.0) | {"regret": 0.5, "regret_most": 2.0}


def rows(strategy, worse=1.0, **options):
    """Rows of a strategy in twenty worlds whose e is about `worse`, and whose η is about one over it."""
    own = trial_rows(worse * (1.0 + NOISE), strategy, **options)
    return own.assign(exploration_efficiency=1.0 / own["trajectory_error"], **FURTHER)


def lidar(strategy, worse, scenario):
    own = rows(strategy, worse, scenario=scenario)
    return own.assign(
        l90=10 * worse * (1 + NOISE), t98_seconds=60 * worse, t90_seconds=50.0, absolute_trajectory_error=0.1
    )


@pytest.fixture
def trials():
    """Heading-aware gain explores better than nearest, and no worse without its heading."""
    return pd.concat(
        [
            *(rows("nearest", 1.0), rows("heading-aware-no-distance", 2.0)),
            *(rows("heading-aware", 0.5), rows("heading-aware-no-heading", 0.5)),
        ],
        ignore_index=True,
    )


def times(strategy="nearest", texts=("1 2", "3 100"), medians=(1.5, 51.5), slowest=(2.0, 100.0)):
    return pd.DataFrame(
        {
            "strategy": strategy,
            "size": 20.0,
            "scenario": "paper",
            "trial": [0, 1],
            "decisions": [2, 2],
            "decision_ms": medians,
            "decision_ms_max": slowest,
            "decisions_ms": texts,
        }
    )


def cells(table, label):
    [row] = [row for row in table.rows if row[0] == label]
    return dict(zip(table.header, row, strict=True))


# The table


def test_it_is_there_where_a_rule_of_others_ran(trials):
    assert field_tables(trials, None).keys() == {"field"}
    assert field_tables(rows("nearest"), None) == {}
    assert is_rule("frontier-tour")
    assert not any(map(is_rule, ("nearest", "graph-stnn", "no-state", "mine.py:Mine")))


def test_the_best_comes_first_and_who_is_told_the_truth_last(trials):
    table = field_table(pd.concat([rows("clairvoyant", 0.1), trials]), None)
    order = ["Heading-aware gain", "Heading-aware gain, no heading", "Nearest", "Heading-aware gain, no distance"]
    assert [row[0] for row in table.rows] == [*order, "Clairvoyant (reference)"]
    told = cells(table, "Clairvoyant (reference)")
    assert {told[name] for name in ("e [m]", "η [m²/step]")} == {"–"}
    assert (told["T90 [step]"][:5], told["R"]) == ("1.000", "0.50 to 2.00"), "for these it plans"


def test_every_size_of_a_strategy_has_a_row_with_its_means(trials):
    table = field_table(pd.concat([trials, rows("nearest", 3.0, size=40.0)]), None)
    assert [row[1] for row in table.rows if row[0] == "Nearest"] == ["20", "40"]
    at = table.header.index("e [m]")
    means = [f"{size * (1.0 + NOISE.mean()):.3f}" for size in (1.0, 3.0)]
    assert [row[at].split()[0] for row in table.rows if row[0] == "Nearest"] == means
    assert all(len(row) == len(table.header) for row in table.rows)


def test_stuck_trials_and_the_bracket_of_the_regret_are_told(trials):
    lost = trials["strategy"].eq("nearest") & trials["trial"].lt(3)
    ended = cells(field_table(trials.assign(status=np.where(lost, "stuck", "explored")), None), "Nearest")
    assert (ended["n"], ended["not explored"], ended["stuck [%]"], ended["R"]) == ("20", "3", "15.0", "0.50 to 2.00")
    untold = field_table(trials.assign(regret=math.nan, regret_most=math.nan), None)
    assert cells(untold, "Nearest")["R"] == "–"


def test_times_are_the_median_of_the_trials_and_of_all_decisions_the_99th_percentile(trials):
    row = cells(field_table(trials, times()), "Nearest")
    every = np.quantile([1.0, 2.0, 3.0, 100.0], 0.99)
    assert [row[name] for name in row if "ms" in name] == ["26", f"{every:.0f}", "100"]
    assert {cells(field_table(trials, times()), "Heading-aware gain")[name] for name in row if "ms" in name} == {"–"}


@pytest.mark.parametrize("old", [times().drop(columns="decisions_ms"), times(texts=("1 2", np.nan))])
def test_files_that_do_not_tell_of_all_decisions_say_nothing_of_their_percentile(trials, old):
    row = cells(field_table(trials, old), "Nearest")
    assert [row[name] for name in row if "ms" in name] == ["26", "–", "100"]


def test_in_lidar_worlds_every_scenario_has_a_row_and_its_own_metrics():
    trials = pd.concat([lidar(name, i, where) for i, name in enumerate(("burgard", "nearest"), 1) for where in "ab"])
    table = field_table(trials, None)
    assert [row[:2] for row in table.rows] == [(n, where) for n in ("Burgard", "Nearest") for where in "ab"]
    assert {"L90 [m]", "T98 [s]", "ATE [m]"} <= set(table.header)
    assert "R" not in table.header


# The figures


def test_every_strategy_has_its_line_best_first_in_a_panel_for_each_metric_and_size(trials):
    figure = field_figure(pd.concat([trials, trials.assign(size=40.0), rows("burgard", 0.1)]))
    assert [axes.get_title() for axes in figure.axes] == ["e, 20 m", "e, 40 m", "η, 20 m", "η, 40 m"]
    assert [axes.get_xlabel() for axes in figure.axes] == ["◂ better"] * 2 + ["better ▸"] * 2
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    order = ["Heading-aware gain", "Heading-aware gain, no heading", "Nearest", "Heading-aware gain, no distance"]
    assert labels == [*order, "Burgard"]  # which lacks a size
    for axes in figure.axes:
        metric, size = axes.get_title().split(", ")
        drawn = {line.get_ydata()[0]: line for line in axes.lines if line.get_marker() in ("o", "s")}
        at = [round(float(drawn[number].get_xdata()[0]), 1) for number in range(4)]
        assert at == ([0.5, 0.5, 1.0, 2.0] if metric == "e" else [2.0, 2.0, 1.0, 0.5])
        assert (4 in drawn) == (size == "20 m")
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == [
        "looks at the way there",
        "looks at what is in view there",
        "the paper's, and the nearest",
        "of others",
    ]
    plt.close(figure)


def test_only_claims_about_the_terms_of_rules_that_ran_are_drawn(trials):
    network = rows("graph-stnn", 1.0, size=30.0)
    found = examined(pd.concat([trials, network, network.assign(strategy="entropy")]))
    assert {claim.name for claim in found} >= {"iii", "heading-aware"}
    [(claim, findings)] = terms_of(found).items()
    assert claim.name == "heading-aware"
    assert {(one.comparison.worse, one.comparison.size) for one in findings} == {
        ("heading-aware-no-heading", 20.0),
        ("heading-aware-no-distance", 20.0),
    }


def test_a_term_that_helps_is_right_of_1_in_both_metrics_and_filled(trials):
    found = terms_of(examined(trials))
    figure = terms_figure(found)
    assert [axes.get_title() for axes in figure.axes] == ["e, 20 m", "η, 20 m"]
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert labels == ["Heading-aware gain : no heading", "Heading-aware gain : no distance"]
    for axes in figure.axes:
        marks = [line for line in axes.lines if line.get_marker() == "o"]
        assert [round(float(line.get_xdata()[0]), 1) for line in marks] == [1.0, 4.0]
        assert [line.get_markerfacecolor() for line in marks] == ["white", FAMILY_COLORS["field-view"]]
    plt.close(figure)


def test_the_files_go_where_no_rule_ran(trials, tmp_path):
    found = examined(trials)
    assert len(write_field_figures(trials, found, tmp_path)) == 4
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}.{kind}" for name in ("field", "field-terms") for kind in ("svg", "png")
    }
    assert write_field_figures(rows("nearest"), {}, tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_every_rule_with_a_control_is_claimed_to_be_better_in_each_scenario_where_both_run(trials):
    for where, sizes in (("paper", (20.0, 30.0, 40.0)), ("range 5 m", (20.0,))):
        ran = pd.concat([rows(n, size=s, scenario=where) for n in ("burgard", "nearest") for s in sizes])
        if where != "paper":
            ran = ran.assign(l90=1.0 + NOISE[0], t98_seconds=1.0)
        [claim] = examined(ran)
        assert {(one.better, one.worse) for one in claim.comparisons} == {("burgard", "nearest")}
        assert len(claim.comparisons) == 2 * len(sizes)
        assert {one.verdict for one in examine(claim, ran)} == {"not shown"}
