"""True motion: command ⊕ noise with the same normals for everyone, and the collisions counted."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from explore_bench.geometry import Grid, between, compose
from explore_bench.world.landmark.motion import Robot
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario
from explore_bench.world.signals import Odometry

COMMANDS = [(0.0, 0.5), (1.2, 0.0), (0.0, 0.1), (-3.0, 0.0), (0.0, 0.5)]
commands = st.one_of(
    st.tuples(st.just(0.0), st.floats(0.01, 2.0)), st.tuples(st.floats(-3.1, 3.1).filter(bool), st.just(0.0))
)


class Fixed:
    """A generator whose standard normals are given."""

    def __init__(self, *normals):
        self.normals = normals or (0.0, 0.0, 0.0)

    def standard_normal(self, count):
        assert count == 3
        return np.array(self.normals)


def world_with(obstacles=(), start=(1.0, 5.0, 0.0), edge=5):
    """Make an edge × edge world of 2 m cells, obstacles given by row and column."""
    blocked = np.zeros((edge, edge), dtype=bool)
    for row, column in obstacles:
        blocked[row, column] = True
    return LandmarkWorld(Grid(edge, edge, 2.0), blocked, np.empty((0, 2)), start)


def driven(robot, moves):
    for move in moves:
        robot.move(move)
    return robot


def angle_between(a, b):
    return math.remainder(a - b, math.tau)


def test_a_straight_step_worked_by_hand():
    """Facing +y: 0.5 m ahead, then 0.07 m more ahead and 0.14 m to the right, and 0.6° of twist."""
    world = world_with(start=(5.0, 5.0, math.pi / 2))
    robot = Robot(Scenario(odometry_sigma=0.07, heading_sigma_deg=0.2), world, Fixed(1.0, -2.0, 3.0))
    robot.move((0.0, 0.5))
    assert robot.pose == pytest.approx((5.14, 5.57, math.pi / 2 + math.radians(0.6)))


def test_a_turn_worked_by_hand():
    """A turn to +y has its own small noise of place, applied in the frame after the turn."""
    world = world_with(start=(5.0, 5.0, 0.0))
    robot = Robot(Scenario(turn_sigma=0.001, heading_sigma_deg=0.2), world, Fixed(1.0, -2.0, -3.0))
    robot.move((math.pi / 2, 0.0))
    assert robot.pose == pytest.approx((5.002, 5.001, math.pi / 2 - math.radians(0.6)))


def test_without_noise_truth_is_the_command():
    robot = driven(Robot(Scenario(), world_with(), Fixed()), [(0.0, 0.5), (math.pi / 2, 0.0), (0.0, 0.25)])
    assert robot.pose == pytest.approx((1.5, 5.25, math.pi / 2))


@given(st.integers(0, 2**32), commands)
def test_twice_the_sigma_is_twice_the_error_of_place(seed, command):
    """All noise levels meet the same normals: common random numbers."""
    world = world_with(start=(5.0, 5.0, 0.7))
    target = compose(world.start, (command[1], 0.0, command[0]))
    errors = []
    for scale in (1.0, 2.0):
        scenario = Scenario(odometry_sigma=0.05 * scale, turn_sigma=0.002 * scale)
        robot = driven(Robot(scenario, world, np.random.default_rng(seed)), [command])
        errors.append(between(target, robot.pose))
    assert np.array(errors[1][:2]) == pytest.approx(2.0 * np.array(errors[0][:2]), rel=1e-9, abs=1e-12)
    assert angle_between(errors[1][2], errors[0][2]) == pytest.approx(0.0, abs=1e-12)


@given(st.integers(0, 2**32))
def test_twice_the_sigma_of_the_heading_is_twice_its_error(seed):
    errors = []
    for sigma in (0.2, 0.4):
        robot = Robot(Scenario(heading_sigma_deg=sigma), world_with(), np.random.default_rng(seed))
        errors.append(driven(robot, [(0.0, 0.5)]).pose[2])
    assert errors[1] == pytest.approx(2.0 * errors[0], abs=1e-12)


def test_noise_is_three_normals_a_step_scaled_whatever_the_command():
    """Every step's error, divided by its σ, is the next three numbers of the stream."""
    scenario = Scenario()
    robot = Robot(scenario, world_with(), np.random.default_rng(5))
    expected = np.random.default_rng(5)
    for turn, forward in COMMANDS:
        target = compose(robot.pose, (forward, 0.0, turn))
        robot.move((turn, forward))
        place = scenario.odometry_sigma if forward else scenario.turn_sigma
        error = np.array(between(target, robot.pose))
        sigmas = [place, place, math.radians(scenario.heading_sigma_deg)]
        assert error / sigmas == pytest.approx(expected.standard_normal(3), abs=1e-9)


