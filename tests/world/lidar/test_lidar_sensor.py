"""The lidar: exact ranges with white noise on them, and as many normals a scan whatever it meets."""

import numpy as np
import pytest
from lidar_worlds import cluttered, drawn, ranges_at

from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.sensor import Lidar

SCENARIO = LidarScenario(size=10.0, sensor_range=4.0)
WORLD = cluttered(10.0, 12, 3, [(5.0, 5.0)])
POSE = (5.0, 5.0, 0.3)


def lidar(scenario=SCENARIO, world=WORLD, seed=0):
    rng = np.random.default_rng(seed)
    return Lidar(scenario, world, rng), rng


def test_without_noise_ranges_are_exact_and_infinite_beyond_the_range():
    sensor, _ = lidar(SCENARIO.replace(range_sigma=0.0, beams=90))
    ranges = sensor.scan(POSE).ranges
    np.testing.assert_array_equal(ranges, ranges_at(WORLD, POSE, 90, 4.0))
    assert np.isinf(ranges).any()
    assert ranges[np.isfinite(ranges)].max() <= 4.0


def test_noise_has_its_standard_deviation_and_no_bias():
    sensor, _ = lidar(SCENARIO.replace(range_sigma=0.05))
    exact = ranges_at(WORLD, POSE, 360, 4.0)
    met = np.isfinite(exact)
    errors = np.array([sensor.scan(POSE).ranges[met] - exact[met] for _ in range(200)])
    assert errors.std() == pytest.approx(0.05, rel=0.02)
    assert abs(errors.mean()) < 0.001
    assert abs(np.corrcoef(errors[:, 0], errors[:, 1])[0, 1]) < 0.3
    assert abs(np.corrcoef(errors[:-1].ravel(), errors[1:].ravel())[0, 1]) < 0.03


def test_what_a_scan_meets_changes_nothing_of_what_is_drawn():
    """Two scans in two worlds, from two places: the streams are the same after them."""
    states = []
    for world, pose in ((WORLD, POSE), (drawn(10.0), (1.0, 1.0, 2.0)), (drawn(10.0, free=[]), (5.0, 5.0, 0.0))):
        sensor, rng = lidar(world=world)
        sensor.scan(pose)
        states.append(rng.standard_normal())
    expected = np.random.default_rng(0)
    expected.standard_normal(SCENARIO.beams)
    assert states == [expected.standard_normal()] * 3


def test_no_range_is_less_than_nothing():
    sensor, _ = lidar(SCENARIO.replace(range_sigma=1.0), drawn(10.0, free=[]))
    ranges = sensor.scan(POSE).ranges
    assert ranges.min() == 0.0
    assert ranges.max() > 0.5


def test_one_stream_gives_one_scan():
    one, other, another = (lidar(seed=seed)[0].scan(POSE).ranges for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, other)
    assert (one != another).any()
