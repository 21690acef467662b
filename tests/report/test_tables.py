"""Tables from summaries made by hand: Markdown, CSV and LaTeX, paper values, untrained and missing strategies."""

import csv
import dataclasses
import io
import math
import re

import numpy as np
import pandas as pd
import pytest
from handmade import record, with_spec

from explore_bench.analysis.statistics import mean_interval
from explore_bench.analysis.tables import SUMMARY_COLUMNS, summary_table, trial_table
from explore_bench.report.drawing import showing
from explore_bench.report.tables import (
    PAPER_TABLES,
    STATUSES,
    Scope,
    Table,
    details_table,
    escape,
    means_table,
    paired_table,
    paper_table,
    report_tables,
    shown_name,
    write_tables,
)
from explore_bench.strategies.registry import strategies
from explore_bench.world.scenario import Scenario

MAP = Scenario(size=20.0)
NAN = math.nan


def line(strategy, metric="trajectory_error", size=20.0, table="table2", n=50, failed=0, mean=1.25, paper=NAN, seeds=0):
    """Return one line of a summary; the interval is the mean ± 0.1, the range of the seeds the mean ± 0.2."""
    values = (table, strategy, size, metric, n, failed, mean, mean - 0.1, mean + 0.1, paper)
    values += (seeds, mean - 0.2, mean + 0.2, "paper")
    return dict(zip(SUMMARY_COLUMNS, values, strict=True))


def published(strategy, table="table2"):
    return [
        line(strategy, m, s, t, n=0, mean=NAN, paper=v)
        for (t, s, m), v in strategies()[strategy].published.items()
        if t == table
    ]


def frame(*lines):
    return pd.DataFrame(lines, columns=list(SUMMARY_COLUMNS))


def row_of(table, label):
    [row] = [row for row in table.rows if row[0] == label]
    return dict(zip(table.header, row, strict=True))


def made(*lines, name="table2"):
    return paper_table(name, PAPER_TABLES[name], frame(*lines))


# The paper's tables


def test_the_paper_s_value_stands_beside_ours_with_its_interval():
    table = made(
        line("random", "trajectory_error", 20.0, mean=1.7812, paper=1.9614),
        line("random", "exploration_efficiency", 40.0, mean=0.3512, paper=0.7779),
    )
    row = row_of(table, "Random")
    assert row["e [m] 20 m: paper"] == "1.9614"
    assert table.rows[[r[0] for r in table.rows].index("Random")][5] == "1.781 [1.681, 1.881]"
    assert row["η [m²/step] 40 m: paper"] == "0.7779"
    assert "0.351 [0.251, 0.451]" in table.markdown()


def test_the_columns_are_both_metrics_at_the_table_s_sizes_paper_first():
    assert made().header == (
        *("Method", "n", "seeds", "trials not explored"),
        *("e [m] 20 m: paper", "ours", "e [m] 40 m: paper", "ours"),
        *("η [m²/step] 20 m: paper", "ours", "η [m²/step] 40 m: paper", "ours"),
    )
    assert len(made(name="table3").header) == 4 + 2 * 2 * 3


def test_every_strategy_of_the_table_has_a_row_in_the_registered_order():
    for name in PAPER_TABLES:
        labels = [row[0].removesuffix(" (reference)") for row in made(name=name).rows]
        assert labels == [entry.label for entry in strategies().values() if name in entry.tables]


def test_a_strategy_without_weights_reads_not_trained_beside_the_paper_s_value(untrained):
    untrained("gcn-obs")
    [row] = [row for row in made(*published("gcn-obs")).rows if row[0] == "GCN-obs"]
    assert row[1:6] == ("0", "–", "–", "0.9665", "not trained")
    assert row.count("not trained") == 4


def test_a_learned_strategy_with_weights_reads_not_run_until_it_has_trials(trained):
    trained(0)
    [row] = [row for row in made(*published("gcn-obs")).rows if row[0] == "GCN-obs"]
    assert row[4:6] == ("0.9665", "not run")
    assert "not trained" not in row


def test_a_strategy_without_trials_reads_not_run_beside_the_paper_s_value():
    row = next(row for row in made(*published("entropy")).rows if row[0] == "Entropy")
    assert row[4:6] == ("1.5038", "not run")
    assert "not trained" not in row


