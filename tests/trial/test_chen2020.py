"""The protocol of Chen et al. 2020 ([8]): what its options change, one by one, and that the whole gives its numbers."""

import csv
import itertools
import math
import re
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import Rectangle

from explore_bench.analysis.claims import Claim, Comparison
from explore_bench.errors import RequestError
from explore_bench.geometry import Grid, compose
from explore_bench.records.store import Store
from explore_bench.report.moment import scene_of
from explore_bench.report.packing import unpack
from explore_bench.report.render import write_report
from explore_bench.report.replays import pack_replay
from explore_bench.report.scene import draw_scene, squares
from explore_bench.robot.planning.candidates import Ground, Withheld, find_candidates
from explore_bench.runs.runner import run
from explore_bench.runs.suites import plan
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.loop import rollout
from explore_bench.trial.run import run_trial
from explore_bench.trial.seeding import stream
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.scenarios import CHEN_2020, PAPER

ROOT = Path(__file__).parents[2]


def world_of(scenario, number=0):
    return draw_world(scenario, stream("calibrate", 0, scenario.size, number, "world"))


def events_of(scenario, number=0, choose=lambda observation: int(observation.path_lengths.argmin())):
    """Rows and observations of a trial, as they come."""
    motion, sensor = (stream("calibrate", 0, scenario.size, number, role) for role in ("motion", "sensor"))
    events, answer, seen = rollout(scenario, world_of(scenario, number), motion, sensor), None, []
    while True:
        try:
            event = events.send(answer)
        except StopIteration as stop:
            return seen, stop.value
        seen.append(event)
        answer = choose(event) if isinstance(event, Observation) else None


def rows_of(events):
    return [event for event in events if isinstance(event, Step)]


def observations_of(events):
    return [event for event in events if isinstance(event, Observation)]


# Worlds


@pytest.mark.parametrize(("size", "landmarks"), [(40.0, 8), (60.0, 18), (80.0, 32), (100.0, 50)])
def test_the_number_of_landmarks_grows_with_the_map_alone(size, landmarks):
    """The margin adds cells, but no landmark."""
    scenario = CHEN_2020.replace(size=size)
    assert scenario.landmarks == landmarks
    assert len(world_of(scenario).landmarks) == landmarks


def test_the_map_goes_on_beyond_its_border():
    """40 m with 20 m around: 40 × 40 cells, of which the 20 × 20 in the middle count."""
    world = world_of(CHEN_2020)
    assert CHEN_2020.grid == Grid(40, 40, 2.0, -20.0, -20.0)
    assert world.grid == CHEN_2020.grid
    assert world.counted.sum() == 400
    assert world.counted[10:30, 10:30].all()
    assert not world.obstacles.any()
    assert CHEN_2020.cell_count == 1600


def test_landmarks_are_uniform_on_the_map_but_not_near_the_start():
    worlds = [world_of(CHEN_2020, number) for number in range(150)]
    landmarks = np.concatenate([world.landmarks for world in worlds])
    starts = np.repeat([world.start[:2] for world in worlds], 8, axis=0)
    distances = np.hypot(*(landmarks - starts).T)
    assert 2.0 <= distances.min() < 2.5
    assert 0.0 <= landmarks.min() < 0.5
    assert 39.5 < landmarks.max() <= 40.0
    cells = [world.grid.cell_of(*place) for world in worlds for place in world.landmarks]
    per_world = np.array(cells).reshape(150, 8)
    assert any(len(set(own)) < 8 for own in per_world.tolist()), "two may share a cell"


def test_a_landmark_is_in_sight_at_the_start():
    """Of some worlds without the moves there is none in range from any of the four places of the start."""
    move = CHEN_2020.noise.start_move.motion

    def sighted(world):
        pose, near = world.start, False
        for _ in range(5):
            near = near or np.hypot(*(world.landmarks - pose[:2]).T).min() < 6.0
            pose = compose(pose, move)
        return near

    assert all(sighted(world_of(CHEN_2020, number)) for number in range(60))
    assert not all(sighted(world_of(CHEN_2020.replace(start_moves=0), number)) for number in range(60))


def test_a_world_without_a_landmark_needs_none_in_sight():
    assert len(world_of(CHEN_2020.replace(landmark_count=0)).landmarks) == 0


def test_a_landmark_that_is_never_in_sight_is_refused(monkeypatch):
    """Out of range by its clearance."""
    monkeypatch.setattr("explore_bench.world.landmark.world.MAX_DRAWS", 50)
    scenario = CHEN_2020.replace(sensor_range=0.5, landmark_count=1, landmark_clearance=10.0)
    with pytest.raises(RequestError, match=r"and a landmark in sight of the start .* in 50 draws.* or add landmarks"):
        world_of(scenario)


