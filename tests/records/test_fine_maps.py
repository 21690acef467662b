"""The finer map in a shard: packed and read back, at the end and at every decision, and absent where there is none."""

import dataclasses

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from handmade import write_plugin
from lidar_worlds import LOOPING, LOOPING_TRIAL, SMALL, play

from explore_bench.geometry import Grid
from explore_bench.records import encoding
from explore_bench.records.encoding import comparable, encode, read_record, read_replay
from explore_bench.records.provenance import trial_key
from explore_bench.robot.belief import FineMap
from explore_bench.runs.suites import plan
from explore_bench.trial.run import run_trial
from explore_bench.trial.snapshot import FINE_COLUMNS, FREE, OCCUPIED, UNKNOWN, pack_fine_map, unpack_fine_map

SPEC = plan("smoke", ["nearest"], [SMALL.size], 1, scenario=SMALL).specs[0]


def shard(folder, result, name="a"):
    path = folder / f"{name}.parquet"
    path.write_bytes(encode(result))
    return path


@pytest.fixture(scope="module")
def result():
    return run_trial(SPEC)


@pytest.fixture(scope="module")
def path(result, tmp_path_factory):
    return shard(tmp_path_factory.mktemp("fine"), result)


@pytest.fixture(scope="module")
def beliefs():
    """Return what the robot of that trial believed at each decision, and at the end."""
    _, seen, ending = play(SMALL, purpose="evaluate")
    return [*(observation.belief for observation in seen), ending.belief], seen


def classes_of(belief):
    fine = belief.fine
    return np.where(~fine.known, UNKNOWN, np.where(fine.occupied, OCCUPIED, FREE))


@pytest.mark.parametrize("shape", [(4, 4), (3, 5), (1, 1)])
def test_any_map_comes_back_whatever_its_number_of_cells(shape):
    rng = np.random.default_rng(0)
    known, occupied = rng.random(shape) < 0.6, rng.random(shape) < 0.5
    fine = FineMap(Grid(shape[0], shape[1], 0.1), known, known & occupied)
    packed = pack_fine_map(fine)
    assert len(packed) == -(-shape[0] * shape[1] // 4)
    back = unpack_fine_map(packed, shape)
    assert back.dtype == np.uint8
    assert np.array_equal(back != UNKNOWN, known)
    assert np.array_equal(back == OCCUPIED, fine.occupied)


def test_a_record_holds_the_map_as_it_was_when_the_trial_ended(path, beliefs):
    record = read_record(path)
    last = classes_of(beliefs[0][-1])
    assert record.fine_map.dtype == np.uint8
    assert record.fine_map.shape == record.spec.scenario.map_grid.shape
    assert np.array_equal(record.fine_map, last)
    assert {UNKNOWN, FREE, OCCUPIED} == set(np.unique(last)), "all classes are tried"
    assert not np.array_equal(last, classes_of(beliefs[0][-2])), "the end is told from the last decision"


def test_a_replay_holds_map_trajectory_and_closures_of_every_decision_and_the_end(path, beliefs):
    replay = read_replay(path)
    believed, seen = beliefs
    shape = SMALL.map_grid.shape
    assert len(replay.fine_maps) == len(replay.trajectories) == len(replay.loops) == len(replay.steps) == len(believed)
    for i, belief in enumerate(believed):
        assert np.array_equal(unpack_fine_map(replay.fine_maps[i], shape), classes_of(belief))
        assert replay.trajectories[i] == pytest.approx(belief.poses[:, :2], abs=1e-6)
        assert np.array_equal(replay.loops[i], belief.graph.closures)
    for i, observation in enumerate(seen):
        assert replay.positions[i] == pytest.approx(observation.positions, abs=1e-6)
        assert len(replay.positions[i]) == len(replay.candidates[i])
    assert replay.positions[-1].shape == (0, 2)


def test_the_closures_of_a_belief_are_those_that_the_rows_count(result, beliefs):
    """On a range of 3 m walls that come into sight anew are often those of long ago."""
    rows, seen, ending = play(LOOPING, trial=LOOPING_TRIAL)
    counts = {row.step: row.closures for row in rows}
    assert counts[rows[-1].step] > 0, "the world has a loop to close"
    for observation in seen:
        closures = observation.belief.graph.closures
        assert closures.shape == (counts[observation.step], 2)
        assert (closures[:, 0] < closures[:, 1]).all()
    assert len(ending.belief.graph.closures) == rows[-1].closures


def test_maps_that_follow_on_each_other_take_few_bytes(result, path):
    """A shard compresses them together: they are alike but for what was seen since."""
    packed = sum(len(snapshot.fine) for snapshot in result.snapshots.values())
    bare = dataclasses.replace(result, snapshots={n: s._replace(fine=b"") for n, s in result.snapshots.items()})
    assert len(encode(result)) - len(encode(bare)) < 0.25 * packed


def test_the_same_trial_has_the_same_bytes(result, path):
    assert encode(run_trial(SPEC)) == path.read_bytes()


def test_a_shard_without_the_columns_is_read_as_one_of_which_no_finer_map_was_kept(path, tmp_path):
    table = pq.read_table(path)
    older = tmp_path / "older.parquet"
    older.write_bytes(encoding._encoded(table.drop_columns(list(FINE_COLUMNS))))
    assert read_record(older).fine_map is None
    replay = read_replay(older)
    assert (replay.fine_maps, replay.positions, replay.trajectories, replay.loops) == ([], [], [], [])
    assert replay.maps == read_replay(path).maps
    assert not comparable(older)[1]


def test_a_landmark_world_s_shard_has_none_of_the_columns(stored):
    for spec in stored.specs:
        assert not set(FINE_COLUMNS) & set(pq.read_schema(stored.store.path(trial_key(spec))).names)
        assert stored.store.find(spec).fine_map is None
        assert stored.store.replay(spec).fine_maps == []


def test_columns_are_of_the_types_that_they_name(path):
    schema = pq.read_schema(path)
    types = {"binary": pa.binary(), "list<int32>": pa.list_(pa.int32()), "list<float32>": pa.list_(pa.float32())}
    for name, column in FINE_COLUMNS.items():
        assert schema.field(name).type == types[column.dtype], name
        assert column.unit, name
        assert column.meaning, name


def test_a_trial_that_failed_on_the_way_has_the_map_of_its_last_decision_that_was_answered(tmp_path):
    name = write_plugin(tmp_path, "raise LookupError('no map')")
    result = run_trial(plan("smoke", [name], [SMALL.size], 1, scenario=SMALL).specs[0])
    path = shard(tmp_path, result)
    record = read_record(path)
    assert record.status == "failed"
    assert np.array_equal(record.fine_map, unpack_fine_map(result.snapshots[0].fine, SMALL.map_grid.shape))


def test_a_trial_that_failed_at_once_has_no_map(tmp_path):
    name = write_plugin(tmp_path, head="raise ImportError('nothing')")
    result = run_trial(plan("smoke", [name], [SMALL.size], 1, scenario=SMALL).specs[0])
    assert result.status.value == "failed"
    path = shard(tmp_path, result)
    assert read_record(path).fine_map is None
    assert read_replay(path).steps == []
