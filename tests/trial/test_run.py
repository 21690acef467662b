"""The rollout and run_trial: rows, decisions, endings, failures, fairness, and what a strategy can reach."""

import contextlib
import copy
import dataclasses
import gc
import math
import os
import signal
import sys
import time
import types
from itertools import pairwise

import numpy as np
import pytest
from handmade import HALLS, write_plugin

from explore_bench.errors import RequestError
from explore_bench.geometry import between, centre_of, compose
from explore_bench.robot.landmark.smoother import Smoother
from explore_bench.robot.planning.candidates import Withheld
from explore_bench.strategies.contract import Observation
from explore_bench.trial.explorer import ChoiceError
from explore_bench.trial.landmark.explorer import LandmarkExplorer
from explore_bench.trial.rollout import rollout
from explore_bench.trial.run import Status, run_trial
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.motion import Robot
from explore_bench.world.landmark.sensor import Sensor
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.maps import with_map
from explore_bench.world.scenario import Scenario
from explore_bench.world.signals import Patch, Scan

SMALL = Scenario(size=12.0)
PAPER = Scenario()


# Strategies, named in specs by "test_run:Name"


class Nearest:
    """Takes the shortest path; the subclasses below do so for three decisions."""

    def reset(self, rng):
        self.decisions = 0

    def choose(self, observation):
        self.decisions += 1
        if self.decisions > 3:
            return self.later(observation)
        return int(observation.path_lengths.argmin())

    def later(self, observation):
        return int(observation.path_lengths.argmin())


class Farthest(Nearest):
    def choose(self, observation):
        return int(observation.path_lengths.argmax())


class AnyOne(Nearest):
    def reset(self, rng):
        self.rng = rng

    def choose(self, observation):
        return int(self.rng.integers(len(observation.candidates)))


class RaisesInReset(Nearest):
    def reset(self, rng):
        raise LookupError("no map in the glove box")


class RaisesInInit(Nearest):
    def __init__(self):
        raise LookupError("no map in the glove box")


class RaisesInChoose(Nearest):
    def later(self, observation):
        raise LookupError("no map in the glove box\nsecond line")


class Exits(Nearest):
    def later(self, observation):
        sys.exit("had enough")


class Loops(Nearest):
    def later(self, observation):
        while True:
            pass


class LoopsHoldingExceptions(Nearest):
    def later(self, observation):
        while True:
            with contextlib.suppress(Exception):
                time.sleep(0.01)


class Answers(Nearest):
    def __init__(self, answer):
        self.answer = answer

    def later(self, observation):
        return self.answer


class Forges(Nearest):
    """Overwrites by force whatever arrays it can make writeable."""

    def choose(self, observation):
        choice = super().choose(observation)
        for array in arrays_in(observation):
            try:
                array.setflags(write=True)
            except ValueError:
                continue
            array.fill(1)
        return choice


class Informed(Nearest):
    """Is told the truth, and insists on it."""

    def reset(self, rng):
        raise AssertionError("a reference is reset with the world")

    def reset_with_world(self, rng, world):
        assert isinstance(world, LandmarkWorld)
        self.decisions = 0


def spec_of(strategy, scenario=SMALL, trial=0, **fields):
    return TrialSpec(strategy, f"{__name__}:{strategy}", scenario, trial, **fields)


# Playing a rollout with a function of the observation


def begin(scenario, trial=0, world=None):
    spec = TrialSpec("none", "none:none", scenario, trial)
    world = world or draw_world(scenario, spec.generator("world"))
    return rollout(scenario, world, spec.generator("motion"), spec.generator("sensor"))


def play(scenario, chooser, trial=0, world=None):
    """Play to the end; returns all events (Steps and pairs of an Observation and the choice) and the Ending."""
    events, found, choice = begin(scenario, trial, world), [], None
    while True:
        try:
            event = events.send(choice)
        except StopIteration as stop:
            return found, stop.value
        choice = chooser(event) if isinstance(event, Observation) else None
        found.append(event if choice is None else (event, choice))


def known_around(observation, cell):
    row, column = divmod(cell, observation.scenario.grid.columns)
    return observation.belief.known[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].tolist()


def nearest(observation):
    return int(observation.path_lengths.argmin())


def farthest(observation):
    return int(observation.path_lengths.argmax())


def at_random(seed):
    rng = np.random.default_rng(seed)
    return lambda observation: int(rng.integers(len(observation.candidates)))


def steps_of(events):
    return [event for event in events if isinstance(event, Step)]


