"""The smoother on small simulated drives: against iSAM2, gtsam's batch marginals, and maps rebuilt from scratch."""

import math

import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from slam_reference import (
    arrays_of,
    batch_marginals,
    no_sighting,
    precise_marginals,
    scan_of,
    small_drive,
    snapshot,
    worst_difference,
)

from explore_bench.geometry import Grid, compose
from explore_bench.robot.landmark.smoother import Smoother
from explore_bench.robot.occupancy import OccupancyMap
from explore_bench.robot.virtual_map import VirtualMap, key_poses
from explore_bench.world.landmark.sensor import Sensor
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario

VARIANTS = {
    "paper": {},
    "occlusion": {"occlusion": True},
    "key poses": {"key_pose_spacing": 1.0},
    "chen": {"first_sight": "replace", "fusion": "determinant", "sensor_range": 6.0},
    "noisy": {"odometry_sigma": 0.15, "heading_sigma_deg": 1.0, "landmark_count": 6},
    "no landmark": {"landmark_count": 0},
}
each_variant = pytest.mark.parametrize("constants", VARIANTS.values(), ids=VARIANTS.keys())


def steps_of(drive, count, every):
    """Drive on, halting at every few steps."""
    for k in range(count):
        drive.step()
        if k % every == 0:
            yield len(drive.scans[-1].sightings.landmarks) > 0


def isam_estimates(smoother):
    """Estimates of all poses and landmarks as iSAM2 itself gives them."""
    values = smoother._graph._isam.calculateEstimate()
    poses = [values.atPose2(X(k)) for k in range(len(smoother.poses))]
    landmarks = [values.atPoint2(L(m)) for m in range(len(smoother.landmarks))]
    return np.array([(p.x(), p.y(), p.theta()) for p in poses]), np.array(landmarks).reshape(-1, 2)


@pytest.mark.parametrize("seed", range(3))
def test_estimates_are_isam2s(seed):
    """To 1e-9 right after a sighting, else within 1e-6 (poses that nothing moved are not fetched again)."""
    drive = small_drive(seed)
    halts = []
    for sighted in steps_of(drive, 80, 1):
        halts.append(sighted)
        poses, landmarks = isam_estimates(drive.smoother)
        tolerance = 1e-9 if sighted else 1e-6
        np.testing.assert_allclose(drive.smoother.poses, poses, atol=tolerance, rtol=0)
        np.testing.assert_allclose(drive.smoother.landmarks, landmarks, atol=tolerance, rtol=0)
        assert drive.smoother.pose == tuple(drive.smoother.poses[-1])
    assert {True, False} == set(halts)


@each_variant
def test_covariances_are_gtsams_at_those_estimates(constants):
    """By gtsam alone, and closer where its derivative of the logarithm is replaced by a precise one."""
    drive = small_drive(7, **constants)
    for _ in steps_of(drive, 100, 9):
        smoother = drive.smoother
        for marginals, tolerance in ((batch_marginals, 1e-5), (precise_marginals, 1e-7)):
            of_poses, of_landmarks = marginals(drive.graph(), smoother.poses, smoother.landmarks)
            assert worst_difference(smoother.pose_covariances, of_poses) < tolerance
            assert worst_difference(smoother.landmark_covariances, of_landmarks) < tolerance


@each_variant
def test_maps_and_peaks_equal_those_rebuilt_from_the_whole_trajectory(constants):
    """Extending by a pose is rebuilding, to the last bit."""
    drive = small_drive(8, **constants)
    for _ in steps_of(drive, 100, 9):
        smoother, scenario = drive.smoother, drive.scenario
        patches, origins = drive.patches()
        virtual_map, occupancy = VirtualMap(scenario), OccupancyMap(scenario)
        used = key_poses(smoother.poses, scenario.key_pose_spacing)
        scans = ((patches, origins),) if scenario.occlusion else ()
        virtual_map.fuse(smoother.poses.copy(), smoother.pose_covariances.copy(), used, *scans)
        occupancy.place(smoother.poses.copy(), patches, origins)
        np.testing.assert_array_equal(smoother.virtual_map.covariances, virtual_map.covariances)
        np.testing.assert_array_equal(smoother.occupancy.probability, occupancy.probability)
        np.testing.assert_array_equal(smoother.occupancy.known, occupancy.known)
        full = max(np.trace(block) for block in smoother.pose_covariances)
        position = max(np.trace(block[:2, :2]) for block in smoother.pose_covariances)
        assert smoother.peak_traces == pytest.approx((full, position), rel=1e-12)


def test_the_start_is_known_exactly():
    """Row 0: one pose at the start with the prior's covariance, and the scan taken there on the map."""
    drive = small_drive(4)
    smoother = drive.smoother
    np.testing.assert_allclose(smoother.poses, [drive.world.start], atol=1e-9)
    assert smoother.peak_traces == pytest.approx((0.005 + math.radians(0.01) ** 2, 0.005), rel=1e-6)
    assert 0.0 < smoother.occupancy.known.mean() < 0.3
    assert smoother.virtual_map.uncertainty < 200.0


def test_peak_traces_may_fall_after_a_loop_closure():
    """The maximum is taken over the trajectory as it is believed now, not as it was."""
    scenario = Scenario(landmark_count=1)
    smoother = Smoother(scenario, (9.0, 9.0, 0.0))
    smoother.update(None, scan_of([(0, 0.0, 3.0)]))
    for _ in range(8):
        smoother.update(scenario.noise.odometry((0.0, 0.5)), no_sighting())
    blind = smoother.peak_traces
    smoother.update(scenario.noise.odometry((math.pi, 0.0)), scan_of([(0, 0.0, 1.0)]))
    assert smoother.peak_traces[0] < 0.8 * blind[0]
    assert smoother.peak_traces[1] < 0.8 * blind[1]


