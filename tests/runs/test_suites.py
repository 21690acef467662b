"""Suites and plans: what a request asks for, in which order, and what it may not ask for."""

import dataclasses
import math

import pytest
from handmade import TINY, write_plugin

from explore_bench.errors import RequestError
from explore_bench.runs.suites import SUITES, plan
from explore_bench.strategies.registry import strategies
from explore_bench.world.maps import gallery
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER, STAGE

UNTRAINED_BASELINES = {
    "entropy",
    "entropy-path",
    "entropy-per-metre",
    "uncertainty",
    "random",
    "nearest",
    "clairvoyant",
    "clairvoyant-accurate",
}
CLAIRVOYANT = ("clairvoyant", "clairvoyant-accurate")
ABLATIONS = {
    *("no-state", "no-temporal", "no-spatial"),
    *("no-temporal-state", "no-spatial-state", "no-spatial-temporal"),
}
LEARNED = {
    "table2": {"graph-stnn", "graph-stnn-path", "belief-attention", "gcn-no-obs", "gcn-obs", "gcn-obs-blind"},
    "table3": {"graph-stnn", *ABLATIONS},
    "layers": {"graph-stnn", "graph-stnn-1-layer", "graph-stnn-3-layers"},
    "cells": {f"{name}-cell" for name in ("graph-stnn", *ABLATIONS)},
}

FIELD = {name for name, entry in strategies().items() if entry.factory.startswith("baselines.field")}
BESIDE_FIELD = {
    "nearest",
    "random",
    "entropy",
    "entropy-path",
    "entropy-per-metre",
    "uncertainty",
    "belief-attention",
    "graph-stnn",
}


@pytest.fixture
def all_trained(monkeypatch):
    """Give every learned strategy the weights of two training seeds; a plan does not look whether they are there."""
    known = strategies()
    for name, entry in known.items():
        if entry.trainer:
            weights = {seed: f"/nowhere/{name}-{seed}.safetensors" for seed in (0, 3)}
            monkeypatch.setitem(known, name, dataclasses.replace(entry, weights=weights))


