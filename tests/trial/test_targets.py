"""Targets of a strategy's own: what is driven, what is kept of it, and what is refused with which sentence."""

import dataclasses
import math
import re

import numpy as np
import pytest
from handmade import TINY, write_plugin
from hypothesis import given, strategies as st

from explore_bench import Course, Target, check, run_trial
from explore_bench.records.store import Store
from explore_bench.report.moment import scene_of
from explore_bench.report.packing import unpack
from explore_bench.report.replays import pack_replay
from explore_bench.runs.suites import plan
from explore_bench.trial.explorer import ChoiceError, StandingError

TAKES = "from explore_bench import Target"


def played(folder, answer, name="plugin", **options):
    """Return the trial of a strategy that answers with these lines at every decision but the first."""
    factory = write_plugin(folder, answer, name, TAKES)
    return run_trial(plan("smoke", [factory], [TINY.size], 1, scenario=TINY.replace(**options)).specs[0])


def as_driven(result):
    """What a trial did: its rows without the number of decisions, which both count alike anyway."""
    return [dataclasses.astuple(step) for step in result.steps]


def test_a_target_at_a_candidate_s_centre_is_that_candidate(tmp_path):
    """The centre of a cell is where a chosen candidate is driven to, so that nothing tells the two apart."""
    nearest = "i = int(observation.path_lengths.argmin())\n"
    chosen = played(tmp_path, nearest + "return i")
    targeted = played(tmp_path, nearest + "return Target(tuple(observation.positions[i]))", "targeted")
    assert chosen.status == targeted.status
    assert as_driven(chosen) == as_driven(targeted)


def test_the_robot_drives_to_the_place_itself(tmp_path):
    """Which may lie anywhere in its cell; within a quarter of a metre it has arrived, by its own estimate."""
    result = played(
        tmp_path,
        """
        x, y = observation.positions[int(observation.path_lengths.argmin())]
        return Target((x + 0.6, y - 0.5))
        """,
    )
    assert result.status.value == "explored", result.reason
    made = sorted(step for step, snapshot in result.snapshots.items() if snapshot.target is not None)
    assert made
    for start, end in zip(made, [*made[1:], None], strict=True):
        x, y = result.snapshots[start].target
        if end is not None:  # the last decision ends where the map is explored
            assert math.hypot(result.steps[end].x - x, result.steps[end].y - y) < 1.0


def test_any_reachable_cell_can_be_a_target(tmp_path):
    result = played(
        tmp_path,
        """
        cells, lengths = observation.reachable
        self.number = getattr(self, "number", 0) + 1
        cell = int(cells[7 * self.number % len(cells)])
        assert len(observation.roads.path_to(cell)) > 1
        return Target(observation.scenario.grid.centre_of(cell))
        """,
        stuck_decisions=1000,
    )
    assert result.status.value in ("explored", "step_limit"), result.reason
    assert sum(snapshot.target is not None for snapshot in result.snapshots.values()) > 2


REFUSED = {
    "Target((-1.0, 3.0))": r"the target \(-1, 3\) lies outside the map of 12 × 12 m; choose one of",
    "Target((3.0, 1e300))": r"lies outside the map",
    "Target((float('nan'), 3.0))": r"the target \(nan, 3.0\) is not finite; give its x and y in metres",
    "Target((float('inf'), 3.0))": r"is not finite",
    "Target('ab')": r"the target 'ab' is no place; give its x and y in metres",
    "Target((1.0, 2.0, 3.0))": r"is no place",
    "Target(None)": r"the target None is no place",
    "Target(('x\\ny', 1.0))": r"is no place",
    "Target(observation.scenario.grid.centre_of(int((~observation.belief.known).argmax())))": (
        r"lies in cell \d+, which is blocked or not known to be free; choose one of observation.reachable"
    ),
}


@pytest.mark.parametrize("answer", REFUSED)
def test_a_target_that_cannot_be_driven_to_fails_the_trial_with_a_sentence(tmp_path, answer):
    result = played(tmp_path, f"return {answer}")
    assert result.status.value == "failed"
    assert not result.transient
    assert "\n" not in result.reason
    assert re.search(REFUSED[answer], result.reason), result.reason
    assert result.reason.endswith("(at decision 1)")
    assert len(result.steps) > 1, "the rows up to there are kept"


STANDING = {
    "Target(observation.pose[:2])": (
        r"lies in the robot's own cell \d+, so that it would never move; choose another one of observation.reachable"
    ),
}


@pytest.mark.parametrize("answer", STANDING)
def test_a_strategy_that_never_moves_is_stuck_with_a_sentence(tmp_path, answer):
    result = played(tmp_path, f"return {answer}")
    assert result.status.value == "stuck"
    assert re.search(STANDING[answer], result.reason), result.reason
    assert result.reason.endswith("(at decision 1)")
    assert len(result.steps) == len(result.final_poses) > 1, "what was driven up to there is measured"
    assert len(result.decision_seconds) == 2


