"""The store: exact round trips, atomic writes, refusals, and stale shards."""

import dataclasses
import gc
import json
import os
import shutil
import weakref
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from handmade import TINY, tiny_plan, write_plugin

from explore_bench import files
from explore_bench.errors import RequestError
from explore_bench.records import encoding
from explore_bench.records.encoding import METADATA_KEY, comparable, read_record, read_replay, renamed
from explore_bench.records.provenance import trial_key
from explore_bench.records.store import HALF, PROTOCOL_FILE, Store, missing
from explore_bench.trial.landmark.step import LandmarkStep
from explore_bench.trial.run import run_trial
from explore_bench.trial.snapshot import REPLAY_COLUMNS, unpack_ellipses, unpack_map
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import FINAL_COLUMNS, SCHEMA_VERSION, step_columns
from explore_bench.world.scenario import Scenario

STEP_COLUMNS = step_columns("landmark")


@pytest.fixture
def store(tmp_path):
    made = Store(tmp_path / "results")
    made.open(0, "evaluate")
    return made


@pytest.fixture
def spec(tmp_path):
    """Return a trial of a plugin, whose file the test may change."""
    return tiny_plan([write_plugin(tmp_path)], trials=1)[0]


def message(function, *arguments):
    """Return the sentence of the RequestError that a call raises, without its quotes; it has one line."""
    with pytest.raises(RequestError) as caught:
        function(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value).replace("'", "")


# Schema


def test_every_column_of_a_step_has_a_type_and_a_unit():
    assert tuple(STEP_COLUMNS) == tuple(field.name for field in dataclasses.fields(LandmarkStep))
    for columns in (STEP_COLUMNS, FINAL_COLUMNS, REPLAY_COLUMNS):
        for name, column in columns.items():
            assert column.dtype, name
            assert column.unit, name


def test_a_column_without_a_meaning_of_its_own_continues_the_one_above():
    for columns in (STEP_COLUMNS, FINAL_COLUMNS, REPLAY_COLUMNS):
        assert next(iter(columns.values())).meaning
        assert all(column.meaning or "cov" in name or "final" in name for name, column in columns.items())


def test_the_files_have_the_columns_and_types_of_the_schema(stored):
    written = pq.read_schema(stored.store.path(trial_key(stored.specs[0])))
    wanted = STEP_COLUMNS | FINAL_COLUMNS | REPLAY_COLUMNS
    assert written.names == list(wanted)
    types = {"float32": pa.float32(), "float64": pa.float64(), "int32": pa.int32(), "binary": pa.binary()}
    types |= {"list<int32>": pa.list_(pa.int32()), "list<float32>": pa.list_(pa.float32())}
    types |= {"list<float64>": pa.list_(pa.float64())}
    for name, column in wanted.items():
        assert written.field(name).type == types[column.dtype], name


# Round trips


def test_steps_come_back_bit_by_bit(stored):
    for spec, result in zip(stored.specs, stored.results, strict=True):
        record = stored.store.find(spec)
        for name in STEP_COLUMNS:
            wanted = np.array([getattr(step, name) for step in result.steps], dtype=record.steps[name].dtype)
            assert record.steps[name].tobytes() == wanted.tobytes(), name


def test_steps_come_back_in_the_types_of_the_schema(stored):
    record = stored.store.find(stored.specs[0])
    assert {name: str(values.dtype) for name, values in record.steps.items()} == {
        name: column.dtype for name, column in STEP_COLUMNS.items()
    }


def test_a_record_says_which_robot_made_each_step(stored):
    """There is one, with the number 0."""
    assert list(STEP_COLUMNS)[:3] == ["step", "decisions", "robot"]
    for spec in stored.specs:
        robots = stored.store.find(spec).steps["robot"]
        assert robots.dtype == np.int32
        assert len(robots) > 1
        assert not robots.any()


def test_specification_ending_and_world_come_back(stored):
    for spec, result in zip(stored.specs, stored.results, strict=True):
        record = stored.store.find(spec)
        assert record.spec == spec
        assert (record.status, record.reason, record.transient) == (result.status.value, result.reason, False)
        assert record.world.digest == result.world.digest
        assert np.array_equal(record.world.landmarks, result.world.landmarks)
        assert record.world.start == result.world.start