def test_a_strategy_that_the_paper_does_not_print_has_a_dash_there():
    row = next(row for row in made(line("nearest")).rows if row[0] == "Nearest")
    assert row[4:6] == ("–", "1.250 [1.150, 1.350]")


def test_the_reference_is_marked_and_nobody_else_and_the_ablations_have_none():
    marked = {name: [row[0] for row in made(name=name).rows if "reference" in row[0]] for name in PAPER_TABLES}
    clairvoyants = ["Clairvoyant (reference)", "Clairvoyant, e and η (reference)"]
    assert marked == {"table2": clairvoyants, "table3": []}


def test_numbers_of_worlds_and_of_unfinished_trials_stand_beside_every_mean():
    table = made(line("nearest", n=50, failed=3), line("nearest", size=40.0, n=50, failed=3))
    assert row_of(table, "Nearest")["n"] == "50"
    assert row_of(table, "Nearest")["trials not explored"] == "3"


def test_training_seeds_are_counted_and_their_range_stands_beside_the_mean():
    counts = {"gcn-obs": 3, "graph-stnn": 1, "random": 0}
    table = made(*(line(name, size=size, seeds=n) for name, n in counts.items() for size in (20.0, 40.0)))
    assert [row_of(table, label)["seeds"] for label in ("GCN-obs", "Graph-STNN", "Random")] == ["3", "1", "–"]
    cells = {row[0]: row[5] for row in table.rows}
    assert cells["GCN-obs"] == "1.250 [1.150, 1.350] (1.050–1.450)"
    assert cells["Graph-STNN"] == cells["Random"] == "1.250 [1.150, 1.350]"


def test_numbers_that_differ_between_sizes_are_given_for_each():
    table = made(line("nearest", n=50, failed=0), line("nearest", size=40.0, n=20, failed=7))
    assert row_of(table, "Nearest")["n"] == "50/20"
    assert row_of(table, "Nearest")["trials not explored"] == "0/7"


def test_a_plugin_has_a_row_after_the_registered_strategies():
    assert made(line("my_plugin")).rows[-1][0] == "my plugin"


def test_a_value_of_the_other_table_is_not_shown():
    row = made(line("nearest", table="table3"), name="table2").rows
    assert next(r for r in row if r[0] == "Nearest")[5] == "not run"


@pytest.mark.parametrize(
    ("mean", "text"),
    [
        (1.23456, "1.235 [1.135, 1.335]"),
        (12.3456, "12.35 [12.25, 12.45]"),
        (-0.5, "−0.500 [−0.600, −0.400]"),
        (10.0, "10.00 [9.90, 10.10]"),
        (100.0, "100.0 [99.9, 100.1]"),
    ],
)
def test_numbers_are_rounded_to_what_their_size_allows(mean, text):
    assert next(r for r in made(line("nearest", mean=mean)).rows if r[0] == "Nearest")[5] == text


def test_a_single_world_has_a_mean_without_an_interval():
    single = line("nearest", n=1) | {"ci_low": NAN, "ci_high": NAN}
    assert next(r for r in made(single).rows if r[0] == "Nearest")[5] == "1.250"


def test_a_mean_of_zero_is_shown():
    assert next(r for r in made(line("nearest", mean=0.0)).rows if r[0] == "Nearest")[5].startswith("0.000 [")


# Details and paired differences


def ended(steps, status="explored", strategy="nearest", trial=0, **options):
    values = {"uncertainty": np.linspace(200.0, 100.0, steps + 1), "peak_trace": [0.25] * (steps + 1)}
    values |= {"explored": np.linspace(0.1, 0.95, steps + 1)}
    return record(status, MAP, strategy, trial, **{**values, **options})


@pytest.fixture(scope="module")
def trials():
    """Rows of three strategies: nearest (one stuck, one at the limit), random (one failed), and the reference."""
    rows = [ended(100, trial=0), ended(120, trial=1), ended(50, "stuck", trial=2), ended(60, "step_limit", trial=3)]
    rows += [ended(200 + 10 * t, strategy="random", trial=t) for t in range(3)]
    rows += [ended(20, "failed", "random", 3)]
    rows += [
        dataclasses.replace(
            with_spec(ended(80, strategy="clairvoyant", trial=t), reference=True), notes={"tour": 80.0, "bound": 40.0}
        )
        for t in range(4)
    ]
    return trial_table(rows)


