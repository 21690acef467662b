"""trials.csv, summary.csv and times.csv: columns, order, regret, means over worlds, and merged times."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from handmade import TINY, record, tiny_plan, with_spec
from handmade_lidar import lidar_record
from lidar_worlds import SMALL, drawn

from explore_bench.analysis.csv_files import read_csv
from explore_bench.analysis.metrics import CURVES, METRICS, curve
from explore_bench.analysis.statistics import mean_interval
from explore_bench.analysis.tables import (
    SUMMARY_COLUMNS,
    TRIAL_COLUMNS,
    WORLD_COLUMNS,
    by_world,
    of_paper,
    read_trials,
    select,
    summary_table,
    trial_table,
    world_table,
    write_trials,
)
from explore_bench.analysis.times import (
    EVERY_DECISION,
    TIME_COLUMNS,
    Expectation,
    every_decision_ms,
    read_times,
    seconds_left,
    write_times,
)
from explore_bench.errors import RequestError
from explore_bench.runs.runner import Outcome
from explore_bench.runs.suites import plan
from explore_bench.strategies.registry import strategies
from explore_bench.trial.spec import Status
from explore_bench.world.lidar.facts import Facts
from explore_bench.world.scenario import Scenario

MAP = Scenario(size=20.0)


def explored(steps, **options):
    """Return a record of a trial that explored in so many steps: U from 200 to 100, max tr Σ 0.25."""
    values = {"uncertainty": [200.0] * steps + [100.0], "peak_trace": [0.25] * (steps + 1)}
    values |= {"explored": [0.5] * steps + [0.95]}
    return record(scenario=MAP, **{**values, **options})


def lines(summary, **wanted):
    for column, value in wanted.items():
        summary = summary[summary[column] == value]
    return summary


# trials.csv


def test_the_columns_of_trials_csv_begin_as_the_design_says():
    assert TRIAL_COLUMNS[:13] == (
        "strategy",
        "training_seed",
        "size",
        "trial",
        "world",
        "status",
        "steps",
        "decisions",
        "path_length",
        "explored",
        "uncertainty_reduction",
        "exploration_efficiency",
        "trajectory_error",
    )


def test_trials_in_landmark_worlds_have_the_columns_of_the_stored_table(stored):
    """The file of the benchmark's own results."""
    results = Path(__file__).parents[2] / "results" / "trials.csv"
    assert tuple(results.read_text(encoding="utf-8").splitlines()[0].split(",")) == TRIAL_COLUMNS
    assert tuple(trial_table(stored.store.records()[0]).columns) == TRIAL_COLUMNS


def test_every_metric_is_a_column_of_trials_csv_once():
    assert set(METRICS) | {"regret", "regret_most"} <= set(TRIAL_COLUMNS)
    assert len(set(TRIAL_COLUMNS)) == len(TRIAL_COLUMNS)


def test_a_row_says_what_was_run_where_and_how_it_ended(stored):
    table = trial_table(stored.store.records()[0])
    assert tuple(table.columns) == TRIAL_COLUMNS
    assert len(table) == len(stored.specs)
    for spec, result in zip(stored.specs, stored.results, strict=True):
        found = stored.store.find(spec)
        row = table[(table["strategy"] == spec.strategy) & (table["trial"] == spec.trial)].iloc[0]
        assert (row["size"], row["status"], row["reason"], row["scenario"]) == (12.0, "explored", "", "paper")
        assert pd.isna(row["training_seed"])
        assert row["world"] == result.world.digest
        assert row["steps"] == len(result.steps) - 1
        assert row["decisions"] == len(result.decision_seconds)
        for name, metric in METRICS.items():
            assert row[name] == pytest.approx(metric.value(found), nan_ok=True), name