def test_a_specification_with_unusual_fields_comes_back_exactly(store):
    scenario = TINY.replace(odometry_sigma=0.1 + 0.2, fusion="determinant", occlusion=True)
    spec = TrialSpec(
        "näme",
        "baselines.reference.clairvoyant:Clairvoyant",
        scenario,
        3,
        {"beam": 2, "metres_per_cell": 1 / 3},
        True,
        "other",
        root=0,
    )
    store.write(run_trial(spec))
    assert store.find(spec).spec == spec


def test_a_trial_in_a_given_map_comes_back_with_what_counts_in_it(store):
    scenario = TINY.replace(map=("?#####", "?#..##", "##..#.", "#....#", "#....#", "######"))
    spec = TrialSpec("nearest", "baselines.nearest:Nearest", scenario, 0)
    result = run_trial(spec)
    store.write(result)
    record = store.find(spec)
    assert record.spec == spec
    assert record.world.digest == result.world.digest
    assert np.array_equal(record.world.counted, result.world.counted)
    assert not record.world.counted.all()


def test_a_folder_of_one_map_refuses_another(tmp_path):
    store = Store(tmp_path / "mapped")
    one, other = (TINY.replace(map=rows) for rows in (("...", "...", "..#"), ("...", "...", "...")))
    store.open(0, "evaluate", one)
    store.open(0, "evaluate", one.replace(map=list(one.map)))
    for scenario in (other, TINY):
        sentence = message(store.open, 0, "evaluate", scenario)
        assert "map=" in sentence
        assert len(sentence) < 400, "a digest, not the map"


def test_the_final_trajectory_comes_back_as_single_precision(stored):
    for spec, result in zip(stored.specs, stored.results, strict=True):
        final = stored.store.find(spec).final
        wanted = np.hstack((result.final_poses, result.final_covariances)).astype(np.float32)
        assert np.array_equal(np.stack(list(final.values()), axis=1), wanted)


def test_a_failed_trial_keeps_its_rows_and_has_no_final_trajectory(store, tmp_path):
    factory = write_plugin(tmp_path, "raise LookupError('no map')")
    spec = tiny_plan([factory], trials=1)[0]
    result = run_trial(spec)
    store.write(result)
    record = store.find(spec)
    assert record.status == "failed"
    assert record.reason == result.reason
    assert len(record.steps["step"]) == len(result.steps) > 1
    assert np.isnan(record.final["final_x"]).all()


def test_a_trial_without_rows_can_be_kept(store, tmp_path):
    file = tmp_path / "never.py"
    file.write_text(
        "class Plugin:\n    def reset(self, rng): raise LookupError('no')\n    def choose(self, o): return 0\n"
    )
    spec = tiny_plan([f"{file}:Plugin"], trials=1)[0]
    store.write(run_trial(spec))
    record = store.find(spec)
    assert record.status == "failed"
    assert all(len(values) == 0 for values in record.steps.values())
    assert store.replay(spec).steps == []


def test_the_replay_holds_candidates_and_choice_of_every_decision_and_the_end(stored):
    for spec, result in zip(stored.specs, stored.results, strict=True):
        replay = stored.store.replay(spec)
        assert replay.steps == sorted(result.snapshots)
        for i, step in enumerate(replay.steps):
            snapshot = result.snapshots[step]
            assert (replay.candidates[i], replay.choices[i]) == (snapshot.candidates, snapshot.choice)
            assert replay.targets[i] == (snapshot.target and tuple(snapshot.target))
        assert replay.candidates[-1] is None
        assert replay.choices[-1] is None
        for own, choice, target in zip(replay.candidates[:-1], replay.choices[:-1], replay.targets[:-1], strict=True):
            assert (choice is None) == (target is not None)
            assert choice is None or 0 <= choice < len(own)


BELIEFS = """
import json, sys
class Plugin:
    def reset(self, rng):
        self.kept = []
        kept.append(self.kept)
    def choose(self, observation):
        self.kept.append(observation.belief)
        return int(observation.path_lengths.argmin())
kept = []
"""


