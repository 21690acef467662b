"""Marginals and the block-arrow elimination against gtsam's batch marginals and dense linear algebra."""

import math

import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from hypothesis import given, settings, strategies as st
from slam_reference import (
    EMPTY,
    batch_graph,
    batch_marginals,
    moved,
    perturbations,
    random_commands,
    random_graph,
    values_of,
    worst_difference,
)

from explore_bench.robot.landmark.block_arrow import CHECKPOINT, invert_corner, recover, to_world
from explore_bench.robot.landmark.growing import Rows
from explore_bench.robot.landmark.marginals import Marginals
from explore_bench.world.scenario import Scenario

GRAPHS = st.builds(
    random_graph,
    seed=st.integers(0, 2**32 - 1),
    poses=st.integers(2, 60),
    landmarks=st.integers(0, 6),
    turn_share=st.sampled_from([0.0, 0.3, 1.0]),
    sight_share=st.sampled_from([0.02, 0.2, 1.0]),
    spread=st.one_of(st.just(0.0), st.floats(0.05, 0.3)),
)
SMALL_GRAPHS = st.builds(
    random_graph,
    seed=st.integers(0, 2**32 - 1),
    poses=st.integers(2, 15),
    landmarks=st.integers(0, 4),
    sight_share=st.sampled_from([0.1, 0.5]),
)


def odometry_before(random, k):
    """Odometry of the step that led to pose k, None at the start."""
    return None if k == 0 else random.scenario.noise.odometry(random.commands[k - 1])


def marginals_of(random, *, solved=True):
    """Marginals fed with the steps of a random graph."""
    marginals = Marginals(random.scenario)
    for k, seen in enumerate(random.seen):
        marginals.add(odometry_before(random, k), seen)
    if solved:
        marginals.solve(random.poses, random.landmarks)
    return marginals


def dense_information(random, marginals):
    """JᵀJ assembled from the Jacobian blocks: poses in order, then landmarks."""
    blocks = marginals.linearization()
    poses, landmarks = len(random.poses), len(random.landmarks)
    size, first = 3 * poses + 2 * landmarks, 3 * poses
    rows = [np.hstack((blocks.prior, np.zeros((3, size - 3))))]
    for k in range(poses - 1):
        row = np.zeros((3, size))
        row[:, 3 * k : 3 * k + 3], row[:, 3 * k + 3 : 3 * k + 6] = blocks.odometry_from[k], blocks.odometry_to[k]
        rows.append(row)
    for k, (p, m) in enumerate(zip(blocks.sighting_poses, blocks.sighting_landmarks, strict=True)):
        row = np.zeros((2, size))
        row[:, 3 * p : 3 * p + 3] = blocks.bearing_range_pose[k]
        row[:, first + 2 * m : first + 2 * m + 2] = blocks.bearing_range_landmark[k]
        rows.append(row)
    jacobian = np.vstack(rows)
    return jacobian.T @ jacobian


def with_further_steps(random, count, seed, *, spread=0.1):
    """Commands and estimates of a random graph, continued by steps without a sighting."""
    rng = np.random.default_rng(seed)
    commands = random_commands(rng, count, 0.3)
    poses, pose = [], tuple(random.poses[-1])
    for command in commands:
        pose = moved(pose, command)
        poses.append(pose)
    further = np.array(poses).reshape(-1, 3) + perturbations(rng, count + 1, spread)[1:]
    return commands, np.vstack((random.poses, further))


@settings(max_examples=60, deadline=None)
@given(random=GRAPHS)
def test_all_covariances_are_gtsams(random):
    """Random graphs at estimates that need not fit the measurements: every pose and every landmark."""
    marginals = marginals_of(random)
    of_poses, of_landmarks = random.marginals()
    assert worst_difference(marginals.pose_covariances, of_poses) < 1e-8
    assert worst_difference(marginals.landmark_covariances, of_landmarks) < 1e-8


