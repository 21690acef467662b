"""Trials in lidar worlds: they end, they repeat, they are counted rightly, and targets can be driven to."""

import dataclasses
import itertools
import math
import re

import numpy as np
import pytest
from lidar_worlds import SMALL, begin, cluttered, drawn, nearest, play

from explore_bench.geometry import between
from explore_bench.robot.lidar import navigator
from explore_bench.robot.lidar.terrain import length_of
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.explorer import ChoiceError, StandingError, explorer_of
from explore_bench.trial.lidar.explorer import LidarExplorer
from explore_bench.trial.lidar.loops import CLOSURE_DISTANCE
from explore_bench.trial.lidar.ride import SAFE_DISTANCE
from explore_bench.trial.lidar.step import LidarStep
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import Step, step_columns
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.sensor import Lidar
from explore_bench.world.signals import RangeScan

TEN = SMALL.replace(size=10.0)


def farthest(observation):
    return int(observation.path_lengths.argmax())


def at_random(seed):
    rng = np.random.default_rng(seed)
    return lambda observation: int(rng.integers(len(observation.candidates)))


def explorer_in(world, scenario=TEN):
    streams = TrialSpec("none", "none:none", scenario, 0)
    return explorer_of(scenario, world, streams.generator("motion"), streams.generator("sensor"), lambda _: None)


@pytest.fixture(scope="module")
def trials():
    """Five trials of 10 m, each with its rows, observations and ending."""
    return [play(TEN, nearest if trial % 2 else at_random(trial), trial) for trial in range(5)]


# How a trial goes


def test_drawn_worlds_are_explored_without_a_contact(trials):
    for rows, seen, ending in trials:
        assert ending.status == Status.EXPLORED
        assert ending.reason == ""
        assert rows[-1].explored >= TEN.coverage
        assert rows[-1].collisions == 0
        assert rows[-1].decisions == len(seen)


def test_a_trial_ends_at_the_first_key_pose_at_which_enough_is_known(trials):
    for rows, _, _ in trials:
        assert all(row.explored < TEN.coverage for row in rows[:-1])


def test_what_is_explored_grows(trials):
    """A rebuilt map may lose a few cells, no more."""
    for rows, _, _ in trials:
        explored = [row.explored for row in rows]
        assert min(np.diff(explored)) > -0.005
        assert explored[0] < 0.9


def test_every_decision_takes_at_least_one_step(trials):
    for rows, seen, _ in trials:
        assert [row.step for row in rows] == list(range(len(rows)))
        steps = [observation.step for observation in seen] + [rows[-1].step]
        assert all(later > earlier for earlier, later in itertools.pairwise(steps))
        assert [observation.decision for observation in seen] == list(range(len(seen)))


def test_a_key_pose_is_taken_every_half_metre_or_half_a_radian(trials):
    for rows, _, _ in trials:
        for one, other in itertools.pairwise(rows):
            true = between((one.true_x, one.true_y, one.true_heading), (other.true_x, other.true_y, other.true_heading))
            assert math.hypot(true[0], true[1]) < 0.6
            assert other.path_length - one.path_length < 0.6
            assert other.turned - one.turned < 0.7
            assert math.hypot(true[0], true[1]) <= other.path_length - one.path_length + 1e-9
            assert 0.0 <= other.seconds - one.seconds <= 11.0


def test_rows_tell_estimates_and_truth_apart(trials):
    for rows, _, ending in trials:
        errors = [math.hypot(row.x - row.true_x, row.y - row.true_y) for row in rows]
        assert errors[0] == 0.0
        assert 0.0 < max(errors) < 0.1
        assert len(ending.belief.poses) == len(rows)
        last = rows[-1]
        np.testing.assert_array_equal(ending.belief.pose, (last.x, last.y, last.heading))
        covariance = ending.belief.pose_covariances[-1]
        assert (last.cov_xx, last.cov_xh, last.cov_hh) == (covariance[0, 0], covariance[0, 2], covariance[2, 2])
        assert last.uncertainty == ending.belief.uncertainty
        assert last.peak_trace == ending.belief.peak_trace
        assert last.peak_position_trace < last.peak_trace