@pytest.fixture
def played(store, tmp_path):
    """Return the replay of a trial and the beliefs at its decisions."""
    import sys

    file = tmp_path / "beliefs.py"
    file.write_text(BELIEFS)
    spec = tiny_plan([f"{file}:Plugin"], trials=1)[0]
    store.write(run_trial(spec))
    module = next(m for m in list(sys.modules.values()) if getattr(m, "__file__", None) == str(file))
    beliefs = module.kept[-1]
    assert len(beliefs) > 1
    return store.replay(spec), beliefs


def test_the_replay_s_maps_are_those_of_the_beliefs_within_half_a_level(played):
    replay, beliefs = played
    for packed, belief in zip(replay.maps, beliefs, strict=False):
        found = unpack_map(packed, TINY.grid.shape)
        assert np.array_equal(np.isnan(found), ~belief.known)
        assert np.abs(found - belief.occupancy)[belief.known].max() <= 0.5 / 200 + 1e-12


def test_the_replay_s_ellipses_are_those_of_the_beliefs_within_their_levels(played):
    replay, beliefs = played
    for packed, belief in zip(replay.ellipses, beliefs, strict=False):
        found = unpack_ellipses(packed, TINY.grid.shape, TINY.virtual_sigma)
        entries = belief.virtual_map
        matrices = np.stack((entries[..., [0, 1]], entries[..., [1, 2]]), axis=-2)
        values, vectors = np.linalg.eigh(matrices)
        assert found[..., 0] == pytest.approx(np.sqrt(values[..., 1]), abs=0.5 / 250 + 1e-9)
        assert found[..., 1] == pytest.approx(np.sqrt(values[..., 0]), abs=0.5 / 250 + 1e-9)
        turned = np.arctan2(vectors[..., 1, 1], vectors[..., 0, 1])
        off = np.abs((found[..., 2] - turned + np.pi / 2) % np.pi - np.pi / 2)
        long = values[..., 1] - values[..., 0] > 1e-6
        assert long.any()
        assert off[long].max() <= 0.5 * np.pi / 256 + 1e-9


def test_the_replay_s_landmarks_are_those_of_the_beliefs(played):
    replay, beliefs = played
    for rows, belief in zip(replay.landmarks, beliefs, strict=False):
        assert rows.shape == (len(belief.landmarks), 5)
        assert rows[:, :2] == pytest.approx(belief.landmarks, rel=1e-6)
        assert rows[:, 2:] == pytest.approx(belief.landmark_covariances[:, [0, 0, 1], [0, 1, 1]], rel=1e-6)


def test_writing_a_trial_again_gives_the_same_bytes(stored, own_store):
    path = own_store.path(trial_key(stored.specs[0]))
    before = path.read_bytes()
    own_store.write(run_trial(stored.specs[0]))
    assert path.read_bytes() == before
    assert len(list(own_store.runs.glob("*.parquet"))) == len(stored.specs)


def test_no_time_of_day_and_no_duration_is_in_a_shard(stored):
    """Else no two runs could agree."""
    names = pq.read_schema(stored.store.path(trial_key(stored.specs[0]))).names
    assert not [name for name in names if "second" in name or "time" in name]
    metadata = pq.read_schema(stored.store.path(trial_key(stored.specs[0]))).metadata[METADATA_KEY]
    assert set(json.loads(metadata)) == {"schema", "spec", "status", "reason", "transient", "world"}


# Atomicity


@pytest.mark.parametrize("function", ["fsync", "replace"])
def test_a_failure_while_writing_leaves_neither_a_shard_nor_a_temporary_file(monkeypatch, stored, store, function):
    def fail(*arguments, **named):
        raise OSError(28, "No space left on device")

    target = "os.fsync" if function == "fsync" else "pathlib.Path.replace"
    monkeypatch.setattr(target, fail)
    with pytest.raises(RequestError, match="No space"):
        store.write(stored.results[0])
    assert [path.name for path in store.runs.iterdir()] == [PROTOCOL_FILE]
    assert not store.has(stored.specs[0])