def test_the_table_of_a_folder_is_that_of_its_records_and_comes_with_these_in_brief(stored):
    table, briefs, stale = read_trials(stored.store)
    records, _ = stored.store.records()
    pd.testing.assert_frame_equal(table, trial_table(records))
    assert [brief.spec for brief in briefs] == [record.spec for record in records]
    assert stale == 0
    for name in CURVES:
        for brief, whole in zip(briefs, records, strict=True):
            np.testing.assert_array_equal(curve(brief, name, 60), curve(whole, name, 60))


def test_all_strategies_have_the_same_worlds(stored):
    table = trial_table(stored.store.records()[0])
    assert (table.groupby("trial")["world"].nunique() == 1).all()
    assert table["world"].nunique() == 3


def test_rows_are_ordered_by_strategy_training_seed_size_and_trial():
    made = [
        with_spec(record(rows=2, strategy=name, trial=trial, scenario=TINY.replace(size=size)), training_seed=seed)
        for name, seed, size, trial in [
            ("b", None, 20.0, 10),
            ("b", None, 20.0, 2),
            ("b", None, 12.0, 3),
            ("a", 1, 20.0, 0),
            ("a", 0, 20.0, 0),
            ("a", 0, 20.0, 1),
        ]
    ]
    table = trial_table(made)
    keys = list(zip(table["strategy"], table["training_seed"].fillna(-1), table["size"], table["trial"], strict=True))
    assert keys == [
        ("a", 0, 20.0, 0),
        ("a", 0, 20.0, 1),
        ("a", 1, 20.0, 0),
        ("b", -1, 12.0, 3),
        ("b", -1, 20.0, 2),
        ("b", -1, 20.0, 10),
    ]
    assert table.equals(trial_table(made[::-1]))


def test_a_trial_without_rows_is_a_row_with_its_reason():
    row = trial_table([record("failed", MAP, rows=0, reason="LookupError: no map")]).iloc[0]
    assert (row["status"], row["steps"], row["decisions"]) == ("failed", 0, 0)
    assert row["reason"] == "LookupError: no map"
    assert row["trajectory_error"] == pytest.approx(10.0 * math.sqrt(2.0))


def test_steps_are_those_taken_also_where_the_score_counts_the_limit():
    row = trial_table([record("stuck", MAP, rows=8)]).iloc[0]
    assert row["steps"] == 7
    assert row["t90"] == MAP.step_limit


def reference_of(trial, tour, bound=40.0):
    """Return a reference's trial of 110 steps that says so of its world."""
    made = with_spec(explored(110, trial=trial, strategy="clairvoyant"), reference=True)
    return dataclasses.replace(made, notes={"tour": tour, "bound": bound})


def test_regret_is_to_what_the_reference_says_of_the_same_world():
    made = [explored(150, trial=0), explored(40, trial=1), explored(70, trial=2)]
    table = trial_table([*made, reference_of(0, 100.0), reference_of(1, 50.0)])
    assert list(lines(table, strategy="nearest")["regret"])[:2] == pytest.approx([0.5, -0.2])
    assert list(lines(table, strategy="nearest")["regret_most"])[:2] == pytest.approx([2.75, 0.0])
    assert math.isnan(lines(table, strategy="nearest", trial=2)["regret"].iloc[0])
    assert list(lines(table, strategy="clairvoyant")["regret"]) == pytest.approx([0.1, 1.2])


def test_regret_is_not_taken_across_scenarios():
    reference = reference_of(0, 100.0)
    other = with_spec(explored(150), scenario=MAP.replace(coverage=0.85))
    assert math.isnan(lines(trial_table([other, reference]), strategy="nearest")["regret"].iloc[0])


