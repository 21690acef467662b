"""Crossings and round trips of small trials made by hand, for which the right count is known."""

import math

import numpy as np
import pytest
from handmade import record
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from explore_bench.analysis.going_back import going_back
from explore_bench.analysis.metrics import FAR, THROUGH, crossings, round_trips
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.scenario import Scenario

OPEN = Scenario(size=40.0, sensor_range=5.0)
"""Cells of 2 m: near is 2 m, away 10 m of way, through 6 m."""


def decided(*decisions, status="explored", scenario=OPEN):
    """Return a record of decisions (to the nearest, to the chosen, driven [m], waits), each driven in steps of 1 m."""
    rows = [(0, 0.0, 0.0, 0, 0.0)]
    for number, (nearest, chosen, driven, waits) in enumerate(decisions, start=1):
        begin = rows[-1][-1]
        ways = [*np.arange(1.0, driven), driven] if driven else []
        # until the last step of a drive the near one always waits: what counts is the drive's end
        rows += [(number, nearest, chosen, int(waits or way < driven), begin + way) for way in ways]
    columns = zip(*rows, strict=True)
    names = ("decisions", "nearest_drive", "chosen_drive", "nearest_waits", "path_length")
    return record(status, scenario, **dict(zip(names, columns, strict=True)))


def driven(*places, step=0.5, scenario=OPEN, status="explored", **columns):
    """Return a record of a drive along straight lines through places [m]."""
    corners = np.array(places, dtype=float)
    along = np.concatenate(([0.0], np.hypot(*np.diff(corners, axis=0).T).cumsum()))
    way = np.arange(0.0, along[-1] + 1e-9, step)
    x, y = (np.interp(way, along, corners[:, axis]) for axis in (0, 1))
    return record(status, scenario, path_length=way, **({"true_x": x, "true_y": y} | columns))


# Crossings


@pytest.mark.parametrize(
    ("decision", "count"),
    [
        ((4.0, 4.0, 4.0, False), 0),  # takes the nearest
        ((4.0, 8.0, 8.0, True), 1),  # twice as far, and the near one is left behind
        ((4.0, 7.9, 7.9, True), 0),  # not quite twice as far
        ((4.0, 20.0, 20.0, False), 0),  # the near one was seen in passing
        ((4.0, 20.0, 20.0, True), 1),
        ((0.0, 0.0, 1.0, True), 0),  # looks at the nearest from where it is
        ((0.0, 3.0, 3.0, True), 1),
    ],
)
def test_a_decision_crosses_where_it_goes_far_and_leaves_a_near_frontier_behind(decision, count):
    assert FAR == 2.0
    assert crossings(decided(decision)) == count


def test_crossings_are_counted_once_a_decision_whatever_many_steps_it_takes_and_candidates_it_leaves():
    near_first = (3.0, 3.0, 3.0, False)
    across = (2.0, 12.0, 12.0, True)
    assert crossings(decided(near_first, across, near_first, across, across)) == 3


def test_a_drive_cut_short_before_the_robot_could_have_been_at_the_near_one_is_no_crossing():
    """A blocked path ends the first two drives; the far one is taken with the third."""
    assert crossings(decided((4.0, 20.0, 1.0, True), (4.0, 20.0, 3.9, True), (4.0, 20.0, 4.0, True))) == 1


def test_a_decision_that_took_no_step_is_passed_over():
    assert crossings(decided((4.0, 20.0, 0.0, True), (4.0, 8.0, 8.0, True))) == 1


def test_a_trial_without_a_decision_crosses_nothing():
    assert crossings(decided()) == 0


# Round trips


def test_a_way_that_goes_on_is_no_round_trip():
    assert round_trips(driven((1, 1), (39, 1), (39, 39))) == 0


def test_there_and_back_is_one_and_there_again_another():
    """Out 20 m and back: from 5 m before the turning point on, the robot is where it was 10 m of way ago."""
    assert round_trips(driven((1, 1), (21, 1), (1, 1))) == 1
    assert round_trips(driven((1, 1), (21, 1), (1, 1), (21, 1))) == 2


