"""Jacobian blocks against gtsam's own factors, numerical derivatives, and numbers worked by hand."""

import math

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from hypothesis import given, settings, strategies as st
from scipy.linalg import expm
from slam_reference import PINNED, diagonal, odometry_factor, sighting_factor

from explore_bench.robot.landmark.linearization import linearize_odometry, linearize_sightings
from explore_bench.world.scenario import Scenario

SCENARIO = Scenario(**PINNED)
ANGLES = st.floats(-3.1, 3.1)
METRES = st.floats(-8.0, 8.0)
OFFSETS = st.floats(-0.6, 0.6)
TWISTS = OFFSETS.filter(lambda w: abs(w) > 0.05)
"""Residual headings: nearer to zero gtsam's own derivative of the logarithm cancels (off by 0.5 at 1e-5 rad)."""


def odometry_blocks(poses, commands):
    count = len(commands)
    of_from, of_to = np.full((count, 3, 3), np.nan), np.full((count, 3, 3), np.nan)
    linearize_odometry(0, np.array(poses), *SCENARIO.noise.odometries(np.array(commands)), of_from, of_to)
    return of_from, of_to


def sighting_blocks(poses, landmarks, pairs):
    noise = SCENARIO.noise
    of_pose, of_landmark = np.full((len(pairs), 2, 3), np.nan), np.full((len(pairs), 2, 2), np.nan)
    seen_from, seen = (np.array(column, dtype=np.int64) for column in zip(*pairs, strict=True))
    linearize_sightings(
        0, np.array(poses), np.array(landmarks), seen_from, seen, noise.bearing, noise.range, of_pose, of_landmark
    )
    return of_pose, of_landmark


def numerical_jacobian(factor, values, key, size, sigmas, step=1e-5):
    """Central differences of a factor's whitened error over the perturbation δ of one variable."""
    columns = []
    for i in range(size):
        errors = []
        for sign in (1.0, -1.0):
            delta = gtsam.VectorValues()
            for other in values.keys():  # noqa: SIM118  (gtsam's Values is no mapping)
                length = 3 if gtsam.Symbol(other).chr() == ord("x") else 2
                delta.insert(other, np.zeros(length))
            bump = np.zeros(size)
            bump[i] = sign * step
            delta.update(_single(key, bump))
            errors.append(factor.unwhitenedError(values.retract(delta)) / sigmas)
        columns.append((errors[0] - errors[1]) / (2.0 * step))
    return np.array(columns).T


def _single(key, vector):
    values = gtsam.VectorValues()
    values.insert(key, vector)
    return values


def two_poses(pose, command, offset):
    """Values of a pose and of its successor, `offset` away from where the command says."""
    first = gtsam.Pose2(*pose)
    second = first.compose(gtsam.Pose2(command[1], 0.0, command[0])).compose(gtsam.Pose2(*offset))
    values = gtsam.Values()
    values.insert(X(0), first)
    values.insert(X(1), second)
    return values, [(p.x(), p.y(), p.theta()) for p in (first, second)]


COMMANDS = st.one_of(
    st.tuples(st.just(0.0), st.floats(0.05, 0.5)),
    st.tuples(st.floats(-3.0, 3.0).filter(bool), st.just(0.0)),
)


@settings(max_examples=60, deadline=None)
@given(pose=st.tuples(METRES, METRES, ANGLES), command=COMMANDS, offset=st.tuples(OFFSETS, OFFSETS, TWISTS))
def test_odometry_blocks_are_those_of_gtsam(pose, command, offset):
    """Residuals of tenths of a metre and radian: the derivative of the true logarithm counts."""
    values, poses = two_poses(pose, command, offset)
    of_from, of_to = odometry_blocks(poses, [command])
    jacobian, _ = odometry_factor(SCENARIO, 0, command).linearize(values).jacobian()
    scale = np.abs(jacobian).max()
    np.testing.assert_allclose(np.hstack((of_from[0], of_to[0])), jacobian, atol=1e-10 * scale, rtol=0)


@settings(max_examples=40, deadline=None)
@given(pose=st.tuples(METRES, METRES, ANGLES), command=COMMANDS, offset=st.tuples(OFFSETS, OFFSETS, TWISTS))
def test_odometry_blocks_are_the_derivative_of_gtsams_error(pose, command, offset):
    values, poses = two_poses(pose, command, offset)
    of_from, of_to = odometry_blocks(poses, [command])
    factor = odometry_factor(SCENARIO, 0, command)
    sigma = SCENARIO.odometry_sigma if command[1] else SCENARIO.turn_sigma
    sigmas = np.array([sigma, sigma, math.radians(SCENARIO.heading_sigma_deg)])
    for key, block in ((X(0), of_from[0]), (X(1), of_to[0])):
        expected = numerical_jacobian(factor, values, key, 3, sigmas)
        np.testing.assert_allclose(block, expected, atol=1e-7 * np.abs(expected).max(), rtol=0)


