"""The pose graph: loops are pulled closed, wrong closures bend little, and covariances are in the frames they say."""

import math

import gtsam
import numpy as np
import pytest
from lidar_worlds import followed

from explore_bench.geometry import between, compose
from explore_bench.robot.lidar.filtering import turns_of
from explore_bench.robot.lidar.pose_graph import START_SIGMAS, Link, PoseGraph, selected_inverse

ODOMETRY = np.diag((0.02**2, 0.02**2, 0.01**2))
SURE = np.diag((0.01**2, 0.01**2, 0.002**2))
SQUARE = [(1.0, 0.0, math.pi / 2 if k % 4 == 3 else 0.0) for k in range(16)]
"""Sixteen motions around a square of 4 m."""


def graph_of(start, motions, covariance=ODOMETRY):
    """Graph of poses that these motions lead to."""
    graph, poses = PoseGraph(start), followed(start, motions)
    for number, motion in enumerate(motions):
        assert graph.add_pose(tuple(poses[number + 1])) == number + 1
        graph.add_link(Link(number, number + 1, motion, covariance))
    return graph, poses


def drifted(scale=1.03, turn=0.01):
    return [(scale * x, y, heading + turn) for x, y, heading in SQUARE]


def test_poses_that_fit_their_links_stay():
    graph, poses = graph_of((1.0, 2.0, 0.5), SQUARE)
    graph.add_link(Link(0, 16, (0.0, 0.0, 0.0), SURE))
    np.testing.assert_allclose(graph.optimize(), poses, atol=1e-6)


def test_a_closure_pulls_a_loop_closed():
    truth = followed((0.0, 0.0, 0.0), SQUARE)
    graph, poses = graph_of((0.0, 0.0, 0.0), drifted())
    assert np.hypot(*poses[16, :2]) > 0.3
    graph.add_link(Link(0, 16, (0.0, 0.0, 0.0), SURE, robust=False))
    closed = graph.optimize()
    assert np.hypot(*closed[16, :2]) < 0.02
    np.testing.assert_allclose(closed[0], 0.0, atol=1e-3)
    off, before = (np.hypot(*(found - truth)[:, :2].T).mean() for found in (closed, poses))
    assert off < 0.6 * before, "and those between move with it"


def test_a_robust_closure_that_is_right_pulls_as_well():
    graph, poses = graph_of((0.0, 0.0, 0.0), drifted(1.005, 0.002))
    graph.add_link(Link(0, 16, (0.0, 0.0, 0.0), SURE, robust=True))
    assert np.hypot(*graph.optimize()[16, :2]) < 0.3 * np.hypot(*poses[16, :2])


def test_a_robust_closure_that_is_wrong_bends_little():
    """It says that the opposite corner is the start."""
    moves = {}
    for robust in (True, False):
        graph, poses = graph_of((0.0, 0.0, 0.0), SQUARE)
        graph.add_link(Link(0, 8, (0.0, 0.0, 0.0), SURE, robust))
        moves[robust] = np.hypot(*(graph.optimize() - poses)[:, :2].T).max()
    assert moves[False] > 1.0
    assert moves[True] < 0.05


def test_the_first_pose_is_where_the_robot_was_put():
    start = (3.0, -2.0, 2.5)
    covariances, _ = PoseGraph(start).covariances()
    np.testing.assert_allclose(covariances, [np.diag(np.square(START_SIGMAS))], atol=1e-12)
    np.testing.assert_allclose(PoseGraph(start).optimize(), [start], atol=1e-12)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, 0.7])
def test_marginals_are_in_the_axes_of_the_world(heading):
    """A motion that is vague along itself, driven at some heading."""
    graph, _ = graph_of((1.0, 1.0, heading), [(1.0, 0.0, 0.0)], np.diag((0.3**2, 0.01**2, 0.001**2)))
    covariance = graph.covariances()[0][1, :2, :2]
    along, across = np.array([math.cos(heading), math.sin(heading)]), np.array([-math.sin(heading), math.cos(heading)])
    assert along @ covariance @ along == pytest.approx(0.3**2, rel=1e-3)
    assert across @ covariance @ across == pytest.approx(0.01**2, rel=0.02)
    assert along @ covariance @ across == pytest.approx(0.0, abs=1e-6)


def test_a_link_s_covariance_is_in_the_frame_of_the_later_pose():
    """After a turn by 90° what is vague along the new heading is vague across the old one."""
    graph, _ = graph_of((0.0, 0.0, 0.0), [(1.0, 0.0, math.pi / 2)], np.diag((0.3**2, 0.01**2, 0.001**2)))
    covariance = graph.covariances()[0][1]
    assert covariance[1, 1] == pytest.approx(0.3**2, rel=1e-3)
    assert covariance[0, 0] == pytest.approx(0.01**2, rel=0.02)


def test_marginals_are_those_of_sampled_drives():
    """Against 20 000 noisy drives of the same motions, at the end and in the middle."""
    rng = np.random.default_rng(0)
    motions = [(0.5, 0.0, 0.1)] * 10
    sigmas = np.array((0.02, 0.01, 0.005))
    graph, _ = graph_of((0.0, 0.0, 0.3), motions, np.diag(sigmas**2))
    covariances, _ = graph.covariances()
    poses = np.tile((0.0, 0.0, 0.3), (20_000, 1)) + rng.standard_normal((20_000, 3)) * START_SIGMAS
    for number, motion in enumerate(motions):
        x, y, turn = (np.array(motion)[:, None] + 0.0 * poses.T).tolist()
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        noise = rng.standard_normal((20_000, 3)) * sigmas  # in the frame after the motion
        cn, sn = np.cos(poses[:, 2] + motion[2]), np.sin(poses[:, 2] + motion[2])
        poses = np.column_stack(
            (
                poses[:, 0] + c * x - s * y + cn * noise[:, 0] - sn * noise[:, 1],
                poses[:, 1] + s * x + c * y + sn * noise[:, 0] + cn * noise[:, 1],
                poses[:, 2] + turn + noise[:, 2],
            )
        )
        if number in (4, 9):
            sampled = np.cov(poses.T)
            scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
            np.testing.assert_allclose(covariances[number + 1] / scale, sampled / scale, atol=0.05)


