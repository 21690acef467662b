"""Merging folders: all of both, in any order and any number of times; disagreement refused with nothing written."""

import dataclasses
import json
import shutil

import pandas as pd
import pytest
from handmade import TINY, tiny_plan, write_plugin

from explore_bench.analysis.csv_files import read_csv
from explore_bench.analysis.tables import write_trials
from explore_bench.analysis.times import write_times
from explore_bench.errors import RequestError
from explore_bench.records.provenance import trial_key
from explore_bench.records.store import PROTOCOL_FILE, Store
from explore_bench.runs.merging import Merged, merge
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Outcome, Status
from explore_bench.trial.steps import SCHEMA_VERSION


@pytest.fixture
def part(stored, tmp_path):
    """Return a function that makes a results folder of some of the stored trials, with their times."""

    def make(name, results, protocol=(0, "evaluate", TINY), seconds=1.0):
        store = Store(tmp_path / name)
        store.open(*protocol)
        for result in results:
            store.write(result)
        outcomes = [Outcome(result.spec, result.status, "", 3, seconds, (0.5,)) for result in results]
        write_times(store.folder, outcomes)
        return store.folder

    return make


@pytest.fixture
def a_and_b(stored, part):
    """Return two folders that have three of nine trials in common."""
    return part("a", stored.results[:6]), part("b", stored.results[3:], seconds=2.0)


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def refusal(sources, into):
    """Return the sentence with which a merge is refused that changes nothing."""
    before = {folder: contents(folder) for folder in (*sources, into)}
    with pytest.raises(RequestError) as caught:
        merge(sources, into)
    assert {folder: contents(folder) for folder in (*sources, into)} == before
    assert "\n" not in str(caught.value)
    return str(caught.value)


# All of both


def test_two_folders_give_the_folder_of_one_machine_that_ran_it_all(stored, a_and_b, tmp_path):
    into, whole = tmp_path / "into", stored.store
    assert merge(a_and_b, into) == Merged(added=9, known=0, stale=0)
    write_trials(whole)
    merged = contents(into)
    del merged["times.csv"]
    assert merged == contents(whole.folder)


def test_a_second_merge_and_another_order_change_nothing(a_and_b, tmp_path):
    into, other = tmp_path / "into", tmp_path / "other"
    merge(a_and_b, into)
    before = contents(into)
    assert merge(a_and_b, into) == Merged(added=0, known=9, stale=0)
    assert contents(into) == before
    merge(a_and_b[::-1], other)
    shards = {name for name in before if name != "times.csv"}
    assert {name: contents(other)[name] for name in shards} == {name: before[name] for name in shards}


def test_a_folder_is_added_to_what_there_is(stored, a_and_b):
    a, b = a_and_b
    assert merge([b], a) == Merged(added=3, known=6, stale=0)
    records, stale = Store(a).records()
    assert stale == 0
    assert sorted(trial_key(record.spec) for record in records) == sorted(map(trial_key, stored.specs))


def test_sources_are_left_alone(a_and_b, tmp_path):
    before = [contents(folder) for folder in a_and_b]
    merge(a_and_b, tmp_path / "into")
    assert [contents(folder) for folder in a_and_b] == before


def test_times_are_merged_and_those_that_were_there_stay(stored, a_and_b):
    a, b = a_and_b
    merge([b], a)
    times = read_csv(a / "times.csv", ["strategy"])
    assert len(times) == 9
    assert sorted(times["seconds"]) == [1.0] * 6 + [2.0] * 3


def test_folders_without_times_have_none_merged(stored, a_and_b, tmp_path):
    for folder in a_and_b:
        (folder / "times.csv").unlink()
    merge(a_and_b, tmp_path / "into")
    assert not (tmp_path / "into" / "times.csv").exists()
    assert len(pd.read_csv(tmp_path / "into" / "trials.csv")) == 9


def test_a_merge_that_was_killed_goes_on(a_and_b, tmp_path, monkeypatch):
    into, kept, keep = tmp_path / "into", [], Store.keep

    def fail(self, key, shard):
        if len(kept) == 4:
            raise KeyboardInterrupt
        kept.append(key)
        keep(self, key, shard)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Store, "keep", fail)
        merge(a_and_b, into)
    assert merge(a_and_b, into) == Merged(added=5, known=4, stale=0)


# Records that disagree


def test_other_rows_under_one_key_are_refused(stored, a_and_b, part, tmp_path):
    result = stored.results[3]
    rows = [dataclasses.replace(step, path_length=step.path_length + 1e-12) for step in result.steps]
    other = part("other", [dataclasses.replace(result, steps=rows)])
    sentence = refusal([a_and_b[0], other], tmp_path / "into")
    name = f"{trial_key(result.spec)}.parquet"
    assert str(a_and_b[0] / "runs" / name) in sentence
    assert str(other / "runs" / name) in sentence
    assert "disagree" in sentence
    assert "delete one" in sentence
    assert "disagree" in refusal([other], a_and_b[0]), "also where one of them lies in the folder merged into"


def test_another_ending_under_one_key_is_refused(stored, a_and_b, part, tmp_path):
    other = part("other", [dataclasses.replace(stored.results[3], status=Status.STUCK)])
    assert "disagree" in refusal([a_and_b[0], other], tmp_path / "into")


def test_a_plugin_s_file_at_another_place_is_no_disagreement(part, tmp_path):
    folders = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        spec = tiny_plan([write_plugin(tmp_path / name)], trials=1)[0]
        folders.append(part(f"results of {name}", [run_trial(spec)]))
    assert contents(folders[0]) != contents(folders[1])
    assert merge(folders, tmp_path / "into") == Merged(added=1, known=0, stale=0)