@settings(max_examples=60, deadline=None)
@given(
    pose=st.tuples(METRES, METRES, ANGLES),
    motion=st.tuples(OFFSETS, OFFSETS, st.floats(-2.0, 2.0)),
    sigmas=st.tuples(*[st.floats(0.01, 1.0)] * 3),
    offset=st.tuples(OFFSETS, OFFSETS, TWISTS),
)
def test_blocks_of_any_motion_with_any_noise_are_those_of_gtsam(pose, motion, sigmas, offset):
    """Forward, sideways and turning in one step, each entry with a σ of its own."""
    first, measured = gtsam.Pose2(*pose), gtsam.Pose2(*motion)
    second = first.compose(measured).compose(gtsam.Pose2(*offset))
    values = gtsam.Values()
    values.insert(X(0), first)
    values.insert(X(1), second)
    of_from, of_to = np.full((1, 3, 3), np.nan), np.full((1, 3, 3), np.nan)
    poses = np.array([(p.x(), p.y(), p.theta()) for p in (first, second)])
    linearize_odometry(0, poses, np.array([motion]), np.array([sigmas]), of_from, of_to)
    factor = gtsam.BetweenFactorPose2(X(0), X(1), measured, diagonal(*sigmas))
    jacobian, _ = factor.linearize(values).jacobian()
    scale = np.abs(jacobian).max()
    np.testing.assert_allclose(np.hstack((of_from[0], of_to[0])), jacobian, atol=1e-10 * scale, rtol=0)


def test_the_residual_matters():
    """Without the derivative of the logarithm the later block would be the bare weights."""
    _, poses = two_poses((0.0, 0.0, 0.0), (0.0, 0.5), (0.2, 0.1, 0.3))
    _, of_to = odometry_blocks(poses, [(0.0, 0.5)])
    weights = np.diag(1.0 / np.array([0.07, 0.07, math.radians(0.2)]))
    assert np.abs(of_to[0] - weights).max() > 0.5


def test_odometry_blocks_by_hand():
    """From (0, 0, 90°) half a metre ahead as commanded: turning the first pose swings the second sideways."""
    noise = SCENARIO.noise
    of_from, of_to = odometry_blocks([(0.0, 0.0, math.pi / 2), (0.0, 0.5, math.pi / 2)], [(0.0, 0.5)])
    weights = np.array([1 / 0.07, 1 / 0.07, 180 / (0.2 * math.pi)])
    np.testing.assert_allclose(of_to[0], np.diag(weights), atol=1e-12)
    by_hand = -np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(of_from[0], weights[:, None] * by_hand, atol=1e-12)
    assert (noise.straight, noise.heading) == (0.07, math.radians(0.2))


def test_a_quarter_turn_by_hand():
    """A turn in place has its own σ, and its first block turns the axes back by the angle."""
    of_from, of_to = odometry_blocks([(3.0, 4.0, 0.0), (3.0, 4.0, math.pi / 2)], [(math.pi / 2, 0.0)])
    weights = np.array([1 / 0.001, 1 / 0.001, 180 / (0.2 * math.pi)])
    np.testing.assert_allclose(of_to[0], np.diag(weights), atol=1e-9)
    by_hand = -np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(of_from[0], weights[:, None] * by_hand, atol=1e-9)


@pytest.mark.parametrize("w", [0.0, 1e-12, 1e-7, 9.99e-5, 1.001e-4, -1.001e-4, 1e-3, 0.3, -1.5, 3.0])
def test_derivative_of_the_logarithm_is_the_inverse_of_that_of_the_exponential(w):
    """With ξ = Log E the later block is (∫₀¹ exp(−s ad ξ) ds)⁻¹, whether w is tiny or large."""
    u, v = 0.3, -0.2
    ad = np.array([[0.0, -w, v], [w, 0.0, -u], [0.0, 0.0, 0.0]])
    block = np.zeros((6, 6))
    block[:3, :3], block[:3, 3:] = -ad, np.eye(3)
    of_exponential = expm(block)[:3, 3:]
    twist = np.array([[0.0, -w, u], [w, 0.0, v], [0.0, 0.0, 0.0]])
    error = expm(twist)  # z⁻¹ h; with z = (0.5, 0, 0) the second pose is z · E
    second = (0.5 + error[0, 2], error[1, 2], math.atan2(error[1, 0], error[0, 0]))
    _, of_to = odometry_blocks([(0.0, 0.0, 0.0), second], [(0.0, 0.5)])
    weights = 1.0 / np.array([0.07, 0.07, math.radians(0.2)])
    np.testing.assert_allclose(of_to[0] / weights[:, None], np.linalg.inv(of_exponential), atol=2e-12)