def test_a_failure_while_rewriting_leaves_the_old_shard(monkeypatch, stored, own_store):
    path = own_store.path(trial_key(stored.specs[0]))
    before = path.read_bytes()
    monkeypatch.setattr(os, "fsync", lambda *_: (_ for _ in ()).throw(OSError(5, "broken")))
    with pytest.raises(RequestError, match="cannot be written"):
        own_store.write(stored.results[0])
    assert path.read_bytes() == before


def test_a_temporary_file_that_a_killed_process_left_is_no_record(stored, own_store):
    shutil.copy(own_store.path(trial_key(stored.specs[0])), own_store.runs / ".left.parquet.0123")
    records, stale = own_store.records()
    assert (len(records), stale) == (len(stored.specs), 0)


# Opening a folder


def test_a_folder_opens_again_with_the_same_protocol(own_store):
    before = (own_store.runs / PROTOCOL_FILE).read_bytes()
    own_store.open(0, "evaluate", TINY)
    assert (own_store.runs / PROTOCOL_FILE).read_bytes() == before
    protocol = own_store.protocol()
    assert (protocol["schema"], protocol["root"], protocol["purpose"]) == (SCHEMA_VERSION, 0, "evaluate")


def test_a_folder_takes_other_sizes_of_its_scenario(own_store):
    own_store.open(0, "evaluate", TINY.replace(size=20.0))


def test_a_folder_of_another_scenario_is_refused_by_what_differs(own_store):
    sentence = message(own_store.open, 0, "evaluate", TINY.replace(coverage=0.75))
    assert "coverage=0.8" in sentence
    assert "coverage=0.75" in sentence
    assert "--results" in sentence
    assert "paper" in message(own_store.open, 0, "evaluate")


def test_a_folder_opened_for_any_scenario_takes_no_evaluation_of_one(tmp_path):
    made = Store(tmp_path / "results")
    made.open(0, "calibrate", None)
    made.open(0, "calibrate", None)
    assert "scenario any" in message(made.open, 0, "calibrate", TINY)


def test_only_an_opened_folder_exists(tmp_path):
    made = Store(tmp_path / "results")
    assert not made.exists()
    made.open(0, "evaluate")
    assert made.exists()


@pytest.mark.parametrize(
    ("root", "purpose", "words"),
    [(5, "evaluate", "root seed 0, not 5"), (0, "calibrate", "purpose evaluate, not calibrate")],
)
def test_a_folder_of_another_protocol_is_refused_by_its_values(own_store, root, purpose, words):
    sentence = message(own_store.open, root, purpose, TINY)
    assert words in sentence
    assert str(own_store.folder) in sentence
    assert "--results" in sentence


@pytest.mark.parametrize("keys", [("schema", "root", "purpose", "scenario"), ("schema",)], ids=["same", "fewer"])
@pytest.mark.parametrize(
    ("version", "words"),
    [(99, f"of another record version, 99, not {SCHEMA_VERSION}"), (1, "of an older record version, 1, not 2")],
)
def test_a_folder_of_another_record_version_is_refused_by_its_version(own_store, keys, version, words):
    """Whatever else another version writes there: nobody is told to delete it as damaged."""
    file = own_store.runs / PROTOCOL_FILE
    values = json.loads(file.read_text()) | {"schema": version}
    file.write_text(json.dumps({key: values[key] for key in keys}))
    for call in ((own_store.open, 0, "evaluate", TINY), (own_store.protocol,), (own_store.records,)):
        sentence = message(*call)
        assert words in sentence
        assert "--results" in sentence


@pytest.mark.parametrize("version", [1, 99])
def test_a_record_of_another_version_is_never_read(stored, own_store, version):
    """Neither its rows nor its replay, and no merge takes it."""
    path = own_store.path(trial_key(stored.specs[0]))
    of_version(version)(path)
    for read in (read_record, read_replay, comparable):
        assert f"record version, {version}, not 2" in message(read, path)


@pytest.mark.parametrize("content", ["", "not json", "[]", "3", '{"schema": 2}', "null", "\udcff"])
def test_a_damaged_protocol_is_named(own_store, content):
    file = own_store.runs / PROTOCOL_FILE
    file.write_bytes(content.encode(errors="surrogateescape"))
    for call in ((own_store.open, 0, "evaluate", TINY), (own_store.protocol,), (own_store.records,)):
        sentence = message(*call)
        assert str(file) in sentence
        assert "damaged" in sentence


