"""Where files of weights lie: paths, and names below a package that stay true wherever it is installed."""

import sys
from pathlib import Path

import pytest
from handmade import TINY

import baselines
from explore_bench.records.provenance import spec_values, trial_key, weights_digest
from explore_bench.strategies.entry import weights_file
from explore_bench.trial.spec import TrialSpec


def test_a_name_below_a_package_is_a_file_of_it():
    place = Path(baselines.__file__).parent
    assert weights_file("baselines:weights/a-0.safetensors") == place / "weights" / "a-0.safetensors"


@pytest.mark.parametrize(
    "path", ["/a/b-0.safetensors", "b-0.safetensors", "no_such_package:b-0.safetensors", "math:b", "C:b-0.safetensors"]
)
def test_anything_else_is_a_path(path):
    assert weights_file(path) == Path(path)


def test_a_package_that_moves_keeps_the_names_and_keys_of_its_trials(tmp_path, monkeypatch):
    """The stored specification names no folder, the factory is given the file where it lies now."""
    keys = []
    for folder in ("here", "there"):
        package = tmp_path / folder / "movable"
        package.mkdir(parents=True)
        (package / "__init__.py").write_text("")
        (package / "w-0.safetensors").write_bytes(b"weights")
        monkeypatch.syspath_prepend(package.parent)
        sys.modules.pop("movable", None)
        weights_digest.cache_clear()
        spec = TrialSpec("w", "baselines.nearest:Nearest", TINY, 0, training_seed=0, weights="movable:w-0.safetensors")
        assert spec.arguments == {"weights": str(package / "w-0.safetensors")}
        assert spec_values(spec)["weights"] == "movable:w-0.safetensors"
        keys.append(trial_key(spec))
    assert keys[0] == keys[1]
    (package / "w-0.safetensors").write_bytes(b"other weights")
    weights_digest.cache_clear()
    assert trial_key(spec) != keys[0]