@settings(max_examples=60, deadline=None)
@given(
    pose=st.tuples(METRES, METRES, ANGLES),
    direction=ANGLES,
    distance=st.floats(0.1, 6.0),
    bearing_off=OFFSETS,
    range_off=OFFSETS,
)
def test_sighting_blocks_are_those_of_gtsam(pose, direction, distance, bearing_off, range_off):
    """Equal up to the sign of a row, which JᵀJ does not see."""
    x, y, heading = pose
    landmark = np.array([x + distance * math.cos(direction), y + distance * math.sin(direction)])
    of_pose, of_landmark = sighting_blocks([pose], [landmark], [(0, 0)])
    factor = sighting_factor(SCENARIO, 0, 0, direction - heading + bearing_off, max(distance + range_off, 0.1))
    values = gtsam.Values()
    values.insert(X(0), gtsam.Pose2(*pose))
    values.insert(L(0), landmark)
    jacobian, _ = factor.linearize(values).jacobian()
    found = np.hstack((of_pose[0], of_landmark[0]))
    for row, expected in zip(found, jacobian, strict=True):
        sign = math.copysign(1.0, row @ expected)
        np.testing.assert_allclose(row, sign * expected, atol=1e-9 * np.abs(expected).max(), rtol=0)
    sigmas = np.array([math.radians(0.5), 0.02])
    for key, block in ((X(0), of_pose[0]), (L(0), of_landmark[0])):
        numerical = numerical_jacobian(factor, values, key, block.shape[1], sigmas, step=1e-6)
        information = numerical.T @ numerical
        np.testing.assert_allclose(block.T @ block, information, atol=1e-6 * np.abs(information).max(), rtol=0)


def test_sighting_blocks_by_hand():
    """A landmark at (3, 4) seen from the origin, range 5: d bearing = (−4, 3)/25 dl − dθ, d range = (3, 4)/5 dl."""
    of_pose, of_landmark = sighting_blocks([(0.0, 0.0, 0.0)], [(3.0, 4.0)], [(0, 0)])
    weights = np.array([[180 / (0.5 * math.pi)], [50.0]])
    np.testing.assert_allclose(of_landmark[0], weights * [[-0.16, 0.12], [0.6, 0.8]], rtol=1e-12)
    np.testing.assert_allclose(of_pose[0], weights * [[0.16, -0.12, -1.0], [-0.6, -0.8, 0.0]], rtol=1e-12)


def test_a_whole_graph_has_gtsams_information_matrix():
    """Rows meet the right poses and landmarks: the assembled JᵀJ equals the Hessian of `graph.linearize`."""
    rng = np.random.default_rng(1)
    poses = rng.normal(0.0, 1.0, (4, 3))
    landmarks = rng.normal(5.0, 1.0, (2, 2))
    commands = [(0.0, 0.5), (1.2, 0.0), (0.0, 0.3)]
    pairs = [(0, 1), (2, 0), (2, 1), (3, 0)]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, command in enumerate(commands):
        graph.add(odometry_factor(SCENARIO, k, command))
    for p, m in pairs:
        graph.add(sighting_factor(SCENARIO, p, m, 0.3, 4.0))
    for k, pose in enumerate(poses):
        values.insert(X(k), gtsam.Pose2(*pose))
    for m, landmark in enumerate(landmarks):
        values.insert(L(m), landmark)
    ordering = gtsam.Ordering()
    for key in [X(k) for k in range(4)] + [L(0), L(1)]:
        ordering.push_back(key)
    expected, _ = graph.linearize(values).hessian(ordering)

    of_from, of_to = odometry_blocks(poses, commands)
    of_pose, of_landmark = sighting_blocks(poses, landmarks, pairs)
    rows = []
    for k in range(3):
        row = np.zeros((3, 16))
        row[:, 3 * k : 3 * k + 3], row[:, 3 * k + 3 : 3 * k + 6] = of_from[k], of_to[k]
        rows.append(row)
    for k, (p, m) in enumerate(pairs):
        row = np.zeros((2, 16))
        row[:, 3 * p : 3 * p + 3], row[:, 12 + 2 * m : 14 + 2 * m] = of_pose[k], of_landmark[k]
        rows.append(row)
    jacobian = np.vstack(rows)
    np.testing.assert_allclose(jacobian.T @ jacobian, expected, atol=1e-10 * np.abs(expected).max(), rtol=0)


def test_rows_before_the_first_are_left_alone():
    poses = np.array([(0.0, 0.0, 0.0), (0.5, 0.1, 0.1), (1.0, 0.0, 0.0)])
    commands = np.array([(0.0, 0.5), (0.0, 0.5)])
    of_from, of_to = np.full((2, 3, 3), 7.0), np.full((2, 3, 3), 7.0)
    linearize_odometry(1, poses, *SCENARIO.noise.odometries(commands), of_from, of_to)
    fresh_from, fresh_to = odometry_blocks(poses, commands)
    assert (of_from[0] == 7.0).all()
    assert (of_to[0] == 7.0).all()
    np.testing.assert_array_equal(of_from[1], fresh_from[1])
    np.testing.assert_array_equal(of_to[1], fresh_to[1])