def test_details_count_every_status_and_give_the_rate_of_stuck_trials(trials):
    table = details_table(trials, summary_table(trials))
    nearest, random = row_of(table, "Nearest"), row_of(table, "Random")
    counted = [nearest[status.replace("_", " ")] for status in STATUSES]
    assert counted == ["2", "1", "1", "0"]
    assert (nearest["trials"], nearest["stuck [%]"]) == ("4", "25.0")
    assert ([random[s.replace("_", " ")] for s in STATUSES], random["stuck [%]"]) == (["3", "0", "0", "1"], "0.0")
    assert row_of(table, "Clairvoyant (reference)")["stuck [%]"] == "0.0"


def test_details_give_further_metrics_with_intervals(trials):
    row = row_of(details_table(trials, summary_table(trials)), "Clairvoyant (reference)")
    assert (row["R ≥"], row["R ≤"]) == ("0.000 [0.000, 0.000]", "1.000 [1.000, 1.000]")
    assert row["T90 [step]"].startswith("76.")
    nearest = row_of(details_table(trials, summary_table(trials)), "Nearest")
    assert (nearest["R ≥"].split()[0], nearest["R ≤"].split()[0]) == ("5.938", "12.88")


def test_a_reference_fills_only_the_columns_for_which_it_plans(trials):
    """It drives for the time alone: its e and η would be taken for what is possible."""
    summary = summary_table(trials)
    row = row_of(details_table(trials, summary), "Clairvoyant (reference)")
    assert {row[name] for name in ("D", "L [m]", "T50 [step]", "ATE [m]", "NEES", "C")} == {"–"}
    assert row_of(means_table(trials, summary), "Clairvoyant (reference)")["e [m]"] == "–"
    table2 = paper_table("table2", PAPER_TABLES["table2"], summary)
    [own] = [line for line in table2.rows if line[0] == "Clairvoyant (reference)"]
    assert set(own[4:]) == {"–"}
    [other] = [line for line in table2.rows if line[0] == "Nearest"]
    assert set(other[4:]) != {"–"}


def test_details_of_several_sizes_have_a_row_each():
    small = [with_spec(ended(30, trial=t), scenario=Scenario(size=12.0)) for t in range(2)]
    rows = trial_table([*small, *(ended(90, trial=t) for t in range(2))])
    table = details_table(rows, summary_table(rows))
    assert [(row[0], row[1]) for row in table.rows] == [("Nearest", "12"), ("Nearest", "20")]


def test_paired_differences_are_between_every_two_competitors_and_exclude_the_reference(trials):
    table = paired_table(trials)
    assert [(row[1], row[2]) for row in table.rows] == [("Random", "Nearest")]
    assert not any("Clairvoyant" in cell for row in table.rows for cell in row)


def test_paired_differences_worked_by_hand():
    """With e = T / 100 · 0.5: 0.5 − 1, 0.6 − 1.05, 0.7 − 1.2 on worlds 0, 1, 2; world 3 has one of the two only."""
    rows = trial_table(
        [ended(n, strategy="random", trial=t) for t, n in enumerate((100, 120, 140, 999))]
        + [ended(n, trial=t) for t, n in enumerate((200, 210, 240))]
    )
    table = paired_table(rows)
    expected = mean_interval(np.array([-0.5, -0.45, -0.5]))
    shown = f"{expected.mean:.3f} [{expected.low:.3f}, {expected.high:.3f}]".replace("-", "−")
    assert table.rows[0][3:5] == ("3", shown)


def test_paired_differences_are_taken_within_a_size():
    rows = trial_table([ended(100), with_spec(ended(90, strategy="random"), scenario=MAP.replace(size=30.0))])
    assert paired_table(rows).rows == ()


def test_a_metric_that_is_not_defined_has_no_paired_difference_and_stops_nothing():
    """T90 where exploring asks for 80 % of the map."""
    scenario = MAP.replace(coverage=0.8)
    rows = [
        record("explored", scenario, name, t, uncertainty=[200.0, 150.0], peak_trace=[0.1, 0.1], explored=[0.2, 0.82])
        for name in ("nearest", "random")
        for t in range(3)
    ]
    table = paired_table(trial_table(rows))
    row = dict(zip(table.header, table.rows[0], strict=True))
    assert row["T90 [step]: A − B"] in ("–", "", "nan")
    assert row["e [m]: A − B"] == "0.000 [0.000, 0.000]"


