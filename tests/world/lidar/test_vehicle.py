"""True motion on two wheels: arcs, accelerations, contacts, and an odometry that errs by a scale and by white noise."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from explore_bench.geometry import Grid, between, compose
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.motion import BLOCK, Vehicle
from explore_bench.world.lidar.world import LidarWorld

SCENARIO = LidarScenario()
EXACT = SCENARIO.replace(odometry_bias=0.0, heading_bias=0.0, odometry_noise=0.0, heading_noise=0.0)
AT_ONCE = EXACT.replace(acceleration=1e6, turn_acceleration=1e6)
GRID = Grid(200, 200, 0.05)
WALL = 8.0
LAND = LidarWorld(
    GRID, np.repeat(GRID.centres()[None, :200, 0] > WALL, 200, axis=0), np.ones(GRID.shape, dtype=bool), (5.0, 5.0, 0.0)
)
"""A square of 10 m, solid from x = WALL on."""

speeds = st.tuples(st.floats(0.01, 0.55), st.floats(-1.0, 1.0))


def vehicle(scenario=EXACT, start=None, seed=0):
    world = LAND if start is None else dataclasses.replace(LAND, start=start)
    return Vehicle(scenario, world, np.random.default_rng(seed))


def drive(robot, command, ticks):
    return [robot.move(command) for _ in range(ticks)]


@given(speeds, st.floats(-3.0, 3.0))
def test_steady_speeds_drive_the_arc_of_the_unicycle(command, heading):
    """Against the closed form on the circle around the instantaneous centre of rotation."""
    v, w = command
    robot = vehicle(AT_ONCE, (4.0, 5.0, heading))
    drive(robot, command, 20)
    if abs(w) > 1e-4:
        x = 4.0 + v / w * (math.sin(heading + 2.0 * w) - math.sin(heading))
        y = 5.0 - v / w * (math.cos(heading + 2.0 * w) - math.cos(heading))
    else:
        x, y = 4.0 + 2.0 * v * math.cos(heading), 5.0 + 2.0 * v * math.sin(heading)
    assert robot.pose[:2] == pytest.approx((x, y), abs=2e-4)
    assert math.remainder(robot.pose[2] - heading - 2.0 * w, math.tau) == pytest.approx(0.0, abs=1e-9)
    assert (robot.length, robot.turned) == pytest.approx((2.0 * v, 2.0 * abs(w)))


def test_speeds_follow_the_command_within_the_accelerations():
    robot = vehicle()
    reached = []
    for command in [(0.55, 1.0)] * 5 + [(0.0, -1.0)] * 7:
        robot.move(command)
        reached.append(robot.velocity)
    expected_v = [0.25, 0.5, 0.55, 0.55, 0.55, 0.3, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0]
    expected_w = [0.32, 0.64, 0.96, 1.0, 1.0, 0.68, 0.36, 0.04, -0.28, -0.6, -0.92, -1.0]
    assert np.array(reached) == pytest.approx(np.stack((expected_v, expected_w), axis=1))


def test_no_command_takes_the_robot_beyond_its_speeds():
    robot = vehicle()
    drive(robot, (9.0, -9.0), 20)
    assert robot.velocity == (SCENARIO.max_speed, -SCENARIO.max_turn_rate)


@pytest.mark.parametrize("heading", [0.0, 0.7, -1.2])
def test_an_obstacle_stops_the_robot_at_its_radius(heading):
    """Never nearer than its radius, no farther than a tick's drive, and its forward speed is gone."""
    robot = vehicle(start=(7.0, 5.0, heading))
    drive(robot, (0.55, 0.0), 100)
    assert SCENARIO.robot_radius <= WALL - robot.pose[0] <= SCENARIO.robot_radius + 0.055
    assert robot.contact
    assert robot.velocity == (0.0, 0.0)


def test_a_contact_counts_once_however_long_it_is_pushed_and_turned():
    robot = vehicle(start=(7.5, 5.0, 0.0))
    drive(robot, (0.5, 0.0), 30)
    assert (robot.collisions, robot.contact) == (1, True)
    place = robot.pose[:2]
    drive(robot, (0.0, 1.0), 12)
    drive(robot, (0.5, 0.0), 5)
    assert (robot.collisions, robot.contact) == (1, True)
    assert robot.pose[:2] == place
    assert robot.pose[2] > 1.0, "a turn in place stays possible"
    drive(robot, (0.0, 1.0), 30)
    drive(robot, (0.5, 0.0), 5)
    assert (robot.collisions, robot.contact) == (1, False)
    assert robot.pose[0] < place[0]
    while robot.pose[2] > 0.0 or robot.pose[2] < -0.2:
        robot.move((0.0, 1.0))
    drive(robot, (0.5, 0.0), 30)
    assert (robot.collisions, robot.contact) == (2, True)


def test_a_robot_that_stands_too_near_may_leave_but_not_come_nearer():
    robot = vehicle(start=(7.9, 5.0, math.pi))
    drive(robot, (0.3, 0.0), 10)
    assert robot.pose[0] == pytest.approx(7.9 - 0.1 * (0.25 + 9 * 0.3))
    assert robot.collisions == 0
    inwards = vehicle(start=(7.9, 5.0, 0.0))
    drive(inwards, (0.3, 0.0), 10)
    assert inwards.pose == (7.9, 5.0, 0.0)


def test_small_moves_along_a_wall_are_not_blocked():
    """A test of whole cells would stop the robot here: it is nearer than its radius plus a cell, and moves by a mm."""
    x = WALL - SCENARIO.robot_radius - 0.001
    robot = vehicle(start=(x, 5.0, math.pi / 2))
    drive(robot, (0.01, 0.0), 50)
    assert robot.collisions == 0
    assert robot.pose[1] == pytest.approx(5.05)