def test_a_folder_that_cannot_be_made_is_refused_by_its_name(tmp_path):
    (tmp_path / "file").write_text("in the way")
    sentence = message(Store(tmp_path / "file" / "results").open, 0, "evaluate")
    assert str(tmp_path / "file" / "results") in sentence
    assert "--results" in sentence


def test_a_folder_that_is_a_file_is_refused_by_its_name(tmp_path):
    (tmp_path / "results").write_text("in the way")
    assert str(tmp_path / "results") in message(Store(tmp_path / "results").open, 0, "evaluate")


def test_an_existing_folder_that_may_not_be_written_is_refused(monkeypatch, own_store):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    sentence = message(own_store.open, 0, "evaluate", TINY)
    assert "not writable" in sentence
    assert str(own_store.folder) in sentence


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_the_right_to_write_is_refused(own_store):
    own_store.runs.chmod(0o500)
    try:
        assert "not writable" in message(own_store.open, 0, "evaluate", TINY)
    finally:
        own_store.runs.chmod(0o700)


def test_a_folder_without_trials_says_how_to_run_some(tmp_path):
    sentence = message(Store(tmp_path / "nothing").records)
    assert "holds no trials" in sentence
    assert "explore-bench run" in sentence


# Files that are no records


def foreign(path):
    pq.write_table(pa.table({"a": [1, 2]}), path)


def of_version(version):
    def rewrite(path):
        table = pq.read_table(path)
        values = json.loads(table.schema.metadata[METADATA_KEY]) | {"schema": version}
        path.write_bytes(encoding._encoded(table.replace_schema_metadata({METADATA_KEY: json.dumps(values)})))

    return rewrite


def truncated(path):
    path.write_bytes(path.read_bytes()[:-100])


def overwritten(path):
    """Break the pages of the columns, but not the footer."""
    content = bytearray(path.read_bytes())
    content[10:2000] = bytes(1990)
    path.write_bytes(content)


BROKEN = [
    (foreign, "no readable record"),
    (of_version(99), f"of another record version, 99, not {SCHEMA_VERSION}"),
    (of_version(1), "of an older record version, 1, not 2"),
    (truncated, "no readable record"),
    (lambda path: path.write_bytes(b""), "no readable record"),
    (lambda path: path.write_text("step,x\n1,2\n" * 20), "no readable record"),
    (overwritten, "no readable record"),
]


def flipped(path):
    """Change one bit in the middle of the columns."""
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 4
    path.write_bytes(content)


def of_another_end(path):
    """Say of the trial that it got stuck, in as many bytes, but not in the digest."""
    content = path.read_bytes()
    assert content.count(b'"status": "explored"') == 1
    path.write_bytes(content.replace(b'"status": "explored"', b'"status": "step_lim"'))


DAMAGES = [foreign, truncated, overwritten, flipped, of_another_end, lambda path: path.write_bytes(b"")]


@pytest.mark.parametrize(("damage", "words"), BROKEN, ids=[words for _, words in BROKEN])
def test_a_file_that_is_no_record_is_named(stored, own_store, damage, words):
    path = own_store.path(trial_key(stored.specs[0]))
    damage(path)
    for read in (read_record, read_replay, comparable):
        sentence = message(read, path)
        assert str(path) in sentence
        assert words in sentence
    assert words in message(lambda: list(own_store.survey()))