@given(commands, st.integers(0, 2**32))
def test_the_odometry_reads_the_command_whatever_the_noise(command, seed):
    """With the σ of the noise that the truth got."""
    scenario = Scenario()
    robot = Robot(scenario, world_with(), np.random.default_rng(seed))
    turn, forward = command
    place = scenario.odometry_sigma if forward else scenario.turn_sigma
    odometry = robot.move(command)
    assert odometry == Odometry((forward, 0.0, turn), (place, place, math.radians(scenario.heading_sigma_deg)))


def test_turns_draw_as_many_numbers_as_straight_steps():
    turning, driving = np.random.default_rng(3), np.random.default_rng(3)
    driven(Robot(Scenario(), world_with(), turning), [(0.3, 0.0)] * 7)
    driven(Robot(Scenario(), world_with(), driving), [(0.0, 0.1)] * 7)
    assert turning.random() == driving.random()


def test_the_noise_has_the_scenario_s_spread():
    scenario = Scenario(odometry_sigma=0.07, heading_sigma_deg=0.2)
    rng = np.random.default_rng(0)
    ends = np.array([driven(Robot(scenario, world_with(), rng), [(0.0, 0.5)]).pose for _ in range(4000)])
    assert ends.mean(axis=0) == pytest.approx([1.5, 5.0, 0.0], abs=4 * 0.07 / math.sqrt(4000))
    assert ends.std(axis=0) == pytest.approx([0.07, 0.07, math.radians(0.2)], rel=0.05)
    assert np.abs(np.corrcoef(ends.T) - np.eye(3)).max() < 0.07


# Collisions: a 5 × 5 world, the robot driving along the middle row from x = 1


def test_passing_through_an_obstacle_is_one_collision_and_alters_no_motion():
    robot = driven(Robot(Scenario(), world_with([(2, 2)]), Fixed()), [(0.0, 0.5)] * 14)
    assert robot.collisions == 1
    assert robot.pose == pytest.approx((8.0, 5.0, 0.0))


def test_an_obstacle_beside_the_way_is_no_collision():
    robot = driven(Robot(Scenario(), world_with([(1, 2), (3, 2)]), Fixed()), [(0.0, 0.5)] * 14)
    assert robot.collisions == 0


def test_steps_and_turns_inside_an_obstacle_are_no_further_collisions():
    robot = Robot(Scenario(), world_with([(2, 2)]), Fixed())
    driven(robot, [(0.0, 0.5)] * 7)
    assert robot.collisions == 1
    driven(robot, [(1.0, 0.0), (-1.0, 0.0), (0.0, 0.2), (0.0, 0.2)])
    assert robot.collisions == 1


def test_coming_back_into_an_obstacle_is_a_second_collision():
    robot = driven(Robot(Scenario(), world_with([(2, 2)]), Fixed()), [(0.0, 0.5)] * 11)
    assert robot.pose[0] == pytest.approx(6.5)
    driven(robot, [(math.pi, 0.0), (0.0, 0.5), (0.0, 0.5)])
    assert robot.collisions == 2


def test_leaving_the_map_is_one_collision_until_it_is_left_again():
    robot = driven(Robot(Scenario(), world_with(), Fixed()), [(math.pi, 0.0)] + [(0.0, 0.5)] * 6)
    assert robot.pose == pytest.approx((-2.0, 5.0, math.pi))
    assert robot.collisions == 1
    driven(robot, [(math.pi, 0.0)] + [(0.0, 0.5)] * 5)
    assert robot.collisions == 1
    driven(robot, [(math.pi, 0.0)] + [(0.0, 0.5)] * 3)
    assert robot.collisions == 2


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_the_map_may_be_left_at_each_side(heading):
    robot = driven(Robot(Scenario(), world_with(start=(5.0, 5.0, heading)), Fixed()), [(0.0, 0.5)] * 9)
    assert robot.collisions == 0
    assert driven(robot, [(0.0, 0.5)] * 2).collisions == 1


def test_cutting_an_obstacle_s_corner_within_one_step_is_a_collision():
    """From cell (2, 1) to cell (1, 2) across 0.28 m of the obstacle (1, 1)'s corner."""
    start = (3.55, 4.25, -math.pi / 4)
    robot = driven(Robot(Scenario(step_length=1.0), world_with([(1, 1)], start), Fixed()), [(0.0, 1.0)])
    assert robot.pose[0] > 4.0
    assert robot.pose[1] < 4.0
    assert robot.collisions == 1


def test_starting_inside_an_obstacle_is_no_collision():
    robot = driven(Robot(Scenario(), world_with([(2, 0)]), Fixed()), [(0.0, 0.5)] * 4)
    assert robot.collisions == 0


def test_a_step_through_two_obstacles_counts_both():
    robot = Robot(Scenario(step_length=8.0), world_with([(2, 1), (2, 3)]), Fixed())
    assert driven(robot, [(0.0, 8.0)]).collisions == 2