@settings(max_examples=30, deadline=None)
@given(random=SMALL_GRAPHS)
def test_all_covariances_are_those_of_the_dense_inverse(random):
    marginals = marginals_of(random)
    dense = np.linalg.inv(dense_information(random, marginals))
    poses = len(random.poses)
    own = np.array([dense[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] for k in range(poses)])
    for k, (_, _, heading) in enumerate(random.poses):
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]]
        own[k] = turn @ own[k] @ turn.T
    assert worst_difference(marginals.pose_covariances, own) < 1e-8
    of_landmarks = dense[3 * poses :, 3 * poses :]
    expected = np.array([of_landmarks[i : i + 2, i : i + 2] for i in range(0, len(of_landmarks), 2)])
    assert worst_difference(marginals.landmark_covariances, expected.reshape(-1, 2, 2)) < 1e-8


@settings(max_examples=30, deadline=None)
@given(random=SMALL_GRAPHS)
def test_elimination_holds_the_conditionals_of_the_dense_information(random):
    """Pose by pose: P = Λ₀₀⁻¹, G = P Λ₀₁, K = P Λ₀ₗ, then the Schur complement; what is left is the corner."""
    marginals = marginals_of(random)
    information, done = dense_information(random, marginals), marginals.elimination()
    border = 2 * len(random.landmarks)
    for k in range(len(random.poses) - 1):
        pivot = np.linalg.inv(information[:3, :3])
        coupling = information[:3, 3:]
        scale = np.abs(pivot).max()
        np.testing.assert_allclose(done.pivots[k], pivot, atol=1e-8 * scale, rtol=0)
        np.testing.assert_allclose(done.gains[k], pivot @ coupling[:, :3], atol=1e-8, rtol=1e-8)
        width = done.widths[k]
        edge = pivot @ information[:3, len(information) - border :]
        np.testing.assert_allclose(done.borders[k, :, :width], edge[:, :width], atol=1e-8, rtol=1e-8)
        assert not edge[:, width:].any()
        information = information[3:, 3:] - coupling.T @ pivot @ coupling
    np.testing.assert_allclose(done.corner, information, atol=1e-8 * np.abs(information).max(), rtol=0)
    np.testing.assert_allclose(done.corner, done.corner.T, atol=1e-12 * np.abs(information).max(), rtol=0)
    size = 3 + border
    np.testing.assert_allclose(done.corner_covariance @ done.corner, np.eye(size), atol=1e-6)


@settings(max_examples=40, deadline=None)
@given(random=SMALL_GRAPHS, count=st.integers(1, 8), seed=st.integers(0, 2**32 - 1))
def test_extend_after_solve_equals_a_fresh_solve(random, count, seed):
    extended = marginals_of(random)
    commands, poses = with_further_steps(random, count, seed)
    for k, command in enumerate(commands, start=len(random.poses) + 1):
        extended.add(random.scenario.noise.odometry(command), [])
        extended.extend(np.ascontiguousarray(poses[:k]))
    fresh = marginals_of(random, solved=False)
    for command in commands:
        fresh.add(random.scenario.noise.odometry(command), [])
    fresh.solve(poses, random.landmarks)
    assert worst_difference(extended.pose_covariances, fresh.pose_covariances) < 1e-9
    assert worst_difference(extended.landmark_covariances, fresh.landmark_covariances) < 1e-9
    one, other = extended.elimination(), fresh.elimination()
    for name in ("pivots", "gains", "corner", "corner_covariance"):
        found, expected = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max(), rtol=0, err_msg=name)
    np.testing.assert_array_equal(one.widths, other.widths)
    for name in ("odometry_from", "odometry_to", "sighting_poses", "bearing_range_pose", "bearing_range_landmark"):
        np.testing.assert_array_equal(getattr(extended.linearization(), name), getattr(fresh.linearization(), name))