@pytest.mark.parametrize("version", [1, 99])
def test_a_run_and_a_report_refuse_records_of_another_version(stored, own_store, version):
    path = own_store.path(trial_key(stored.specs[0]))
    of_version(version)(path)
    for call in (own_store.records, lambda: list(missing(own_store, stored.specs))):
        assert f"record version, {version}" in message(call)
    assert path.exists() and not own_store.damaged


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_shard_is_moved_aside_named_and_not_stored(stored, own_store, damage):
    spec = stored.specs[0]
    path = own_store.path(trial_key(spec))
    damage(path)
    left = path.read_bytes()
    assert not own_store.has(spec)
    assert list(missing(own_store, stored.specs)) == [spec]
    assert path.read_bytes() == left, "to ask moves nothing"
    records, stale = own_store.records()
    assert (len(records), stale) == (len(stored.specs) - 1, 0)
    [place] = own_store.damaged
    assert place == own_store.runs / "damaged" / path.name
    assert place.read_bytes() == left
    assert not path.exists()
    assert own_store.records()[1] == 0, "what lies aside is no record"
    own_store.write(stored.results[0])
    assert len(own_store.records()[0]) == len(stored.specs)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_a_damaged_shard_is_found_whatever_of_it_is_asked_for(stored, own_store, share):
    """Columns are decoded when they are asked for; the digest is of all bytes."""
    path = own_store.path(trial_key(stored.specs[0]))
    content = bytearray(path.read_bytes())
    content[int(share * len(content))] ^= 1
    path.write_bytes(content)
    specs, stale = own_store.records(lambda record: record.spec)
    assert specs == sorted(stored.specs[1:], key=lambda spec: (spec.strategy, spec.trial))
    assert (stale, own_store.damaged) == (0, [own_store.runs / "damaged" / path.name])


def test_one_whole_trial_is_in_memory_at_a_time(stored):
    """Nor has a column been decoded that nobody asked for."""
    alive, most = weakref.WeakSet(), []

    def keep(record):
        gc.collect()
        alive.add(record)
        most.append(len(alive))
        return record.brief()

    before = pa.total_allocated_bytes()
    briefs, _ = stored.store.records(keep)
    assert max(most) <= 2, "this one and the one before"
    rows = sum(len(brief.steps["step"]) for brief in briefs)
    columns = sum(len(brief.steps) for brief in briefs)
    gc.collect()
    assert pa.total_allocated_bytes() - before <= rows * (4 + 3 * 8) + 128 * columns
    assert {*briefs[0].steps} == {"step", "uncertainty", "peak_trace", "explored"}
    for brief in briefs:
        whole = stored.store.find(brief.spec)
        assert all(np.array_equal(values, whole.steps[name]) for name, values in brief.steps.items())


def test_a_record_that_cannot_be_read_now_is_not_taken_for_a_damaged_one(monkeypatch, stored, own_store):
    def refuse(path):
        raise OSError(24, "Too many open files")

    with monkeypatch.context() as patched:
        patched.setattr("pathlib.Path.read_bytes", refuse)
        for call in (own_store.records, lambda: own_store.has(stored.specs[0])):
            assert "cannot be read (Too many open files)" in message(call)
    assert not own_store.damaged
    assert len(own_store.records()[0]) == len(stored.specs)


def test_a_trial_that_runs_again_keeps_what_was_damaged(stored, own_store):
    path = own_store.path(trial_key(stored.specs[0]))
    whole = path.read_bytes()
    flipped(path)
    left = path.read_bytes()
    own_store.write(stored.results[0])
    assert path.read_bytes() == whole
    assert [place.read_bytes() for place in own_store.damaged] == [left]


@pytest.mark.parametrize("seed", range(40))
def test_no_change_of_a_byte_goes_unnoticed(stored, own_store, seed):
    rng = np.random.default_rng(seed)
    path = own_store.path(trial_key(stored.specs[seed % len(stored.specs)]))
    content = bytearray(path.read_bytes())
    place = int(rng.integers(len(content)))
    content[place] = (content[place] + int(rng.integers(1, 256))) % 256
    path.write_bytes(content)
    assert "no readable record" in message(read_record, path)


def test_long_and_broken_reasons_are_kept_as_one_short_line(stored, store):
    reason = "it answered\n" + 5_000_000 * "x" + "\x1b[31m, which is no\r\nnumber"
    store.write(dataclasses.replace(stored.results[0], status=Status.FAILED, reason=reason))
    kept = store.find(stored.specs[0]).reason
    assert len(kept) <= 1000
    assert kept.startswith("it answered xxx") and kept.endswith("xxx [31m, which is no number")
    assert store.path(trial_key(stored.specs[0])).stat().st_size < 200_000


# What is stored, and what is stale


