"""The driving rule: when to turn, how far to go, when a waypoint is reached."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from explore_bench.geometry import compose
from explore_bench.robot.landmark.driver import Driver, next_command
from explore_bench.world.scenario import Scenario

DRIVER = Driver(step_length=0.5, turn_threshold=math.radians(15.0), arrival_radius=0.25)
metres = st.floats(-10.0, 10.0)
drivers = st.builds(
    Driver,
    step_length=st.floats(0.05, 3.0),
    turn_threshold=st.floats(0.01, math.pi / 2),
    arrival_radius=st.floats(0.01, 2.0),
    open_loop=st.just(False),
)


def ahead(distance, degrees):
    """Waypoint at this distance and bearing from (3, 4) when the robot faces 0."""
    return 3.0 + distance * math.cos(math.radians(degrees)), 4.0 + distance * math.sin(math.radians(degrees))


def integrated(pose, commands):
    """Poses passed through, by arithmetic of this test's own."""
    x, y, heading = pose
    passed = [(x, y)]
    for turn, forward in commands:
        x, y, heading = x + forward * math.cos(heading), y + forward * math.sin(heading), heading + turn
        passed.append((x, y))
    return passed


def test_the_driver_of_a_scenario_has_its_constants():
    driver = Driver.of(Scenario(step_length=0.4, turn_threshold_deg=30.0, arrival_radius=0.1))
    assert driver == Driver(0.4, pytest.approx(math.pi / 6), 0.1)


@pytest.mark.parametrize("degrees", [15.1, -15.1, 90.0, -179.0, 179.0])
def test_a_bearing_off_by_more_than_the_threshold_asks_for_a_turn_by_just_that(degrees):
    assert DRIVER.command((3.0, 4.0, 0.0), ahead(3.0, degrees)) == pytest.approx((math.radians(degrees), 0.0))


@pytest.mark.parametrize("degrees", [0.0, 14.9, -14.9])
def test_a_bearing_within_the_threshold_asks_for_a_straight_step(degrees):
    assert DRIVER.command((3.0, 4.0, 0.0), ahead(3.0, degrees)) == (0.0, 0.5)


def test_the_turn_is_the_shorter_way_round():
    turn, _ = DRIVER.command((3.0, 4.0, math.radians(170.0)), ahead(3.0, -170.0))
    assert turn == pytest.approx(math.radians(20.0))


@pytest.mark.parametrize(("distance", "forward"), [(3.0, 0.5), (0.5, 0.5), (0.4, 0.4), (0.26, 0.26)])
def test_a_straight_step_goes_no_farther_than_the_waypoint(distance, forward):
    assert DRIVER.command((3.0, 4.0, 0.0), ahead(distance, 0.0)) == pytest.approx((0.0, forward))


@pytest.mark.parametrize("degrees", [0.0, 100.0, 180.0])
def test_a_waypoint_within_the_arrival_radius_is_reached_whatever_the_bearing(degrees):
    assert DRIVER.command((3.0, 4.0, 0.0), ahead(0.24, degrees)) is None


def test_the_arrival_radius_itself_is_reached():
    assert DRIVER.command((3.0, 4.0, 0.0), (3.25, 4.0)) is None


def test_following_worked_by_hand():
    """From (1, 1) facing 0 to (3, 1), then (3, 3): four steps end on the centre, a quarter turn, four more."""
    commands = DRIVER.follow((1.0, 1.0, 0.0), np.array([[3.0, 1.0], [3.0, 3.0]]))
    expected = [(0.0, 0.5)] * 4 + [(math.pi / 2, 0.0)] + [(0.0, 0.5)] * 4
    assert commands == pytest.approx(np.array(expected), abs=1e-9)


def test_following_nothing_takes_no_command():
    assert DRIVER.follow((1.0, 1.0, 0.0), np.empty((0, 2))).shape == (0, 2)


