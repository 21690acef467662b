"""Tasks for other machines: their files travel, and other code is refused by what differs."""

import dataclasses
from pathlib import Path

import pytest
from handmade import tiny_plan, write_plugin

from explore_bench.records.provenance import trial_key
from explore_bench.runs.workers.parcel import OtherCodeError, pack, unpack
from explore_bench.runs.workers.task import make_task
from explore_bench.trial.run import run_trial


def parcel_of(factory):
    return pack(make_task(tiny_plan([factory], trials=1)[0], 60.0))


def test_a_strategy_of_a_package_travels_by_its_name(tmp_path):
    for name in ("nearest", "graph-stnn"):
        parcel = parcel_of(name)
        assert parcel.files == {}
        assert unpack(parcel, tmp_path) == parcel.task.spec
    assert list(tmp_path.iterdir()) == []


def test_a_plugin_s_file_travels_with_its_task_and_runs_where_it_is_not(tmp_path, fresh_digests):
    there = tmp_path / "there"
    there.mkdir()
    parcel = parcel_of(write_plugin(tmp_path))
    (tmp_path / "plugin.py").unlink()
    fresh_digests()
    spec = unpack(parcel, there)
    assert Path(spec.factory).is_relative_to(there)
    assert trial_key(spec) == parcel.task.key
    assert run_trial(spec).status == "explored"
    assert unpack(parcel, there) == spec, "the same files have one copy"


def test_an_edited_plugin_has_a_copy_of_its_own(tmp_path, fresh_digests):
    there = tmp_path / "there"
    there.mkdir()
    first = unpack(parcel_of(write_plugin(tmp_path)), there)
    factory = write_plugin(tmp_path, "return 0")
    fresh_digests()
    second = unpack(parcel_of(factory), there)
    assert first.factory != second.factory
    assert trial_key(first) != trial_key(second)


def test_weights_that_lie_in_no_package_travel_with_their_card(tmp_path, trained, fresh_digests):
    there = tmp_path / "there"
    there.mkdir()
    weights = Path(trained(0)[0])
    parcel = parcel_of("gcn-obs")
    for file in (weights, weights.with_suffix(".json")):
        file.unlink()
    fresh_digests()
    spec = unpack(parcel, there)
    assert Path(spec.weights).is_relative_to(there)
    assert run_trial(spec).status == "explored"


@pytest.mark.parametrize("name", ["numpy", "code"])
def test_what_differs_is_named(tmp_path, name):
    parcel = parcel_of("nearest")
    assert name in parcel.versions
    other = dataclasses.replace(
        parcel,
        task=dataclasses.replace(parcel.task, key="0" * 20),
        versions={**parcel.versions, name: "0.0"},
    )
    with pytest.raises(OtherCodeError) as caught:
        unpack(other, tmp_path)
    assert f"it has {name} {parcel.versions[name]} for 0.0;" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_edited_code_of_the_core_is_refused(tmp_path, monkeypatch, fresh_digests):
    from explore_bench.records import provenance
    from explore_bench.robot.planning import shortest_paths

    parcel = parcel_of("nearest")
    fresh_digests()
    syntax, edited = provenance._syntax, Path(shortest_paths.__file__).read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(provenance, "_syntax", lambda source: b"edited" if source == edited else syntax(source))
        with pytest.raises(OtherCodeError, match=rf"it has code \w+ for {parcel.versions['code']};"):
            unpack(parcel, tmp_path)