def test_a_plan_s_missing_trials_are_those_not_stored_in_the_order_of_the_plan(stored, own_store):
    removed = stored.specs[1], stored.specs[4]
    for spec in removed:
        own_store.path(trial_key(spec)).unlink()
    assert list(missing(own_store, stored.specs)) == list(removed)


def test_a_trial_that_ran_out_of_time_does_not_count_as_stored(store, stored):
    late = dataclasses.replace(stored.results[0], transient=True)
    store.write(late)
    assert not store.has(stored.specs[0])
    assert list(missing(store, stored.specs[:1])) == [stored.specs[0]]
    assert store.find(stored.specs[0]).transient


def test_a_failed_trial_counts_as_stored(store, tmp_path):
    """It would fail again: a trial is a pure function of its specification."""
    spec = tiny_plan([write_plugin(tmp_path, "raise LookupError('no map')")], trials=1)[0]
    store.write(run_trial(spec))
    assert store.has(spec)


def test_trials_of_another_scenario_parameter_or_number_are_others(store, stored):
    spec = stored.specs[0]
    store.write(stored.results[0])
    for other in (
        dataclasses.replace(spec, trial=7),
        dataclasses.replace(spec, parameters={"beam": 2}),
        dataclasses.replace(spec, scenario=spec.scenario.replace(coverage=0.81)),
    ):
        assert store.has(spec)
        assert not store.has(other)


def test_trials_of_edited_code_are_left_out_and_counted(store, spec, tmp_path, stored, fresh_digests):
    store.write(run_trial(spec))
    store.write(stored.results[0])
    assert [len(part) if isinstance(part, list) else part for part in store.records()] == [2, 0]
    write_plugin(tmp_path, "return 0")
    fresh_digests()
    records, stale = store.records()
    assert [record.spec.strategy for record in records] == [stored.specs[0].strategy]
    assert stale == 1
    assert not store.has(spec)


@pytest.mark.parametrize("change", ["unlink", "break"])
def test_trials_of_a_plugin_that_is_gone_or_broken_are_left_out_and_counted(
    store, spec, tmp_path, fresh_digests, change
):
    store.write(run_trial(spec))
    file = tmp_path / "plugin.py"
    if change == "unlink":
        file.unlink()
    else:
        file.write_text("class Plugin(:")
    fresh_digests()
    assert store.records() == ([], 1)


def test_a_shard_renamed_to_its_own_name_has_the_same_bytes(stored):
    for spec in stored.specs:
        path = stored.store.path(trial_key(spec))
        assert renamed(path, spec) == path.read_bytes()


def test_trials_of_a_plugin_that_was_moved_are_taken_over(store, spec, tmp_path, fresh_digests):
    """Whatever counts as stored is a record, wherever its files lie."""
    store.write(run_trial(spec))
    before = store.find(spec)
    moved = tmp_path / "elsewhere" / "plugin.py"
    moved.parent.mkdir()
    (tmp_path / "plugin.py").rename(moved)
    fresh_digests()
    asked = dataclasses.replace(spec, factory=f"{moved}:Plugin")
    assert store.has(asked)
    assert store.records() == ([], 1)
    store.take([asked])
    [record], stale = store.records()
    assert (stale, record.spec) == (0, asked)
    for name, values in before.steps.items():
        np.testing.assert_array_equal(record.steps[name], values)
    shard = store.path(trial_key(asked)).read_bytes()
    store.take([asked])
    assert store.path(trial_key(asked)).read_bytes() == shard


def test_weights_that_were_moved_are_taken_over(store, weighed, tmp_path, fresh_digests):
    specs, files = weighed
    moved = [file.rename(tmp_path / f"moved-{file.name}") for file in files]
    fresh_digests()
    asked = [dataclasses.replace(spec, weights=str(file)) for spec, file in zip(specs, moved, strict=True)]
    assert all(map(store.has, asked))
    store.take(asked)
    assert [record.spec for record in store.records()[0]] == asked


def test_a_scenario_of_another_name_is_taken_over(own_store, stored):
    asked = dataclasses.replace(stored.specs[0], scenario_name="mine")
    assert own_store.has(asked)
    own_store.take([asked])
    assert asked in [record.spec for record in own_store.records()[0]]


