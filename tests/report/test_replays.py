"""Replays packed for the page: which trials, what comes back, how many bytes."""

import dataclasses
import gzip
import hashlib

import numpy as np
import pytest
from handmade import record, with_spec
from hypothesis import given, strategies as st
from lidar_worlds import LOOPING, LOOPING_TRIAL

from explore_bench.analysis.metrics import curve, exploration_efficiency
from explore_bench.records.encoding import Replay, encode, read_record, read_replay
from explore_bench.report.fine_replays import fine_maps
from explore_bench.report.packing import AXIS_LEVELS, SCALES, Columns, _integers, _varints, unpack
from explore_bench.report.replays import choose_trials, pack_replay, packed
from explore_bench.runs.suites import plan
from explore_bench.trial.run import run_trial
from explore_bench.trial.snapshot import unpack_ellipses, unpack_fine_map, unpack_map
from explore_bench.world.scenarios import load_scenario


def tried(trial, uncertainty, strategy="nearest", **options):
    """Return a record of two steps that ends at this uncertainty: the lower, the higher η."""
    return record(strategy=strategy, trial=trial, uncertainty=[200.0, 100.0, uncertainty], **options)


def roles_of(records):
    return {(c.record.spec.strategy, c.record.spec.trial): c.roles for c in choose_trials(records)}


@pytest.fixture(scope="module", params=range(9))
def both(request, stored):
    """Return a stored record and its replay."""
    spec = stored.specs[request.param]
    return stored.store.find(spec), stored.store.replay(spec)


# Which trials


def test_the_common_example_and_the_best_the_median_and_the_worst_are_chosen():
    records = [tried(trial, u) for trial, u in enumerate((50.0, 90.0, 10.0, 40.0, 70.0))]
    found = roles_of(records)
    ranked = sorted(range(5), key=lambda i: exploration_efficiency(records[i]))
    assert found == {
        ("nearest", 0): ("example", "median"),
        ("nearest", ranked[0]): ("worst",),
        ("nearest", ranked[-1]): ("best",),
    }


def test_of_an_even_number_the_median_is_the_worse_in_the_middle_and_of_equals_the_lower_world_is_worse():
    assert roles_of([tried(trial, 50.0) for trial in range(4)]) == {
        ("nearest", 0): ("example", "worst"),
        ("nearest", 1): ("median",),
        ("nearest", 3): ("best",),
    }


def test_one_trial_alone_is_all_of_them():
    assert roles_of([tried(0, 50.0)]) == {("nearest", 0): ("example", "best", "median", "worst")}


def test_without_the_example_s_world_there_are_the_others():
    assert roles_of([tried(3, 50.0), tried(5, 40.0)]) == {
        ("nearest", 3): ("median", "worst"),
        ("nearest", 5): ("best",),
    }


def test_every_strategy_and_size_has_its_own():
    assert set(roles_of([tried(0, 50.0), tried(0, 50.0, strategy="random")])) == {("nearest", 0), ("random", 0)}


def test_of_several_training_seeds_the_first_counts():
    seeds = [with_spec(tried(trial, 50.0 - 10 * seed), training_seed=seed) for seed in (1, 2) for trial in range(2)]
    assert {c.record.spec.training_seed for c in choose_trials(seeds)} == {1}


def test_a_trial_that_failed_without_a_step_cannot_be_replayed():
    assert choose_trials([record("failed", rows=0, reason="no")]) == []
    assert roles_of([record("failed", rows=0, trial=0), tried(1, 50.0)]) == {
        ("nearest", 1): ("best", "median", "worst")
    }


# What comes back