def test_a_target_over_the_edge_of_a_cell_where_the_robot_already_is_leads_nowhere_either():
    """Within the arrival radius, in the next cell: one robot is sent to an edge until another cell is that near."""
    process = Course(TINY, "calibrate", 0).begin(0)
    for _ in range(50):
        observation = process.observation
        assert observation is not None, "the trial ended before"
        x, y = observation.pose[:2]
        reachable = observation.reachable.cells
        for place in ((x + step, y) for step in (-0.2, -0.1, 0.1, 0.2)):
            if TINY.grid.holds(*place) and TINY.grid.cell_of(*place) in reachable:
                with pytest.raises(StandingError, match="lies where the robot is, so that it would never move"):
                    process.decide(Target(place))
                return
        cell = int(reachable[observation.reachable.lengths.argmin()])
        process.decide(Target(tuple(TINY.grid.centre_of(cell) + np.array((0.99, 0.0)))))
    pytest.fail("no robot came that near to an edge")


def test_a_target_in_an_obstacle_or_behind_one_is_refused():
    """In the blocked cells themselves, and in a free cell to which no way leads."""
    process = Course(TINY, "calibrate", 0).begin(0)
    roads, grid = process.observation.roads, TINY.grid
    free = roads.free.reshape(-1)
    reachable = set(process.observation.reachable.cells.tolist())
    refused = 0
    for cell in sorted(set(range(grid.cells)) - reachable - {roads.start}):
        with pytest.raises(ChoiceError, match="which is blocked" if not free[cell] else "to which no way leads"):
            Course(TINY, "calibrate", 0).begin(0).decide(Target(grid.centre_of(cell)))
        refused += 1
    assert refused > 10


def test_a_forged_way_leads_nowhere():
    """The cells that a strategy may drive through are the benchmark's own, whatever it does to what it was given."""
    process = Course(TINY, "calibrate", 0).begin(0)
    roads = process.observation.roads
    unknown = int((~process.observation.belief.known).argmax())
    with pytest.raises(ValueError, match="read-only"):
        roads.free[:] = True
    object.__setattr__(roads, "free", np.ones_like(roads.free))
    with pytest.raises(ChoiceError, match=f"lies in cell {unknown}, to which no way leads"):
        process.decide(Target(TINY.grid.centre_of(unknown)))


@given(x=st.floats(-2.0, 14.0), y=st.floats(-2.0, 14.0))
def test_what_is_reachable_is_driven_to_and_nothing_else(x, y):
    process = Course(TINY, "calibrate", 0).begin(1)
    inside = 0.0 <= x <= 12.0 and 0.0 <= y <= 12.0
    if inside and TINY.grid.cell_of(x, y) in process.observation.reachable.cells:
        rows = len(process.rows)
        process.decide(Target((x, y)))
        assert len(process.rows) > rows
    else:
        with pytest.raises(ChoiceError, match="the target"):
            process.decide(Target((x, y)))


def test_every_candidate_is_reachable_by_a_drive_of_its_length():
    process = Course(TINY, "calibrate", 0).begin(2)
    while (observation := process.observation) is not None:
        cells, lengths = observation.reachable
        place = np.searchsorted(cells, observation.candidates)
        np.testing.assert_array_equal(cells[place], observation.candidates)
        np.testing.assert_allclose(lengths[place], observation.path_lengths, rtol=1e-12)
        process.decide(int(observation.path_lengths.argmax()))


# What is kept and shown of it


@pytest.fixture
def kept(tmp_path):
    """Return the store and the record of a trial whose later answers are targets."""
    answer = "return Target(tuple(observation.positions[int(observation.path_lengths.argmin())] + 0.25))"
    result = played(tmp_path, answer)
    store = Store(tmp_path / "results")
    store.open(0, "evaluate", TINY)
    store.write(result)
    return store, store.find(result.spec), result


def test_a_replay_keeps_the_target_and_no_index(kept):
    store, record, result = kept
    replay = store.replay(record.spec)
    made = [result.snapshots[step] for step in sorted(result.snapshots)]
    assert replay.choices == [snapshot.choice for snapshot in made]
    assert replay.targets == [snapshot.target and tuple(snapshot.target) for snapshot in made]
    assert replay.choices[0] is not None
    assert replay.targets[0] is None
    assert replay.choices[1] is None
    assert replay.targets[1] is not None
    assert replay.targets[-1] is None
    assert scene_of(record, replay, 1).snapshot.target == list(replay.targets[1])


def test_the_page_s_player_is_told_where_it_lies(kept):
    store, record, _ = kept
    replay = store.replay(record.spec)
    page = unpack(pack_replay(record, replay))
    for k, target in enumerate(replay.targets):
        if target is None:
            assert page["target_x"][k] == page["target_y"][k] == -1.0
        else:
            assert (page["target_x"][k], page["target_y"][k]) == pytest.approx(target, abs=0.006)
            assert page["choice"][k] == -1


# The conformance kit


def found_of(factory):
    """Return the findings of a strategy, and the rules that it breaks."""
    findings = {finding.rule: finding for finding in check(factory)}
    return findings, [rule for rule, finding in findings.items() if not finding.ok]


def test_a_strategy_of_targets_keeps_the_contract(tmp_path):
    """A candidate's own place need not be one to drive to: by lidar it is the edge of what is known."""
    answer = (
        "return Target(tuple(observation.roads.grid.centres(observation.reachable.cells)["
        "observation.reachable.lengths.argmax()] + 0.02))"
    )
    assert found_of(write_plugin(tmp_path, answer, head=TAKES))[1] == []


def test_a_strategy_whose_targets_cannot_be_reached_breaks_the_rule_of_the_range(tmp_path):
    findings, broken = found_of(write_plugin(tmp_path, "return Target((-5.0, 1.0))", head=TAKES))
    assert broken == ["in-range"]
    assert "lies outside the map" in findings["in-range"].detail