@pytest.fixture
def weighed(store, stored, tmp_path):
    """Return a stored trial of two training seeds each, and the files of their weights."""
    files = [tmp_path / f"weights-{seed}.safetensors" for seed in (0, 1)]
    for file in files:
        file.write_bytes(file.name.encode())
    specs = [
        dataclasses.replace(stored.specs[0], training_seed=seed, weights=str(file)) for seed, file in enumerate(files)
    ]
    for spec in specs:
        store.write(dataclasses.replace(stored.results[0], spec=spec))
    return specs, files


def test_trials_of_two_training_seeds_are_two_records_and_come_back_exactly(store, weighed):
    specs, _ = weighed
    records, stale = store.records()
    assert ([record.spec for record in records], stale) == (specs, 0)
    assert list(missing(store, specs)) == []


@pytest.mark.parametrize("change", ["unlink", "other bytes"])
def test_trials_of_other_weights_are_left_out_and_counted(store, weighed, fresh_digests, change):
    specs, files = weighed
    files[0].unlink() if change == "unlink" else files[0].write_bytes(b"trained anew")
    fresh_digests()
    records, stale = store.records()
    assert ([record.spec for record in records], stale) == (specs[1:], 1)
    assert list(missing(store, specs)) == specs[:1]


def test_trials_of_other_libraries_are_left_out_and_counted(monkeypatch, own_store, stored):
    monkeypatch.setattr("explore_bench.records.provenance.library_versions", lambda *_: {"numpy": "0.1"})
    assert own_store.records() == ([], len(stored.specs))


def test_records_come_in_one_order_whatever_the_order_of_writing(stored, tmp_path):
    orders = []
    for name, results in (("a", stored.results), ("b", stored.results[::-1])):
        made = Store(tmp_path / name)
        made.open(0, "evaluate")
        for result in results:
            made.write(result)
        orders.append([record.spec for record in made.records()[0]])
    assert orders[0] == orders[1]


def test_the_scenario_of_a_record_is_equal_to_the_one_that_ran(stored):
    """Also in what was set and what was left at its default, or a plan would ask for it again."""
    record = stored.store.find(stored.specs[0])
    assert isinstance(record.spec.scenario, Scenario)
    assert record.spec.scenario == stored.specs[0].scenario
    assert hash(record.spec.scenario) == hash(stored.specs[0].scenario)
    assert trial_key(record.spec) == trial_key(stored.specs[0])


def test_what_a_killed_process_had_half_written_is_removed_later_and_what_is_being_written_is_not(own_store):
    figures = own_store.folder / "figures"
    figures.mkdir()
    places = (own_store.runs, own_store.folder, figures)
    old, young = ([place / f".file.{digit * 32}" for place in places] for digit in "ab")
    own = own_store.folder / ".gitignore"
    for path in (*old, *young, own):
        path.write_bytes(b"PAR1")
    an_hour_ago = own.stat().st_mtime - 3601.0
    for path in (*old, own):
        os.utime(path, (an_hour_ago, an_hour_ago))
    own_store.open(0, "evaluate", TINY)
    assert [path.exists() for path in old] == [False] * 3
    assert [path.exists() for path in (*young, own)] == [True] * 4, "of those who write now, or of the user"


def test_a_file_half_written_is_known_by_its_name(own_store, monkeypatch):
    def killed(file: int) -> None:
        raise SystemExit

    monkeypatch.setattr(files.os, "fsync", killed)
    monkeypatch.setattr(Path, "unlink", lambda path, missing_ok=False: None)
    with pytest.raises(SystemExit):
        files.write_whole(own_store.folder / "times.csv", "half")
    (half,) = own_store.folder.glob(".times.csv*")
    assert HALF.search(half.name)


def test_what_a_reference_says_of_the_world_is_kept(stored):
    notes = {spec.strategy: stored.store.find(spec).notes for spec in stored.specs if spec.trial == 0}
    assert notes["clairvoyant"].keys() == {"tour", "bound"}
    assert 0 < notes["clairvoyant"]["bound"] <= notes["clairvoyant"]["tour"]
    assert notes["nearest"] == notes["random"] == {}