def test_explored_is_the_known_share_of_what_counts_and_mislabelled_are_cells_that_are_not_what_they_seem(trials):
    """Against the fine map in the last belief and the truth of the same world."""
    rows, _, ending = trials[1]
    spec = TrialSpec("none", "none:none", TEN, 1, purpose="calibrate")
    from explore_bench.world.kinds import draw_world

    world = draw_world(TEN, spec.generator("world"))
    fine = ending.belief.fine
    known = np.kron(fine.known, np.ones((2, 2), dtype=bool))
    assert rows[-1].explored == pytest.approx(known[world.counted].mean())
    obstacles = world.obstacles.reshape(100, 2, 100, 2).sum(axis=(1, 3))
    wrong = fine.known & ((fine.occupied & (obstacles == 0)) | (~fine.occupied & (obstacles == 4)))
    assert rows[-1].mislabelled == wrong.sum()
    assert wrong.sum() < 0.05 * fine.known.sum()


def test_rows_keep_the_drives_of_the_decision_under_way_and_whether_its_nearest_frontier_waits(monkeypatch):
    """At the end of each decision, as the map is then, looked at anew."""
    kept = []
    offer = navigator.Navigator.offer

    def noting(self, *arguments):
        found = offer(self, *arguments)
        kept.append((self, found))
        return found

    monkeypatch.setattr(navigator.Navigator, "offer", noting)
    waited = []
    for chooser in (nearest, farthest, to_the_200th_cell):
        kept.clear()
        explorer = explorer_in(cluttered(), TEN)
        row = explorer.row()
        assert (row.nearest_drive, row.chosen_drive, row.nearest_waits) == (0.0, 0.0, 0)
        while explorer.status() is None:
            observation = explorer.observe()
            answer = chooser(observation)
            planner, found = kept[-1]
            nearest_one = found.frontiers[int(found.lengths.argmin())]
            if isinstance(answer, Target):
                cell = observation.roads.grid.cell_of(*answer.position)
                route = planner.ways(explorer.pose).to(cell)
                chosen = length_of(route, observation.roads.grid.columns, observation.roads.grid.resolution)
            else:
                chosen = observation.path_lengths[answer]
            rows = list(explorer.drive(answer))
            drives = {(row.nearest_drive, row.chosen_drive) for row in rows}
            assert drives == {(observation.path_lengths.min(), chosen)}
            planner.look()
            assert rows[-1].nearest_waits == int(not planner.resolved(nearest_one))
            waited.append(rows[-1].nearest_waits)
    assert 0 < sum(waited) < len(waited)


def to_the_200th_cell(observation):
    cells, lengths = observation.reachable
    return Target(observation.roads.grid.centre_of(int(cells[lengths.argsort()[min(200, len(cells) - 1)]])))


def test_equal_seeds_give_equal_rows_and_others_do_not(trials):
    rows, _, ending = trials[1]
    again, _, ending_again = play(TEN, nearest, 1)
    assert again == rows
    np.testing.assert_array_equal(ending_again.belief.pose_covariances, ending.belief.pose_covariances)
    np.testing.assert_array_equal(ending_again.belief.virtual_map, ending.belief.virtual_map)
    other, _, _ = play(TEN, nearest, 2)
    assert other[0].true_x != rows[0].true_x


def test_noise_does_not_depend_on_what_is_chosen():
    """The bias of the odometry and the noise of the first scan are the trial's, in whichever world."""
    first = [next(begin(TEN, 3, world)) for world in (None, None)]
    assert first[0] == first[1]
    one, other = explorer_in(drawn(10.0)), explorer_in(cluttered(10.0, 5, 1, [(1.0, 1.0)]))
    assert one._vehicle.bias == other._vehicle.bias
    assert one._vehicle.bias != (0.0, 0.0, 0.0)