def decisions_of(events):
    """Pairs of an Observation and the Steps that followed its choice."""
    found = []
    for event in events:
        if isinstance(event, Step):
            if found:
                found[-1][1].append(event)
        else:
            found.append((event[0], []))
    return found


def first_observation(scenario=PAPER, trial=0, after=0):
    """Return the observation after so many decisions for the nearest, with the last row and the rollout."""
    events = begin(scenario, trial)
    choice, row = None, None
    while True:
        event = events.send(choice)
        choice = None
        if isinstance(event, Step):
            row = event
        elif event.decision == after:
            return event, row, events
        else:
            choice = nearest(event)


# Rows


@pytest.fixture(scope="module", params=[0, 1, 2, 3])
def played(request):
    """Trials at 20 m with random choices."""
    return play(PAPER, at_random(request.param), request.param)


def test_row_0_is_the_start_known_and_scanned(played):
    first = played[0][0]
    assert isinstance(first, Step)
    assert (first.step, first.decisions, first.path_length, first.turned, first.collisions) == (0, 0, 0.0, 0.0, 0)
    assert (first.x, first.y, first.heading) == pytest.approx((first.true_x, first.true_y, first.true_heading), abs=0.2)
    assert 0.0 < first.explored < 0.9
    assert first.uncertainty < PAPER.prior_uncertainty


def test_steps_are_numbered_without_a_gap(played):
    assert [row.step for row in steps_of(played[0])] == list(range(len(steps_of(played[0]))))


def test_every_step_turns_or_drives_within_the_step_length(played):
    rows = steps_of(played[0])
    for before, after in pairwise(rows):
        turned, driven = after.turned - before.turned, after.path_length - before.path_length
        assert (turned > 1e-9) != (driven > 1e-9)
        assert driven <= PAPER.step_length + 1e-9
        assert turned == 0.0 or math.radians(15.0) - 1e-9 < turned <= math.pi + 1e-9


def test_counts_never_fall(played):
    for name in ("decisions", "path_length", "turned", "collisions", "landmarks"):
        assert (np.diff([getattr(row, name) for row in steps_of(played[0])]) >= 0).all(), name


def test_the_trial_ends_at_the_first_row_that_reaches_the_coverage(played):
    events, ending = played
    explored = [row.explored for row in steps_of(events)]
    assert ending.status is Status.EXPLORED
    assert ending.reason == ""
    assert explored[-1] >= 0.9
    assert max(explored[:-1]) < 0.9


def test_every_decision_has_a_straight_step(played):
    lengths = [0.0] + [rows[-1].path_length for _, rows in decisions_of(played[0])]
    assert np.all(np.diff(lengths) > 0.0)


def test_observations_and_rows_number_the_decisions(played):
    for number, (observation, rows) in enumerate(decisions_of(played[0])):
        assert observation.decision == number
        assert {row.decisions for row in rows} == {number + 1}
        assert rows[0].step == observation.step + 1