# Moves at the start


def test_the_moves_at_the_start_are_not_counted():
    """Five poses and no step: a square of 2 m back to the start, as the odometry sees it."""
    events, _ = events_of(CHEN_2020)
    first, start = rows_of(events)[0], world_of(CHEN_2020).start
    assert (first.step, first.decisions, first.path_length, first.turned) == (0, 0, 0.0, 0.0)
    belief = observations_of(events)[0].belief
    assert len(belief.poses) == 5
    pose = start
    for estimate in belief.poses:
        assert math.dist(estimate[:2], pose[:2]) < 1.0
        pose = compose(pose, (1.0, 1.0, math.pi / 2))
    assert math.dist(belief.poses[-1, :2], start[:2]) < 1.0
    assert (first.true_x, first.true_y) != start[:2], "they have noise"
    assert first.cov_xx > 1.5 * 0.05**2, "and make it less certain than the prior"


# Decisions


def ground(drawing, robot=0, **rules):
    """Ground of a drawing, '?' unknown, '.' free; cells of 2 m, the first line is row 0."""
    signs = np.array([list(row) for row in drawing])
    scenario = LandmarkScenario(size=2.0 * len(signs), landmark_count=0, obstacle_count=0, candidates_per_robot=9)
    pose = (*scenario.grid.centre_of(robot), 0.3)
    return Ground(scenario, pose, signs != "?", signs == "#", np.empty((0, 2)), **rules)


def cells_of(*arguments, **rules):
    found = find_candidates(ground(*arguments, **rules), Withheld())
    return None if found is None else found.cells.tolist()


def test_a_frontier_may_need_several_unknown_neighbours():
    """Of the last known row the cells at its ends see two unknown ones, those between see three."""
    drawing = ("....", "....", "????", "????")
    assert cells_of(drawing) == cells_of(drawing, least_unknown=2) == [4, 5, 6, 7]
    assert cells_of(drawing, least_unknown=3) == [5, 6]
    assert cells_of(drawing, least_unknown=4) is None


def test_only_cells_inside_are_candidates():
    drawing = ("....", "....", "....", "????")
    inside = np.zeros((4, 4), dtype=bool)
    inside[:, :2] = True
    assert cells_of(drawing) == [8, 9, 10, 11]
    assert cells_of(drawing, inside=inside) == [8, 9]


def test_straight_on_nothing_is_in_the_way():
    """A frontier behind a wall can be reached; the way is the two cells at its ends, as long as the crow flies."""
    drawing = ("..#.?", "..#.?", "..#.?", "..#.?", "..#.?")
    assert cells_of(drawing, 5) == [3, 8, 13, 18, 23], "by a detour through what is not known to be free"
    found = find_candidates(ground(drawing, 5, straight=True), Withheld())
    assert found.cells.tolist() == [3, 8, 13, 18, 23]
    assert [path.tolist() for path in found.paths] == [[5, cell] for cell in found.cells.tolist()]
    assert found.lengths == pytest.approx([math.dist((1.0, 3.0), (7.0, y)) for y in (1.0, 3.0, 5.0, 7.0, 9.0)])
    assert 2 not in found.roads.reachable.cells.tolist(), "an obstacle itself is no goal"


def test_a_decision_is_one_turn_and_straight_steps():
    """Of every decision: a turn, full steps of 2 m and the rest, whose lengths add up to that of the path."""
    events, ending = events_of(CHEN_2020)
    assert ending.status == "explored"
    decisions, steps = observations_of(events), rows_of(events)
    for seen, following in itertools.pairwise(decisions):
        length = float(seen.path_lengths.min())
        assert following.step - seen.step == 2 + int(length / 2.0)
        driven = steps[following.step].path_length - steps[seen.step].path_length
        assert driven == pytest.approx(length, abs=1e-9)
        prediction = seen.belief.predict(seen.paths[int(seen.path_lengths.argmin())])
        assert len(prediction.poses) == following.step - seen.step


def test_a_target_is_driven_to_straight_on():
    goal = (21.3, 18.4)

    def choose(observation):
        known = observation.belief.known.reshape(-1)
        cell = CHEN_2020.grid.cell_of(*goal)
        if observation.decision == 0 and known[cell] and cell in observation.reachable.cells:
            return Target(goal)
        return int(observation.path_lengths.argmin())

    number = next(n for n in range(60) if math.dist(world_of(CHEN_2020, n).start[:2], goal) < 5.0)
    events, _ = events_of(CHEN_2020, number, choose)
    first, second = observations_of(events)[:2]
    assert math.dist(second.pose[:2], goal) < 0.8
    assert second.step - first.step == 2 + int(math.dist(first.pose[:2], goal) / 2.0)