def test_every_step_comes_back_within_the_unit_of_its_column(both):
    record_, replay = both
    found = unpack(pack_replay(record_, replay))
    steps = record_.steps
    for name in ("x", "y", "true_x", "true_y"):
        assert found[name] == pytest.approx(steps[name], abs=0.501 * SCALES[name])
    turn = (found["heading"] - steps["heading"] + np.pi) % (2 * np.pi) - np.pi
    assert abs(turn).max() <= 0.501 * SCALES["heading"]
    length = len(steps["step"])
    assert found["explored"] == pytest.approx(steps["explored"] * record_.spec.scenario.cell_count)
    for name in ("trajectory_error", "exploration_efficiency"):
        assert found[name] == pytest.approx(np.nan_to_num(curve(record_, name, length)), abs=0.501 * SCALES[name])
    traces = found["pose_major"] ** 2 + found["pose_minor"] ** 2
    assert traces == pytest.approx(steps["cov_xx"] + steps["cov_yy"], abs=4 * SCALES["pose_major"])


def test_every_decision_comes_back(both):
    record_, replay = both
    scenario = record_.spec.scenario
    shape = scenario.grid.shape
    found = unpack(pack_replay(record_, replay))
    assert found["decided_at"].tolist() == replay.steps
    assert found["choice"].tolist() == [-1 if choice is None else choice for choice in replay.choices]
    assert found["candidates"].tolist() == [cell for own in replay.candidates for cell in own or []]
    assert found["candidate_count"].tolist() == [len(own or []) for own in replay.candidates]
    for i, kinds in enumerate(found["map"].reshape(-1, *shape)):
        belief = unpack_map(replay.maps[i], shape)
        assert ((kinds == 0) == np.isnan(belief)).all()
        assert ((kinds == 2) == (belief > 0.5)).all()
        axes = unpack_ellipses(replay.ellipses[i], shape, 1.0)
        assert found["major"].reshape(-1, *shape)[i] == pytest.approx(axes[..., 0], abs=0.51 / AXIS_LEVELS)
        assert found["minor"].reshape(-1, *shape)[i] == pytest.approx(axes[..., 1], abs=0.51 / AXIS_LEVELS)
    landmarks = np.concatenate(replay.landmarks)
    assert found["landmark_count"].tolist() == [len(own) for own in replay.landmarks]
    assert found["landmark_x"] == pytest.approx(landmarks[:, 0], abs=0.0051)
    assert found["landmark_y"] == pytest.approx(landmarks[:, 1], abs=0.0051)


def test_the_true_world_comes_with_it(both):
    record_, replay = both
    found = unpack(pack_replay(record_, replay))
    assert found["obstacles"] == np.flatnonzero(record_.world.obstacles).tolist()
    assert np.array(found["landmarks"]).reshape(-1, 2) == pytest.approx(record_.world.landmarks, abs=0.0051)
    assert (found["cells"], found["cellSize"]) == (record_.world.grid.columns, record_.world.grid.resolution)


@given(st.lists(st.integers(-(2**40), 2**40)))
def test_integers_come_back(values):
    numbers = np.array(values, dtype=np.int64)
    assert _integers(_varints(numbers)).tolist() == values


def test_small_numbers_take_one_byte():
    assert _varints(np.array([0, -1, 1, 63, -64, 64])) == bytes((0, 1, 2, 126, 127, 128, 1))


def test_what_is_not_finite_counts_as_nothing():
    columns = Columns()
    columns.add("x", [np.nan, np.inf, -np.inf, 0.02])
    assert columns.values["x"].tolist() == [0, 0, 0, 2]


def test_a_trial_without_a_decision_is_packed_as_nothing(stored, monkeypatch):
    record_ = stored.store.find(stored.specs[0])
    replay = stored.store.replay(stored.specs[0])
    columns = (field.name for field in dataclasses.fields(replay))
    empty = dataclasses.replace(replay, **{name: [] for name in columns})
    monkeypatch.setattr(stored.store, "replay", lambda spec: empty)
    assert packed(stored.store, record_) == ""
    assert unpack(pack_replay(record_, empty))["map"].size == 0


# Bytes


def test_the_same_replay_has_the_same_bytes_and_no_date(both):
    content = pack_replay(*both)
    assert content == pack_replay(*both)
    assert content[4:8] == bytes(4), "gzip's time"


