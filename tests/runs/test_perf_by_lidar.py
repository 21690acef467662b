"""What lidar worlds cost: the arithmetic on times made up, and real trials in a small scene."""

from types import SimpleNamespace

import pytest
from lidar_worlds import SMALL

from explore_bench.runs import perf_by_lidar
from explore_bench.runs.perf_by_lidar import SCENES, ScenePart, SceneTimes, measure_scene, scene_table
from explore_bench.trial.run import run_trial
from explore_bench.world.scenarios import STAGE


def test_a_rare_part_is_spread_over_all_key_poses(monkeypatch):
    """Loops of 30 ms at one key pose of three are 10 ms a key pose: half of what all cost."""
    steps = [{"match": 0.010, "loops": 0.030}, {"match": 0.010}, {"match": 0.010}]
    monkeypatch.setattr(perf_by_lidar, "_timed", lambda scenario, trial: (steps, (40.0, 60.0)[trial]))
    times = measure_scene("maze")
    assert (times.scene, times.key_poses) == ("maze", 6)
    assert times.times_real_time == pytest.approx(50.0)
    assert times.parts == [
        ScenePart("match", pytest.approx(10.0), pytest.approx(0.5)),
        ScenePart("loops", pytest.approx(10.0), pytest.approx(0.5)),
        ScenePart("whole key pose", pytest.approx(20.0), pytest.approx(1.0)),
    ]


def test_times_real_time_are_simulated_seconds_to_cpu_seconds_without_the_strategy(monkeypatch):
    """30 simulated seconds in 2 s, of which the strategy had 0.5 s."""
    clock = iter((100.0, 102.0))
    monkeypatch.setattr(perf_by_lidar, "time", SimpleNamespace(process_time=lambda: next(clock)))
    result = SimpleNamespace(steps=[SimpleNamespace(seconds=30.0)], decision_seconds=[0.2, 0.3])
    monkeypatch.setattr(perf_by_lidar, "run_trial", lambda spec, lap: result)
    assert perf_by_lidar._timed(SMALL, 0)[1] == pytest.approx(20.0)


def test_every_part_of_a_real_key_pose_is_timed(monkeypatch):
    seen = []

    def remember(spec, lap):
        seen.append(run_trial(spec, lap=lap))
        return seen[-1]

    monkeypatch.setattr(perf_by_lidar, "run_trial", remember)
    steps, factor = perf_by_lidar._timed(SMALL, 0)
    (result,) = seen
    assert result.status.value == "explored"
    assert result.spec.purpose == "calibrate"
    assert len(steps) == len(result.steps) - 1
    always = {"driver", "world", "match", "covariances", "map", "virtual map", "row"}
    assert all(always <= step.keys() for step in steps)
    assert {"frontiers", "route"} <= {name for step in steps for name in step}
    assert not any("decision" in step for step in steps)
    assert sum(sum(step.values()) for step in steps) < result.seconds
    assert factor > 1.0


def test_a_table_has_a_column_a_scene_and_a_line_a_part_of_either():
    one = SceneTimes("dense", 165, 101.4, [ScenePart("match", 6.25, 0.75), ScenePart("row", 2.0, 0.25)])
    other = SceneTimes("office", 448, 87.6, [ScenePart("match", 8.0, 0.5), ScenePart("loops", 8.0, 0.5)])
    lines = scene_table([one, other])
    assert [line.split() for line in lines[1:]] == [
        ["part", "dense", "office"],
        ["match", "6.25", "(", "75%)", "8.00", "(", "50%)"],
        ["row", "2.00", "(", "25%)"],
        ["loops", "8.00", "(", "50%)"],
        ["key", "poses", "165", "448"],
        ["times", "real", "time", "101", "88"],
    ]
    assert len({len(line) for line in lines[2:] if "row" not in line}) == 1
    assert lines[4].index("8.00") > lines[3].index("2.00") + 10, "in the office's column"


def test_the_scenes_are_one_of_obstacles_and_one_floor_plan():
    assert [STAGE.replace(scene=scene).scene for scene in SCENES] == ["dense", "office"]