def test_tables_of_another_scenario_show_our_means_without_the_paper(trials):
    """E and η have a table of their own there, with the same numbers."""
    elsewhere = trials.assign(scenario="chen2020")
    found = report_tables(elsewhere, summary_table(elsewhere))
    assert list(found) == ["means", "details", "paired"]
    own = row_of(found["means"], "Random")
    assert (own["n"], own["trials not explored"]) == ("4", "1")
    assert row_of(found["means"], "Nearest")["trials not explored"] == "2"
    table2 = paper_table("table2", PAPER_TABLES["table2"], summary_table(trials))
    [beside] = [row for row in table2.rows if row[0] == "Random"]
    assert [own["e [m]"], own["η [m²/step]"]] == [cell for cell in beside if "[" in cell]
    assert "paper" not in found["means"].markdown().lower()


PRINTED = {"table2": ["random", "uncertainty", "entropy", "gcn-obs", "gcn-no-obs", "graph-stnn"]}
PRINTED["table3"] = [name for name, entry in strategies().items() if any(t == "table3" for t, _, _ in entry.published)]


@pytest.mark.parametrize("ran", [("table2",), ("table3",), ("table2", "table3")], ids="+".join)
def test_a_table_of_the_paper_is_shown_where_all_that_it_prints_ran(ran):
    names = {name for table in ran for name in PRINTED[table]}
    table = trial_table([ended(100, strategy=name) for name in sorted(names)])
    assert [
        name for name in report_tables(table, summary_table(table)) if name in ("means", "table2", "table3")
    ] == list(ran)


def test_of_some_of_the_paper_s_methods_the_table_has_those_that_ran(trials):
    found = report_tables(trials, summary_table(trials))
    assert list(found) == ["means", "details", "paired"]
    assert {row[0] for row in found["means"].rows} == {"Random", "Nearest", "Clairvoyant (reference)"} & {
        shown_name(name) for name in set(trials["strategy"])
    }
    assert "not run" not in found["means"].markdown()


def test_a_strategy_without_weights_keeps_no_table_of_the_paper_away(untrained):
    untrained("gcn-obs")
    table = trial_table([ended(100, strategy=name) for name in PRINTED["table2"] if name != "gcn-obs"])
    found = report_tables(table, summary_table(table))
    assert "not trained" in row_of(found["table2"], "GCN-obs").values()


def test_a_strategy_in_no_table_stands_among_the_means_of_all_beside_the_paper_s_tables():
    ran = trial_table([ended(100, strategy=name) for name in sorted({*PRINTED["table2"], "frontier-tour"})])
    summary = summary_table(ran)
    assert set(summary.loc[summary["strategy"] == "frontier-tour", "table"]) == {"none"}
    found = report_tables(ran, summary)
    assert list(found) == ["table2", "means", "details", "paired"]
    rows = {row[0]: row[1:] for row in found["means"].rows}
    assert rows["Frontier tour"] == rows["Random"]
    assert "Frontier tour" not in {row[0] for row in found["table2"].rows}
    details = {row[0]: row[1:] for row in found["details"].rows}
    assert details["Frontier tour"] == details["Random"]


def test_strategies_without_a_common_world_have_a_dash_for_their_difference():
    rows = trial_table([ended(100, trial=0), ended(90, strategy="random", trial=1)])
    assert paired_table(rows).rows[0][3:] == ("0", "–", "–", "–")


# Formats


PLAIN = Table(
    "A title & more", ("Method", "η [m²/step]"), (("GCN-no_obs", "1.2 [−0.5, 3]"), ("a | b", "90 %")), "σ₀² note"
)


def test_markdown_is_a_table_with_title_and_note():
    assert PLAIN.markdown().splitlines() == [
        "**A title & more**",
        "",
        "| Method | η [m²/step] |",
        "| --- | --- |",
        "| GCN-no_obs | 1.2 [−0.5, 3] |",
        r"| a \| b | 90 % |",
        "",
        "σ₀² note",
    ]