def test_extend_leaves_all_earlier_covariances_untouched():
    random = random_graph(5, 20, 3)
    marginals = marginals_of(random)
    before, of_landmarks = marginals.pose_covariances.copy(), marginals.landmark_covariances
    commands, poses = with_further_steps(random, 1, 6)
    marginals.add(random.scenario.noise.odometry(commands[0]), [])
    marginals.extend(poses)
    np.testing.assert_array_equal(marginals.pose_covariances[:-1], before)
    np.testing.assert_array_equal(marginals.landmark_covariances, of_landmarks)
    assert np.trace(marginals.pose_covariances[-1]) > np.trace(before[-1])


@pytest.mark.parametrize("seed", range(5))
def test_solving_again_after_extending_is_gtsams_too(seed):
    """Solve, extend, then solve at other estimates, as an online run does: nothing stale is left."""
    random = random_graph(seed, 30, 4, spread=0.2)
    marginals = Marginals(random.scenario)
    estimates = random.poses + 0.3 * np.sin(np.arange(90)).reshape(30, 3)
    for k, seen in enumerate(random.seen):
        marginals.add(odometry_before(random, k), seen)
        known = max((m for earlier in random.seen[: k + 1] for m in earlier), default=-1) + 1
        if seen or k == 0:
            marginals.solve(np.ascontiguousarray(estimates[: k + 1]), random.landmarks[:known] + 0.1)
        else:
            marginals.extend(np.ascontiguousarray(estimates[: k + 1]))
    marginals.solve(random.poses, random.landmarks)
    of_poses, of_landmarks = random.marginals()
    assert worst_difference(marginals.pose_covariances, of_poses) < 1e-8
    assert worst_difference(marginals.landmark_covariances, of_landmarks) < 1e-8


