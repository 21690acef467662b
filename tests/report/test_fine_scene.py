"""A moment in a lidar world: Figure 16 and the demo's picture show the robot's own map, and what the lidar sees."""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np
import pytest
from handmade import TINY, tiny_plan
from lidar_worlds import LOOPING, LOOPING_TRIAL, SMALL, drawn
from matplotlib.colors import to_hex

from explore_bench.geometry import Grid
from explore_bench.records.store import Store
from explore_bench.report import demo
from explore_bench.report.captions import caption
from explore_bench.report.drawing import styled
from explore_bench.report.figures import write_figures
from explore_bench.report.fine_scene import BEAMS, _sight, bands, draw_fine_map, draw_truth, outline
from explore_bench.report.moment import Scene, scene_of
from explore_bench.report.scene import draw_scene, scene_image, scene_legend
from explore_bench.report.scene_colors import CANDIDATE, CHOSEN, ESTIMATE, LOOP, OCCUPIED, RANGE, TRUE, UNKNOWN
from explore_bench.report.tables import shown_name
from explore_bench.runs.suites import plan
from explore_bench.strategies.registry import in_order
from explore_bench.trial.run import run_trial
from explore_bench.trial.snapshot import unpack_fine_map
from explore_bench.trial.spec import TrialSpec


def stored_trial(folder, scenario, name="stage", trial=0, **changes):
    own = plan("smoke", ["nearest"], [scenario.size], trial + 1, scenario=scenario, scenario_name=name)
    spec = own.specs[trial]
    store = Store(folder)
    spec = dataclasses.replace(spec, **changes)
    store.open(spec.root, spec.purpose, scenario if spec.purpose == "evaluate" else None)
    store.write(run_trial(spec))
    return store, store.find(spec), store.replay(spec)


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """Return a folder of a trial whose robot closes loops, its record and its replay."""
    return stored_trial(tmp_path_factory.mktemp("fine") / "results", LOOPING, trial=LOOPING_TRIAL, purpose="calibrate")


@pytest.fixture
def axes():
    with styled():
        yield plt.figure().add_subplot()


def lines_of(axes):
    found = {}
    for line in axes.get_lines():
        found.setdefault(to_hex(line.get_color()), []).append(line.get_xydata())
    return found


def fills_of(axes):
    return {to_hex(patch.get_facecolor()) for patch in axes.patches if patch.get_fill()}


def covered(path, grid):
    """Which cells' centres a path of boxes holds, shape (rows, columns)."""
    boxes = path.vertices.reshape(-1, 5, 2)
    low, high = boxes.min(axis=1), boxes.max(axis=1)
    centres = grid.centres(np.arange(grid.cells))
    held = ((centres[:, None] > low) & (centres[:, None] < high)).all(axis=2)
    return held.sum(axis=1).reshape(grid.shape)


# Shapes


def test_bands_hold_each_cell_that_is_set_once_and_no_other():
    cells = np.random.default_rng(0).random((7, 9)) < 0.5
    grid = Grid(7, 9, 0.5)
    assert np.array_equal(covered(bands(cells, 0.5), grid), cells.astype(int))


def test_an_outline_is_as_long_as_the_sides_between_set_cells_and_others():
    cells = np.zeros((6, 6), dtype=bool)
    cells[1:4, 2:4] = True
    cells[5, 0] = True
    sides = outline(cells, 0.5).vertices.reshape(-1, 2, 2)
    assert np.abs(np.diff(sides, axis=1)).sum() == pytest.approx(0.5 * (2 * (3 + 2) + 4))
    assert len(sides) == 8, "a straight side is one line"


# What the lidar sees


def test_the_area_in_sight_ends_at_walls_and_at_the_range():
    world = drawn(8.0, (4.0, 4.5, 0.0, 8.0))
    steps = {"true_x": np.array([2.0]), "true_y": np.array([4.0]), "true_heading": np.array([0.7])}
    x, y, ends = _sight(Scene(SMALL.replace(sensor_range=3.0), world, steps, None))
    away = np.hypot(*(ends - (x, y)).T)
    assert (x, y) == (2.0, 4.0)
    assert ends.shape == (BEAMS, 2)
    assert ends[:, 0].max() == pytest.approx(4.0), "the wall"
    assert away.max() == pytest.approx(3.0), "the range"
    assert ends[:, 0].min() == pytest.approx(0.1), "the wall around"


# Drawing


def test_the_map_with_trajectory_closures_candidates_and_the_way_driven_next(trial, axes):
    _, record, replay = trial
    k = next(i for i, loops in enumerate(replay.loops) if len(loops))
    scene = scene_of(record, replay, k)
    draw_fine_map(axes, scene, truth=False)
    lines = lines_of(axes)
    places = replay.trajectories[k]
    assert lines[ESTIMATE][0] == pytest.approx(places)
    assert np.array(lines[LOOP]) == pytest.approx(places[replay.loops[k]])
    assert lines[CANDIDATE][0] == pytest.approx(replay.positions[k])
    assert lines[CHOSEN][1][0] == pytest.approx(replay.positions[k][replay.choices[k]])
    rows = slice(replay.steps[k], replay.steps[k + 1] + 1)
    assert lines[CHOSEN][0] == pytest.approx(np.stack([record.steps["x"][rows], record.steps["y"][rows]], axis=1))
    assert TRUE not in lines, "the robot does not know it"
    grid = record.spec.scenario.map_grid
    shown = {to_hex(patch.get_facecolor()): covered(patch.get_path(), grid) for patch in axes.patches}
    cells = unpack_fine_map(replay.fine_maps[k], grid.shape)
    assert np.array_equal(shown[UNKNOWN], cells == 0)
    assert np.array_equal(shown[OCCUPIED], cells == 2)