def test_the_file_holds_every_number_exactly(own_store):
    table = write_trials(own_store)
    with (own_store.folder / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for name in METRICS:
        found = [float(row[name] or "nan") for row in rows]
        assert np.array_equal(table[name], found, equal_nan=True), name


def test_the_file_is_the_same_on_every_machine_and_has_unix_lines(own_store):
    write_trials(own_store)
    content = (own_store.folder / "trials.csv").read_bytes()
    assert b"\r" not in content
    assert content.decode().splitlines()[0] == ",".join(TRIAL_COLUMNS)
    assert len(content.decode().splitlines()) == 10


def test_trials_of_older_code_are_not_in_the_file(own_store, monkeypatch):
    monkeypatch.setattr("explore_bench.records.provenance.library_versions", lambda *_: {"numpy": "0.1"})
    assert len(write_trials(own_store)) == 0
    assert (own_store.folder / "trials.csv").read_text().splitlines() == [",".join(TRIAL_COLUMNS)]


def test_the_rows_of_a_plan_are_selected_by_strategy_size_and_world(stored):
    table = trial_table(stored.store.records()[0])
    found = select(table, tiny_plan(("nearest",), trials=2))
    assert list(zip(found["strategy"], found["trial"], strict=True)) == [("nearest", 0), ("nearest", 1)]
    assert list(found.index) == [0, 1]


def seeded(times, **options):
    """Return records of one strategy with so many steps for each (training seed, world)."""
    return [with_spec(explored(n, trial=trial, **options), training_seed=seed) for (seed, trial), n in times.items()]


def test_the_rows_of_a_plan_are_selected_by_training_seed_too(trained):
    """A folder may hold trials of weights that are no longer asked for, and of the like without weights."""
    trained(1, 4)
    asked = plan("table2", ["gcn-obs"], [20.0], 2).specs
    made = seeded({(seed, trial): 50 for seed in (None, 0, 1, 4) for trial in range(3)}, strategy="gcn-obs")
    found = select(trial_table(made), asked)
    assert list(zip(found["training_seed"], found["trial"], strict=True)) == [(1, 0), (1, 1), (4, 0), (4, 1)]
    assert select(trial_table(made[:3]), asked).empty
    assert len(select(trial_table(made[:3]), [dataclasses.replace(asked[0], training_seed=None)])) == 1


def test_training_seeds_survive_the_file(tmp_path):
    made = seeded({(3, 0): 50}, strategy="gcn-obs") + [explored(40)]
    trial_table(made).to_csv(tmp_path / "trials.csv", index=False)
    table = read_csv(tmp_path / "trials.csv", TRIAL_COLUMNS)
    assert list(table["training_seed"]) == [3, pd.NA]


# summary.csv


@pytest.fixture(scope="module")
def trials():
    """Return the rows of two strategies on three worlds, one trial of which did not explore, and of a plugin."""
    made = [explored(n, trial=t) for t, n in enumerate((100, 120, 140))]
    made += [explored(n, trial=t, strategy="random") for t, n in enumerate((200, 220))]
    made += [explored(90, trial=2, strategy="random", status="stuck")]
    made += [explored(80, trial=t, strategy="mine") for t in range(3)]
    return trial_table(made)


def test_the_columns_of_summary_csv_are_those_of_the_design(trials):
    assert (
        *("table", "strategy", "size", "metric", "n", "failed"),
        *("mean", "ci_low", "ci_high", "paper"),
        *("seeds", "seed_low", "seed_high", "scenario"),
    ) == SUMMARY_COLUMNS
    assert tuple(summary_table(trials).columns) == SUMMARY_COLUMNS


def test_means_and_intervals_are_those_of_the_worlds(trials):
    """T = 100, 120, 140 of 100 cells with √0.25: e = 0.5, 0.6, 0.7."""
    line = lines(summary_table(trials), table="table2", strategy="nearest", metric="trajectory_error", size=20.0).iloc[
        0
    ]
    expected = mean_interval(np.array([0.5, 0.6, 0.7]))
    assert (line["mean"], line["ci_low"], line["ci_high"]) == pytest.approx((0.6, expected.low, expected.high))
    assert (line["n"], line["failed"]) == (3, 0)
    assert (line["seeds"], math.isnan(line["seed_low"]), math.isnan(line["seed_high"])) == (0, True, True)


def test_a_trial_that_did_not_explore_counts_in_the_mean_and_is_counted_beside_it(trials):
    """T = 200, 220 and the limit of 1000 with √2: e = 1, 1.1 and 10 √2."""
    line = lines(summary_table(trials), table="table2", strategy="random", metric="trajectory_error", size=20.0).iloc[0]
    assert line["mean"] == pytest.approx((1.0 + 1.1 + 10.0 * math.sqrt(2.0)) / 3)
    assert (line["n"], line["failed"]) == (3, 1)


def test_the_paper_s_value_stands_only_in_the_table_that_prints_it(trials):
    summary = lines(summary_table(trials), metric="trajectory_error", size=20.0)
    graph = lines(summary, strategy="graph-stnn").set_index("table")["paper"]
    assert graph.to_dict() == {"table2": 0.8761, "table3": 1.0160}
    random = lines(summary, strategy="random").set_index("table")["paper"]
    assert random.to_dict() == {"table2": 1.9614}
    mine = lines(summary, strategy="mine").set_index("table")["paper"]
    assert set(mine.index) == {"table2", "table3"}
    assert mine.isna().all()


def test_every_value_of_the_paper_is_in_the_summary_once(trials):
    summary = summary_table(trials)
    printed = summary[summary["paper"].notna()]
    keys = list(zip(printed["table"], printed["strategy"], printed["size"], printed["metric"], strict=True))
    wanted = [(t, name, s, m) for name, entry in strategies().items() for t, s, m in entry.published]
    assert sorted(keys) == sorted(wanted)


@pytest.mark.parametrize("scenario", ["stage", "chen2020"])
def test_beside_trials_of_another_scenario_there_is_no_value_of_the_paper(trials, scenario):
    """Nor a line for what did not run there: nobody asked for it."""
    summary = summary_table(trials.assign(scenario=scenario))
    assert summary["paper"].isna().all()
    assert set(summary["strategy"]) == set(trials["strategy"])
    ours = ["table", "strategy", "size", "metric", "n", "mean", "ci_low", "ci_high"]
    own = summary_table(trials)
    pd.testing.assert_frame_equal(summary[ours], own[own["n"] > 0][ours].reset_index(drop=True))


def test_trials_of_two_scenarios_are_not_of_the_paper_s_alone(trials):
    assert of_paper(trials)
    assert not of_paper(pd.concat((trials, trials.assign(scenario="stage"))))


def test_worlds_of_a_kind_that_says_nothing_of_them_are_not_listed(stored):
    table = world_table(stored.store.records()[0])
    assert table.empty
    assert tuple(table.columns) == WORLD_COLUMNS


def test_every_lidar_world_is_listed_once_with_its_facts_for_the_range_of_the_lidar():
    """Two strategies in two worlds, and one of these with a lidar that sees less."""
    world = drawn(8.0, (3.0, 5.0, 3.0, 5.0), start=(1.0, 1.0, 0.0))
    other = drawn(8.0, start=(1.0, 1.0, 0.0))
    near = SMALL.replace(sensor_range=2.0)
    made = [lidar_record(rows=1, strategy=name, world=world) for name in ("nearest", "random")]
    made += [lidar_record(rows=1, trial=1, world=other)]
    made += [lidar_record(rows=1, scenario=near, name="range 2 m", world=world)]
    table = world_table(made)
    assert list(table.columns) == [*WORLD_COLUMNS, "scene", *Facts._fields]
    assert table["scenario"].tolist() == ["range 2 m", "stage", "stage"]
    assert table["trial"].tolist() == [0, 0, 1]
    assert table["world"].tolist() == [world.digest, world.digest, other.digest]
    assert table["loops"].tolist() == [1, 1, 0]
    assert table["beyond_range"][0] > table["beyond_range"][1] > 0.0
    assert table["free_area"].tolist() == pytest.approx([7.8**2 - 4.0, 7.8**2 - 4.0, 7.8**2])


def test_a_strategy_without_trials_stands_in_it_with_no_worlds_and_no_mean(trials):
    line = lines(
        summary_table(trials), table="table2", strategy="graph-stnn", metric="trajectory_error", size=40.0
    ).iloc[0]
    assert (line["n"], line["failed"]) == (0, 0)
    assert math.isnan(line["mean"])


def test_a_plugin_stands_in_both_tables_after_the_registered_strategies(trials):
    summary = summary_table(trials)
    assert set(lines(summary, strategy="mine")["table"]) == {"table2", "table3"}
    assert summary["strategy"].iloc[-1] == "mine"


def test_a_variant_stands_in_the_tables_of_its_strategy_after_it_and_no_paper_prints_it(trials):
    variant = trials[trials["strategy"] == "random"].assign(strategy="random[bias=0.5]")
    summary = summary_table(pd.concat((trials, variant)))
    own = lines(summary, strategy="random[bias=0.5]")
    assert set(own["table"]) == {"table2"}
    assert own["paper"].isna().all()
    order = list(dict.fromkeys(summary["strategy"]))
    assert order.index("random[bias=0.5]") == order.index("random") + 1


def test_two_sets_of_weights_of_one_name_are_refused(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.bin").write_bytes(name.encode())
    made = explored(100)
    two = [
        with_spec(made, trial=i, training_seed=0, weights=str(tmp_path / f"{name}.bin")) for i, name in enumerate("ab")
    ]
    assert len(trial_table(two[:1])) == 1
    with pytest.raises(RequestError, match=r"the weights .*a\.bin and for the weights .*b\.bin in one folder"):
        trial_table(two)


def test_training_seeds_are_averaged_within_a_world_first():
    """Worlds count once each: n = 2, not 6."""
    table = trial_table(seeded({(0, 0): 100, (1, 0): 140, (2, 0): 120, (0, 1): 220, (1, 1): 200, (2, 1): 180}))
    assert by_world(table, "trajectory_error") == pytest.approx({0: 0.6, 1: 1.0})
    line = lines(summary_table(table), table="table2", strategy="nearest", metric="trajectory_error", size=20.0).iloc[0]
    expected = mean_interval(np.array([0.6, 1.0]))
    assert (line["n"], line["mean"], line["ci_low"]) == (2, pytest.approx(0.8), pytest.approx(expected.low))
    assert (line["seeds"], line["seed_low"], line["seed_high"]) == (3, pytest.approx(0.75), pytest.approx(0.85))


def test_worlds_weigh_alike_however_many_training_seeds_ran_on_them():
    """Worlds 0 and 1 with two seeds and world 2 with one: (0.5 + 0.7) / 2, (0.8 + 1.0) / 2 and 2."""
    table = trial_table(seeded({(0, 0): 100, (1, 0): 140, (0, 1): 160, (1, 1): 200, (1, 2): 400}))
    assert by_world(table, "trajectory_error") == pytest.approx({0: 0.6, 1: 0.9, 2: 2.0})
    line = lines(summary_table(table), table="table2", strategy="nearest", metric="trajectory_error", size=20.0).iloc[0]
    assert (line["n"], line["mean"]) == (3, pytest.approx(3.5 / 3))


def test_trials_of_every_training_seed_that_did_not_explore_are_counted():
    made = seeded({(0, 0): 100, (1, 0): 140, (1, 1): 100}) + seeded({(0, 1): 90}, status="stuck")
    made += seeded({(0, 2): 90}, status="step_limit")
    line = lines(summary_table(trial_table(made)), table="table2", strategy="nearest", metric="decisions").iloc[0]
    assert (line["n"], line["failed"]) == (3, 2)


def test_a_value_that_is_missing_is_never_left_out_of_a_mean_over_training_seeds():
    """A mean over those that have one would flatter."""
    made = [with_spec(explored(100), training_seed=0), with_spec(record("failed", MAP, rows=0), training_seed=1)]
    table = trial_table(made)
    assert math.isnan(table["path_length"].iloc[1])
    assert math.isnan(by_world(table, "path_length")[0])


@pytest.mark.parametrize(
    "other",
    [record("failed", MAP, rows=0, trial=1), explored(0, trial=1)],
    ids=["failed before its first row", "explored without a step"],
)
def test_a_metric_that_a_trial_lacks_has_no_mean_over_the_others(other):
    """It has no mean at all, or every trial counts; the summary is made either way."""
    summary = summary_table(trial_table([explored(100), other]))
    assert set(lines(summary, strategy="nearest", metric="trajectory_error")["n"]) == {2}
    for name in ("path_length", "exploration_efficiency", "pose_nees"):
        assert set(lines(summary, strategy="nearest", metric=name)["n"]) <= {0, 2}, name


def test_regret_is_summarized_where_every_world_has_a_reference():
    made = [explored(150, trial=t) for t in range(2)]
    reference = [reference_of(t, 100.0) for t in range(2)]
    full = summary_table(trial_table([*made, *reference]))
    assert lines(full, table="table2", strategy="nearest", metric="regret")["mean"].iloc[0] == pytest.approx(0.5)
    part = summary_table(trial_table([*made, reference[0]]))
    assert len(lines(part, strategy="nearest", metric="regret")) == 0


# times.csv


def outcome(trial, seconds, strategy="nearest", decisions=(0.1, 0.2, 0.6), size=12.0):
    spec = dataclasses.replace(tiny_plan(["nearest"], trials=1)[0], trial=trial, strategy=strategy)
    spec = dataclasses.replace(spec, scenario=spec.scenario.replace(size=size))
    return Outcome(spec, Status.EXPLORED, "", 25, seconds, tuple(decisions))


def test_times_are_those_of_the_outcomes(tmp_path):
    write_times(tmp_path, [outcome(0, 1.5)])
    row = read_csv(tmp_path / "times.csv", TIME_COLUMNS).iloc[0]
    assert (row["strategy"], row["size"], row["trial"], row["seconds"], row["steps"]) == ("nearest", 12.0, 0, 1.5, 25)
    assert (row["decisions"], row["decision_ms"], row["decision_ms_max"]) == (3, 200.0, 600.0)


def test_times_tell_of_every_decision_of_trials_that_were_timed_so(tmp_path):
    write_times(tmp_path, [outcome(0, 1.5), outcome(1, 1.0, decisions=(0.00123456,)), outcome(2, 1.0, decisions=())])
    table = read_times(tmp_path)
    assert every_decision_ms(table).tolist() == [100.0, 200.0, 600.0, 1.23]
    assert every_decision_ms(table.iloc[1:]).tolist() == [1.23]
    table.drop(columns=EVERY_DECISION).to_csv(tmp_path / "times.csv", index=False)
    assert every_decision_ms(read_times(tmp_path)).size == 0, "a file of an earlier version is read still"
    write_times(tmp_path, [outcome(1, 2.0)])
    mixed = read_times(tmp_path)
    assert len(mixed) == 3
    assert every_decision_ms(mixed).size == 0
    assert every_decision_ms(mixed[mixed["trial"] == 1]).tolist() == [100.0, 200.0, 600.0]


def test_times_of_later_runs_are_added_and_replace_those_of_the_same_trial(tmp_path):
    write_times(tmp_path, [outcome(1, 1.0), outcome(0, 2.0)])
    write_times(tmp_path, [outcome(1, 3.0), outcome(2, 4.0), outcome(0, 5.0, "random")])
    table = read_csv(tmp_path / "times.csv", TIME_COLUMNS)
    found = list(zip(table["strategy"], table["trial"], table["seconds"], strict=True))
    assert found == [("nearest", 0, 2.0), ("nearest", 1, 3.0), ("nearest", 2, 4.0), ("random", 0, 5.0)]


def test_times_tell_training_seeds_apart(tmp_path):
    one, other = outcome(0, 1.0), outcome(0, 2.0)
    other = dataclasses.replace(other, spec=dataclasses.replace(other.spec, training_seed=1))
    write_times(tmp_path, [one, other])
    write_times(tmp_path, [dataclasses.replace(other, seconds=3.0)])
    table = read_csv(tmp_path / "times.csv", TIME_COLUMNS)
    found = {
        (None if pd.isna(seed) else seed): s for seed, s in zip(table["training_seed"], table["seconds"], strict=True)
    }
    assert found == {None: 1.0, 1: 3.0}


def test_a_run_without_trials_leaves_the_times_alone(tmp_path):
    write_times(tmp_path, [])
    assert not (tmp_path / "times.csv").exists()


def test_a_trial_without_decisions_has_no_decision_time(tmp_path):
    write_times(tmp_path, [outcome(0, 1.0, decisions=())])
    row = read_csv(tmp_path / "times.csv", TIME_COLUMNS).iloc[0]
    assert row["decisions"] == 0
    assert math.isnan(row["decision_ms"])
    assert math.isnan(row["decision_ms_max"])


def test_the_time_to_expect_is_the_mean_of_the_like_that_ran(tmp_path):
    write_times(tmp_path, [outcome(0, 2.0), outcome(1, 4.0), outcome(0, 50.0, "random")])
    assert Expectation(tmp_path).of(tiny_plan(("nearest",), trials=1)[0]) == pytest.approx(3.0)


def test_without_times_larger_maps_are_expected_to_take_longer(tmp_path):
    small, large = tiny_plan(("nearest",), trials=1)[0], outcome(0, 1.0, size=24.0).spec
    assert 0.0 < 4 * Expectation(tmp_path).of(small) < Expectation(tmp_path).of(large)


@pytest.mark.parametrize(("suite", "least", "most"), [("paper", 10, 40), ("stage", 15, 60), ("plans", 5, 30)])
def test_the_time_that_a_suite_is_expected_to_take_is_that_of_an_idle_machine(suite, least, most, tmp_path):
    """Minutes on two cores, within a factor of two of what they took."""
    assert least < sum(map(Expectation(tmp_path).of, plan(suite).specs)) / 2 / 60 < most


def test_finer_cells_of_the_same_floor_cost_in_proportion_to_their_number(tmp_path):
    coarse = outcome(0, 1.0, size=24.0).spec
    fine = dataclasses.replace(coarse, scenario=coarse.scenario.replace(cell_size=coarse.scenario.cell_size / 2))
    assert Expectation(tmp_path).of(fine) == pytest.approx(4 * Expectation(tmp_path).of(coarse))


def test_the_time_that_is_left_follows_how_fast_trials_came():
    assert seconds_left(60.0, done=10.0, expected=30.0) == 120.0, "three times as slow as expected, two thirds left"
    assert seconds_left(60.0, done=40.0, expected=30.0) == 0.0
    assert seconds_left(60.0, done=0.0, expected=30.0) == 30.0


@pytest.mark.parametrize("content", ["", "a,b\n1,2\n", "\x00\x01"], ids=["empty", "other columns", "bytes"])
def test_a_times_file_that_is_none_is_as_good_as_none(tmp_path, content):
    [spec] = tiny_plan(("nearest",), trials=1)
    expected = Expectation(tmp_path).of(spec)
    (tmp_path / "times.csv").write_text(content)
    assert Expectation(tmp_path).of(spec) == expected
    write_times(tmp_path, [outcome(0, 1.5)])
    assert read_csv(tmp_path / "times.csv", TIME_COLUMNS)["seconds"].tolist() == [1.5]
