"""The pose graph: loops are pulled closed, wrong closures bend little, and covariances are in the frames they say."""

import math

import numpy as np
import pytest
from lidar_worlds import followed

from explore_bench.geometry import between, compose
from explore_bench.robot.lidar.pose_graph import START_SIGMAS, Link, PoseGraph

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


def test_a_closure_makes_poses_surer():
    graph, poses = graph_of((0.0, 0.0, 0.0), SQUARE)
    before, _ = graph.covariances()
    graph.add_link(Link(0, 16, between(tuple(poses[0]), tuple(poses[16])), SURE, robust=True))
    after, _ = graph.covariances()
    trace_before, trace_after = np.trace(before, axis1=1, axis2=2), np.trace(after, axis1=1, axis2=2)
    assert (trace_after[1:] < trace_before[1:]).all()
    assert trace_after[16] < 0.1 * trace_before[16]
    assert compose(tuple(poses[0]), (0.0, 0.0, 0.0)) == pytest.approx(tuple(poses[0]))