def test_the_dynamic_window_drives_as_well():
    rows, _, ending = play(SMALL.replace(local_planner="dwa"), nearest, 1)
    assert ending.status == Status.EXPLORED
    assert rows[-1].collisions == 0


# What is summed up along the way


def test_drives_in_vain_are_counted_in_the_rows_after_them(monkeypatch):
    """As often as a frontier is noted to be left unresolved; the drive that ends the trial is in no row."""
    noted, note = [], navigator.Navigator.note_in_vain
    monkeypatch.setattr(
        navigator.Navigator, "note_in_vain", lambda self, frontier: (noted.append(frontier), note(self, frontier))[1]
    )
    rows, _, _ = play(TEN, nearest, 1)
    assert len(noted) > 0
    assert rows[-1].in_vain in (len(noted), len(noted) - 1)
    assert rows[0].in_vain == 0
    changes = {(b.decisions - a.decisions, b.in_vain - a.in_vain) for a, b in itertools.pairwise(rows)}
    assert changes <= {(0, 0), (1, 0), (1, 1)}, "only where the next drive begins"


def test_what_is_summed_up_never_falls_and_clearance_never_rises(trials):
    for rows, _, _ in trials:
        for one, other in itertools.pairwise(rows):
            assert other.clearance <= one.clearance
            assert other.unsafe_seconds - one.unsafe_seconds <= other.seconds - one.seconds + 1e-9
            assert other.unsafe_seconds >= one.unsafe_seconds
            assert other.speed_change >= one.speed_change
            assert other.missed_closures >= one.missed_closures
        last = rows[-1]
        assert (last.unsafe_seconds > 0.0) <= (last.clearance < SAFE_DISTANCE)
        assert last.clearance > 0.0
        assert last.speed_change >= 2 * TEN.max_speed, "it started and stopped"
        assert last.speed_change <= TEN.acceleration * last.seconds


# How it ends


def test_a_time_limit_ends_a_trial_at_the_next_key_pose():
    limit = 15.0
    rows, _, ending = play(TEN.replace(time_limit=limit), nearest, 1)
    assert ending.status == Status.STEP_LIMIT
    assert limit <= rows[-1].seconds < limit + 3.0
    assert all(row.seconds < limit for row in rows[:-1])


def test_a_step_limit_ends_a_trial():
    rows, _, ending = play(TEN.replace(steps_per_cell=0.4), nearest, 1)
    assert ending.status == Status.STEP_LIMIT
    assert rows[-1].step == 10


def grille():
    """Two halves of a room, between them a wall of which every third part is open: to see through, not to go."""
    return drawn(8.0, *[(x, x + 0.1, 4.0, 4.1) for x in np.arange(0.1, 7.9, 0.35)], start=(2.0, 2.0, 0.0))


@pytest.mark.parametrize("choose", [nearest, farthest, at_random(1)], ids=["nearest", "farthest", "random"])
def test_frontiers_that_can_never_be_resolved_do_not_keep_the_robot_for_ever(choose):
    """What lies behind a grille is seen in fans, whose edges are frontiers that no place to stand resolves."""
    rows, seen, ending = play(SMALL, choose, 0, grille())
    assert ending.status == Status.STUCK
    assert ending.reason == "no frontier can be reached"
    assert 2 <= len(seen) <= 60
    assert 0.5 < rows[-1].explored < 0.97
    assert rows[-1].collisions == 0


def test_a_robot_whose_scans_match_nothing_ends_its_trial_with_a_sentence(monkeypatch):
    """A lidar that returns nothing: all is open, and nothing is there to match."""
    monkeypatch.setattr(Lidar, "scan", lambda *_: RangeScan(np.full(360, np.inf)))
    rows, _, ending = play(TEN, at_random(0), 0)
    assert ending.status == Status.STUCK
    assert re.fullmatch(r"no scan has matched what was seen before for 6\d s", ending.reason)
    assert 60.0 <= rows[-1].seconds < 70.0