def message(*arguments, **options):
    with pytest.raises(RequestError) as caught:
        plan(*arguments, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def cells(specs):
    return {(spec.strategy, spec.scenario.size, spec.trial) for spec in specs}


def every_field(spec):
    return spec.strategy, spec.scenario.size, spec.trial, spec.training_seed, spec.weights


# What the suites hold


def test_the_suites_of_the_benchmark():
    landmarks = ["smoke", "table2", "table3", "layers", "cells", "paper", "robustness", "maps"]
    assert list(SUITES) == [*landmarks, "stage", "plans", "figure16", "field", "field-stage", "confirmation"]
    assert all(suite.description for suite in SUITES.values())


def test_robustness_runs_every_strategy_at_20_m_under_every_variation_of_one_constant(all_trained):
    asked = plan("robustness")
    assert asked.scenario is None
    assert plan("paper").scenario == PAPER
    assert {spec.strategy for spec in asked.specs} == set(strategies()) - LEARNED["cells"] - FIELD
    names = list(SUITES["robustness"].variations)
    assert names[0] == "paper"
    for strategy in ("nearest", "gcn-obs"):
        own = [spec for spec in asked.specs if spec.strategy == strategy and spec.training_seed in (None, 0)]
        assert [spec.scenario_name for spec in own] == [name for name in names for _ in range(20)]
        assert {spec.trial for spec in own} == set(range(20))
    physics = {spec.scenario_name: spec.scenario for spec in asked.specs}
    assert len(set(physics.values())) == len(names) == 10
    for name, scenario in physics.items():
        changes = SUITES["robustness"].variations[name]
        assert scenario == PAPER.replace(**changes)
        assert len(changes) == (name != "paper")
    assert PAPER.odometry_sigma * 4 == physics["odometry noise × 4"].odometry_sigma
    assert physics["sensor range 3 m"].sensor_range == 3.0
    assert physics["occlusion"].occlusion


def test_a_suite_may_ask_for_the_first_training_seed_only():
    learned = next(name for name, entry in strategies().items() if len(entry.weights) > 1)
    assert {spec.training_seed for spec in plan("robustness", [learned]).specs} == {0}
    assert {spec.training_seed for spec in plan("smoke", [learned]).specs} == set(strategies()[learned].weights)


def test_variations_change_a_scenario_that_is_given():
    asked = plan("robustness", ["nearest"], trials=1, scenario=PAPER.replace(range_sigma=0.1)).specs
    assert {spec.scenario.range_sigma for spec in asked} == {0.1}
    assert len(asked) == 10


def test_maps_runs_the_compared_methods_on_20_worlds_of_every_map_of_the_gallery_with_occlusion(all_trained):
    asked = plan("maps")
    assert asked.scenario is None
    assert {spec.strategy for spec in asked.specs} == UNTRAINED_BASELINES | LEARNED["table2"]
    own = [spec for spec in asked.specs if spec.strategy == "nearest"]
    assert [spec.scenario_name for spec in own] == [name for name in gallery() for _ in range(20)]
    for spec in own:
        assert spec.scenario == PAPER.replace(map=gallery()[spec.scenario_name], occlusion=True)
        assert spec.scenario.size == 40.0


def test_the_field_runs_at_three_sizes_beside_what_others_know_with_one_training_seed(all_trained):
    asked = plan("field")
    here = {name for name in FIELD if not strategies()[name].kinds}
    assert len(here) > 20
    assert cells(asked.specs) == {
        (name, size, trial)
        for name in here | BESIDE_FIELD | {"clairvoyant"}
        for size in (20.0, 30.0, 40.0)
        for trial in range(50)
    }
    assert len(asked.specs) == len(cells(asked.specs))
    assert {spec.training_seed for spec in asked.specs} == {None, 0}


def test_the_field_runs_in_the_worlds_of_the_stage_too_with_what_needs_fine_maps(all_trained):
    asked = plan("field-stage", trials=2)
    assert {spec.strategy for spec in asked.specs} == FIELD | BESIDE_FIELD
    stage = {(spec.scenario_name, spec.scenario) for spec in plan("stage", ["nearest"], trials=1).specs}
    assert {(spec.scenario_name, spec.scenario) for spec in asked.specs} == stage
    assert asked.elsewhere == ()


@pytest.mark.parametrize("suite", [name for name in SUITES if name not in ("field", "field-stage", "confirmation")])
def test_no_other_suite_takes_the_field(all_trained, suite):
    assert not {spec.strategy for spec in plan(suite, trials=1).specs} & FIELD


def test_constants_of_a_scenario_hold_in_the_maps_of_a_suite_too():
    asked = plan("maps", ["nearest"], trials=1, scenario=PAPER.replace(size=30.0, range_sigma=0.1)).specs
    assert {(spec.scenario.range_sigma, spec.scenario.size) for spec in asked} == {(0.1, 40.0)}
    coarse = plan("maps", ["nearest"], trials=1, scenario=PAPER.replace(cell_size=1.0)).specs
    assert {spec.scenario.size for spec in coarse} == {20.0}


def test_a_map_keeps_its_size_in_every_suite():
    mapped = PAPER.replace(map=gallery()["loop"])
    assert {spec.scenario.size for spec in plan("table2", ["nearest"], trials=1, scenario=mapped).specs} == {40.0}
    asked = plan("robustness", ["nearest"], trials=1, scenario=mapped).specs
    assert {(spec.scenario.map, spec.scenario.size) for spec in asked} == {(mapped.map, 40.0)}


def test_a_size_that_is_not_the_map_s_and_two_maps_at_once_are_refused():
    mapped = PAPER.replace(map=gallery()["loop"])
    assert "size 20 m is not that of the map, 40 m" in message("table2", ["nearest"], [20.0], scenario=mapped)
    assert "size 30 m is not that of the map, 40 m" in message("maps", ["nearest"], [30.0])
    assert plan("maps", ["nearest"], [40.0], 1).specs == plan("maps", ["nearest"], trials=1).specs
    assert "suite 'maps' has maps of its own" in message("maps", ["nearest"], scenario=mapped)


# Lidar worlds


def test_stage_runs_the_compared_methods_on_50_lidar_worlds_at_two_ranges(all_trained):
    asked = plan("stage")
    assert asked.scenario is None
    assert {spec.strategy for spec in asked.specs} == UNTRAINED_BASELINES - set(CLAIRVOYANT) | LEARNED["table2"]
    assert asked.elsewhere == CLAIRVOYANT
    own = [spec for spec in asked.specs if spec.strategy == "gcn-obs"]
    assert [spec.scenario_name for spec in own] == [name for name in ("range 10 m", "range 5 m") for _ in range(50)]
    assert {spec.training_seed for spec in own} == {0}
    scenarios = {spec.scenario_name: spec.scenario for spec in own}
    assert scenarios == {f"range {r} m": STAGE.replace(size=20.0, sensor_range=float(r)) for r in (10, 5)}
    assert scenarios["range 10 m"].scene == "dense"
    assert own[0].generator("world").integers(10**9) == own[50].generator("world").integers(10**9), "the same scenes"


def test_plans_runs_five_methods_on_ten_floor_plans_of_each_kind(all_trained):
    asked = plan("plans")
    assert asked.scenario is None
    assert {spec.strategy for spec in asked.specs} == {"random", "nearest", "entropy", "graph-stnn", "belief-attention"}
    own = [spec for spec in asked.specs if spec.strategy == "graph-stnn"]
    assert [spec.scenario_name for spec in own] == [n for n in ("office", "rooms", "maze", "hall") for _ in range(10)]
    assert all(spec.scenario == STAGE.replace(size=20.0, scene=spec.scenario_name) for spec in own)


def test_figure_16_runs_two_methods_on_five_scenes(all_trained):
    asked = plan("figure16")
    assert asked.scenario == STAGE
    assert [(spec.strategy, spec.trial) for spec in asked.specs] == [
        (name, trial) for name in ("graph-stnn", "nearest") for trial in range(5)
    ]
    assert {(spec.scenario, spec.scenario_name) for spec in asked.specs} == {(STAGE.replace(size=20.0), "stage")}


@pytest.mark.parametrize("suite", ["stage", "plans", "figure16"])
def test_a_plugin_runs_in_all_worlds_of_a_suite_of_lidars(tmp_path, suite):
    asked = plan(suite, [write_plugin(tmp_path)], trials=1)
    assert [spec.scenario_name for spec in asked.specs] == list(SUITES[suite].variations or ["stage"])
    assert {spec.scenario.kind for spec in asked.specs} == {"lidar"}


@pytest.mark.parametrize("suite", ["stage", "plans", "figure16"])
def test_a_suite_with_a_scenario_of_its_own_takes_no_other(suite):
    for other in (STAGE, PAPER.replace(map=gallery()["loop"])):
        sentence = message(suite, ["nearest"], scenario=other)
        assert f"suite '{suite}' runs in the scenario 'stage' alone; leave your scenario or map out" in sentence


@pytest.mark.parametrize("suite", ["robustness", "maps"])
def test_variations_of_one_kind_of_world_are_refused_in_another(suite):
    sentence = message(suite, ["nearest"], scenario=STAGE)
    assert f"suite '{suite}' varies worlds of kind 'landmark', not 'lidar'; leave your scenario out" in sentence


def test_the_paper_s_suite_runs_in_lidar_worlds_but_for_what_cannot(all_trained):
    asked = plan("paper", trials=1, scenario=STAGE, scenario_name="stage")
    here = plan("paper", trials=1)
    assert asked.elsewhere == CLAIRVOYANT
    assert not here.elsewhere
    assert cells(asked.specs) == {cell for cell in cells(here.specs) if cell[0] not in CLAIRVOYANT}
    assert {(spec.scenario.kind, spec.scenario_name) for spec in asked.specs} == {("lidar", "stage")}


def test_a_strategy_named_for_worlds_in_which_it_cannot_run_is_refused():
    sentence = message("smoke", ["nearest", "clairvoyant"], scenario=STAGE)
    assert sentence == "strategy 'clairvoyant' runs in worlds of kind landmark, not 'lidar'; leave it out."


# The paper's suites


def test_table_2_runs_at_20_and_40_m_and_table_3_at_30_m_too_on_50_worlds():
    assert (SUITES["table2"].sizes, SUITES["table2"].trials) == ((20.0, 40.0), 50)
    assert (SUITES["table3"].sizes, SUITES["table3"].trials) == ((20.0, 30.0, 40.0), 50)


def test_the_paper_is_table_2_table_3_layers_and_cells_without_repeats_and_table_2_at_30_m(all_trained):
    paper = plan("paper").specs
    parts = [plan(name).specs for name in ("table2", "table3", "layers", "cells")]
    between = plan("table2", sizes=[30.0]).specs
    assert cells(paper) == set().union(*map(cells, (*parts, between)))
    assert len(set(map(every_field, paper))) == len(paper)


def test_the_paper_suite_runs_every_strategy_that_needs_no_training_on_50_worlds_of_three_sizes(untrained):
    untrained()
    paper = plan("paper").specs
    assert cells(paper) == {
        (name, size, trial) for name in UNTRAINED_BASELINES for size in (20.0, 30.0, 40.0) for trial in range(50)
    }


def test_the_paper_suite_runs_compared_methods_and_ablations_at_three_sizes_and_the_others_at_20_m(all_trained):
    sizes = {}
    for spec in plan("paper", trials=1).specs:
        sizes.setdefault(spec.strategy, set()).add(spec.scenario.size)
    everywhere = UNTRAINED_BASELINES | LEARNED["table2"] | LEARNED["table3"]
    assert sizes == {name: {20.0, 30.0, 40.0} for name in everywhere} | {
        name: {20.0} for name in (LEARNED["layers"] | LEARNED["cells"]) - everywhere
    }


def test_what_needs_no_training_is_no_part_of_table_3(all_trained):
    assert {spec.strategy for spec in plan("table3", trials=1).specs} == LEARNED["table3"]


def test_smoke_looks_at_every_compared_strategy_that_can_run(all_trained, untrained):
    assert {spec.strategy for spec in plan("smoke").specs} == UNTRAINED_BASELINES | LEARNED["table2"]
    untrained()
    assert {spec.strategy for spec in plan("smoke").specs} == UNTRAINED_BASELINES


@pytest.mark.parametrize("suite", LEARNED)
def test_strategies_without_weights_are_listed_and_not_run(untrained, suite):
    untrained()
    asked = plan(suite)
    assert set(asked.untrained) == LEARNED[suite]
    assert {spec.strategy for spec in asked.specs} == (UNTRAINED_BASELINES if suite == "table2" else set())


def test_layers_asks_for_the_strategies_of_figure_8_only(all_trained):
    asked = plan("layers", trials=1)
    assert {(spec.strategy, spec.scenario.size) for spec in asked.specs} == {(n, 20.0) for n in LEARNED["layers"]}
    assert asked.untrained == ()


def test_a_named_strategy_without_weights_is_listed_too(untrained):
    untrained("graph-stnn")
    asked = plan("table2", ["graph-stnn", "nearest"], trials=1)
    assert asked.untrained == ("graph-stnn",)
    assert {spec.strategy for spec in asked.specs} == {"nearest"}


# Training seeds


def test_a_learned_strategy_runs_with_the_weights_of_each_training_seed_on_the_same_worlds(all_trained):
    specs = plan("table2", ["gcn-no-obs"], trials=3).specs
    assert [(spec.scenario.size, spec.training_seed, spec.trial) for spec in specs] == [
        (size, seed, trial) for size in (20.0, 40.0) for seed in (0, 3) for trial in range(3)
    ]
    assert {(spec.training_seed, spec.weights) for spec in specs} == {
        (seed, f"/nowhere/gcn-no-obs-{seed}.safetensors") for seed in (0, 3)
    }


def test_weights_reach_the_factory_beside_the_parameters(all_trained):
    spec = plan("table2", ["gcn-no-obs"], trials=1).specs[0]
    assert spec.parameters == {"obstacles": False}
    assert spec.arguments == {"obstacles": False, "weights": "/nowhere/gcn-no-obs-0.safetensors"}
    assert spec.factory == strategies()["gcn-no-obs"].factory


def test_a_strategy_that_is_not_learned_runs_once_without_weights(all_trained):
    specs = plan("table2", ["nearest"], [20.0], 2).specs
    assert [(spec.trial, spec.training_seed, spec.weights) for spec in specs] == [(0, None, None), (1, None, None)]
    assert specs[0].arguments == {}


def test_a_trial_draws_the_same_world_and_noise_whatever_the_training_seed(all_trained):
    one, other = plan("table2", ["gcn-obs"], [20.0], 1).specs
    assert (one.training_seed, other.training_seed) == (0, 3)
    for role in ("world", "motion", "sensor", "strategy"):
        assert one.generator(role).integers(10**9) == other.generator(role).integers(10**9)


# Plans


def test_a_plan_goes_by_strategy_then_size_then_world():
    specs = plan("table3", ["random", "nearest"], trials=2).specs
    assert [(spec.strategy, spec.scenario.size, spec.trial) for spec in specs] == [
        (name, size, trial) for name in ("random", "nearest") for size in (20.0, 30.0, 40.0) for trial in (0, 1)
    ]


def test_a_plan_is_the_same_every_time():
    assert plan("paper") == plan("paper")


def test_a_plan_s_trials_carry_what_their_entry_says():
    entry = strategies()["clairvoyant"]
    spec = plan("smoke", ["clairvoyant"], trials=1).specs[0]
    assert (spec.factory, spec.reference, spec.parameters) == (entry.factory, True, dict(entry.parameters))
    assert (spec.purpose, spec.root, spec.training_seed, spec.scenario_name) == ("evaluate", 0, None, "paper")
    assert spec.scenario == PAPER.replace(size=20.0)


def test_root_seed_and_purpose_reach_every_trial():
    specs = plan("smoke", root=9, purpose="calibrate").specs
    assert {(spec.root, spec.purpose) for spec in specs} == {(9, "calibrate")}


def test_sizes_and_numbers_can_be_asked_for():
    specs = plan("table2", ["nearest"], [12.0, 16.0], 3).specs
    assert [(spec.scenario.size, spec.trial) for spec in specs] == [(s, t) for s in (12.0, 16.0) for t in range(3)]


def test_a_size_asked_for_twice_runs_once():
    specs = plan("smoke", ["nearest"], [12.0, 12.0], 2).specs
    assert len(specs) == len(cells(specs)) == 2


def test_a_strategy_asked_for_twice_runs_once():
    specs = plan("smoke", ["nearest", "nearest"], trials=2).specs
    assert len(specs) == 2


def test_two_strategies_of_one_name_are_refused(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    a, b = (write_plugin(tmp_path / folder) for folder in "ab")
    assert message("smoke", [a, b]) == (
        f"strategies '{a}' and '{b}' have the same name, 'Plugin': one is {a}, the other {b}; "
        "rename one factory or leave one out."
    )


def test_two_of_one_name_that_differ_in_their_weights_are_told_by_them(tmp_path):
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "w.safetensors").write_bytes(b"")
    plugin, *files = write_plugin(tmp_path), *(tmp_path / folder / "w.safetensors" for folder in "ab")
    sentence = message("smoke", [f"{plugin}[weights={file}]" for file in files])
    assert f"one is {plugin} with the weights {files[0]}, the other {plugin} with the weights {files[1]};" in sentence


def test_one_strategy_named_in_two_ways_is_called_the_same(tmp_path):
    plugin = write_plugin(tmp_path)
    sentence = message("smoke", ["nearest", plugin, plugin.replace("/plugin", "/./plugin")])
    assert sentence.endswith(f"have the same name, 'Plugin', and are both {plugin}; leave one out.")
    assert "nearest" not in sentence


def test_a_plugin_of_the_name_of_a_registered_strategy_is_refused_beside_it(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("class nearest: ...\n")
    assert "the name of a registered one" in message("smoke", ["nearest", f"{file}:nearest"])


def test_a_plugin_runs_at_all_sizes_of_the_suite(tmp_path):
    specs = plan("table3", [write_plugin(tmp_path)], trials=1).specs
    assert [spec.scenario.size for spec in specs] == [20.0, 30.0, 40.0]
    assert {spec.strategy for spec in specs} == {"Plugin"}


# Scenarios


def test_a_scenario_without_a_size_takes_the_sizes_of_the_suite():
    specs = plan("table2", ["nearest"], trials=1, scenario=Scenario(coverage=0.7), scenario_name="mine").specs
    assert [spec.scenario.size for spec in specs] == [20.0, 40.0]
    assert {(spec.scenario.coverage, spec.scenario_name) for spec in specs} == {(0.7, "mine")}


def test_a_scenario_with_a_size_of_its_own_keeps_it():
    specs = plan("table2", ["nearest"], trials=1, scenario=Scenario(size=12.0)).specs
    assert [spec.scenario.size for spec in specs] == [12.0]


def test_a_scenario_whose_own_size_is_the_default_keeps_it():
    specs = plan("table2", ["nearest"], trials=1, scenario=Scenario(size=20.0)).specs
    assert [spec.scenario.size for spec in specs] == [20.0]


def test_a_size_that_is_asked_for_wins_over_the_scenario_s():
    specs = plan("table2", ["nearest"], [16.0], 1, scenario=TINY).specs
    assert [spec.scenario for spec in specs] == [TINY.replace(size=16.0)]


# What may not be asked for


@pytest.mark.parametrize(("wrong", "right"), [("tabel2", "table2"), ("Smoke", "smoke"), ("papers", "paper")])
def test_an_unknown_suite_is_refused_with_the_nearest_spelling(wrong, right):
    sentence = message(wrong)
    assert f"suite '{wrong}' is unknown" in sentence
    assert f"did you mean '{right}'?" in sentence


def test_an_unknown_strategy_is_refused():
    assert "strategy 'nearst' is unknown" in message("smoke", ["random", "nearst"])


@pytest.mark.parametrize("trials", [0, -3])
def test_a_number_of_trials_below_one_is_refused(trials):
    assert f"trials is {trials}" in message("smoke", trials=trials)


@pytest.mark.parametrize("root", [-1, 2**32])
def test_a_root_seed_out_of_range_is_refused_with_the_range(root):
    sentence = message("smoke", root=root)
    assert f"seed is {root}" in sentence
    assert str(2**32 - 1) in sentence


@pytest.mark.parametrize("root", [0, 2**32 - 1])
def test_the_ends_of_the_range_of_root_seeds_can_be_used(root):
    assert plan("smoke", ["nearest"], trials=1, root=root).specs[0].root == root


@pytest.mark.parametrize("size", [0.0, -20.0, 21.0, 2.0, 1e6, math.nan, math.inf])
def test_a_size_that_no_map_can_have_is_refused_by_its_value(size):
    assert f"{size:g}" in message("smoke", ["nearest"], [size])
