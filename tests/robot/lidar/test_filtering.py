"""The filter of the newest pose against gtsam's full marginals, and its two matrices against finite differences."""

import math

import numpy as np
import pytest

from explore_bench.geometry import between, compose
from explore_bench.robot.lidar.filtering import TailFilter, adjoint_of_inverse, rotated
from explore_bench.robot.lidar.odometry import OdometryModel
from explore_bench.robot.lidar.pose_graph import Link, PoseGraph
from explore_bench.world.lidar.constants import LidarScenario

SCENARIO = LidarScenario()


def random_covariance(rng, scales):
    spread = rng.standard_normal((3, 3)) * np.array(scales)[:, None]
    return spread @ spread.T + np.diag(np.square(scales))


def ties_of(newest):
    """Poses to which the next poses may be linked: every fifth of the last forty, and the newest."""
    return [number for number in range(max(newest - 40, 0), newest + 1) if number % 5 == 0 or number == newest]


@pytest.mark.parametrize("noisy", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_newest_covariance_is_that_of_full_marginals(seed, noisy):
    """Over 100 simulated poses, tied to some before them as SLAM ties them, none of them computed anew.

    Where odometry and matches disagree, gtsam's factors bend with what they are off by and the filter's do not: then
    variances stay within 0.5 %.
    """
    rng = np.random.default_rng(seed)
    pose = (1.0, 2.0, 0.5)
    graph = PoseGraph(pose)
    poses, off, off_variances = [pose], 0.0, 0.0
    tail = TailFilter([0], graph.covariances([0])[1])
    for newest in range(1, 101):
        motion = (0.5, 0.02 * rng.standard_normal(), 0.4 * rng.standard_normal())
        noise = OdometryModel.of(SCENARIO).covariance(motion, 0.5, abs(motion[2]))
        odometry = tuple(np.array(motion) + noisy * np.sqrt(np.diag(noise)) * rng.standard_normal(3))
        pose = compose(pose, motion)
        poses.append(pose)
        graph.add_pose(pose)
        graph.add_link(Link(newest - 1, newest, odometry, noise))
        tail.advance(between(poses[-2], pose), noise)
        if rng.random() < 0.8:  # some match nothing
            anchor = int(rng.choice(tail.numbers[:-1]))
            match = Link(anchor, newest, between(poses[anchor], pose), random_covariance(rng, (0.01, 0.03, 0.003)))
            graph.add_link(match)
            tail.measure(anchor, match.motion, match.covariance)
        tail.keep(ties_of(newest))
        assert tail.numbers == ties_of(newest)
        full = graph.covariances()[0][-1]
        scale = np.sqrt(np.outer(np.diag(full), np.diag(full)))
        difference = np.abs((tail.newest(pose[2]) - full) / scale)
        off, off_variances = max(off, difference.max()), max(off_variances, np.diag(difference).max())
    assert off < (0.02 if noisy else 1e-9)
    assert off_variances < 0.005


def test_a_filter_may_begin_anywhere():
    """From the joint covariance of the ties, as after a closure."""
    rng = np.random.default_rng(5)
    graph, poses = PoseGraph((0.0, 0.0, 0.0)), [(0.0, 0.0, 0.0)]
    noise = np.diag((0.03**2, 0.01**2, 0.01**2))

    def add():
        poses.append(compose(poses[-1], (0.5, 0.0, 0.2 * rng.standard_normal())))
        number = graph.add_pose(poses[-1])
        graph.add_link(Link(number - 1, number, between(poses[-2], poses[-1]), noise))

    for _ in range(40):
        add()
    tail = TailFilter([30, 40], graph.covariances([30, 40])[1])
    for _ in range(5):
        add()
        tail.advance(between(poses[-2], poses[-1]), noise)
        motion = between(poses[30], poses[-1])
        graph.add_link(Link(30, len(poses) - 1, motion, 0.1 * noise))
        tail.measure(30, motion, 0.1 * noise)
        np.testing.assert_allclose(tail.newest(poses[-1][2]), graph.covariances()[0][-1], rtol=1e-5, atol=1e-12)


def test_what_is_forgotten_leaves_the_rest_as_it_was():
    tail = TailFilter([3], np.diag((0.1, 0.2, 0.3)))
    for _ in range(4):
        tail.advance((0.5, 0.1, 0.3), np.diag((0.01, 0.01, 0.01)))
    assert tail.numbers == [3, 4, 5, 6, 7]
    before = tail.newest(0.0)
    tail.keep([4, 99])
    assert tail.numbers == [4, 7]
    np.testing.assert_array_equal(tail.newest(0.0), before)


def test_a_measurement_makes_the_newest_surer_and_none_of_no_worth_does():
    tail = TailFilter([0], np.zeros((3, 3)))
    tail.advance((1.0, 0.0, 0.0), np.diag((0.04, 0.04, 0.01)))
    tail.measure(0, (1.0, 0.0, 0.0), 1e9 * np.eye(3))
    np.testing.assert_allclose(tail.newest(0.0), np.diag((0.04, 0.04, 0.01)), rtol=1e-6)
    tail.measure(0, (1.0, 0.0, 0.0), np.diag((0.04, 0.01, 0.01)))
    np.testing.assert_allclose(tail.newest(0.0), np.diag((0.02, 0.008, 0.005)), rtol=1e-6)


@pytest.mark.parametrize("motion", [(0.7, -0.3, 0.9), (0.0, 0.0, 2.0), (-1.0, 2.0, -2.5), (1.0, 0.0, 0.0)])
def test_the_adjoint_carries_small_errors_through_a_motion(motion):
    """An error before the motion, in that frame, against the one after it in the frame there."""
    start, step = (0.4, -1.2, 0.8), 1e-6
    end = compose(start, motion)
    columns = []
    for axis in range(3):
        error = [0.0, 0.0, 0.0]
        error[axis] = step
        columns.append(np.array(between(end, compose(compose(start, tuple(error)), motion))) / step)
    np.testing.assert_allclose(adjoint_of_inverse(motion), np.column_stack(columns), atol=1e-5)


def test_a_rotated_covariance_is_that_of_rotated_errors():
    rng = np.random.default_rng(0)
    covariance = random_covariance(rng, (0.3, 0.1, 0.2))
    errors = rng.multivariate_normal(np.zeros(3), covariance, 200_000)
    c, s = math.cos(0.6), math.sin(0.6)
    turned = np.column_stack((c * errors[:, 0] - s * errors[:, 1], s * errors[:, 0] + c * errors[:, 1], errors[:, 2]))
    np.testing.assert_allclose(rotated(covariance, 0.6), np.cov(turned.T), atol=0.003)
    np.testing.assert_allclose(rotated(np.diag((4.0, 1.0, 9.0)), math.pi / 2), np.diag((1.0, 4.0, 9.0)), atol=1e-12)
    np.testing.assert_allclose(rotated(rotated(covariance, 0.6), -0.6), covariance, atol=1e-15)