def late_version(result):
    return dataclasses.replace(result, status=Status.FAILED, reason="took longer", transient=True)


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)], ids=["late first", "late last"])
def test_a_trial_that_was_late_on_one_machine_counts_as_it_went_on_the_other(stored, part, tmp_path, order):
    late = late_version(stored.results[0])
    folders = [part("late", [late]), part("fine", [stored.results[0]])][order]
    merge(folders, tmp_path / "into")
    assert Store(tmp_path / "into").find(stored.specs[0]).status == "explored"


def test_a_late_trial_gives_way_in_the_folder_merged_into_too(stored, part):
    late = late_version(stored.results[0])
    into = part("late", [late])
    assert merge([part("fine", [stored.results[0]])], into) == Merged(added=0, known=1, stale=0)
    assert Store(into).find(stored.specs[0]).status == "explored"


@pytest.mark.parametrize(
    ("protocol", "words"),
    [
        ((1, "evaluate", TINY), "root seed '1', not '0'"),
        ((0, "calibrate", TINY), "purpose 'calibrate', not 'evaluate'"),
        ((0, "evaluate", TINY.replace(coverage=0.75)), "scenario '"),
    ],
    ids=["root", "purpose", "scenario"],
)
def test_folders_of_other_protocols_are_refused(a_and_b, part, tmp_path, protocol, words):
    other = part("other", [], protocol)
    sentence = refusal([a_and_b[0], other], tmp_path / "into")
    assert words in sentence
    assert str(other) in sentence
    assert str(a_and_b[1]) in refusal([a_and_b[1]], other), "also those of the folder merged into"


def test_one_name_for_two_strategies_is_refused(part, tmp_path):
    folders = []
    for trial, name in enumerate(["one", "two"]):
        (tmp_path / name).mkdir()
        spec = tiny_plan([write_plugin(tmp_path / name)], trials=2)[trial]
        folders.append(part(f"results of {name}", [run_trial(spec)]))
    assert "the name 'Plugin' stands for" in refusal(folders, tmp_path / "into")


def test_two_sets_of_weights_under_one_name_are_refused(part, tmp_path, trained):
    """The same strategy and training seed with other weights, both of which are here."""
    specs = []
    for seed in (0, 1):
        weights = trained(seed)[seed]
        specs.append(dataclasses.replace(tiny_plan(["gcn-obs"], trials=1)[0], training_seed=0, weights=weights))
    assert trial_key(specs[0]) != trial_key(specs[1])
    folders = [part(name, [run_trial(spec)]) for name, spec in zip("ab", specs, strict=True)]
    assert "stands for the weights" in refusal(folders, tmp_path / "into")


# Other code


def test_trials_of_other_code_are_kept_and_counted(a_and_b, part, tmp_path, fresh_digests):
    plugin = part("plugin", [run_trial(tiny_plan([write_plugin(tmp_path)], trials=1)[0])])
    write_plugin(tmp_path, "return 0")
    fresh_digests()
    assert merge([*a_and_b, plugin], tmp_path / "into") == Merged(added=10, known=0, stale=1)
    records, stale = Store(tmp_path / "into").records()
    assert (len(records), stale) == (9, 1)


# Folders that cannot be merged


def test_a_folder_that_is_given_twice_is_refused(a_and_b, tmp_path):
    a = a_and_b[0]
    assert "given twice" in refusal([a, a.parent / "." / a.name], tmp_path / "into")
    assert str(a) in refusal([a, a], tmp_path / "into")
    assert "given twice" in refusal([a], a)


def test_a_folder_without_records_is_refused(a_and_b, part, tmp_path):
    for empty in (tmp_path / "nothing", part("opened", [])):
        sentence = refusal([*a_and_b, empty], tmp_path / "into")
        assert str(empty) in sentence
        assert "holds no trials" in sentence


def test_a_damaged_shard_is_refused_by_its_name(stored, a_and_b, tmp_path):
    for number in (4, 7):  # one that both have, and one that one has
        folder = tmp_path / f"damaged-{number}"
        shutil.copytree(a_and_b[1], folder)
        shard = Store(folder).path(trial_key(stored.specs[number]))
        shard.write_bytes(shard.read_bytes()[:-100])
        sentence = refusal([a_and_b[0], folder], tmp_path / "into")
        assert str(shard) in sentence
        assert "no readable record" in sentence


def test_damaged_times_are_left_out(a_and_b, tmp_path):
    """No trial depends on them."""
    a, b = a_and_b
    (b / "times.csv").write_text("strategy\nnearest\n")
    assert merge([a, b], tmp_path / "into").added == 9
    assert len(read_csv(tmp_path / "into" / "times.csv", ["strategy"])) == len(read_csv(a / "times.csv", ["strategy"]))


def test_a_damaged_protocol_or_another_version_is_refused(a_and_b, tmp_path):
    a, b = a_and_b
    protocol = b / "runs" / PROTOCOL_FILE
    protocol.write_text(json.dumps({**json.loads(protocol.read_text()), "schema": 99}))
    assert f"record version, 99, not {SCHEMA_VERSION}" in refusal([a, b], tmp_path / "into")
    protocol.write_text("{")
    assert "damaged" in refusal([a, b], tmp_path / "into")


def test_a_folder_that_cannot_be_written_is_refused(a_and_b, tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert "cannot be written" in refusal(a_and_b, tmp_path / "file" / "into")