def again(withhold, number):
    """How often a frontier that was driven to is a candidate once more, as little known around it as before."""
    scenario = CHEN_2020.replace(withhold=withhold, sensor_range=2.9, steps_per_cell=0.2)
    ends, count, before = {}, 0, None
    for seen in observations_of(events_of(scenario, number)[0]):
        known = np.pad(seen.belief.known, 1)
        around = {cell: known[cell // 40 : cell // 40 + 3, cell % 40 : cell % 40 + 3].tobytes() for cell in range(1600)}
        if before is not None:
            ends[before] = around[before]
        count += sum(ends.get(cell) == around[cell] for cell in seen.candidates.tolist())
        before = int(seen.candidates[seen.path_lengths.argmin()])
    return count


def test_what_is_not_withheld_is_a_candidate_again():
    """With a range of 2.9 m a neighbour at the corner stays unknown, and the frontier remains one."""
    assert sum(again(False, number) for number in range(4)) > 0
    assert sum(again(True, number) for number in range(4)) == 0


def test_a_sighted_landmark_makes_its_cell_occupied_and_known():
    events, ending = events_of(CHEN_2020)
    for belief in (observations_of(events)[3].belief, ending.belief):
        cells = [CHEN_2020.grid.cell_of(*place) for place in belief.landmarks]
        assert len(cells)
        assert belief.occupancy.reshape(-1)[cells] == pytest.approx(0.7)
        assert belief.known.reshape(-1)[cells].all()
    for seen in observations_of(events):
        assert not {CHEN_2020.grid.cell_of(*place) for place in seen.belief.landmarks} & set(seen.candidates.tolist())
    _, without = events_of(CHEN_2020.replace(landmarks_occupy=False))
    cells = [CHEN_2020.grid.cell_of(*place) for place in without.belief.landmarks]
    assert (without.belief.occupancy.reshape(-1)[cells] < 0.5).all()
    assert rows_of(events)[0].landmarks > 0
    assert rows_of(events)[0].mislabelled == 0, "such a cell is labelled as it should be"


def test_candidates_lie_on_the_map_itself():
    events, _ = events_of(CHEN_2020)
    for seen in observations_of(events):
        assert (seen.positions >= 0.0).all() and (seen.positions <= 40.0).all()
        assert seen.belief.known.shape == (40, 40)


# Range and coverage are strict


def test_more_than_85_percent_end_a_trial_and_not_85():
    assert CHEN_2020.coverage > 340 / 400
    assert CHEN_2020.coverage <= 341 / 400
    events, ending = events_of(CHEN_2020)
    explored = [row.explored for row in rows_of(events)]
    assert ending.status == "explored"
    assert explored[-1] > 0.85
    assert max(explored[:-1]) <= 0.85


def test_what_lies_at_6_m_is_out_of_range():
    grid = CHEN_2020.grid
    assert not grid.in_reach(np.array([[1.0, 1.0]]), CHEN_2020.sensor_range)[0, grid.cell_of(7.0, 1.0)]
    assert grid.in_reach(np.array([[1.0 + 1e-9, 1.0]]), CHEN_2020.sensor_range)[0, grid.cell_of(7.0, 1.0)]


# Bad input


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"margin": 3.0}, "margin 3 m is no multiple of cell_size 2 m"),
        ({"planner": "straight"}, "planner 'straight' goes round none of 20 obstacles; set planner 'grid'"),
        ({"planner": "curved"}, "planner"),
        ({"landmark_clearance": 10.0}, "landmark_clearance 10 m leaves no room around the start"),
        ({"frontier_neighbours": 9}, "frontier_neighbours"),
        ({"start_moves": -1}, "start_moves"),
        ({"relinearize_interval": 0}, "relinearize_interval"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, complaint):
    with pytest.raises(RequestError, match=re.escape(complaint)):
        PAPER.replace(**options)


def test_a_map_of_its_own_needs_the_other_planner_and_no_margin():
    rows = ["#####", "#...#", "#.S.#", "#...#", "#####"]
    with pytest.raises(RequestError, match="set planner 'grid'"):
        CHEN_2020.replace(map=rows)
    scenario = CHEN_2020.replace(map=rows, planner="grid")
    assert scenario.grid == Grid(5, 5, 2.0)
    world_of(scenario)


# The numbers


def lines():
    with (ROOT / "docs" / "studies" / "chen2020.csv").open(encoding="utf-8", newline="") as file:
        return {line["strategy"].strip("`"): line for line in csv.DictReader(file)}