def test_a_replay_takes_few_bytes(both):
    record_, replay = both
    content = pack_replay(record_, replay)
    cells = record_.spec.scenario.cell_count
    assert len(content) < 2000
    assert len(gzip.decompress(content)) < 3000 + 30 * len(record_.steps["step"]) + 4 * cells * len(replay.steps)


def test_a_replay_in_a_landmark_world_has_the_bytes_that_it_always_had():
    made = record(
        x=[1.0, 2.5, 3.25],
        y=[1.0, 1.0, 0.5],
        true_x=[1.0, 2.4, 3.3],
        heading=[0.0, -1.0, 7.0],
        explored=[0.1, 0.2, 0.9],
    )
    cells = made.spec.scenario.cell_count
    replay = Replay(
        steps=[0, 1, 2],
        candidates=[[3, 5], [7], None],
        choices=[1, None, None],
        targets=[None, (2.5, 4.0), None],
        maps=[bytes([level] * cells) for level in (255, 100, 190)],
        ellipses=[bytes([250, 100, 7] * cells)] * 3,
        landmarks=[np.arange(5.0).reshape(1, 5)] * 3,
    )
    digest = hashlib.sha256(gzip.decompress(pack_replay(made, replay))).hexdigest()
    assert digest == "f9e247931adc4092b0650472eea6cf1ad70e28ac30a02312afc1f0737b8cd5c8"


# Finer maps


@pytest.fixture(scope="module", params=["stage", "looping"])
def fine(request, tmp_path_factory):
    """Return the record and the replay of a trial with a finer map: a dense scene of 20 m, and one with closures."""
    scenario, trial = (LOOPING, LOOPING_TRIAL) if request.param == "looping" else (load_scenario("stage"), 0)
    own = plan("smoke", ["nearest"], [scenario.size], trial + 1, scenario=scenario, scenario_name="stage")
    spec = dataclasses.replace(own.specs[trial], purpose="calibrate")
    path = tmp_path_factory.mktemp("fine") / "a.parquet"
    path.write_bytes(encode(run_trial(spec)))
    return read_record(path), read_replay(path)


def test_finer_maps_come_back_cell_by_cell(fine):
    record_, replay = fine
    found = unpack(pack_replay(record_, replay))
    shape = record_.spec.scenario.map_grid.shape
    assert found["fineCells"] == shape[1]
    wanted = [unpack_fine_map(packed, shape) for packed in replay.fine_maps]
    assert np.array_equal(fine_maps(found), wanted)
    assert np.array_equal(wanted[-1], record_.fine_map)


def test_trajectories_candidates_and_closures_come_back(fine):
    record_, replay = fine
    found = unpack(pack_replay(record_, replay))
    path, at = np.empty((0, 2)), 0
    for k, places in enumerate(replay.trajectories):
        first, count = int(found["path_from"][k]), int(found["path_count"][k])
        tail = np.stack((found["path_x"], found["path_y"]), axis=1)[at : at + count - first]
        path, at = np.concatenate((path[:first], tail)), at + count - first
        assert path == pytest.approx(places, abs=0.501 * SCALES["path_x"])
    assert at == len(found["path_x"])
    positions = np.stack((found["candidate_x"], found["candidate_y"]), axis=1)
    assert positions == pytest.approx(np.concatenate(replay.positions), abs=0.501 * SCALES["candidate_x"])
    assert len(positions) == len(found["candidates"])
    loops = np.stack((found["loop_earlier"], found["loop_later"]), axis=1)
    for count, own in zip(found["loop_count"].astype(int), replay.loops, strict=True):
        assert np.array_equal(loops[:count], own)
    if record_.spec.scenario.size == 12.0:
        assert len(loops) > 0


def test_a_replay_of_a_dense_scene_of_20_m_takes_less_than_400_kb(fine):
    assert len(pack_replay(*fine)) < 400_000


def test_a_replay_with_a_finer_map_has_the_same_bytes_twice(fine):
    assert pack_replay(*fine) == pack_replay(*fine)
