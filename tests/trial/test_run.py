"""run_trial: a pure function of its specification, failures with a reason, and the same worlds and noise for all."""

import contextlib
import dataclasses
import math
import sys
import time
from itertools import pairwise

import numpy as np
import pytest
from handmade import HALLS, write_plugin
from playing import (
    PAPER,
    SMALL,
    Nearest,
    arrays_in,
    decisions_of,
    nearest,
    play,
    steps_of,
)

from explore_bench.geometry import between, compose
from explore_bench.trial.run import Status, run_trial
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.maps import with_map
from explore_bench.world.scenario import Scenario

# Strategies, named in specs by "test_run:Name"; Nearest is that of playing.py


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


def test_a_strategy_that_is_broken_from_the_start_fails_with_its_reason():
    result = run_trial(dataclasses.replace(spec_of("Nearest"), broken="entry point 'a' cannot be used; mend it."))
    assert (result.status, result.transient, result.steps) == (Status.FAILED, True, [])
    assert result.reason == "entry point 'a' cannot be used; mend it. (before the first decision)"


def test_a_reference_is_told_the_world_and_meets_the_same_noise():
    result = run_trial(spec_of("Informed", reference=True))
    assert result.steps == run_trial(spec_of("Nearest")).steps


@pytest.fixture(scope="module")
def honest_small():
    return run_trial(spec_of("Nearest"))


def test_a_strategy_that_overwrites_its_observation_by_force_changes_nothing(honest):
    result = run_trial(spec_of("Forges", PAPER))
    assert result.reason == ""
    assert result.steps == honest.steps


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


# Given maps


ROOMS = Scenario(map=HALLS, occlusion=True)


@pytest.mark.parametrize("name", ["cave", "corridor", "loop", "rooms"])
def test_every_map_of_the_gallery_is_explored_by_the_nearest_frontier(name):
    scenario = with_map(PAPER.replace(occlusion=True), name)
    result = run_trial(TrialSpec("nearest", f"{__name__}:Nearest", scenario, 0))
    assert result.status is Status.EXPLORED
    assert len(result.steps) < scenario.step_limit / 4


def test_the_reference_explores_a_map_whose_cells_do_not_all_count():
    spec = TrialSpec("clairvoyant", "baselines.reference.clairvoyant:Clairvoyant", ROOMS, 0, reference=True)
    known, blind = run_trial(spec), run_trial(TrialSpec("nearest", f"{__name__}:Nearest", ROOMS, 0))
    assert known.status is blind.status is Status.EXPLORED
    assert len(known.steps) <= 1.2 * len(blind.steps)


def test_a_trial_in_a_map_is_the_same_every_time():
    first, second = (run_trial(TrialSpec("nearest", f"{__name__}:Nearest", ROOMS, 1)) for _ in range(2))
    assert first.steps == second.steps
    assert first.world.digest == second.world.digest