def test_a_robot_that_is_lost_ends_its_trial_with_a_sentence(monkeypatch):
    """A lidar that shows another place every time, so that what matches does so by chance."""
    rng = np.random.default_rng(0)
    monkeypatch.setattr(Lidar, "scan", lambda *_: RangeScan(rng.uniform(0.5, 10.0, 360)))
    rows, _, ending = play(TEN, at_random(0), 0)
    assert ending.status == Status.STUCK
    assert re.fullmatch(r"the robot is lost: it is 2\.\d m from where it believes to be", ending.reason)
    away = [math.hypot(row.x - row.true_x, row.y - row.true_y) for row in rows]
    assert away[-1] > 2.0 >= max(away[:-1])


@pytest.mark.parametrize("beams", [8, 12])
def test_holes_between_a_few_beams_do_not_keep_the_robot_for_ever(beams):
    """They are frontiers that most looks do not resolve."""
    rows, seen, ending = play(SMALL.replace(beams=beams), nearest, 1)
    assert ending.status in (Status.EXPLORED, Status.STUCK)
    assert len(seen) <= 150
    assert rows[-1].explored > 0.9


def test_without_withholding_the_robot_would_look_at_the_same_place_again_and_again(monkeypatch):
    """In a drawn world, until the patience of a trial ends it: so the rule is what lets trials go on."""
    monkeypatch.setattr(navigator.Navigator, "note_in_vain", lambda *_: None)
    rows, _, ending = play(TEN, nearest, 0)
    assert ending.status == Status.STUCK
    assert "decisions did not leave cell" in ending.reason
    assert rows[-1].explored < 0.9


def test_a_sealed_robot_is_stuck_at_once():
    world = drawn(8.0, free=[(1.0, 2.5, 1.0, 2.5), (4.0, 7.5, 1.0, 7.5)], start=(1.7, 1.7, 0.0))
    rows, seen, ending = play(SMALL, nearest, 0, world)
    assert (len(rows), len(seen)) == (1, 0)
    assert ending.status == Status.STUCK
    assert ending.reason == "no frontier can be reached"


def test_a_robot_between_walls_that_it_cannot_leave_ends_in_time():
    """A start from which it sees much, but in a pen of bars between which it does not fit."""
    bars = [(x, x + 0.05, y, y + 0.05) for x in np.arange(2.0, 5.1, 0.3) for y in (2.0, 5.0)]
    bars += [(x, x + 0.05, y, y + 0.05) for y in np.arange(2.0, 5.1, 0.3) for x in (2.0, 5.0)]
    rows, seen, ending = play(SMALL, nearest, 0, drawn(8.0, *bars, start=(3.5, 3.5, 0.5)))
    assert ending.status in (Status.STUCK, Status.EXPLORED)
    assert len(seen) <= 60
    assert rows[-1].collisions <= 1


def test_a_world_that_does_not_fit_the_scenario_is_refused():
    with pytest.raises(
        ValueError, match=r"160 × 160 cells of 0.05 m, the scenario 200 × 200 of 0.05 m; make them agree"
    ):
        explorer_in(drawn(8.0), TEN)


# Two equal rooms