def test_the_edge_of_the_map_is_an_obstacle():
    robot = vehicle(start=(1.0, 5.0, math.pi))
    drive(robot, (0.55, 0.0), 100)
    assert SCENARIO.robot_radius <= robot.pose[0] < SCENARIO.robot_radius + 0.03
    assert robot.collisions == 1


def test_odometry_without_errors_is_the_motion_even_against_a_wall():
    """Wheels that are blocked do not slip."""
    robot = vehicle(start=(7.0, 5.0, 0.3))
    believed = robot.pose
    for k in range(80):
        before = robot.pose
        measured = robot.move((0.4, 0.3 * math.sin(0.2 * k)))
        assert measured == pytest.approx(between(before, robot.pose), abs=1e-12)
        believed = compose(believed, measured)
    assert robot.contact
    assert believed == pytest.approx(robot.pose, abs=1e-9)


def biases(count, scenario=SCENARIO):
    return np.array([vehicle(scenario, seed=seed).bias for seed in range(count)])


def test_the_bias_is_drawn_once_uniform_within_half_of_its_constant():
    drawn = biases(400) / (0.5 * np.array([SCENARIO.odometry_bias] * 2 + [SCENARIO.heading_bias]))
    assert np.abs(drawn).max(axis=0) == pytest.approx(1.0, abs=0.02)
    assert np.abs(drawn).max() <= 1.0
    assert drawn.mean(axis=0) == pytest.approx(0.0, abs=3.5 / math.sqrt(3 * 400))
    assert drawn.var(axis=0) == pytest.approx(1.0 / 3.0, abs=0.05)
    assert np.abs(np.corrcoef(drawn.T) - np.eye(3)).max() < 0.2


def test_odometry_scales_each_component_by_its_bias():
    scenario = SCENARIO.replace(odometry_noise=0.0, heading_noise=0.0)
    robot = vehicle(scenario, seed=4)
    for command in [(0.5, 0.3), (0.2, -1.0), (0.0, 0.7)] * 3:
        before = robot.pose
        measured = robot.move(command)
        motion = np.array(between(before, robot.pose))
        assert measured == pytest.approx(motion * (1.0 + np.array(robot.bias)), abs=1e-12)
    assert robot.bias == tuple(biases(5)[4]), "the same throughout"


@pytest.mark.parametrize(
    ("command", "length", "turn"), [((0.5, 0.0), 0.05, 0.0), ((0.0, 1.0), 0.0, 0.1), ((0.3, -0.8), 0.03, 0.08)]
)
def test_white_noise_has_the_variance_of_the_length_and_the_turn(command, length, turn):
    """4000 ticks: the sample variance is within 10 %, four of its standard errors; and neighbours are independent."""
    noisy = AT_ONCE.replace(odometry_noise=0.02, heading_noise=0.03)
    robot = vehicle(noisy)
    errors = np.empty((4000, 3))
    for row in errors:
        robot.pose = (5.0, 5.0, 0.0)
        measured = robot.move(command)
        row[:] = np.array(measured) - between((5.0, 5.0, 0.0), robot.pose)
    across = 0.02**2 * length
    assert errors.var(axis=0) == pytest.approx([across, across, 0.03**2 * (length + turn)], rel=0.1, abs=1e-15)
    heading = errors[:, 2]
    assert abs(np.corrcoef(heading[1:], heading[:-1])[0, 1]) < 0.06


def test_the_truth_has_no_noise():
    """Whatever the odometry's errors, and whoever draws them."""
    quiet, noisy = vehicle(EXACT, seed=1), vehicle(SCENARIO, seed=2)
    for command in [(0.5, 0.3), (0.2, -1.0)] * 10:
        quiet.move(command)
        noisy.move(command)
    assert quiet.pose == noisy.pose


def test_equal_seeds_give_equal_odometry_and_others_another():
    def run(seed):
        return drive(vehicle(SCENARIO, seed=seed), (0.3, 0.2), 20)

    assert run(7) == run(7)
    assert run(7) != run(8)


def test_the_normals_of_a_tick_do_not_depend_on_the_commands_before():
    """Pairing: after as many ticks, whatever they were, the next one errs alike. Across a block's end, too."""
    for ticks in (5, BLOCK + 3):
        histories = [(0.5, 0.0)], [(0.0, 1.0)], [(0.0, 0.0)], [(0.3, -0.4), (0.1, 1.0)]
        last = set()
        for history in histories:
            robot = vehicle(AT_ONCE.replace(odometry_noise=0.02, heading_noise=0.02), seed=11)
            for k in range(ticks):
                robot.pose = (5.0, 5.0, 0.0)
                robot.move(history[k % len(history)])
            robot.pose = (5.0, 5.0, 0.0)
            last.add(robot.move((0.4, 0.5)))
        assert len(last) == 1


def test_a_larger_noise_is_the_same_noise_scaled():
    """Common random numbers: levels of bias and noise meet the same draws."""
    errors = []
    for scale in (1.0, 2.0):
        robot = vehicle(AT_ONCE.replace(odometry_noise=0.01 * scale, heading_noise=0.02 * scale), seed=3)
        measured = np.array(drive(robot, (0.4, 0.3), 10))
        errors.append(measured - drive(vehicle(AT_ONCE), (0.4, 0.3), 10))
    assert errors[1] == pytest.approx(2.0 * errors[0], abs=1e-12)
    assert biases(3, SCENARIO.replace(odometry_bias=0.06, heading_bias=0.1)) == pytest.approx(2.0 * biases(3))