# --- the frozen belief -----------------------------------------------------------------------------------


def test_the_belief_holds_what_the_smoother_knows():
    drive = small_drive(9, 40)
    smoother, belief = drive.smoother, drive.smoother.belief()
    np.testing.assert_array_equal(belief.poses, smoother.poses)
    np.testing.assert_array_equal(belief.pose_covariances, smoother.pose_covariances)
    np.testing.assert_array_equal(belief.landmarks, smoother.landmarks)
    np.testing.assert_array_equal(belief.landmark_covariances, smoother.landmark_covariances)
    np.testing.assert_array_equal(belief.occupancy.ravel(), smoother.occupancy.probability)
    np.testing.assert_array_equal(belief.known.ravel(), smoother.occupancy.known)
    np.testing.assert_array_equal(belief.virtual_map.reshape(-1, 3), smoother.virtual_map.covariances)
    assert belief.virtual_map.shape == (10, 10, 3)
    assert belief.occupancy.shape == belief.known.shape == (10, 10)
    assert belief.pose == smoother.pose
    assert belief.peak_trace == smoother.peak_traces[0]
    assert belief.peak_trace == pytest.approx(max(map(np.trace, smoother.pose_covariances)), rel=1e-12)
    assert belief.explored == smoother.occupancy.known.mean()
    assert belief.uncertainty == pytest.approx(belief.virtual_traces.sum(), rel=1e-12)
    first_seen = list(dict.fromkeys(int(i) for scan in drive.scans for i in scan.sightings.landmarks))
    assert belief.landmark_ids.tolist() == first_seen


@each_variant
def test_the_belief_is_frozen_and_later_updates_leave_it_alone(constants):
    drive = small_drive(10, 30, **constants)
    belief = drive.smoother.belief()
    before, uncertainty = snapshot(belief), belief.uncertainty
    for _ in range(60):
        drive.step()
    assert len(before) >= 18
    for name, array in arrays_of(belief).items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)
        assert not array.flags.writeable, name
    assert belief.uncertainty == uncertainty
    assert len(drive.smoother.poses) == len(belief.poses) + 60
    with pytest.raises(AttributeError):
        belief.poses = None


def test_the_smoother_goes_on_after_freezing():
    """Beliefs taken on the way change nothing."""
    one, other = small_drive(11, 50), small_drive(11)
    for _ in range(50):
        other.smoother.belief()
        other.step()
    np.testing.assert_array_equal(one.smoother.poses, other.smoother.poses)
    np.testing.assert_array_equal(one.smoother.virtual_map.covariances, other.smoother.virtual_map.covariances)


# --- a loop closure repairs the map ----------------------------------------------------------------------


def believed_obstacles(smoother):
    return [divmod(int(cell), 20) for cell in np.flatnonzero(smoother.occupancy.occupied)]


def test_a_loop_closure_moves_a_misplaced_obstacle_back():
    """A round of 48 m whose every step turns 0.4° too far left, beside an obstacle in cell (11, 11).

    At its far side the estimate is metres off and puts the obstacle into cell (11, 12); when the landmark known
    from the start is sighted again, the whole trajectory bends and the obstacle falls into its true cell.
    """
    scenario = Scenario(size=40.0, landmark_count=2, obstacle_count=1, heading_sigma_deg=1.0, odometry_sigma=0.01)
    obstacles = np.zeros((20, 20), dtype=bool)
    obstacles[11, 11] = True
    landmarks = np.array([[9.0, 12.0], [12.0, 9.0]])
    world = LandmarkWorld(Grid(20, 20, 2.0), obstacles, landmarks, (11.0, 11.0, 0.0))
    sensor = Sensor(scenario, world, np.random.default_rng(0))
    smoother, pose = Smoother(scenario, world.start), world.start
    scan = sensor.scan(pose)
    assert scan.sightings.landmarks.tolist() == [0, 1]
    smoother.update(None, scan)

    misplaced, closed = 0, False
    side = [(0.0, 0.5)] * 24 + [(math.pi / 2, 0.0)]
    for k, command in enumerate(side * 4):
        pose = compose(compose(pose, (command[1], 0.0, command[0])), (0.0, 0.0, math.radians(0.4)))
        scan = sensor.scan(pose)
        smoother.update(scenario.noise.odometry(command), scan)
        closed = closed or (k > 40 and len(scan.sightings.landmarks) > 0)
        off = math.hypot(smoother.pose[0] - pose[0], smoother.pose[1] - pose[1])
        if closed and k > 80:
            assert believed_obstacles(smoother) == [(11, 11)]
            assert off < 0.5
        elif k > 40 and not closed:
            assert believed_obstacles(smoother) == [(11, 12)]
            assert off > 1.0
            misplaced += 1
    assert closed
    assert misplaced > 20


def test_the_smoother_reports_its_parts_in_order():
    parts = []
    smoother = Smoother(Scenario(), (9.0, 9.0, 0.0), parts.append)
    smoother.update(None, no_sighting())
    smoother.update(Scenario().noise.odometry((0.0, 0.5)), no_sighting())
    assert parts == ["isam2", "estimate", "covariances", "virtual map", "occupancy"] * 2