def test_two_identical_rooms_close_no_false_loop():
    """Joined by a corridor around, furnished alike, wall to wall."""
    furniture = [(0.3, 0.9, 2.2, 2.6), (2.3, 2.7, 0.4, 1.5), (0.2, 0.5, 0.3, 0.6)]
    rooms, boxes = [(0.5, 3.5, 0.5, 3.5), (3.6, 6.6, 0.5, 3.5)], []
    for x0, _, y0, _ in rooms:
        boxes += [(x0 + a, x0 + b, y0 + c, y0 + d) for a, b, c, d in furniture]
    free = [*rooms, (1.6, 2.6, 3.5, 9.5), (1.6, 9.5, 8.5, 9.5), (8.5, 9.5, 4.0, 9.5), (4.7, 9.5, 4.0, 5.0)]
    world = drawn(10.0, *boxes, free=[*free, (4.7, 5.7, 3.4, 4.1)], start=(2.1, 1.5, 0.0))
    rows, _, ending = play(TEN.replace(coverage=0.95), nearest, 0, world)  # nooks behind the furniture stay unseen
    assert ending.status == Status.EXPLORED
    assert rows[-1].false_closures == 0
    assert rows[-1].closures == 0
    errors = [math.hypot(row.x - row.true_x, row.y - row.true_y) for row in rows]
    assert max(errors) < 0.2


def test_closures_are_compared_with_the_truth():
    """Of two closures by hand one is a centimetre off and one more than is allowed."""
    explorer = explorer_in(cluttered(10.0, 8, 2, [(1.0, 1.0)]))
    observation = explorer.observe()
    rows = list(explorer.drive(int(observation.path_lengths.argmax())))
    assert rows[-1].closures == rows[-1].false_closures == 0
    slam, last = explorer.mapper.slam, len(explorer.mapper.slam.poses) - 1
    start, end = explorer_in(cluttered(10.0, 8, 2, [(1.0, 1.0)])).row(), rows[-1]
    x, y, heading = between(
        (start.true_x, start.true_y, start.true_heading), (end.true_x, end.true_y, end.true_heading)
    )
    link = slam.links[-1]
    for off, false in ((0.01, 0), (CLOSURE_DISTANCE + 0.05, 1), (0.0, 1)):
        slam.closures.append(link._replace(earlier=0, later=last, motion=(x + off, y, heading)))
        row = explorer.row()
        assert row.false_closures == false
    assert row.closures == 3
    slam.closures.append(link._replace(earlier=0, later=last, motion=(x, y, heading + math.radians(4.0))))
    assert explorer.row().false_closures == 2


# Targets


def test_a_target_is_driven_to():
    explorer = explorer_in(drawn(10.0, (4.0, 4.4, 2.0, 6.0), start=(2.0, 4.0, 0.0)))
    observation = explorer.observe()
    cells, lengths = observation.reachable
    cell = observation.roads.grid.cell_of(3.4, 6.9)
    place = observation.roads.grid.centre_of(cell)
    rows = list(explorer.drive(Target(place)))
    assert math.dist(place, (rows[-1].x, rows[-1].y)) <= 0.3
    assert math.dist(place, (rows[-1].true_x, rows[-1].true_y)) <= 0.4
    assert lengths[list(cells).index(cell)] == pytest.approx(math.dist(place, (2.0, 4.0)), rel=0.1)
    assert rows[-1].decisions == 1
    assert rows[-1].collisions == 0


def test_what_is_reachable_lies_on_the_fine_map():
    explorer = explorer_in(drawn(10.0, start=(2.0, 4.0, 0.0)))
    observation = explorer.observe()
    assert observation.roads.grid == TEN.map_grid
    fine = observation.belief.fine
    cells = observation.reachable.cells
    assert fine.known.reshape(-1)[cells].all()
    assert not fine.occupied.reshape(-1)[cells].any()
    assert len(cells) > 1000


REFUSED = {
    "in a wall": ((5.05, 0.02), r"lies in cell \d+, which is blocked or not known to be free"),
    "too near to one": ((5.0, 0.25), r"lies in cell \d+, which is blocked or not known to be free"),
    "where nothing is known": ((9.5, 9.5), r"lies in cell \d+, which is blocked or not known to be free"),
    "outside": ((11.0, 5.0), r"lies outside the map of 10 × 10 m"),
    "where the robot is": ((2.0, 4.0), r"lies in the robot's own cell"),
    "nowhere": ((math.nan, 1.0), r"is not finite"),
}