def test_observations_offer_candidates_with_paths_from_the_robot_s_cell(played):
    for observation, _ in decisions_of(played[0]):
        belief, n = observation.belief, PAPER.grid.columns
        count = len(observation.candidates)
        assert count >= 1
        assert observation.positions.shape == (count, 2)
        assert observation.path_lengths.shape == (count,)
        assert len(observation.paths) == count
        assert len(belief.poses) == observation.step + 1
        own = int(observation.pose[1] // 2) * n + int(observation.pose[0] // 2)
        for cell, position, path, length in zip(
            observation.candidates.tolist(),
            observation.positions,
            observation.paths,
            observation.path_lengths,
            strict=True,
        ):
            assert tuple(position) == centre_of(PAPER.grid, cell)
            assert path[-1] == cell
            assert path[0] == own or not (0 < observation.pose[0] < 20 and 0 < observation.pose[1] < 20)
            assert length == pytest.approx(np.hypot(*np.diff(np.divmod(path, n))).sum() * 2.0)
            assert belief.known.reshape(-1)[cell]
            assert belief.occupancy.reshape(-1)[cell] <= 0.5


def test_rows_agree_with_the_belief_and_the_true_map():
    """U, the known share, the pose's covariance and the wrongly labelled cells, computed once more."""
    world = draw_world(PAPER, TrialSpec("none", "none:none", PAPER, 5).generator("world"))
    events, ending = play(PAPER, nearest, 5)
    rows = {row.step: row for row in steps_of(events)}
    beliefs = [(observation.step, observation.belief) for observation, _ in decisions_of(events)]
    for step, belief in [*beliefs, (max(rows), ending.belief)]:
        row = rows[step]
        assert row.uncertainty == pytest.approx(belief.virtual_traces.sum())
        assert row.uncertainty == pytest.approx(belief.uncertainty)
        assert row.explored == pytest.approx(belief.known.mean())
        assert row.mislabelled == np.count_nonzero(belief.known & ((belief.occupancy > 0.5 + 1e-9) != world.obstacles))
        assert (row.x, row.y, row.heading) == belief.pose
        covariance = [row.cov_xx, row.cov_xy, row.cov_xh, row.cov_yy, row.cov_yh, row.cov_hh]
        assert covariance == pytest.approx(belief.pose_covariances[-1][np.triu_indices(3)])
        traces = np.trace(belief.pose_covariances, axis1=1, axis2=2)
        assert row.peak_trace == pytest.approx(traces.max())
        assert row.peak_position_trace == pytest.approx((traces - belief.pose_covariances[:, 2, 2]).max())
        assert row.landmarks == len(belief.landmarks)


# Decisions


def test_with_little_noise_decisions_end_at_the_target_or_at_a_blocked_path():
    scenario = PAPER.replace(odometry_sigma=1e-3, heading_sigma_deg=1e-3)
    events, _ = play(scenario, at_random(0), 1)
    choices = [event for event in events if not isinstance(event, Step)]
    arrived = 0
    for (observation, choice), (later, _) in pairwise(choices):
        if math.dist(later.pose[:2], observation.positions[choice]) <= scenario.arrival_radius:
            arrived += 1
            continue
        path = observation.paths[choice].tolist()
        needed = set(path)
        for cell, to in pairwise(path):
            needed |= {cell // 10 * 10 + to % 10, to // 10 * 10 + cell % 10}
        blocked = set(np.flatnonzero(later.belief.occupancy > 0.5 + 1e-9).tolist())
        blocked |= {int(y // 2) * 10 + int(x // 2) for x, y in later.belief.landmarks}
        assert needed & blocked
    assert arrived > len(choices) // 2


@pytest.mark.parametrize("trial", range(4))
def test_even_without_any_tolerance_a_decision_has_a_straight_step(trial):
    """The estimate leaves the path's segment at a sighting of a landmark, which may follow the first turn."""
    scenario = PAPER.replace(path_tolerance=1e-9, stuck_decisions=1000, steps_per_cell=1.0)
    events, _ = play(scenario, at_random(trial), trial)
    lengths = [0.0] + [rows[-1].path_length for _, rows in decisions_of(events)[:-1]]
    assert len(lengths) > 10
    assert np.all(np.diff(lengths) > 0.0)


@pytest.mark.parametrize(
    ("sensor_range", "steps"),
    [(2.7, 1), (2.05, 4)],  # sighted from x = 9.5, before the cell, or from x = 10.5, inside it
)
def test_a_landmark_sighted_in_the_target_s_cell_ends_the_decision_unless_the_robot_is_there(sensor_range, steps):
    """From (9, 9) towards the centre of cell 45, (11, 9), with a landmark in its far corner."""
    constants = {"landmark_count": 1, "obstacle_count": 0, "odometry_sigma": 1e-3, "heading_sigma_deg": 1e-3}
    scenario = Scenario(sensor_range=sensor_range, step_length=0.5, **constants)
    world = LandmarkWorld(scenario.grid, np.zeros((10, 10), dtype=bool), np.array([[11.95, 9.95]]), (9.0, 9.0, 0.0))
    events = begin(scenario, world=world)
    next(events)
    row = events.send(next(events).candidates.tolist().index(45))
    while isinstance(row, Step):
        last, row = row, next(events)
    assert last.step == steps
    assert last.landmarks == 1
    assert 45 not in row.candidates


@pytest.mark.parametrize("trial", range(4))
def test_a_frontier_at_which_a_decision_ended_is_not_offered_again_as_it_was(trial):
    """Not before the known cells around it change, unless all that is offered was reached before: no ping-pong.

    A sensor of 2.5 m does not see the corners of the cells around, so that frontiers stay what they are.
    """
    scenario = PAPER.replace(sensor_range=2.5)
    events, _ = play(scenario, nearest, trial)
    choices = [event for event in events if not isinstance(event, Step)]
    reached = {}
    for (before, choice), (observation, _) in pairwise(choices):
        if math.dist(observation.pose[:2], before.positions[choice]) <= scenario.arrival_radius:
            target = int(before.candidates[choice])
            reached[target] = known_around(observation, target)
        as_they_were = [
            reached.get(cell) == known_around(observation, cell) for cell in observation.candidates.tolist()
        ]
        assert not any(as_they_were) or all(as_they_were)
    assert len(reached) > 5


def test_an_arrival_radius_as_wide_as_a_cell_is_refused_or_leaves_a_straight_step_in_every_decision():
    """Within reach of the next cell's centre from the start, the driver alone would command nothing."""
    try:
        scenario = PAPER.replace(arrival_radius=2.5, sensor_range=2.5)
    except RequestError:
        return
    events, _ = play(scenario, nearest)
    lengths = [0.0] + [rows[-1].path_length if rows else 0.0 for _, rows in decisions_of(events)]
    assert np.all(np.diff(lengths) > 0.0)


@pytest.mark.parametrize("answer", [-1, 99, 10**30, 0.0, 1.5, True, np.True_, None, "0", [0], np.array(0), math.nan])
def test_an_answer_that_is_no_index_raises_and_names_the_value(answer):
    observation, _, events = first_observation(SMALL)
    assert len(observation.candidates) < 99
    with pytest.raises(ChoiceError) as error:
        events.send(answer)
    assert repr(answer) in str(error.value)
    assert f"0 to {len(observation.candidates) - 1}" in str(error.value)


def test_the_first_index_past_the_last_is_refused_and_the_last_is_not():
    observation, _, events = first_observation(SMALL)
    count = len(observation.candidates)
    with pytest.raises(ChoiceError, match=f"answer {count} "):
        events.send(count)
    _, _, events = first_observation(SMALL)
    assert events.send(count - 1).step == 1


@pytest.mark.parametrize("kind", [np.int64, np.int8, np.uint16])
def test_integers_of_numpy_are_indices(kind):
    _, _, events = first_observation(SMALL)
    assert events.send(kind(0)).step == 1


# Endings


def test_the_step_limit_ends_a_trial():
    scenario = SMALL.replace(steps_per_cell=0.2)
    events, ending = play(scenario, nearest)
    assert scenario.step_limit == 7
    assert ending.status is Status.STEP_LIMIT
    assert steps_of(events)[-1].step == 7


def test_coverage_is_looked_at_before_the_step_limit_and_at_once():
    """A map seen whole at the start asks for no decision."""
    tiny = Scenario(size=4.0, landmark_count=0, obstacle_count=0, steps_per_cell=0.01)
    events, ending = play(tiny, nearest)
    assert tiny.step_limit == 0
    assert ending.status is Status.EXPLORED
    assert len(events) == 1


def test_a_robot_walled_in_is_stuck_at_once():
    obstacles = np.zeros((10, 10), dtype=bool)
    obstacles[3:6, 3:6] = True
    obstacles[4, 4] = False
    scenario = Scenario(sensor_range=2.9, landmark_count=0, obstacle_count=8)
    world = LandmarkWorld(scenario.grid, obstacles, np.empty((0, 2)), (9.0, 9.0, 0.5))
    events, ending = play(scenario, nearest, world=world)
    assert ending.status is Status.STUCK
    assert ending.reason == "no frontier can be reached"
    assert len(events) == 1
    assert events[0].explored == 0.09


@pytest.mark.parametrize("limit", [1, 2])
def test_decisions_that_do_not_leave_a_cell_are_stuck(limit):
    """With no tolerance each decision ends after its first straight step of 1 cm."""
    scenario = SMALL.replace(path_tolerance=1e-9, step_length=0.01, stuck_decisions=limit)
    events, ending = play(scenario, nearest)
    assert ending.status is Status.STUCK
    assert f"{limit} decisions did not leave cell" in ending.reason
    assert len(decisions_of(events)) == limit


def test_decisions_in_new_cells_are_not_counted_as_stuck():
    """One decision a cell is allowed; the trial goes on for as long as every decision leaves its cell."""
    events, ending = play(PAPER.replace(stuck_decisions=1), nearest, 1)
    assert ending.status is Status.EXPLORED
    assert len(decisions_of(events)) > 5


# run_trial


@pytest.mark.parametrize("strategy", ["Nearest", "AnyOne"])
def test_a_trial_is_a_pure_function_of_its_spec(strategy):
    first, second = run_trial(spec_of(strategy, PAPER)), run_trial(spec_of(strategy, PAPER))
    assert first.status is Status.EXPLORED
    assert first.steps == second.steps
    assert first.snapshots == second.snapshots
    assert np.array_equal(first.final_poses, second.final_poses)
    assert np.array_equal(first.final_covariances, second.final_covariances)
    assert first.world.digest == second.world.digest


def test_another_trial_purpose_or_root_is_another_world_and_another_noise():
    base = run_trial(spec_of("Nearest"))
    for other in (spec_of("Nearest", trial=1), spec_of("Nearest", root=1), spec_of("Nearest", purpose="train")):
        result = run_trial(other)
        assert result.world.digest != base.world.digest
        assert result.steps != base.steps


def test_a_result_holds_what_the_rollout_gave():
    events, ending = play(SMALL, nearest)
    result = run_trial(spec_of("Nearest"))
    assert result.steps == steps_of(events)
    assert (result.status, result.reason, result.transient) == (Status.EXPLORED, "", False)
    assert np.array_equal(result.final_poses, ending.belief.poses)
    assert result.final_covariances == pytest.approx(ending.belief.pose_covariances[:, [0, 0, 1], [0, 1, 1]])
    made = {observation.step: observation for observation, _ in decisions_of(events)}
    assert sorted(result.snapshots) == [*made, result.steps[-1].step]
    for step, observation in made.items():
        assert result.snapshots[step].candidates == observation.candidates.tolist()
        assert result.snapshots[step].choice == nearest(observation)
    assert result.snapshots[result.steps[-1].step].choice is None
    assert len(result.decision_seconds) == len(made)
    assert 0.0 < sum(result.decision_seconds) < result.seconds


FAILURES = [
    ("RaisesInChoose", {}, "LookupError: no map in the glove box"),
    ("Exits", {}, "SystemExit: had enough"),
    ("Loops", {}, "longer than the 1.5 s allowed"),
    ("LoopsHoldingExceptions", {}, "longer than the 1.5 s allowed"),
    ("Answers", {"answer": 99}, "99 is not the index of a candidate"),
    ("Answers", {"answer": 2**40}, f"{2**40} is not the index of a candidate"),
    ("Answers", {"answer": -1}, "-1 is not the index of a candidate"),
    ("Answers", {"answer": 0.0}, "0.0 is of type float"),
    ("Answers", {"answer": True}, "True is of type bool"),
    ("Answers", {"answer": None}, "None is of type NoneType"),
    ("Answers", {"answer": np.zeros((3, 3))}, "is of type ndarray"),
]
NAMES = [f"{strategy}-{reason[:12]}" for strategy, _, reason in FAILURES]


@pytest.fixture(scope="module")
def honest():
    return run_trial(spec_of("Nearest", PAPER))


@pytest.fixture(scope="module", params=FAILURES, ids=NAMES)
def failed(request, honest):
    """Trials of strategies that fail at their fourth decision, and a part of the reason; `honest` compiles first."""
    strategy, parameters, reason = request.param
    timeout = 1.5 if "longer" in reason else None
    return run_trial(spec_of(strategy, PAPER, parameters=parameters), timeout=timeout), reason


def test_a_strategy_that_fails_makes_a_failed_trial_with_a_reason_in_one_line(failed):
    result, reason = failed
    assert result.status is Status.FAILED
    assert reason in result.reason
    assert "\n" not in result.reason
    assert result.transient == ("longer" in reason)


def test_a_failed_trial_keeps_its_rows_and_its_snapshots(failed, honest):
    """They are those of the same choices made by a strategy that does not fail."""
    result, _ = failed
    assert len(result.steps) == max(list(honest.snapshots)[:4]) + 1
    assert result.steps == honest.steps[: len(result.steps)]
    assert {step: result.snapshots[step] for step in list(honest.snapshots)[:3]} == dict(
        list(honest.snapshots.items())[:3]
    )
    assert result.final_poses.shape == (0, 3)


def test_a_snapshot_s_choice_is_always_one_of_its_candidates(failed):
    for snapshot in failed[0].snapshots.values():
        assert snapshot.choice is None or 0 <= snapshot.choice < len(snapshot.candidates)


def test_whatever_fails_at_a_decision_the_reason_counts_decisions_alike(failed):
    assert "(at decision 3)" in failed[0].reason


@pytest.mark.parametrize("strategy", ["RaisesInReset", "RaisesInInit", "NotThere"])
def test_a_strategy_that_cannot_begin_makes_a_failed_trial_without_rows(strategy):
    result = run_trial(spec_of(strategy))
    assert result.status is Status.FAILED
    assert ("glove box" in result.reason) or ("NotThere" in result.reason)
    assert result.steps == []
    assert result.world.grid == SMALL.grid


def test_what_a_strategy_prints_goes_to_stderr_and_changes_nothing(tmp_path, capsys, honest_small):
    head = "print('imported')"
    factory = write_plugin(tmp_path, "print('chosen')\nreturn int(observation.path_lengths.argmin())", head=head)
    result = run_trial(dataclasses.replace(spec_of("Nearest"), factory=factory))
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("imported\nchosen\n")
    assert result.steps == honest_small.steps


@pytest.fixture(scope="module")
def honest_small():
    return run_trial(spec_of("Nearest"))


@pytest.mark.parametrize("place", ["import", "init", "reset", "choose"])
def test_a_process_that_a_strategy_forks_off_ends_and_the_trial_goes_on(tmp_path, place, honest_small):
    """Each process that came out of the trial would leave a mark."""
    fork = {name: "fork()" if name == place else "None" for name in ("import", "init", "reset", "choose")}
    file, children = tmp_path / "forks.py", tmp_path / "children"
    file.write_text(
        f"import os\n"
        f"def fork():\n"
        f"    if pid := os.fork():\n"
        f"        with open({str(children)!r}, 'a') as file: print(pid, file=file)\n"
        f"{fork['import']}\n"
        f"class Forks:\n"
        f"    def __init__(self): {fork['init']}\n"
        f"    def reset(self, rng): {fork['reset']}\n"
        f"    def choose(self, observation):\n"
        f"        {fork['choose']}\n"
        f"        return int(observation.path_lengths.argmin())\n"
    )
    own = os.getpid()
    try:
        result = run_trial(dataclasses.replace(spec_of("Nearest"), factory=f"{file}:Forks"))
    finally:
        if os.getpid() != own:
            (tmp_path / f"{os.getpid()}").touch()
            os._exit(1)
    pids = [int(pid) for pid in children.read_text().split()]
    assert pids
    assert [os.waitpid(pid, 0)[1] for pid in pids] == [0] * len(pids), "they have ended by themselves"
    assert [path.name for path in tmp_path.iterdir() if path.name.isdigit()] == []
    assert result.steps == honest_small.steps


def test_a_strategy_that_is_broken_from_the_start_fails_with_its_reason():
    result = run_trial(dataclasses.replace(spec_of("Nearest"), broken="entry point 'a' cannot be used; mend it."))
    assert (result.status, result.transient, result.steps) == (Status.FAILED, True, [])
    assert result.reason == "entry point 'a' cannot be used; mend it. (before the first decision)"


def test_the_time_limit_leaves_no_alarm_behind():
    handler = signal.getsignal(signal.SIGALRM)
    run_trial(spec_of("Nearest"), timeout=30.0)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is handler


def test_a_reference_is_told_the_world_and_meets_the_same_noise():
    result = run_trial(spec_of("Informed", reference=True))
    assert result.steps == run_trial(spec_of("Nearest")).steps


# Fairness


def normals_of(rows, scenario, expected):
    """Noise of every step divided by its σ, from consecutive true poses and the command between them.

    Rows do not say to which side a turn was: the side is taken that comes nearer to what is expected.
    """
    found = []
    for (before, after), wanted in zip(pairwise(rows), expected, strict=True):
        forward, turned = after.path_length - before.path_length, after.turned - before.turned
        start, end = ((row.true_x, row.true_y, row.true_heading) for row in (before, after))
        straight = forward > 1e-9
        sigma = scenario.odometry_sigma if straight else scenario.turn_sigma
        errors = [between(compose(start, (forward, 0.0, sign * turned)), end) for sign in (1.0, -1.0)]
        normals = np.array(errors) / [sigma, sigma, math.radians(scenario.heading_sigma_deg)]
        found.append(min(normals, key=lambda own: np.abs(own - wanted).max()))
    return np.array(found)


def test_all_strategies_meet_the_same_world_start_and_first_scan():
    results = [run_trial(spec_of(name, PAPER, trial=3)) for name in ("Nearest", "Farthest", "AnyOne")]
    assert len({result.world.digest for result in results}) == 1
    assert len({result.steps[0] for result in results}) == 1


def test_all_strategies_meet_the_same_noise_of_motion_step_by_step():
    """Whatever they command, step k is disturbed by the k-th three normals of the trial's stream."""
    for name in ("Nearest", "Farthest", "AnyOne"):
        spec = spec_of(name, PAPER, trial=3)
        steps = run_trial(spec).steps
        expected = spec.generator("motion").standard_normal((len(steps) - 1, 3))
        found = normals_of(steps, PAPER, expected)
        assert found == pytest.approx(expected, abs=1e-6)


def test_rows_agree_until_the_first_choice_that_differs():
    first, _ = play(PAPER, nearest, 4)
    second, _ = play(PAPER, lambda observation: (nearest if observation.decision < 4 else farthest)(observation), 4)
    rows, others = steps_of(first), steps_of(second)
    last = decisions_of(first)[3][1][-1].step
    assert rows[: last + 1] == others[: last + 1]
    assert rows != others


# What a strategy can reach


def reachable_from(root, bases=True):
    """All objects that can be reached from one, without those of modules, classes and code."""
    seen, found, queue = {id(root)}, [root], [root]
    while queue:
        item = queue.pop()
        parts = gc.get_referents(item)
        if isinstance(item, np.ndarray) and bases:
            parts = [*parts, item.base]
        elif dataclasses.is_dataclass(item):
            parts = [*parts, *(getattr(item, field.name) for field in dataclasses.fields(item))]
        for part in parts:
            if id(part) in seen or isinstance(part, type | types.ModuleType | types.FunctionType | types.CodeType):
                continue
            seen.add(id(part))
            found.append(part)
            queue.append(part)
    return found


def arrays_in(root, bases=True):
    return [item for item in reachable_from(root, bases) if isinstance(item, np.ndarray)]


@pytest.fixture(scope="module")
def mid_trial():
    """Return an observation in the middle of a trial, the row before it, and the true world."""
    world = draw_world(PAPER, TrialSpec("none", "none:none", PAPER, 0).generator("world"))
    observation, row, events = first_observation(after=6)
    assert events.gi_frame is not None
    return observation, row, world


def test_the_walk_does_find_what_is_there(mid_trial):
    """A walk that saw nothing would prove nothing."""
    observation = mid_trial[0]
    belief = observation.belief
    found = {id(item) for item in reachable_from(observation)}
    graph = belief.graph
    parts = [belief, belief.poses, graph.linearization.odometry_to, graph.elimination.corner, belief.scenario]
    parts += [observation.roads, observation.roads.free]
    assert all(id(part) in found for part in [*parts, *observation.paths])
    hidden = types.SimpleNamespace(held=[{"deep": (mid_trial[2],)}])
    assert any(isinstance(item, LandmarkWorld) for item in reachable_from(hidden))


def test_no_object_of_the_simulator_can_be_reached(mid_trial):
    forbidden = (LandmarkWorld, LandmarkExplorer, Scan, Patch, Robot, Sensor, Smoother, Withheld, Step, np.random.Generator, types.GeneratorType)
    frames = (types.FrameType, types.MethodType)
    assert not [item for item in reachable_from(mid_trial[0]) if isinstance(item, forbidden + frames)]


def test_no_true_number_can_be_reached(mid_trial):
    """Neither the true pose (also within its cell, as a scan holds it), nor landmarks, nor the obstacles."""
    observation, row, world = mid_trial
    true = [row.true_x, row.true_y, row.true_heading, row.true_x % 2.0, row.true_y % 2.0, *world.landmarks.ravel()]
    for item in reachable_from(observation):
        if isinstance(item, float):
            assert item not in true
        elif isinstance(item, np.ndarray) and item.dtype.kind == "f":
            assert not np.isin(item, true).any()
        elif isinstance(item, np.ndarray) and item.dtype.kind in "bu" and item.size == world.obstacles.size:
            assert not np.array_equal(item.reshape(-1), world.obstacles.reshape(-1))


def test_all_arrays_of_an_observation_are_read_only(mid_trial):
    """The nested ones of the belief too."""
    arrays = arrays_in(mid_trial[0], bases=False)
    assert len(arrays) > 20
    assert not [array.shape for array in arrays if array.flags.writeable]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_no_array_of_an_observation_is_a_view_of_one_that_can_be_written(mid_trial):
    assert not [array.shape for array in arrays_in(mid_trial[0]) if array.flags.writeable]


def test_an_observation_and_its_belief_are_frozen(mid_trial):
    observation = mid_trial[0]
    for target, name in ((observation, "step"), (observation.belief, "poses"), (observation, "anything")):
        with pytest.raises((AttributeError, TypeError)):
            setattr(target, name, 0)


def numbers_of(part):
    """All numbers of a dataclass of arrays, nested ones too, as bytes."""
    if isinstance(part, np.ndarray):
        return part.tobytes()
    if isinstance(part, tuple):
        return [numbers_of(item) for item in part]
    if dataclasses.is_dataclass(part):
        return [numbers_of(getattr(part, field.name)) for field in dataclasses.fields(part)]
    return part


def test_observations_stay_as_they_were_while_the_trial_goes_on():
    kept = []

    def keep(observation):
        kept.append((observation, copy.deepcopy(numbers_of(observation))))
        return nearest(observation)

    play(PAPER, keep, 6)
    assert len(kept) > 5
    for observation, numbers in kept:
        assert numbers_of(observation) == numbers


def test_a_strategy_that_overwrites_its_observation_by_force_changes_nothing(honest):
    result = run_trial(spec_of("Forges", PAPER))
    assert result.reason == ""
    assert result.steps == honest.steps


# Given maps


ROOMS = Scenario(map=HALLS, occlusion=True)


@pytest.fixture(scope="module")
def mapped():
    return play(ROOMS, nearest)


def test_in_a_map_the_known_share_is_of_the_cells_that_count(mapped):
    events, ending = mapped
    world = draw_world(ROOMS, TrialSpec("none", "none:none", ROOMS, 0).generator("world"))
    rows = {row.step: row for row in steps_of(events)}
    beliefs = [(observation.step, observation.belief) for observation, _ in decisions_of(events)]
    for step, belief in [*beliefs, (max(rows), ending.belief)]:
        assert rows[step].explored == pytest.approx(belief.known[world.counted].mean())
        assert belief.explored == pytest.approx(belief.known.mean())
    assert ending.status is Status.EXPLORED
    assert rows[max(rows)].explored >= 0.9 > rows[max(rows) - 1].explored
    assert ending.belief.explored < rows[max(rows)].explored


def test_u_stays_a_sum_over_all_cells(mapped):
    events, ending = mapped
    last = steps_of(events)[-1]
    assert last.uncertainty == pytest.approx(ending.belief.virtual_traces.sum())
    assert ending.belief.virtual_traces.shape == (10, 10)
    assert last.uncertainty < ROOMS.prior_uncertainty == 200.0


def test_nothing_that_a_strategy_is_shown_holds_the_map(mapped):
    for observation, _ in decisions_of(mapped[0]):
        assert observation.scenario.map is None
        assert observation.scenario == ROOMS.blind
        parts = reachable_from(observation)
        assert any(part is observation.belief.known for part in parts)
        assert not [part for part in parts if isinstance(part, str) and part in ROOMS.map]
    assert mapped[1].belief.scenario.map is None


def test_a_world_of_a_map_may_have_fewer_landmarks_but_not_more():
    crowded = ROOMS.replace(landmark_count=60)
    events, ending = play(crowded, nearest)
    assert isinstance(events[0], Step)
    assert ending.status is Status.EXPLORED
    world = draw_world(crowded, TrialSpec("none", "none:none", crowded, 0).generator("world"))
    with pytest.raises(ValueError, match="make them agree"):
        play(crowded.replace(landmark_count=len(world.landmarks) - 1), nearest, world=world)


@pytest.mark.parametrize("name", ["cave", "corridor", "loop", "rooms"])
def test_every_map_of_the_gallery_is_explored_by_the_nearest_frontier(name):
    scenario = with_map(PAPER.replace(occlusion=True), name)
    result = run_trial(TrialSpec("nearest", f"{__name__}:Nearest", scenario, 0))
    assert result.status is Status.EXPLORED
    assert len(result.steps) < scenario.step_limit / 4


def test_the_reference_explores_a_map_whose_cells_do_not_all_count():
    spec = TrialSpec("clairvoyant", "baselines.clairvoyant:Clairvoyant", ROOMS, 0, reference=True)
    known, blind = run_trial(spec), run_trial(TrialSpec("nearest", f"{__name__}:Nearest", ROOMS, 0))
    assert known.status is blind.status is Status.EXPLORED
    assert len(known.steps) <= 1.2 * len(blind.steps)


def test_a_trial_in_a_map_is_the_same_every_time():
    first, second = (run_trial(TrialSpec("nearest", f"{__name__}:Nearest", ROOMS, 1)) for _ in range(2))
    assert first.steps == second.steps
    assert first.world.digest == second.world.digest
