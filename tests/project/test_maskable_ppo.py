"""The example that trains MaskablePPO: it learns to beat chance, and its policy enters the benchmark as a plugin."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from handmade import record
from safetensors.numpy import load_file, save_file

from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.statistics import paired_difference
from explore_bench.cli import main
from explore_bench.errors import RequestError
from explore_bench.strategies.loading import load_factory
from explore_bench.trial.decision_process import Course
from explore_bench.trial.features import CANDIDATE_COLUMNS, STATE_COLUMNS, features
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import step_columns
from explore_bench.world.scenarios import PAPER

EXAMPLES = Path(__file__).parents[2] / "examples"
PLUGIN = f"{EXAMPLES / 'maskable_ppo.py'}:MaskablePPO"
DECISIONS, WORLDS = 12_288, 30
INPUTS = 14 * len(CANDIDATE_COLUMNS) + len(STATE_COLUMNS)


@pytest.fixture(scope="module")
def example():
    """Import the training script the way it runs: with its own folder on the path."""
    for library in ("gymnasium", "sb3_contrib"):
        pytest.importorskip(library, reason=f"{library} is missing: install the extra 'test'")
    sys.path.insert(0, str(EXAMPLES))
    yield importlib.import_module("train_maskable_ppo")
    sys.path.remove(str(EXAMPLES))


@pytest.fixture(scope="module")
def trained(example, tmp_path_factory):
    """Train with a fixed seed and budget; return the model and the file of its policy."""
    model = example.train(DECISIONS, seed=0, verbose=0)
    path = tmp_path_factory.mktemp("policy") / "maskable_ppo.safetensors"
    example.export(model, path)
    return SimpleNamespace(model=model, path=path)


def efficiencies(factory, weights=None):
    """η of a strategy in each validation world."""
    found = {}
    for trial in range(WORLDS):
        result = run_trial(TrialSpec("any", factory, PAPER, trial, purpose="validate", weights=weights))
        assert result.status is not Status.FAILED, result.reason
        columns = {name: [getattr(step, name) for step in result.steps] for name in step_columns("landmark")}
        found[trial] = METRICS["exploration_efficiency"].value(record(result.status.value, PAPER, **columns))
    return found


@pytest.mark.slow
def test_it_beats_chance_in_worlds_that_it_has_not_seen(trained):
    policy = efficiencies(PLUGIN, str(trained.path))
    difference = paired_difference(policy, efficiencies("baselines.random_walk:Random"))
    assert difference.n == WORLDS
    assert difference.low > 0.0, difference
    assert np.mean(list(policy.values())) > 1.4


@pytest.mark.slow
def test_the_plugin_chooses_as_the_model_does(trained):
    plugin = load_factory(PLUGIN)(str(trained.path))
    process, count = Course(PAPER, "validate", 1).begin(0), 0
    while process.observation is not None:
        seen = features(process.observation)
        mask = np.arange(14) < len(seen.order)
        action, _ = trained.model.predict(
            {"candidates": seen.candidates, "state": seen.state}, action_masks=mask, deterministic=True
        )
        assert plugin.choose(process.observation) == seen.order[int(action)]
        process.decide(plugin.choose(process.observation))
        count += 1
    assert count > 4


@pytest.mark.slow
def test_it_enters_the_benchmark_beside_the_others(trained, tmp_path):
    results = tmp_path / "results"
    name = f'MaskablePPO[weights="{trained.path.name}"]'
    asked = ["-s", f"{EXAMPLES / 'maskable_ppo.py'}:MaskablePPO[weights={trained.path}]", "-s", "random"]
    with pytest.raises(SystemExit) as ended:
        main(["run", "smoke", *asked, "--trials", "2", "--results", str(results)])
    assert ended.value.code == 0
    rows = pd.read_csv(results / "trials.csv")
    assert set(rows["strategy"]) == {name, "random"}
    assert (rows["status"] == "explored").all()


@pytest.mark.slow
def test_a_seed_gives_the_same_policy_again(example, tmp_path):
    files = [tmp_path / f"{i}.safetensors" for i in range(3)]
    for seed, file in zip((3, 3, 4), files, strict=True):
        example.export(example.train(512, seed, verbose=0), file)
    one, same, other = map(load_file, files)
    assert one.keys() == same.keys() == other.keys()
    assert all(np.array_equal(one[name], same[name]) for name in one)
    assert not all(np.array_equal(one[name], other[name]) for name in one)


# The plugin alone


def layers(width=14):
    """Tensors of a policy that prefers the row of the longest path, whatever it sees."""
    bias = np.arange(width, dtype=np.float32)
    return {"0.weight": np.zeros((width, INPUTS), dtype=np.float32), "0.bias": bias}


COLUMNS = {"candidates": " ".join(CANDIDATE_COLUMNS), "state": " ".join(STATE_COLUMNS)}


def test_only_candidates_are_chosen(tmp_path):
    """A policy that always wants the last action gets the last candidate."""
    save_file(layers(), tmp_path / "last.safetensors", COLUMNS)
    plugin = load_factory(PLUGIN)(str(tmp_path / "last.safetensors"))
    process = Course(PAPER, "validate", 0).begin(0)
    while process.observation is not None:
        order = features(process.observation).order
        assert plugin.choose(process.observation) == order[-1]
        process.decide(plugin.choose(process.observation))


def test_on_larger_maps_it_sees_the_candidates_with_the_shortest_paths(tmp_path):
    save_file(layers(), tmp_path / "last.safetensors", COLUMNS)
    plugin = load_factory(PLUGIN)(str(tmp_path / "last.safetensors"))
    process, beyond = Course(PAPER.replace(size=40.0, steps_per_cell=1.0), "validate", 0).begin(0), 0
    while process.observation is not None:
        order = features(process.observation).order
        beyond += len(order) > 14
        assert plugin.choose(process.observation) == order[:14][-1]
        process.decide(plugin.choose(process.observation))
    assert beyond > 0


def test_a_file_that_is_missing_or_foreign_is_refused(tmp_path):
    make = load_factory(PLUGIN)
    with pytest.raises(RequestError, match="make it with train_maskable_ppo"):
        make(str(tmp_path / "nowhere.safetensors"))
    (tmp_path / "text.safetensors").write_text("no weights")
    with pytest.raises(RequestError, match="cannot be read"):
        make(str(tmp_path / "text.safetensors"))
    save_file(layers(), tmp_path / "other.safetensors", {**COLUMNS, "state": "other"})
    with pytest.raises(RequestError, match="train it anew"):
        make(str(tmp_path / "other.safetensors"))