@pytest.mark.parametrize("where", REFUSED)
def test_a_target_that_cannot_be_driven_to_is_refused_in_a_sentence(where):
    place, sentence = REFUSED[where]
    explorer = explorer_in(drawn(10.0, start=(2.0, 4.0, 0.0)))
    explorer.observe()
    with pytest.raises(ChoiceError, match=sentence) as refused:
        next(iter(explorer.drive(Target(place))))
    assert "\n" not in str(refused.value)
    assert isinstance(refused.value, StandingError) == (where == "where the robot is")
    assert explorer.decisions == 0


@pytest.mark.parametrize("answer", [-1, 99, 0.5, None, True])
def test_what_is_no_candidate_is_refused(answer):
    explorer = explorer_in(drawn(10.0, start=(2.0, 4.0, 0.0)))
    explorer.observe()
    with pytest.raises(ChoiceError, match="answer"):
        next(iter(explorer.drive(answer)))


def test_a_strategy_of_targets_ends_its_trial():
    """One that drives to and fro between two places explores nothing more, and patience or the limit ends it."""

    def to_and_fro(observation):
        cells, lengths = observation.reachable
        return Target(observation.roads.grid.centre_of(int(cells[lengths.argmin()])))

    rows, seen, ending = play(SMALL.replace(steps_per_cell=5.0), to_and_fro, 0, cluttered(8.0, 6, 1, [(1.0, 1.0)]))
    assert ending.status in (Status.STUCK, Status.STEP_LIMIT)
    assert len(seen) <= rows[-1].step <= 80


# What passes to a strategy


def test_an_observation_leads_to_no_truth():
    """Neither the map given nor anything of the vehicle hangs on what a strategy is shown."""
    given = TEN.replace(size=10.0)
    explorer = explorer_in(drawn(10.0, start=(2.0, 4.0, 0.0)), given)
    observation = explorer.observe()
    assert isinstance(explorer, LidarExplorer)
    seen, queue = set(), [observation]
    while queue:
        item = queue.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        assert item is not explorer._vehicle
        assert not any(item is own for own in (explorer._truth, explorer._loops, explorer._ride))
        if isinstance(item, np.ndarray):
            assert item.size == 0 or not item.flags.writeable
            queue.append(item.base)
        elif dataclasses.is_dataclass(item) and not isinstance(item, type):
            queue += [getattr(item, field.name) for field in dataclasses.fields(item)]
        elif isinstance(item, tuple | list):
            queue += item


def test_the_row_of_a_step_is_the_kind_s():
    row = next(begin(SMALL, 0))
    assert type(row) is LidarStep
    assert isinstance(row, Step)
    columns = step_columns("lidar")
    assert list(columns) == [field.name for field in dataclasses.fields(LidarStep)]
    assert list(columns)[-8:] == [
        *("seconds", "closures", "false_closures", "missed_closures"),
        *("in_vain", "clearance", "unsafe_seconds", "speed_change"),
    ]
    for name, column in columns.items():
        kind = float if column.dtype.startswith("float") else int
        assert type(getattr(row, name)) is kind, name
    assert (row.step, row.decisions, row.seconds, row.path_length) == (0, 0, 0.0, 0.0)
    events = begin(SMALL, 0)
    next(events)
    assert isinstance(next(events), Observation)


def test_a_given_map_is_the_robot_s_to_discover():
    """The robot's constants do not hold the map that is given."""
    rows = ("#" * 60, *["#" + "." * 58 + "#"] * 58, "#" * 60)
    scenario = LidarScenario(map=rows, resolution=0.1, sensor_range=3.0)
    assert scenario.size == 8.0
    events = begin(scenario, 0)
    next(events)
    observation = next(events)
    assert observation.scenario.map is None
    assert observation.scenario.size == 8.0
