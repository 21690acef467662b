"""The example that trains MaskablePPO: what its plugin chooses.

That it learns to beat chance and enters the benchmark is asked of the training of docs/gymnasium.md (left_by_pages.py).
"""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from explore_bench.errors import RequestError
from explore_bench.strategies.loading import load_factory
from explore_bench.trial.decision_process import Course
from explore_bench.trial.features import CANDIDATE_COLUMNS, STATE_COLUMNS, features
from explore_bench.world.scenarios import PAPER

EXAMPLES = Path(__file__).parents[2] / "examples"
PLUGIN = f"{EXAMPLES / 'maskable_ppo.py'}:MaskablePPO"
DECISIONS = 512
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
    """Train a little with a fixed seed; return the model and the file of its policy."""
    model = example.train(DECISIONS, seed=3, verbose=0)
    path = tmp_path_factory.mktemp("policy") / "maskable_ppo.safetensors"
    example.export(model, path)
    return SimpleNamespace(model=model, path=path)


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
def test_a_seed_gives_the_same_policy_again(example, trained, tmp_path):
    files = [trained.path, tmp_path / "again.safetensors", tmp_path / "other.safetensors"]
    for seed, file in zip((3, 4), files[1:], strict=True):
        example.export(example.train(DECISIONS, seed, verbose=0), file)
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
