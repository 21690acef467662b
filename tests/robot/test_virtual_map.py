"""The virtual map against scipy's minimizer, explicit matrix products, samples and numbers worked by hand."""

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.optimize import minimize_scalar

from explore_bench.robot.virtual_map import VirtualMap, key_poses, uncertainty
from explore_bench.world.scenario import Scenario

FREE, HIDDEN = 0, 2
SEEDS = st.integers(0, 2**32 - 1)


def spd2(first, second, angle):
    """Covariance with these eigenvalues, its first axis at an angle."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s], [s, c]])
    return turn @ np.diag([first, second]) @ turn.T


COVARIANCES = st.builds(
    lambda size, ratio, angle: spd2(size, size * ratio, angle),
    size=st.floats(1e-3, 3.0),
    ratio=st.floats(1e-4, 1.0),
    angle=st.floats(-3.2, 3.2),
)


def intersection(a, b, fusion="trace"):
    """A fused with B: the pose stands on the centre of a cell with an exact heading, so that it sees just B."""
    scenario = Scenario(size=4.0, sensor_range=0.5, landmark_count=0, obstacle_count=0, fusion=fusion)
    virtual_map = VirtualMap(scenario)
    virtual_map.covariances[0] = a[0, 0], a[0, 1], a[1, 1]
    covariance = np.zeros((1, 3, 3))
    covariance[0, :2, :2] = b
    virtual_map.fuse(np.array([[1.0, 1.0, 0.7]]), covariance, np.ones(1, dtype=bool))
    xx, xy, yy = virtual_map.covariances[0]
    return np.array([[xx, xy], [xy, yy]])


def mixture(a, b, omega):
    return np.linalg.inv(omega * np.linalg.inv(a) + (1.0 - omega) * np.linalg.inv(b))


def least(cost, a, b):
    """Least cost of a mixture over ω in [0, 1]; both costs are quasi-convex in ω."""
    found = minimize_scalar(lambda w: cost(mixture(a, b, w)), bounds=(0.0, 1.0), options={"xatol": 1e-12})
    return min(found.fun, cost(a), cost(b))


def assert_is_a_mixture(fused, a, b):
    """The fused information lies on the segment between those of A and B."""
    of_a, of_b, of_fused = (np.linalg.inv(m).ravel() for m in (a, b, fused))
    direction = of_a - of_b
    size = np.abs(of_a).max() + np.abs(of_b).max()
    if np.abs(direction).max() < 1e-9 * size:
        return
    omega = float((of_fused - of_b) @ direction / (direction @ direction))
    assert -1e-9 <= omega <= 1.0 + 1e-9
    np.testing.assert_allclose(of_fused, of_b + omega * direction, atol=1e-8 * size)


@settings(max_examples=300, deadline=None)
@given(a=COVARIANCES, b=COVARIANCES)
def test_intersection_has_the_least_trace(a, b):
    fused = intersection(a, b)
    assert np.trace(fused) == pytest.approx(least(np.trace, a, b), rel=1e-9)
    assert_is_a_mixture(fused, a, b)


@settings(max_examples=300, deadline=None)
@given(a=COVARIANCES, b=COVARIANCES)
def test_intersection_by_determinant_has_the_least_determinant(a, b):
    fused = intersection(a, b, "determinant")
    assert np.linalg.det(fused) == pytest.approx(least(np.linalg.det, a, b), rel=1e-8)
    assert_is_a_mixture(fused, a, b)


def test_intersection_of_two_crossed_ellipses_by_hand():
    """A = I and B = diag(1/100, 4): tr(ω) = 1/(100 − 99 ω) + 1/(¼ + ¾ ω), whose derivative is zero in closed form."""
    p, q = math.sqrt(99.0), math.sqrt(0.75)
    omega = (100.0 * q - 0.25 * p) / (0.75 * p + 99.0 * q)
    expected = np.diag([1.0 / (100.0 - 99.0 * omega), 1.0 / (0.25 + 0.75 * omega)])
    assert 0.0 < omega < 1.0
    np.testing.assert_allclose(intersection(np.eye(2), np.diag([0.01, 4.0])), expected, atol=1e-12)


def test_intersection_by_determinant_of_two_crossed_ellipses_by_hand():
    """With the same A and B det M = (100 − 99 ω)(¼ + ¾ ω) is greatest at ω = (75 − 24.75) / 148.5."""
    omega = 50.25 / 148.5
    expected = np.diag([1.0 / (100.0 - 99.0 * omega), 1.0 / (0.25 + 0.75 * omega)])
    found = intersection(np.eye(2), np.diag([0.01, 4.0]), "determinant")
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("fusion", ["trace", "determinant"])
def test_the_smaller_of_two_nested_ellipses_wins_alone(fusion):
    """Covariance intersection does not average: it never counts information twice."""
    small, large = spd2(0.1, 0.2, 0.4), spd2(1.0, 2.0, 0.4)
    np.testing.assert_allclose(intersection(small, large, fusion), small, rtol=1e-12)
    np.testing.assert_allclose(intersection(large, small, fusion), small, rtol=1e-12)
    np.testing.assert_allclose(intersection(small, small, fusion), small, rtol=1e-12)


def random_covariances(rng, count, size=0.3):
    roots = rng.normal(0.0, size, (count, 3, 3)) * np.array([1.0, 1.0, 0.3])[:, None]
    return roots @ roots.transpose(0, 2, 1) + 1e-6 * np.eye(3)


def random_trajectory(seed, count):
    rng = np.random.default_rng(seed)
    poses = rng.uniform((0.0, 0.0, -np.pi), (20.0, 20.0, np.pi), (count, 3))
    return poses, random_covariances(rng, count)


def in_range(scenario, pose):
    """Cells whose centre is within range of a pose, and the offsets of all, by numpy alone."""
    row, column = np.divmod(np.arange(scenario.cell_count), scenario.grid.columns)
    dx, dy = (column + 0.5) * scenario.cell_size - pose[0], (row + 0.5) * scenario.cell_size - pose[1]
    return np.hypot(dx, dy) <= scenario.sensor_range, dx, dy


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, count=st.integers(1, 12))
def test_seeing_a_cell_never_raises_its_trace(seed, count):
    poses, covariances = random_trajectory(seed, count)
    virtual_map = VirtualMap(Scenario())
    assert virtual_map.uncertainty == 200.0
    for k in range(count):
        before = virtual_map.covariances[:, 0] + virtual_map.covariances[:, 2]
        virtual_map.fuse(poses[k : k + 1], covariances[k : k + 1], np.ones(1, dtype=bool))
        after = virtual_map.covariances[:, 0] + virtual_map.covariances[:, 2]
        assert (after <= before * (1.0 + 1e-12)).all()
        assert virtual_map.uncertainty <= 200.0
    determinants = virtual_map.covariances[:, 0] * virtual_map.covariances[:, 2] - virtual_map.covariances[:, 1] ** 2
    assert (determinants > 0.0).all()


@pytest.mark.parametrize(("size", "sigma"), [(20.0, 1.0), (40.0, 1.0), (20.0, 0.5)])
def test_the_prior_uncertainty_is_two_sigma_squared_a_cell(size, sigma):
    virtual_map = VirtualMap(Scenario(size=size, virtual_sigma=sigma))
    assert virtual_map.uncertainty == pytest.approx(2.0 * sigma**2 * (size / 2.0) ** 2, rel=1e-12)
    assert uncertainty(virtual_map.covariances) == virtual_map.uncertainty


def test_uncertainty_is_the_sum_of_the_traces():
    grid = np.arange(12.0).reshape(4, 3)
    assert uncertainty(grid) == grid[:, 0].sum() + grid[:, 2].sum()


def test_a_worse_sight_than_the_prior_leaves_it():
    """A pose lost by 10 m tells nothing, and U stays U₀."""
    virtual_map = VirtualMap(Scenario())
    covariance = np.diag([100.0, 100.0, 1.0])[None]
    virtual_map.fuse(np.array([[9.0, 9.0, 0.0]]), covariance, np.ones(1, dtype=bool))
    assert virtual_map.uncertainty == 200.0
    assert virtual_map.seen.sum() == in_range(Scenario(), (9.0, 9.0))[0].sum()


def candidate(scenario, pose, covariance, dx, dy):
    """J Σ Jᵀ + R as matrices: J = ∂(landmark)/∂(pose), R turned from range and bearing."""
    jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx]])
    distance, direction = math.hypot(dx, dy), math.atan2(dy, dx)
    turn = np.array([[math.cos(direction), -math.sin(direction)], [math.sin(direction), math.cos(direction)]])
    noise = np.diag([scenario.range_sigma**2, (math.radians(scenario.bearing_sigma_deg) * distance) ** 2])
    return jacobian @ covariance @ jacobian.T + turn @ noise @ turn.T


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_a_sight_is_the_poses_covariance_carried_to_the_cell_plus_noise(seed):
    """Read from the map that the first sight replaces."""
    scenario = Scenario(first_sight="replace", bearing_sigma_deg=4.0, range_sigma=0.2)
    poses, covariances = random_trajectory(seed, 1)
    virtual_map = VirtualMap(scenario)
    virtual_map.fuse(poses, covariances, np.ones(1, dtype=bool))
    seen, dx, dy = in_range(scenario, poses[0])
    for cell in np.flatnonzero(seen):
        expected = candidate(scenario, poses[0], covariances[0], dx[cell], dy[cell])
        found = virtual_map.covariances[cell]
        np.testing.assert_allclose(found, [expected[0, 0], expected[0, 1], expected[1, 1]], rtol=1e-10, atol=1e-12)


def test_a_sight_is_the_spread_of_sampled_landmarks():
    """Monte Carlo: poses drawn from Σ and noisy measurements put the landmark where the map says it may be."""
    scenario = Scenario(first_sight="replace", bearing_sigma_deg=2.0, range_sigma=0.1)
    rng = np.random.default_rng(0)
    pose = np.array([8.2, 9.3, 0.6])
    covariance = random_covariances(rng, 1, 0.08)[0]
    virtual_map = VirtualMap(scenario)
    virtual_map.fuse(pose[None], covariance[None], np.ones(1, dtype=bool))
    cell, (x, y) = 5 * 10 + 5, (11.0, 11.0)
    poses = rng.multivariate_normal(pose, covariance, 200_000)
    dx, dy = x - pose[0], y - pose[1]
    distance = math.hypot(dx, dy) + rng.normal(0.0, 0.1, len(poses))
    bearing = math.atan2(dy, dx) - pose[2] + rng.normal(0.0, math.radians(2.0), len(poses))
    angle = poses[:, 2] + bearing
    points = poses[:, :2] + distance[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    expected = np.cov(points.T)
    found = virtual_map.covariances[cell]
    scale = expected.max()
    np.testing.assert_allclose(found, [expected[0, 0], expected[0, 1], expected[1, 1]], atol=0.02 * scale, rtol=0)


def test_a_pose_on_the_centre_of_a_cell_gives_it_its_own_covariance():
    """Neither bearing nor range noise has a direction there."""
    virtual_map = VirtualMap(Scenario())
    covariance = np.diag([0.01, 0.02, 0.001])[None]
    virtual_map.fuse(np.array([[9.0, 9.0, 0.4]]), covariance, np.ones(1, dtype=bool))
    np.testing.assert_allclose(virtual_map.covariances[44], [0.01, 0.0, 0.02], atol=1e-15)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS, outside=st.floats(-6.0, 6.0))
def test_only_cells_whose_centre_is_in_range_change(seed, outside):
    """Poses beyond the edge included."""
    scenario = Scenario(first_sight="replace")
    poses, covariances = random_trajectory(seed, 1)
    poses[0, 0] = outside
    virtual_map = VirtualMap(scenario)
    virtual_map.fuse(poses, covariances, np.ones(1, dtype=bool))
    seen, _, _ = in_range(scenario, poses[0])
    np.testing.assert_array_equal(virtual_map.seen, seen)
    np.testing.assert_array_equal((virtual_map.covariances != [1.0, 0.0, 1.0]).any(axis=1), seen)


def test_a_centre_exactly_at_the_range_counts():
    """From (9.5, 9.5) the centre (13.5, 12.5) is 5 m away."""
    virtual_map = VirtualMap(Scenario(cell_size=1.0, size=20.0))
    covariance = 1e-4 * np.eye(3)[None]
    virtual_map.fuse(np.array([[9.5, 9.5, 0.0]]), covariance, np.ones(1, dtype=bool))
    assert virtual_map.seen[12 * 20 + 13]
    assert not virtual_map.seen[13 * 20 + 13]


@pytest.mark.parametrize(
    "constants",
    [{}, {"fusion": "determinant"}, {"first_sight": "replace"}, {"fusion": "determinant", "first_sight": "replace"}],
)
@pytest.mark.parametrize("cut", [1, 7, 19])
def test_fusing_in_two_calls_equals_fusing_in_one(constants, cut):
    poses, covariances = random_trajectory(3, 20)
    used = np.arange(20) % 3 != 1
    whole, parts = VirtualMap(Scenario(**constants)), VirtualMap(Scenario(**constants))
    whole.fuse(poses, covariances, used)
    parts.fuse(poses[:cut], covariances[:cut], used[:cut])
    parts.fuse(poses[cut:], covariances[cut:], used[cut:])
    np.testing.assert_array_equal(parts.covariances, whole.covariances)
    np.testing.assert_array_equal(parts.seen, whole.seen)


@pytest.mark.parametrize("seed", range(3))
def test_sights_judged_together_equal_sights_fused_one_by_one_to_the_last_bit(seed):
    """The slow way: each sight in plain Python, and fused alone with the cell that it sees."""
    scenario = Scenario()
    poses, covariances = random_trajectory(seed, 12)
    virtual_map = VirtualMap(scenario)
    virtual_map.fuse(poses, covariances, np.ones(12, dtype=bool))
    cells = {}
    bearing2, range2 = (sigma**2 for sigma in scenario.sight_sigmas)
    for (x, y, _), sigma in zip(poses.tolist(), covariances.tolist(), strict=True):
        (xx, xy, xh), (_, yy, yh), (_, _, hh) = sigma
        for cell, (to_x, to_y) in enumerate(scenario.grid.centres().tolist()):
            dx, dy = to_x - x, to_y - y
            distance2 = dx * dx + dy * dy
            if distance2 > scenario.sensor_range**2:
                continue
            along = range2 / distance2
            b_xx = xx - 2.0 * dy * xh + dy * dy * hh + along * dx * dx + bearing2 * dy * dy
            b_xy = xy + dx * xh - dy * yh - dx * dy * hh + (along - bearing2) * dx * dy
            b_yy = yy + 2.0 * dx * yh + dx * dx * hh + along * dy * dy + bearing2 * dx * dx
            held = cells.get(cell, scenario.virtual_sigma**2 * np.eye(2))
            cells[cell] = intersection(held, np.array([[b_xx, b_xy], [b_xy, b_yy]]))
    assert len(cells) > 20
    assert set(cells) == set(np.flatnonzero(virtual_map.seen).tolist())
    expected = np.array([cells[cell][[0, 0, 1], [0, 1, 1]] for cell in sorted(cells)])
    np.testing.assert_array_equal(virtual_map.covariances[sorted(cells)], expected)


def test_poses_that_are_not_used_take_no_part():
    poses, covariances = random_trajectory(4, 10)
    used = np.arange(10) % 2 == 0
    some, only = VirtualMap(Scenario()), VirtualMap(Scenario())
    some.fuse(poses, covariances, used)
    only.fuse(poses[::2].copy(), covariances[::2].copy(), np.ones(5, dtype=bool))
    np.testing.assert_array_equal(some.covariances, only.covariances)


def test_the_first_sight_replaces_the_prior_and_the_second_is_fused():
    scenario = Scenario(first_sight="replace", size=4.0, sensor_range=0.5, landmark_count=0, obstacle_count=0)
    virtual_map = VirtualMap(scenario)
    pose, first, second = np.array([[1.0, 1.0, 0.0]]), np.diag([9.0, 4.0, 0.0]), np.diag([2.0, 1.0, 0.0])
    virtual_map.fuse(pose, first[None], np.ones(1, dtype=bool))
    np.testing.assert_allclose(virtual_map.covariances[0], [9.0, 0.0, 4.0], atol=1e-12)
    virtual_map.fuse(pose, second[None], np.ones(1, dtype=bool))
    np.testing.assert_allclose(virtual_map.covariances[0], [2.0, 0.0, 1.0], atol=1e-12)
    virtual_map.fuse(pose, first[None], np.ones(1, dtype=bool))
    np.testing.assert_allclose(virtual_map.covariances[0], [2.0, 0.0, 1.0], atol=1e-12)


def test_clear_returns_to_the_prior_and_a_copy_is_independent():
    poses, covariances = random_trajectory(5, 5)
    scenario = Scenario(first_sight="replace")
    virtual_map, fresh = VirtualMap(scenario), VirtualMap(scenario)
    virtual_map.fuse(poses, covariances, np.ones(5, dtype=bool))
    kept = virtual_map.copy()
    covariances_before = virtual_map.covariances.copy()
    virtual_map.clear()
    np.testing.assert_array_equal(virtual_map.covariances, fresh.covariances)
    assert not virtual_map.seen.any()
    np.testing.assert_array_equal(kept.covariances, covariances_before)
    kept.fuse(poses, 0.5 * covariances, np.ones(5, dtype=bool))
    np.testing.assert_array_equal(virtual_map.covariances, fresh.covariances)


# --- key poses -------------------------------------------------------------------------------------------


def test_all_poses_are_key_poses_without_a_spacing():
    assert key_poses(np.zeros((4, 3)), 0.0).tolist() == [True] * 4


def test_key_poses_are_a_spacing_apart_along_the_way():
    """Half-metre steps, a turn in place, and back: it is the way that counts, not the distance."""
    xs = [0.0, 0.5, 1.0, 1.0, 1.5, 1.0, 0.5, 0.0]
    poses = np.array([(x, 2.0, 0.0) for x in xs])
    assert key_poses(poses, 1.0).tolist() == [True, False, True, False, False, True, False, True]


def test_key_poses_of_uneven_steps_count_from_the_last_key_pose():
    poses = np.array([(x, 0.0, 0.0) for x in (0.0, 0.75, 1.5, 2.25, 3.0)])
    assert key_poses(poses, 1.0).tolist() == [True, False, True, False, True]
    assert key_poses(poses[:1], 1.0).tolist() == [True]


# --- occlusion -------------------------------------------------------------------------------------------


def hide(*cells, side=7):
    """Patch with hidden cells (row, column)."""
    patch = np.full((side, side), FREE, dtype=np.uint8)
    for row, column in cells:
        patch[row, column] = HIDDEN
    return patch


def fused_cells(pose, patch, origin, sensor_range=5.0):
    """Cells (row, column) seen by one pose under occlusion."""
    virtual_map = VirtualMap(Scenario(occlusion=True, sensor_range=sensor_range))
    covariance = 1e-4 * np.eye(3)[None]
    scans = patch[None], np.array([origin])
    virtual_map.fuse(np.array([pose]), covariance, np.ones(1, dtype=bool), scans)
    changed = (virtual_map.covariances != [1.0, 0.0, 1.0]).any(axis=1)
    np.testing.assert_array_equal(changed, virtual_map.seen)
    return {divmod(cell, 10) for cell in np.flatnonzero(changed).tolist()}


def test_hidden_cells_are_not_fused():
    """From the centre of cell (4, 4), in the middle of its patch, two cells east and one north are hidden."""
    everything = fused_cells((9.0, 9.0, 0.0), hide(), (7.0, 7.0, 0.0))
    assert len(everything) == in_range(Scenario(), (9.0, 9.0))[0].sum()
    found = fused_cells((9.0, 9.0, 0.0), hide((3, 5), (4, 3)), (7.0, 7.0, 0.0))
    assert everything - found == {(4, 6), (5, 4)}


def test_hidden_cells_turn_with_the_estimated_heading():
    """The robot looked along the patch's x axis but believes it looked north: east of the robot is hidden north."""
    found = fused_cells((9.0, 9.0, math.pi / 2), hide((3, 5)), (7.0, 7.0, 0.0))
    everything = fused_cells((9.0, 9.0, 0.0), hide(), (7.0, 7.0, 0.0))
    assert everything - found == {(6, 4)}


def test_hidden_cells_move_with_the_estimated_place():
    """The robot stood at (9, 9) but believes (13, 9)."""
    everything = fused_cells((13.0, 9.0, 0.0), hide(), (7.0, 7.0, 0.0))
    found = fused_cells((13.0, 9.0, 0.0), hide((2, 4)), (7.0, 7.0, 0.0))
    assert everything - found == {(3, 7)}


def test_a_point_on_the_far_edge_of_the_patch_is_looked_up_inside_it():
    """At 6 m range a cell may fall on the patch's very edge by rounding; beyond it lies another row's memory."""
    edge = np.nextafter(8.0, 0.0)
    assert edge + 6.0 == 14.0  # rounds to the far edge of 7 cells of 2 m
    found = fused_cells((9.0, 9.0, 0.0), hide((4, 0)), (edge, 7.0, 0.0), sensor_range=6.0)
    assert (4, 7) in found