def test_the_joint_covariance_of_some_is_in_their_own_frames():
    graph, poses = graph_of((0.0, 0.0, 0.4), SQUARE[:6])
    marginals, joint = graph.covariances([2, 5])
    assert joint.shape == (6, 6)
    for place, number in enumerate((2, 5)):
        own = joint[3 * place : 3 * place + 3, 3 * place : 3 * place + 3]
        c, s = math.cos(poses[number, 2]), math.sin(poses[number, 2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        np.testing.assert_allclose(turn @ own @ turn.T, marginals[number], atol=1e-12)
    assert np.abs(joint[:3, 3:]).max() > 1e-6
    assert graph.covariances()[1].shape == (0, 0)


def tangled(seed, poses=60, links=40, robust=0.3):
    """Graph of a drive that turns where it likes, with links between any two of its poses, and errors."""
    rng = np.random.default_rng(seed)
    motions = [(0.5, 0.0, turn) for turn in rng.normal(0.0, 0.5, poses).tolist()]
    graph, places = graph_of((0.3, -0.2, 0.7), motions)
    for _ in range(links):
        earlier, later = sorted(rng.choice(poses + 1, 2, replace=False).tolist())
        seen = np.array(between(tuple(places[earlier]), tuple(places[later]))) + rng.normal(0.0, (0.02, 0.02, 0.005))
        root = rng.normal(0.0, (0.02, 0.02, 0.005), (3, 3))
        graph.add_link(Link(earlier, later, tuple(seen), root.T @ root + SURE, bool(rng.random() < robust)))
    return graph


@pytest.mark.parametrize(("robust", "near"), [(0.0, 1e-6), (0.3, 0.01)])
@pytest.mark.parametrize("seed", range(5))
def test_poses_and_covariances_are_those_that_gtsam_gives(seed, robust, near):
    graph = tangled(seed, robust=robust)
    sure = gtsam.LevenbergMarquardtParams()
    sure.setRelativeErrorTol(1e-14)
    sure.setMaxIterations(500)
    expected = gtsam.LevenbergMarquardtOptimizer(graph._graph, graph._values, sure).optimize()
    found = graph.optimize()
    np.testing.assert_allclose(found, gtsam.utilities.extractPose2(expected), atol=near)
    together = [0, 7, 31, 60]
    marginals = gtsam.Marginals(graph._graph, graph._values)
    own = np.array([marginals.marginalCovariance(number) for number in range(61)])
    turn = turns_of(found[:, 2])
    covariances, joint = graph.covariances(together)
    np.testing.assert_allclose(covariances, turn @ own @ turn.transpose(0, 2, 1), rtol=1e-7, atol=1e-12)
    expected_joint = marginals.jointMarginalCovariance(together).fullMatrix()
    np.testing.assert_allclose(joint, expected_joint, rtol=1e-7, atol=1e-12)


def test_covariances_of_poses_whose_axes_are_independent():
    """Along x nothing ties the three axes together, or the first of them to the others: L has no entries for that."""
    for motions in ([], [(0.5, 0.0, 0.0)] * 12):
        graph, poses = graph_of((0.0, 0.0, 0.0), motions)
        marginals = gtsam.Marginals(graph._graph, graph._values)
        own = np.array([marginals.marginalCovariance(number) for number in range(len(poses))])
        np.testing.assert_allclose(graph.covariances()[0], own, rtol=1e-9, atol=1e-15)


def test_an_inverse_that_the_pattern_does_not_tell_is_asked_for():
    """Of a matrix whose factor lacks what fills in, no entry is given that is wrong."""
    starts, rows = np.array([0, 3, 4, 5], dtype=np.int32), np.array([0, 1, 2, 1, 2], dtype=np.int32)
    lower = np.array([1.0, 0.5, 0.25, 1.0, 1.0])
    inverse = selected_inverse(starts, rows, lower, np.ones(3))
    full = np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.25, 0.0, 1.0]])
    expected = np.linalg.inv(full @ full.T)[rows, [0, 0, 0, 1, 2]]
    assert np.isnan(inverse).any()
    given = np.isfinite(inverse)
    np.testing.assert_allclose(inverse[given], expected[given])


def test_a_closure_makes_poses_surer():
    graph, poses = graph_of((0.0, 0.0, 0.0), SQUARE)
    before, _ = graph.covariances()
    graph.add_link(Link(0, 16, between(tuple(poses[0]), tuple(poses[16])), SURE, robust=True))
    after, _ = graph.covariances()
    trace_before, trace_after = np.trace(before, axis1=1, axis2=2), np.trace(after, axis1=1, axis2=2)
    assert (trace_after[1:] < trace_before[1:]).all()
    assert trace_after[16] < 0.1 * trace_before[16]
    assert compose(tuple(poses[0]), (0.0, 0.0, 0.0)) == pytest.approx(tuple(poses[0]))
