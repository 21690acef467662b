"""One trial to look at: pictures and animations, and what cannot be drawn."""

import dataclasses
import json
import re
import subprocess
import sys

import pytest
from handmade import TINY, tiny_plan, write_plugin
from PIL import Image

from explore_bench.errors import RequestError
from explore_bench.report import side_by_side
from explore_bench.report.demo import FRAMES_PER_SECOND, draw_trial, draw_trials
from explore_bench.report.moment import scene_at
from explore_bench.trial.run import run_trial

SPEC = tiny_plan(["nearest"], trials=1)[0]


@pytest.mark.parametrize("suffix", [".png", ".svg", ".gif", ".html"])
def test_a_trial_is_drawn_and_its_record_returned(tmp_path, suffix):
    path = tmp_path / "deep" / f"a{suffix}"
    record = draw_trial(SPEC, path)
    assert path.stat().st_size > 5000
    assert record.status == "explored"
    assert len(record.steps["step"]) == len(run_trial(SPEC).steps)
    assert [file.name for file in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".PNG", ".Svg", ".HTML"])
def test_a_suffix_may_be_of_capitals(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    draw_trial(SPEC, path)
    lower = tmp_path / f"a{suffix.lower()}"
    draw_trial(SPEC, lower)
    assert path.read_bytes() == lower.read_bytes()


def test_a_picture_is_of_the_end_of_the_trial(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr("explore_bench.report.demo.draw_scene", lambda axes, scene: drawn.append(scene))
    monkeypatch.setattr("explore_bench.report.demo.scene_legend", lambda scene: [])
    record = draw_trial(SPEC, tmp_path / "a.png")
    [scene] = drawn
    assert len(scene.steps["step"]) == len(record.steps["step"])
    assert scene.steps["explored"][-1] >= SPEC.scenario.coverage


def test_an_animation_has_a_frame_a_decision_and_a_second_of_the_end(tmp_path):
    record = draw_trial(SPEC, tmp_path / "a.gif")
    shown, frames = 0, set()
    with Image.open(tmp_path / "a.gif") as image:
        for index in range(image.n_frames):
            image.seek(index)
            shown += image.info["duration"]  # equal frames may have been joined
            frames.add(image.convert("RGB").tobytes())
    decisions = record.steps["decisions"][-1]
    assert len(frames) == decisions + 1
    assert shown == pytest.approx(1000 * (decisions + 1 + FRAMES_PER_SECOND) / FRAMES_PER_SECOND)


def test_the_same_picture_has_the_same_bytes_in_this_process_and_another(tmp_path):
    draw_trial(SPEC, tmp_path / "a.svg")
    draw_trial(SPEC, tmp_path / "b.svg")
    code = f"""
from pathlib import Path
from explore_bench.report.demo import draw_trial
from explore_bench.world.scenario import Scenario
from explore_bench.runs.suites import plan
scenario = Scenario(**{TINY.model_dump(exclude_unset=True)!r})
draw_trial(plan("smoke", ["nearest"], trials=1, scenario=scenario).specs[0], Path({str(tmp_path / "c.svg")!r}))
"""
    subprocess.run([sys.executable, "-c", code], check=True)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes() == (tmp_path / "c.svg").read_bytes()


@pytest.mark.parametrize("name", ["a.pdf", "a.jpg", "a", "a.PNG.txt"])
def test_another_kind_of_file_is_refused_before_anything_runs(tmp_path, monkeypatch, name):
    monkeypatch.setattr(
        "explore_bench.report.demo.run_witnessed", lambda spec: pytest.fail("a trial was run for nothing")
    )
    with pytest.raises(RequestError) as caught:
        draw_trial(SPEC, tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)
    assert all(suffix in str(caught.value) for suffix in (".gif", ".png", ".svg", ".html"))


def test_a_trial_that_failed_on_the_way_is_drawn_up_to_there(tmp_path):
    spec = tiny_plan([write_plugin(tmp_path, "raise LookupError('no map')")], trials=1)[0]
    record = draw_trial(spec, tmp_path / "a.png")
    assert record.status == "failed"
    assert (tmp_path / "a.png").stat().st_size > 5000


def test_a_trial_that_failed_before_any_decision_is_refused_with_its_reason(tmp_path):
    file = tmp_path / "never.py"
    file.write_text(
        "class Never:\n    def reset(self, rng): raise LookupError('no map')\n    def choose(self, o): ...\n"
    )
    with pytest.raises(RequestError, match="no map"):
        draw_trial(tiny_plan([f"{file}:Never"], trials=1)[0], tmp_path / "a.png")


def test_the_trial_that_is_drawn_is_the_one_of_the_run(tmp_path, stored):
    """Same streams, same rows: a picture of a stored trial is of that trial."""
    record = draw_trial(SPEC, tmp_path / "a.svg")
    kept = stored.store.find(SPEC)
    assert record.spec == kept.spec
    assert all((record.steps[name] == kept.steps[name]).all() for name in kept.steps)


def test_a_trial_of_other_streams_can_be_drawn(tmp_path):
    draw_trial(dataclasses.replace(SPEC, root=3, purpose="calibrate"), tmp_path / "a.png")
    assert (tmp_path / "a.png").exists()


# Several side by side


def frames_of(path):
    """Frames of an animation as (image, milliseconds that it is shown)."""
    with Image.open(path) as image:
        for index in range(image.n_frames):
            image.seek(index)
            yield image.convert("RGB"), image.info["duration"]


def test_several_strategies_stand_side_by_side_and_a_scenario_makes_a_row(tmp_path):
    near, random = tiny_plan(["nearest", "random"], trials=1)
    further = [dataclasses.replace(spec, trial=1) for spec in (near, random)]
    sizes = []
    for rows in ([[near, random]], [[near, random], further]):
        records = draw_trials(rows, tmp_path / "a.png")
        assert [[record.spec for record in row] for row in records] == rows
        with Image.open(tmp_path / "a.png") as image:
            sizes.append(image.size)
    assert sizes[1] == (sizes[0][0], 2 * sizes[0][1])


def test_an_animation_of_several_moves_until_the_last_of_them_has_ended_and_then_holds(tmp_path):
    specs = tiny_plan(["nearest", "random"], trials=1)
    [records] = draw_trials([specs], tmp_path / "a.gif")
    frames = list(frames_of(tmp_path / "a.gif"))
    assert frames[-1][1] >= 1000 * side_by_side.HELD_SECONDS
    width, height = frames[0][0].size
    halves = [
        [frame.crop((0, 0, width // 2, height)), frame.crop((width // 2, 0, width, height))] for frame, _ in frames
    ]
    ends = [record.steps["step"][-1] for record in records]
    assert len(frames) == max(ends) + 1, "a frame a step: equal ones are joined"
    first = ends.index(min(ends))
    late = int(len(frames) * (min(ends) / max(ends) + 1) / 2)  # one has ended by then, the other has not
    assert halves[late][first].tobytes() == halves[-1][first].tobytes()
    assert halves[late][1 - first].tobytes() != halves[-1][1 - first].tobytes()


def test_a_page_of_several_trials_plays_them_all(tmp_path):
    draw_trials([tiny_plan(["nearest", "random"], trials=1)], tmp_path / "a.html")
    text = (tmp_path / "a.html").read_text()
    [found] = re.findall(r'id="replays">(.*?)</script>', text, re.DOTALL)
    assert {trial["strategy"] for trial in json.loads(found)["trials"]} == {0, 1}


def test_a_moment_between_two_decisions_has_the_map_of_the_one_and_the_way_until_then(stored):
    record = stored.store.find(SPEC)
    replay = stored.store.replay(SPEC)
    between = (replay.steps[0] + replay.steps[1]) // 2
    scene = scene_at(record, replay, between)
    assert replay.steps[0] < between < replay.steps[1]
    assert scene.snapshot.map == replay.maps[0]
    assert scene.steps["step"].tolist() == list(range(between + 1))
    assert scene_at(record, replay, replay.steps[1]).snapshot.map == replay.maps[1]