def test_at_the_end_of_a_trial_nothing_is_chosen_and_no_way_leads_on(trial, axes):
    _, record, replay = trial
    scene = scene_of(record, replay, -1)
    assert len(scene.way) == 1
    draw_fine_map(axes, scene, truth=False)
    assert sum(map(len, lines_of(axes)[CHOSEN])) == 1
    assert not len(lines_of(axes)[CANDIDATE][0])


def test_the_true_scene_shows_nothing_of_what_the_robot_believes(trial, axes):
    _, record, replay = trial
    draw_truth(axes, scene_of(record, replay, 1))
    assert set(lines_of(axes)) == {TRUE}
    assert fills_of(axes) == {OCCUPIED, RANGE}


def test_a_scene_in_a_lidar_world_is_the_finer_map_and_in_a_landmark_world_its_cells(trial, stored, axes):
    _, record, replay = trial
    scene = scene_of(record, replay, 1)
    draw_scene(axes, scene)
    assert axes.get_xlim() == (0.0, LOOPING.size)
    assert RANGE in fills_of(axes)
    assert {TRUE, ESTIMATE} <= set(lines_of(axes))
    words = " ".join(handle.get_label() for handle in scene_legend(scene))
    assert "landmark" not in words
    assert f"loop closure ({len(replay.loops[1])} so far)" in words
    spec = stored.specs[0]
    landmark = scene_of(stored.store.find(spec), stored.store.replay(spec), 0)
    words = " ".join(handle.get_label() for handle in scene_legend(landmark))
    assert "true landmark" in words
    assert "loop" not in words


def test_the_legend_of_a_landmark_world_without_landmarks_names_none(tmp_path):
    _, record, replay = stored_trial(tmp_path / "r", TINY.replace(landmark_count=0), "bare")
    scene = scene_of(record, replay, 0)
    assert not [h for h in scene_legend(scene) if h.get_label() in ("true landmark", "estimated landmark")]


def test_a_picture_alone_can_be_had(trial):
    _, record, replay = trial
    assert len(np.unique(scene_image(scene_of(record, replay, 1)).reshape(-1, 3), axis=0)) > 5


# Figure 16


def names_of(files):
    return sorted({file.stem for file in files})


def test_a_folder_of_a_lidar_world_gets_figure_16_and_none_of_the_landmark_worlds(trial, tmp_path):
    store, record, _ = trial
    written = write_figures(store, [record], tmp_path)
    assert names_of(written) == ["figure-16a", "figure-16b"]
    assert {file.suffix for file in written} == {".svg", ".png"}
    for file in written:
        assert 5_000 < file.stat().st_size < 200_000, file
        assert "Figure 16" in caption(file.stem)
    assert "<image" not in (tmp_path / "figure-16b.svg").read_text(), "nothing is rasterized"
    again = write_figures(store, [record], tmp_path / "again")
    assert [file.read_bytes() for file in written] == [file.read_bytes() for file in again]


def test_figure_16_shows_graph_stnn_where_it_ran_then_another_of_its_suite_and_else_the_first_strategy(
    trial, tmp_path, monkeypatch
):
    store, record, replay = trial
    titles = []
    monkeypatch.setattr("explore_bench.report.figures.save_all", lambda figure, stem: titles.append(figure) or [])
    monkeypatch.setattr(store, "replay", lambda spec: replay)
    monkeypatch.setattr(store, "find", lambda spec: dataclasses.replace(record, spec=spec))

    def shown(*strategies):
        titles.clear()
        made = [
            dataclasses.replace(record, spec=dataclasses.replace(record.spec, strategy=name)) for name in strategies
        ]
        write_figures(store, made, tmp_path)
        return [figure.axes[0].get_title() for figure in titles if figure is not None]

    for title, words in zip(shown("nearest", "graph-stnn", "random"), ("scene", "map"), strict=True):
        assert "Graph-STNN" in title
        assert words in title
    assert all("Nearest" in title for title in shown("random", "nearest")), "it is in the figure's suite"
    assert all(shown_name(in_order({"entropy", "random"})[0]) in title for title in shown("random", "entropy")), (
        "the registered order"
    )
    assert shown() == []


def test_trials_of_another_scenario_are_not_drawn_as_figures_of_the_paper(tmp_path):
    """In a landmark world too: the paper's figures are of its own constants."""
    spec = TrialSpec(**{**vars(tiny_plan(["random"], trials=1)[0]), "scenario": TINY.replace(size=20.0)})
    store = Store(tmp_path / "results")
    store.open(spec.root, spec.purpose, spec.scenario)
    store.write(run_trial(spec))
    [record] = store.records()[0]
    assert "figure-10b" in names_of(write_figures(store, [record], tmp_path / "own"))
    other = dataclasses.replace(record, spec=dataclasses.replace(spec, scenario_name="wide"))
    assert write_figures(store, [other], tmp_path / "other") == []


# Demo


@pytest.mark.parametrize("suffix", [".png", ".svg", ".html"])
def test_a_trial_in_a_lidar_world_can_be_looked_at(tmp_path, suffix):
    spec = plan("smoke", ["nearest"], [SMALL.size], 1, scenario=SMALL, scenario_name="stage").specs[0]
    record = demo.draw_trial(spec, tmp_path / f"a{suffix}")
    assert record.status == "explored"
    content = (tmp_path / f"a{suffix}").read_bytes()
    assert len(content) > 5000
    if suffix == ".html":
        assert b"loop closure" in content
        assert b"true landmark" not in content