@given(drivers, metres, metres, st.floats(-4.0, 4.0), st.lists(st.tuples(metres, metres), min_size=1, max_size=6))
def test_following_passes_every_waypoint_in_order_and_ends_at_the_last(driver, x, y, heading, waypoints):
    """Within the arrival radius; every command is a turn or a straight step, none too long, none empty."""
    commands = driver.follow((x, y, heading), np.array(waypoints))
    passed = integrated((x, y, heading), commands.tolist())
    assert np.all((commands == 0.0).sum(axis=1) == 1)
    assert np.all((commands[:, 1] >= 0.0) & (commands[:, 1] <= driver.step_length))
    assert np.all((commands[:, 0] == 0.0) | (np.abs(commands[:, 0]) > driver.turn_threshold))
    k = 0
    for waypoint in waypoints:
        while math.dist(passed[k], waypoint) > driver.arrival_radius + 1e-9:
            k += 1
    assert math.dist(passed[-1], waypoints[-1]) <= driver.arrival_radius + 1e-9


@settings(max_examples=40)
@given(drivers, metres, metres, st.floats(-3.0, 3.0), metres, metres)
def test_following_is_one_command_after_the_other(driver, x, y, heading, to_x, to_y):
    pose, commands = (x, y, heading), []
    while (command := driver.command(pose, (to_x, to_y))) is not None:
        commands.append(command)
        pose = compose(pose, (command[1], 0.0, command[0]))
    assert driver.follow((x, y, heading), np.array([[to_x, to_y]])).tolist() == [list(c) for c in commands]


@given(
    st.builds(Driver, st.floats(0.05, 3.0), st.floats(0.01, 1.5), st.floats(0.01, 2.0), st.booleans()), metres, metres
)
def test_next_commands_are_those_that_follow_it(driver, to_x, to_y):
    pose, stage, commands = (0.0, 0.0, 0.5), 0, []
    while True:
        turn, forward, stage = next_command(driver, pose, (to_x, to_y), stage)
        if stage < 0:
            break
        commands.append([turn, forward])
        pose = compose(pose, (forward, 0.0, turn))
    assert driver.follow((0.0, 0.0, 0.5), np.array([[to_x, to_y]])).tolist() == commands


def test_where_the_robot_is_there_is_no_next_command():
    assert next_command(DRIVER, (3.0, 4.0, 0.5), (3.1, 4.1), 0) == (0.0, 0.0, -1)


# Open loop


STRAIGHT = DRIVER._replace(step_length=2.0, open_loop=True)


def test_an_open_loop_turns_once_and_goes_straight_on():
    """From (1, 1) facing 0 to (1, 6): a quarter turn, two full steps and the rest; whatever the arrival radius."""
    expected = [(math.pi / 2, 0.0), (0.0, 2.0), (0.0, 2.0), (0.0, 1.0)]
    assert STRAIGHT.follow((1.0, 1.0, 0.0), np.array([[1.0, 6.0]])) == pytest.approx(np.array(expected))
    near = STRAIGHT.follow((1.0, 1.0, 0.0), np.array([[1.1, 1.0]]))
    assert near == pytest.approx(np.array([(0.0, 0.0), (0.0, 0.1)]))


def test_an_open_loop_takes_a_step_for_a_turn_of_nothing():
    assert STRAIGHT.follow((1.0, 1.0, 0.0), np.array([[4.0, 1.0]])).tolist() == [[0.0, 0.0], [0.0, 2.0], [0.0, 1.0]]


@given(metres, metres, st.floats(-4.0, 4.0), st.lists(st.tuples(metres, metres), min_size=1, max_size=4))
def test_an_open_loop_ends_at_its_last_waypoint(x, y, heading, waypoints):
    commands = STRAIGHT.follow((x, y, heading), np.array(waypoints))
    assert integrated((x, y, heading), commands.tolist())[-1] == pytest.approx(waypoints[-1], abs=1e-6)
    assert np.all(commands[:, 1] <= 2.0)


@pytest.mark.parametrize(("planner", "open_loop"), [("grid", False), ("straight", True)])
def test_the_scenario_s_planner_says_which_loop(planner, open_loop):
    assert Driver.of(Scenario(planner=planner, obstacle_count=0)).open_loop is open_loop