@pytest.mark.parametrize("name", ["nearest", "random", "gcn-no-obs"])
def test_the_steps_agree_with_those_of_the_ancestor_s_code(name):
    """The 95 % interval of the difference holds 0, from 50 worlds of ours."""
    line = lines()[name]
    low, high = map(float, re.findall(r"\[(.*), (.*)\]", line["steps, ours less theirs"])[0])
    assert low <= 0.0 <= high
    assert line["worlds"] == "50"


@pytest.mark.parametrize("name", ["nearest", "random"])
def test_the_entropy_agrees_within_3_nats(name):
    line = lines()[name]
    assert abs(float(line["entropy [nat]"].split(" ±")[0]) - float(line["entropy in [8] [nat]"])) < 3.0


@pytest.mark.slow
def test_the_study_gives_what_its_page_says():
    import sys

    sys.path.insert(0, str(ROOT / "docs" / "studies"))
    try:
        import chen2020
    finally:
        sys.path.pop(0)
    stored, anew = lines()["nearest"], chen2020.row("nearest", 50)
    assert {key: str(value) for key, value in anew.items()} == stored


def test_a_trial_is_stored_with_a_pose_for_every_row():
    """The four moves at the start have poses, but no rows."""
    [spec] = plan("smoke", ["nearest"], trials=1, scenario=CHEN_2020, scenario_name="chen2020").specs
    result = run_trial(spec)
    assert len(result.final_poses) == len(result.final_covariances) == len(result.steps)
    last = result.steps[-1]
    assert result.final_poses[-1].tolist() == [last.x, last.y, last.heading]


# What a report shows of it


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A results folder of three short trials, reported, with two claims about their scenario."""
    folder = tmp_path_factory.mktemp("chen2020")
    run("table2", ["nearest"], trials=3, scenario="chen2020", results=folder, workers=1)
    of_nearest = [Comparison("nearest", other, "trajectory_error", 40.0) for other in ("random", "entropy")]
    own = tuple(Claim(one.worse, "Nearest is better.", (one,), scenario="chen2020") for one in of_nearest)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("explore_bench.analysis.claims.claims", lambda: own)
        write_report(folder)
    return folder


def test_every_table_names_the_scenario_and_none_has_a_number_of_the_paper(folder):
    tables = sorted((folder / "tables").glob("*.md"))
    assert {"means", "details", "paired", "claims"} <= {table.stem for table in tables}
    for table in tables:
        text = table.read_text()
        assert "Scenario: chen2020." in text, table.name
        assert "paper" not in text, table.name
    for file in [folder / "summary.csv", *(folder / "tables").glob("*.csv")]:
        rows = pd.read_csv(file, dtype=str)
        of_two = file.stem in {"paired", "wins"}  # no row of one strategy alone
        assert set(rows["scenario"]) == (set() if of_two else {"chen2020"}), file.name
    assert not {"constants", "table2", "table3"} & {table.stem for table in tables}
    claims = (folder / "claims.md").read_text()
    assert claims.count("\n| --- |") == claims.count("\nScenario: chen2020.\n") == 3, "all claims, and each by itself"
    section = (folder / "report.html").read_text().split('<section id="section-1">')[1].split("</section>")[0]
    notes = section.count('<p class="note">Scenario: chen2020.')
    assert notes == section.count('<figure class="table">') == 5, "and in words"
    assert "paper" not in section


def test_a_replay_begins_at_the_corner_of_the_margin(folder):
    """The player's origin is the lower left corner of the grid, 20 m below and left of the map's."""
    store = Store(folder)
    kept = store.records()[0][0]
    shown = unpack(pack_replay(kept, store.replay(kept.spec)))
    assert shown["x"] == pytest.approx(kept.steps["x"] + 20.0, abs=0.01)
    assert shown["true_y"] == pytest.approx(kept.steps["true_y"] + 20.0, abs=0.01)
    assert np.array(shown["landmarks"]) == pytest.approx(kept.world.landmarks + 20.0, abs=0.0051)


def test_a_picture_shows_the_border_and_what_lies_beyond(folder):
    store = Store(folder)
    kept = store.records()[0][0]
    figure, axes = plt.subplots()
    draw_scene(axes, scene_of(kept, store.replay(kept.spec), -1))
    assert axes.get_xlim() == axes.get_ylim() == pytest.approx((-6.0, 46.0))
    [border] = [patch for patch in axes.patches if isinstance(patch, Rectangle)]
    assert (border.get_xy(), border.get_width(), border.get_height()) == ((0.0, 0.0), 40.0, 40.0)
    free = squares(np.eye(40, dtype=bool), CHEN_2020.grid)
    assert free.vertices.min() == -20.0 and free.vertices.max() == 60.0
    plt.close(figure)