@pytest.mark.parametrize(("out", "count"), [(5.0, 0), (11.5, 0), (12.5, 1)])
def test_a_look_around_the_corner_is_none(out, count):
    """At d from the turning point the robot was within 2 m 2 d − 2 of way ago: 10 m at d = 6; 6 m through makes 12."""
    assert round_trips(driven((1, 1), (1 + out, 1), (1, 1))) == count


def test_to_cross_an_old_track_is_none_and_to_drive_along_beside_it_is_one():
    loop = ((1, 10), (30, 10), (30, 20), (15, 20))
    assert round_trips(driven(*loop, (15, 1))) == 0, "at a right angle"
    assert round_trips(driven(*loop, (15, 11.5), (25, 11.5))) == 1, "1.5 m beside it"
    assert round_trips(driven(*loop, (15, 12.5), (25, 12.5))) == 0, "2.5 m beside it"


def test_a_step_aside_does_not_end_a_round_trip():
    """A look into a room beside the way back leads 2.2 m away from it."""
    aside = ((20, 1), (19, 3.2), (18, 1))
    assert round_trips(driven((1, 1), (36, 1), *aside, (1, 1))) == 1


def test_two_ways_back_with_new_land_between_them_are_two():
    assert round_trips(driven((1, 1), (36, 1), (22, 1), (22, 15), (10, 15), (10, 1), (1, 1))) == 2


def test_the_sensor_s_range_says_what_is_away_and_the_true_way_counts():
    there_and_back = ((1, 1), (16, 1), (1, 1))
    assert round_trips(driven(*there_and_back)) == 1
    assert round_trips(driven(*there_and_back, scenario=OPEN.replace(sensor_range=15.0))) == 0
    lost = np.linspace(0.0, 500.0, 61)
    assert round_trips(driven(*there_and_back, x=lost, y=lost)) == 1


def test_they_are_counted_in_lidar_worlds_by_the_same_rule():
    scenario = LidarScenario(size=40.0)
    assert scenario.sensor_range == 10.0
    assert round_trips(driven((1, 1), (30, 1), (1, 1), scenario=scenario)) == 1
    assert round_trips(driven((1, 1), (12, 1), (1, 1), scenario=scenario)) == 0
    assert crossings(decided((4.0, 20.0, 20.0, True), scenario=scenario)) == 1


def test_turning_in_place_for_long_is_none():
    still = np.zeros(200)
    assert round_trips(record("explored", OPEN, true_x=still, true_y=still, path_length=still)) == 0


@given(arrays(float, st.tuples(st.integers(0, 40), st.just(2)), elements=st.integers(-4, 4)), st.floats(0.5, 4.0))
def test_a_pose_goes_back_where_it_was_before_it_was_off(places, near):
    """As the definition says it, pose by pose."""
    way = np.concatenate([np.zeros(min(len(places), 1)), np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    expected = []
    for now in range(len(places)):
        beside = ((places[:now] - places[now]) ** 2).sum(axis=1) <= near**2
        off = np.flatnonzero(~beside)
        before = np.flatnonzero(beside[: off[-1]]) if len(off) else []
        expected.append(len(before) > 0 and way[now] - way[before[-1]] >= 2.0 * near)
    assert going_back(places, way, near, 2.0 * near).tolist() == expected


# Endings


@pytest.mark.parametrize(
    ("status", "said"), [("failed", False), ("broken", False), ("stuck", False)] + [("step_limit", True)]
)
def test_a_trial_that_broke_off_has_neither_and_one_at_the_limit_has_both(status, said):
    across = decided((4.0, 8.0, 8.0, True), status=status)
    back = driven((1, 1), (21, 1), (1, 1), status=status)
    assert [math.isnan(value) for value in (crossings(across), round_trips(back))] == [not said] * 2
    if said:
        assert (crossings(across), round_trips(back)) == (1, 1)


def test_constants_are_those_that_the_pages_say():
    assert (FAR, THROUGH) == (2.0, 3.0)