def test_the_scenario_of_every_row_is_named_once_where_it_is_one_else_in_a_column():
    one, several = PLAIN.naming_each(["paper", "paper"]), PLAIN.naming_each(["paper", "stage"])
    assert one == PLAIN.naming("paper") and one.note == "Scenario: paper. σ₀² note"
    assert several.header == ("Method", "scenario", "η [m²/step]")
    assert [row[:2] for row in several.rows] == [("GCN-no_obs", "paper"), ("a | b", "stage")]
    scoped = dataclasses.replace(PLAIN, columns=(Scope(), Scope(size=20.0))).naming_each(["paper", "stage"])
    assert scoped.columns == (Scope(), Scope(), Scope(size=20.0))
    nothing = dataclasses.replace(PLAIN, rows=())
    assert nothing.naming_each([]) == nothing


def test_csv_can_be_read_back():
    assert list(csv.reader(io.StringIO(PLAIN.csv()))) == [list(PLAIN.header), *map(list, PLAIN.rows)]
    assert "\r" not in PLAIN.csv()
    named = list(csv.reader(io.StringIO(PLAIN.naming("chen2020").csv())))
    assert named == [[*PLAIN.header, "scenario"], *([*row, "chen2020"] for row in PLAIN.rows)]


@pytest.mark.parametrize(
    ("text", "latex"),
    [
        ("GCN-no_obs", r"GCN-no\_obs"),
        ("90 %", r"90 \%"),
        ("a & b", r"a \& b"),
        ("$5 #1 {x}", r"\$5 \#1 \{x\}"),
        ("a~b^c", r"a\textasciitilde{}b\textasciicircum{}c"),
        ("a\\b", r"a\textbackslash{}b"),
        ("η", r"$\eta$"),
        ("2 σ₀²", r"2 $\sigma$$_0$$^2$"),
        ("−1", r"$-$1"),
    ],
)
def test_latex_escapes_every_special_character(text, latex):
    assert escape(text) == latex


def test_latex_is_a_complete_table_of_as_many_columns_as_the_header():
    lines = PLAIN.latex().splitlines()
    assert lines[0] == r"\begin{table}"
    assert lines[-1] == r"\end{table}"
    assert r"\begin{tabular}{lr}" in lines
    assert r"GCN-no\_obs & 1.2 [$-$0.5, 3] \\" in lines
    assert r"\caption{A title \& more. $\sigma$$_0$$^2$ note}" in lines


def test_all_tables_of_the_benchmark_are_latex_without_a_bare_special_character(trials, tmp_path):
    """Nor any character beyond ASCII, which LaTeX might not know."""
    files = write_tables(report_tables(trials, summary_table(trials)), tmp_path)
    for file in files:
        if file.suffix == ".tex":
            text = file.read_text(encoding="utf-8")
            assert text.isascii(), sorted({c for c in text if not c.isascii()})
            body = [row for row in text.splitlines() if row.endswith(r"\\")]
            columns = {len(re.split(r"(?<!\\)&", row)) for row in body}
            assert len(columns) == 1
            assert not re.search(r"(?<!\\)[%#_](?!\d\$)", "\n".join(body)), file


def test_writing_gives_each_table_in_three_formats(trials, tmp_path):
    files = write_tables(report_tables(trials, summary_table(trials)), tmp_path / "tables")
    assert {file.name for file in files} == {
        f"{name}{suffix}" for name in ("means", "details", "paired") for suffix in (".md", ".csv", ".tex")
    }
    assert all(file.read_text(encoding="utf-8").strip() for file in files)


def test_writing_twice_gives_the_same_bytes(trials, tmp_path):
    first = [file.read_bytes() for file in write_tables(report_tables(trials, summary_table(trials)), tmp_path / "a")]
    assert first == [
        file.read_bytes() for file in write_tables(report_tables(trials, summary_table(trials)), tmp_path / "b")
    ]


# Strategies that are not registered


def test_a_reference_that_is_no_longer_registered_stays_one():
    """It was told the truth when its trials ran, and is compared with nobody."""
    told = with_spec(record(rows=3, strategy="oracle"), reference=True)
    other = record(rows=3, strategy="entropy[alpha=0.5]")
    with showing([told.spec, other.spec]):
        assert shown_name("oracle") == "oracle (reference)"
        assert shown_name("entropy[alpha=0.5]") == "Entropy [alpha=0.5]"
    assert shown_name("oracle") == "oracle"
