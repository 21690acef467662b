"""What the robot knows of its odometry: covariances as they are drawn, and scale errors learned from matches."""

import math
from dataclasses import replace

import numpy as np
import pytest

from explore_bench.robot.lidar.odometry import OdometryModel
from explore_bench.world.lidar.constants import LidarScenario


def test_the_odometry_s_covariance_is_that_of_its_bias_and_noise():
    scenario = LidarScenario()
    motion = (0.5, 0.1, 0.3)
    rng = np.random.default_rng(0)
    half = rng.uniform(-0.5, 0.5, (200_000, 3)) * (
        scenario.odometry_bias,
        scenario.odometry_bias,
        scenario.heading_bias,
    )
    white = rng.standard_normal((200_000, 3)) * (
        scenario.odometry_noise * math.sqrt(0.6),
        scenario.odometry_noise * math.sqrt(0.6),
        scenario.heading_noise * math.sqrt(0.6 + 0.3),
    )
    sampled = np.var(half * motion + white, axis=0)
    covariance = OdometryModel.of(scenario).covariance(motion, 0.6, 0.3)
    np.testing.assert_allclose(np.diag(covariance), sampled, rtol=0.02)
    assert not covariance[~np.eye(3, dtype=bool)].any()
    still = OdometryModel.of(scenario.replace(odometry_noise=0.0, heading_noise=0.0)).covariance(
        (0.0, 0.0, 0.0), 0.0, 0.0
    )
    assert (np.diag(still) > 0.0).all(), "and may be inverted where there is none"


def test_scale_errors_are_learned_from_matches_as_the_best_linear_estimate_does():
    """Of many simulated trials the estimate's error is what its variance says, and much less than before."""
    scenario = LidarScenario()
    rng = np.random.default_rng(3)
    errors, before = [], OdometryModel.of(scenario).variances
    for _ in range(300):
        scales = 1.0 + np.sqrt(before) * rng.standard_normal(3)
        model = OdometryModel.of(scenario)
        for _ in range(40):
            motion = np.array((0.5, 0.02, rng.uniform(-0.5, 0.5)))
            turned = abs(float(motion[2]))
            matched = np.square((0.003, 0.003, 0.001))
            noise = np.sqrt(model.white_noise(0.5, turned) + matched)
            made = scales * motion + noise * rng.standard_normal(3)
            model = model.learned(tuple(motion.tolist()), tuple(made.tolist()), matched, 0.5, turned)
        errors.append((model.scales - scales) / np.sqrt(model.variances))
    assert (model.variances[[0, 2]] < 0.35 * before[[0, 2]]).all()
    assert model.variances[1] > 0.9 * before[1], "across there is next to no motion to learn from"
    np.testing.assert_allclose(np.mean(np.square(errors), axis=0), 1.0, atol=0.25)


def test_what_no_match_measures_teaches_nothing():
    model = OdometryModel.of(LidarScenario())
    same = model.learned((0.5, 0.0, 0.1), (0.6, 0.1, 0.2), np.full(3, 1e6), 0.5, 0.1)
    np.testing.assert_allclose(same.scales, 1.0, atol=1e-8)
    np.testing.assert_allclose(same.variances, model.variances, rtol=1e-8)


def test_a_motion_is_corrected_by_the_scales_and_its_covariance_shrinks_with_them():
    model = replace(OdometryModel.of(LidarScenario()), scales=np.array((1.01, 0.99, 1.02)), variances=np.zeros(3))
    assert model.corrected((0.5, 0.1, 0.2)) == pytest.approx((0.505, 0.099, 0.204))
    np.testing.assert_allclose(np.diag(model.covariance((0.5, 0.1, 0.2), 0.5, 0.2)), model.white_noise(0.5, 0.2))


def test_half_a_turn_to_the_left_is_one_to_the_right():
    model = OdometryModel.of(LidarScenario())
    same = model.learned((0.0, 0.0, 3.13), (0.0, 0.0, -3.14), np.full(3, 1e-6), 0.0, 3.13)
    assert same.scales[2] == pytest.approx(1.0, abs=0.01)