@pytest.mark.parametrize("moved_since", [0, 20, 70, 139])
def test_solving_what_moved_equals_solving_all_to_the_last_bit(moved_since):
    """The slow way: a fresh solve at the same estimates, step after step; across several checkpoints."""
    rng = np.random.default_rng(moved_since)
    random = random_graph(7, 140, 5, sight_share=0.05)
    marginals, fresh = Marginals(random.scenario), None
    estimates, points = random.poses.copy(), random.landmarks.copy()
    known = 0
    for k, seen in enumerate(random.seen):
        marginals.add(odometry_before(random, k), seen)
        known = max([known, *(m + 1 for m in seen)])
        if not seen and k > 0 and k % 5:
            marginals.extend(estimates[: k + 1].copy())
            continue
        some = rng.uniform(size=len(estimates)) < 0.3
        some[:moved_since] = False
        estimates[some] += rng.normal(0.0, 0.02, (some.sum(), 3))
        if moved_since == 0:
            points += rng.normal(0.0, 0.02, points.shape) * (rng.uniform(size=(len(points), 1)) < 0.5)
        marginals.solve(estimates[: k + 1].copy(), points[:known].copy())
        if k < 100 and k % 7:
            continue
        fresh = Marginals(random.scenario)
        for j, earlier in enumerate(random.seen[: k + 1]):
            fresh.add(odometry_before(random, j), earlier)
        fresh.solve(estimates[: k + 1].copy(), points[:known].copy())
        np.testing.assert_array_equal(marginals.pose_covariances, fresh.pose_covariances)
        np.testing.assert_array_equal(marginals.landmark_covariances, fresh.landmark_covariances)
        one, other = marginals.elimination(), fresh.elimination()
        for name in ("pivots", "gains", "widths", "corner", "corner_covariance"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert fresh is not None
    assert known == 5


def test_an_elimination_sets_in_after_all_that_stayed_where_it_was():
    """Of 140 poses the last ten move: what belongs to poses before the checkpoint ahead of them is not touched."""
    random = random_graph(3, 140, 5, sight_share=0.05)
    marginals = marginals_of(random)
    estimates = random.poses.copy()
    estimates[130:] += 0.1
    marginals._pivots.view[:] = 0.0
    marginals.solve(estimates, random.landmarks)
    untouched = (marginals._pivots.view == 0.0).all(axis=(1, 2))
    assert untouched[: 4 * CHECKPOINT].all()
    assert not untouched[4 * CHECKPOINT :].any()


def long_chain(poses):
    """A square of 10 m driven again and again, with four landmarks that are seen near its corners."""
    rng = np.random.default_rng(poses)
    landmarks = np.array([[4.0, 4.0], [16.0, 4.0], [16.0, 16.0], [4.0, 16.0]])
    commands, trajectory = [], [(5.0, 5.0, 0.0)]
    while len(trajectory) < poses:
        command = (math.pi / 2, 0.0) if len(commands) % 21 == 20 else (0.0, 0.5)
        commands.append(command)
        trajectory.append(moved(trajectory[-1], command))
    estimates = np.array(trajectory) + perturbations(rng, poses, 0.05)
    sightings = []
    for k in range(0, poses, 2):
        for m, (x, y) in enumerate(landmarks):
            dx, dy = x - estimates[k, 0], y - estimates[k, 1]
            if math.hypot(dx, dy) < 2.0:
                sightings.append((k, m, math.atan2(dy, dx) - estimates[k, 2], math.hypot(dx, dy)))
    return commands, estimates, landmarks, sightings


def solved_chain(poses):
    scenario = Scenario(landmark_count=4)
    commands, estimates, landmarks, sightings = long_chain(poses)
    marginals = Marginals(scenario)
    for k in range(poses):
        odometry = scenario.noise.odometry(commands[k - 1]) if k else None
        marginals.add(odometry, [m for p, m, _, _ in sightings if p == k])
    marginals.solve(estimates, landmarks)
    return marginals


def test_a_thousand_poses_with_loop_closures_are_gtsams():
    commands, estimates, landmarks, sightings = long_chain(1000)
    assert len({k // 84 for k, *_ in sightings}) > 10  # rounds that closed a loop
    graph = batch_graph(Scenario(), estimates[0], commands, sightings)
    of_poses, of_landmarks = batch_marginals(graph, estimates, landmarks)
    marginals = solved_chain(1000)
    assert worst_difference(marginals.pose_covariances, of_poses) < 1e-8
    assert worst_difference(marginals.landmark_covariances, of_landmarks) < 1e-8


def kept_bytes(marginals):
    """Bytes of all arrays that an object keeps."""
    total = 0
    for part in vars(marginals).values():
        if isinstance(part, Rows):
            part = vars(part)["_array"]
        if isinstance(part, np.ndarray):
            total += part.nbytes
    return total


def test_memory_is_linear_in_the_poses():
    small, large = solved_chain(400), solved_chain(800)
    assert 100_000 < kept_bytes(small) < 2_000_000
    assert kept_bytes(large) / kept_bytes(small) < 2.2


def test_the_first_pose_has_the_prior_in_the_world_frame():
    """σ = (0.05 m, 0.05 m, 0.01°), and no landmark."""
    marginals = Marginals(Scenario())
    marginals.add(None, [])
    marginals.solve(np.array([[3.0, 4.0, 1.0]]), EMPTY)
    expected = np.diag([0.0025, 0.0025, math.radians(0.01) ** 2])
    np.testing.assert_allclose(marginals.pose_covariances, expected[None], rtol=1e-12, atol=1e-18)
    assert marginals.landmark_covariances.shape == (0, 2, 2)


def test_one_straight_step_by_hand():
    """North by 0.5 m: across grows by the lever of the heading, (0.5 σ_θ)², and odometry adds its own."""
    scenario = Scenario(prior_heading_sigma_deg=6.0, odometry_sigma=0.07)
    marginals = Marginals(scenario)
    marginals.add(None, [])
    marginals.solve(np.array([[0.0, 0.0, math.pi / 2]]), EMPTY)
    marginals.add(scenario.noise.odometry((0.0, 0.5)), [])
    marginals.extend(np.array([[0.0, 0.0, math.pi / 2], [0.0, 0.5, math.pi / 2]]))
    heading2, step2 = math.radians(6.0) ** 2, 0.05**2 + 0.07**2
    expected = [
        [step2 + 0.25 * heading2, 0.0, -0.5 * heading2],
        [0.0, step2, 0.0],
        [-0.5 * heading2, 0.0, heading2 + math.radians(0.2) ** 2],
    ]
    np.testing.assert_allclose(marginals.pose_covariances[1], expected, rtol=1e-12, atol=1e-16)


def test_one_sighting_by_hand():
    """A landmark 2 m east of the start has the start's σ, range along and bearing and heading times 2 m across."""
    marginals = Marginals(Scenario())
    marginals.add(None, [0])
    marginals.solve(np.array([[1.0, 1.0, 0.3]]), np.array([[3.0, 1.0]]))
    across = 4.0 * (math.radians(0.5) ** 2 + math.radians(0.01) ** 2)
    expected = np.diag([0.0025 + 0.0004, 0.0025 + across])
    np.testing.assert_allclose(marginals.landmark_covariances, expected[None], rtol=1e-10, atol=1e-14)


def test_copies_handed_out_do_not_follow_later_steps():
    random = random_graph(3, 10, 2)
    marginals = marginals_of(random)
    elimination, blocks = marginals.elimination(), marginals.linearization()
    pivots, of_to = elimination.pivots.copy(), blocks.odometry_to.copy()
    marginals.solve(random.poses + 0.3 * np.cos(np.arange(30)).reshape(10, 3), random.landmarks)
    np.testing.assert_array_equal(elimination.pivots, pivots)
    np.testing.assert_array_equal(blocks.odometry_to, of_to)
    assert not np.array_equal(marginals.linearization().odometry_to, of_to)


@settings(max_examples=40, deadline=None)
@given(size=st.integers(3, 15), seed=st.integers(0, 2**32 - 1))
def test_invert_corner_is_the_symmetric_inverse(size, seed):
    root = np.random.default_rng(seed).normal(size=(size, size))
    matrix = root @ root.T + 0.1 * np.eye(size)
    inverse = invert_corner(matrix)
    expected = np.linalg.inv(matrix)
    np.testing.assert_allclose(inverse, expected, atol=1e-9 * np.abs(expected).max(), rtol=0)
    np.testing.assert_array_equal(inverse, inverse.T)


@given(seed=st.integers(0, 2**32 - 1), heading=st.floats(-3.2, 3.2))
def test_to_world_rotates_the_covariance(seed, heading):
    root = np.random.default_rng(seed).normal(size=(3, 3))
    own, world = root @ root.T, np.full((3, 3), np.nan)
    to_world(own, heading, world)
    c, s = math.cos(heading), math.sin(heading)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(world, turn @ own @ turn.T, atol=1e-12)


def test_recover_of_a_single_pose_only_turns_it():
    corner = np.diag([1.0, 4.0, 9.0, 2.0, 2.0])
    covariances = np.full((1, 3, 3), np.nan)
    none = np.empty((0, 3, 3))
    widths = np.empty(0, dtype=np.int64)
    recover(0, corner, none, none, np.empty((0, 3, 2)), widths, np.array([math.pi / 2]), covariances)
    np.testing.assert_allclose(covariances[0], np.diag([4.0, 1.0, 9.0]), atol=1e-12)


def test_the_oracle_numbers_poses_and_landmarks_as_we_do():
    values = values_of([(1.0, 2.0, 0.3)], [(5.0, 6.0)])
    assert values.atPose2(X(0)).x() == 1.0
    np.testing.assert_array_equal(values.atPoint2(L(0)), (5.0, 6.0))
