"""A second kind of world runs through everything that is shared, from a scenario to a row of trials.csv."""

import dataclasses
import json

import numpy as np
import pytest
from second_kind import KIND, ChessScenario, ChessStep, registered

from explore_bench import RequestError, Scenario, TrialSpec, World, draw_world, run_trial, stream
from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.tables import TRIAL_COLUMNS, summary_table, trial_table, world_table
from explore_bench.records.encoding import read_replay
from explore_bench.records.store import Store
from explore_bench.runs.workers.task import warm_up
from explore_bench.trial.steps import step_columns
from explore_bench.world.kinds import KINDS
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.scenarios import load_scenario


@pytest.fixture(autouse=True)
def _chess(monkeypatch):
    registered(monkeypatch)


STRATEGIES = {
    "nearest": "baselines.nearest:Nearest",
    "random": "baselines.random_walk:Random",
    "entropy": "baselines.entropy:Entropy",
    "uncertainty": "baselines.uncertainty:Uncertainty",
}


def spec_of(name="nearest", factory="", **options):
    return TrialSpec(name, factory or STRATEGIES[name], ChessScenario(**options), 0, purpose="calibrate")


def test_a_scenario_is_of_the_class_of_its_kind():
    assert type(Scenario(kind=KIND)) is ChessScenario
    assert type(Scenario()) is LandmarkScenario
    assert type(Scenario(kind=KIND).replace(coverage=0.5)) is ChessScenario
    assert Scenario(kind=KIND).landmarks == 0
    with pytest.raises(RequestError, match=r"kind of world 'ches' is unknown; did you mean 'chess'\?"):
        Scenario(kind="ches")
    with pytest.raises(RequestError, match="scenario key 'odometry_sigma' is unknown"):
        Scenario(kind=KIND, odometry_sigma=0.1)


def test_a_scenario_file_names_its_kind(tmp_path):
    file = tmp_path / "board.toml"
    file.write_text('kind = "chess"\npawns = 2\n')
    assert load_scenario(str(file)) == ChessScenario(pawns=2)


@pytest.mark.parametrize("name", STRATEGIES)
def test_strategies_that_know_no_kind_explore_it(name):
    result = run_trial(spec_of(name))
    assert (result.status.value, result.reason) == ("explored", "")
    assert {type(step) for step in result.steps} == {ChessStep}


def test_its_rows_have_the_common_columns_and_its_own():
    common = [name for name in step_columns("landmark") if name != "landmarks"]
    assert list(step_columns(KIND)) == [*common, "diagonal"]


def test_a_shard_brings_back_its_rows_its_scenario_and_its_world(tmp_path):
    spec = spec_of("random")
    result = run_trial(spec)
    store = Store(tmp_path / "results")
    store.open(0, "calibrate", spec.scenario)
    store.write(result)
    assert json.loads((store.runs / "protocol.json").read_text())["scenario"] == "kind=chess"
    record = store.find(spec)
    assert record.spec == spec
    assert record.world.digest == result.world.digest
    np.testing.assert_array_equal(record.world.obstacles, result.world.obstacles)
    np.testing.assert_array_equal(record.steps["diagonal"], [step.diagonal for step in result.steps])
    assert set(record.steps["robot"]) == {0}
    assert record.steps["diagonal"].any()


def test_all_metrics_and_a_row_of_trials_csv_can_be_computed(tmp_path):
    store = Store(tmp_path / "results")
    store.open(0, "calibrate", ChessScenario())
    store.write(run_trial(spec_of()))
    (record,), stale = store.records()
    assert stale == 0
    table = trial_table([record])
    assert list(table.columns) == list(TRIAL_COLUMNS)
    assert table["status"][0] == "explored"
    assert 0 < table["exploration_efficiency"][0] < record.spec.scenario.prior_uncertainty
    assert not [name for name, metric in METRICS.items() if np.isnan(metric.value(record))]


def test_a_folder_of_one_kind_refuses_the_other(tmp_path):
    Store(tmp_path).open(0, "evaluate", ChessScenario())
    with pytest.raises(RequestError, match="kind=chess"):
        Store(tmp_path).open(0, "evaluate")


def test_a_target_is_driven_to_and_replayed(tmp_path):
    file = tmp_path / "far.py"
    file.write_text(FAR)
    spec = spec_of("far", f"{file}:Far")
    result = run_trial(spec)
    assert result.status.value == "explored", result.reason
    store = Store(tmp_path / "results")
    store.open(0, "calibrate", spec.scenario)
    store.write(result)
    replay = read_replay(store.path(next(store.runs.glob("*.parquet")).stem))
    assert [choice for choice in replay.choices if choice is not None] == []
    assert all(target is not None for target in replay.targets[:-1])


FAR = """
from explore_bench import Target

class Far:
    def reset(self, rng): ...
    def choose(self, observation):
        return Target(tuple(observation.positions[observation.path_lengths.argmax()]))
"""


def test_workers_warm_up_on_a_tiny_trial_of_the_kind():
    warm_up(spec_of().scenario.tiny)
    assert Scenario().tiny.landmarks == 2


def test_every_kind_s_parts_can_be_imported_and_fit_together():
    for name, kind in KINDS.items():
        scenario = Scenario(kind=name)
        assert type(scenario) is kind.load("scenario")
        world = draw_world(scenario, stream("calibrate", 0, scenario.size, 0, "world"))
        assert isinstance(world, kind.load("world"))
        again: World = kind.load("world").from_facts(json.loads(json.dumps(world.facts())), scenario)
        assert again.digest == world.digest
        assert (again.grid, again.start) == (world.grid, world.start)
        assert all(part.count(":") == 1 for part in (*kind.simulated, *filter(None, vars(kind).values())))


def test_what_a_kind_does_not_have_has_a_stand_in():
    assert KINDS[KIND].load("metrics", {}) == {}
    assert KINDS[KIND].load("tables") is None


def test_a_kind_s_own_metrics_and_facts_come_into_the_files_of_a_folder(tmp_path, monkeypatch):
    """Columns after the common ones, lines of the summary, and a line of worlds.csv a world."""
    more = {"metrics": "second_kind_analysis:METRICS", "facts": "second_kind_analysis:facts"}
    monkeypatch.setitem(KINDS, KIND, dataclasses.replace(KINDS[KIND], **more))
    store = Store(tmp_path / "results")
    store.open(0, "calibrate", ChessScenario())
    for name in ("nearest", "random"):
        store.write(run_trial(spec_of(name)))
    records, _ = store.records()
    table = trial_table(records)
    assert list(table.columns) == [*TRIAL_COLUMNS, "turns"]
    for record, turns in zip(records, table["turns"], strict=True):
        assert turns == record.steps["diagonal"].sum()
    [line] = summary_table(table).query("strategy == 'nearest' and metric == 'turns'").to_dict("records")
    assert line["mean"] == table["turns"][0]
    worlds = world_table(records)
    assert worlds.to_dict("records") == [
        {"scenario": "paper", "size": 16.0, "trial": 0, "world": records[0].world.digest, "pawns": 4}
    ]
