"""The page's replay player: it draws every step of every kind of world, from what was packed; its legend."""

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from lidar_worlds import LOOPING, LOOPING_TRIAL

from explore_bench.analysis.tables import trial_table
from explore_bench.records.store import Store
from explore_bench.report import player
from explore_bench.report.html import script_json
from explore_bench.report.player import COLORS, player_data, player_legend
from explore_bench.runs.suites import plan
from explore_bench.trial.run import run_trial
from explore_bench.trial.snapshot import FREE, OCCUPIED, UNKNOWN, unpack_fine_map

SCRIPT = Path(player.__file__).parent / "assets" / "player.js"
NODE = shutil.which("node")


@pytest.fixture(scope="module")
def lidar(tmp_path_factory):
    """Return a folder of one trial whose robot closes loops."""
    specs = plan("smoke", ["nearest"], [LOOPING.size], LOOPING_TRIAL + 1, scenario=LOOPING, purpose="calibrate").specs
    spec = specs[LOOPING_TRIAL]
    store = Store(tmp_path_factory.mktemp("player") / "results")
    store.open(spec.root, spec.purpose, LOOPING)
    store.write(run_trial(spec))
    return store, store.find(spec), store.replay(spec)


def played(folder, store, record):
    """Return what the player draws at every step there and back, run without a browser."""
    if not NODE:
        pytest.skip("node is missing: install the package 'nodejs'")
    data = player_data(store, [record], trial_table([record]), [record.spec.strategy])
    (folder / "replays.json").write_text(script_json(data))
    page = Path(__file__).parent / "player_page.js"
    done = subprocess.run([NODE, page, SCRIPT, folder / "replays.json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def words_of(records):
    return [str(item["words"]) for item in player_legend(records)]


def test_no_function_of_the_player_is_declared_twice():
    """The later one would silently stand in for the earlier."""
    names = re.findall(r"^  (?:async )?function (\w+)", SCRIPT.read_text(), re.MULTILINE)
    assert len(names) > 20
    assert sorted(names) == sorted(set(names))


def test_every_step_of_a_landmark_world_is_drawn(tmp_path, stored):
    record = stored.store.find(stored.specs[0])
    shown = played(tmp_path, stored.store, record)
    assert len(shown) == 2 * len(record.steps["step"])
    assert all(one["lines"] for one in shown)
    assert COLORS["chosen"] in {line[0] for line in shown[0]["lines"]}, "the way to the chosen one"


def test_the_finer_map_that_is_drawn_is_the_robot_s_forwards_and_backwards(tmp_path, lidar):
    store, record, replay = lidar
    shape = record.fine_map.shape
    shade = {int(COLORS[name][1:3], 16): one for name, one in (("unknown", 0), ("free", 1), ("occupied", 2))}
    assert {UNKNOWN, FREE, OCCUPIED} == set(shade.values())
    seen = set()
    for one in played(tmp_path, store, record):
        if one["map"] is not None:
            red = np.frombuffer(base64.b64decode(one["map"]), dtype=np.uint8).reshape(*shape, 4)[::-1, :, 0]
            k = np.searchsorted(replay.steps, one["step"], side="right") - 1
            assert np.array_equal(np.vectorize(shade.get)(red), unpack_fine_map(replay.fine_maps[k], shape)), k
            seen.add(int(k))
    assert seen == set(range(len(replay.steps)))


def test_loops_and_trajectory_are_drawn_where_they_were_estimated(tmp_path, lidar):
    store, record, replay = lidar
    assert len(replay.loops[-1]) > 0
    scale = 400 / LOOPING.size
    for one in played(tmp_path, store, record)[: len(record.steps["step"])]:
        if one["step"] not in replay.steps:
            continue
        k = replay.steps.index(one["step"])
        lines = {
            name: np.array([line[1:3] for line in one["lines"] if line[0] == COLORS[name]])
            for name in ("loop", "estimate")
        }
        places = replay.trajectories[k] * scale * (1, -1) + (0, 400)
        assert lines["estimate"][: len(places)] == pytest.approx(places, abs=0.006 * scale)
        assert lines["loop"].reshape(-1, 2, 2) == pytest.approx(places[replay.loops[k]], abs=0.006 * scale)


def test_the_legend_names_landmarks_in_worlds_that_have_them_only(stored, lidar):
    landmark, fine = words_of([stored.store.find(stored.specs[0])]), words_of([lidar[1]])
    assert "true landmark" in landmark
    assert "how unsure a landmark in the cell would be (1 σ)" in landmark
    assert not [words for words in landmark if "loop" in words]
    assert not [words for words in fine if "landmark" in words]
    assert "loop closure" in fine
