"""Predictions against a batch graph of gtsam, and against what happens when every measurement comes out as expected."""

import math

import numpy as np
import pytest
from slam_reference import (
    arrays_of,
    batch_marginals,
    moved,
    odometry_factor,
    precise_marginals,
    scan_of,
    sighting_factor,
    small_drive,
    snapshot,
    worst_difference,
)

from explore_bench.geometry import Grid, cell_of
from explore_bench.robot.landmark.driver import Driver
from explore_bench.robot.virtual_map import VirtualMap, key_poses
from explore_bench.world.landmark.world import LandmarkWorld

GRID = Grid(10, 10, 2.0)
AROUND_THE_START = np.array([[7.5, 11.0], [12.0, 8.0], [10.5, 12.5]])


def open_world(landmarks=AROUND_THE_START):
    """20 m without an obstacle; the robot starts at the centre of cell (4, 4)."""
    return LandmarkWorld(GRID, np.zeros((10, 10), dtype=bool), np.array(landmarks).reshape(-1, 2), (9.0, 9.0, 0.4))


def random_path(drive, seed, length=4):
    """Cells from the robot's own by random steps to neighbours."""
    rng = np.random.default_rng(seed)
    x, y, _ = drive.smoother.pose
    row, column = divmod(cell_of(GRID, x, y), 10)
    path = [row * 10 + column]
    while len(path) < length:
        i, j = rng.integers(-1, 2, 2).tolist()
        row, column = min(max(row + i, 0), 9), min(max(column + j, 0), 9)
        if row * 10 + column != path[-1]:
            path.append(row * 10 + column)
    return path


def path_to(drive, row, column):
    x, y, _ = drive.smoother.pose
    return [cell_of(GRID, x, y), row * 10 + column]


def expected_drive(belief, path):
    """Commands along a path, the poses they lead to, and the sightings (pose, landmark, bearing, range) made there."""
    scenario = belief.scenario
    driver = Driver.of(scenario)
    pose = belief.pose
    commands, poses, sightings = [], [], []
    for cell in path[1:] or path:
        row, column = divmod(cell, scenario.grid.columns)
        waypoint = ((column + 0.5) * scenario.cell_size, (row + 0.5) * scenario.cell_size)
        while command := driver.command(pose, waypoint):
            pose = moved(pose, command)
            pose = (*pose[:2], math.remainder(pose[2], 2.0 * math.pi))
            commands.append(command)
            poses.append(pose)
            for m, (x, y) in enumerate(belief.landmarks.tolist()):
                distance = math.hypot(x - pose[0], y - pose[1])
                if scenario.min_landmark_range <= distance <= scenario.sensor_range:
                    bearing = math.atan2(y - pose[1], x - pose[0]) - pose[2]
                    sightings.append((len(poses) - 1, m, bearing, distance))
    return commands, np.array(poses).reshape(-1, 3), sightings


def assert_same_poses(found, expected):
    """Equal to rounding; a heading of π is one of −π."""
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * found[:, 2]), np.exp(1j * expected[:, 2]), atol=1e-12)


def by_gtsam(drive, belief, path, marginals=precise_marginals):
    """Covariances of all poses, past and predicted, and of the landmarks, from the whole graph at once."""
    commands, poses, sightings = expected_drive(belief, path)
    graph, past = drive.graph(), len(belief.poses)
    for k, command in enumerate(commands):
        graph.add(odometry_factor(belief.scenario, past - 1 + k, command))
    for pose, landmark, bearing, distance in sightings:
        graph.add(sighting_factor(belief.scenario, past + pose, landmark, bearing, distance))
    return marginals(graph, np.vstack((belief.poses, poses)), belief.landmarks)


def rebuilt(belief, poses, covariances):
    """Virtual map of a whole trajectory, without occlusion."""
    virtual_map = VirtualMap(belief.scenario)
    virtual_map.fuse(poses, covariances, key_poses(poses, belief.scenario.key_pose_spacing))
    return virtual_map


DRIVES = [(seed, steps) for seed in range(4) for steps in (0, 7, 40)]


@pytest.mark.parametrize(("seed", "steps"), DRIVES)
def test_predicted_covariances_are_those_of_the_whole_graph(seed, steps):
    """Past poses, predicted poses and landmarks; the last steps before may have sighted something or nothing."""
    drive = small_drive(seed, steps)
    belief = drive.smoother.belief()
    for variant in range(3):
        path = random_path(drive, variant, 2 + 3 * variant)
        prediction = belief.predict(path)
        commands, poses, sightings = expected_drive(belief, path)
        assert len(commands) > 0
        assert_same_poses(prediction.poses, poses)
        assert prediction.sightings == len(sightings)
        for marginals, tolerance in ((batch_marginals, 1e-5), (precise_marginals, 1e-7)):
            of_poses, of_landmarks = by_gtsam(drive, belief, path, marginals)
            assert worst_difference(prediction.pose_covariances, of_poses) < tolerance
            assert worst_difference(prediction.landmark_covariances, of_landmarks) < tolerance


def test_the_drives_tested_predict_with_and_without_sightings():
    counts = [
        drive.smoother.belief().predict(random_path(drive, 1, 5)).sightings
        for drive in (small_drive(seed, steps) for seed, steps in DRIVES)
    ]
    assert 0 in counts
    assert max(counts) > 5


@pytest.mark.parametrize(
    "constants",
    [{}, {"fusion": "determinant"}, {"first_sight": "replace"}, {"key_pose_spacing": 1.0}],
    ids=["trace", "determinant", "replace", "key poses"],
)
@pytest.mark.parametrize("target", [(4, 7), (0, 0)], ids=["landmarks in range", "towards a corner"])
def test_the_predicted_virtual_map_is_rebuilt_from_those_covariances(constants, target):
    drive = small_drive(3, 30, world=open_world(), **constants)
    belief = drive.smoother.belief()
    path = path_to(drive, *target)
    prediction = belief.predict(path)
    of_poses, _ = by_gtsam(drive, belief, path)
    expected = rebuilt(belief, np.vstack((belief.poses, prediction.poses)), of_poses)
    assert prediction.virtual_map.shape == (10, 10, 3)
    np.testing.assert_allclose(prediction.virtual_map.reshape(-1, 3), expected.covariances, rtol=1e-6, atol=1e-9)
    assert prediction.uncertainty == pytest.approx(expected.uncertainty, rel=1e-7)


def test_sightings_improve_the_past():
    """A landmark known from the start, seen again after a blind stretch, lowers the traces of that stretch."""
    drive = small_drive(0, 0, world=open_world([[8.0, 10.0]]), landmark_count=1)
    for _ in range(4):
        drive.carry_out((-0.1, 0.0))
        drive.carry_out((0.0, 0.5))
    while drive.sightings()[-1][0] > len(drive.commands) - 10:
        drive.carry_out((0.0, 0.5))
    belief = drive.smoother.belief()
    prediction = belief.predict(path_to(drive, 4, 4))
    assert prediction.sightings > 0
    before = np.trace(belief.pose_covariances, axis1=1, axis2=2)
    after = np.trace(prediction.pose_covariances[: len(before)], axis1=1, axis2=2)
    assert (after <= before * (1.0 + 1e-9)).all()
    assert after[-1] < 0.8 * before[-1]


def out_of_sight():
    """A drive that has left its only landmarks behind."""
    drive = small_drive(2, 0, world=open_world([[8.0, 9.0], [8.5, 10.0]]), landmark_count=2)
    for _ in range(16):
        drive.carry_out((0.0, 0.5))
    assert len(drive.scans[-1].sightings.landmarks) == 0
    return drive


@pytest.mark.parametrize("constants", [{}, {"key_pose_spacing": 1.0}])
def test_without_a_landmark_in_range_the_past_stays_and_the_map_is_extended(constants):
    drive = out_of_sight()
    belief = drive.smoother.belief()
    prediction = belief.predict(path_to(drive, 9, 9))
    assert prediction.sightings == 0
    past = len(belief.poses)
    np.testing.assert_array_equal(prediction.pose_covariances[: past - 1], belief.pose_covariances[:-1])
    np.testing.assert_allclose(
        prediction.pose_covariances[past - 1], belief.pose_covariances[-1], rtol=1e-9, atol=1e-15
    )
    assert worst_difference(prediction.landmark_covariances, belief.landmark_covariances) < 1e-9
    of_poses, _ = by_gtsam(drive, belief, path_to(drive, 9, 9))
    sequential = drive.smoother.virtual_map.copy()
    sequential.fuse(prediction.poses, of_poses[past:], np.ones(len(prediction.poses), dtype=bool))
    assert prediction.uncertainty == pytest.approx(sequential.uncertainty, rel=1e-9)
    assert prediction.uncertainty < belief.uncertainty


def test_without_any_landmark_known():
    drive = small_drive(1, 5, world=open_world([]), landmark_count=0)
    belief = drive.smoother.belief()
    prediction = belief.predict(random_path(drive, 1))
    of_poses, _ = by_gtsam(drive, belief, random_path(drive, 1))
    assert worst_difference(prediction.pose_covariances, of_poses) < 1e-8
    assert prediction.landmark_covariances.shape == (0, 2, 2)
    assert prediction.sightings == 0


def test_a_path_that_is_already_driven_changes_nothing():
    """The robot stands on the centre of the only cell."""
    drive = small_drive(1, 0, world=open_world())
    belief = drive.smoother.belief()
    prediction = belief.predict([44])
    assert prediction.poses.shape == (0, 3)
    assert worst_difference(prediction.pose_covariances, belief.pose_covariances) < 1e-9
    assert prediction.uncertainty == pytest.approx(belief.uncertainty, rel=1e-12)


def test_a_single_cell_is_driven_to():
    drive = small_drive(1, 0, world=open_world())
    prediction = drive.smoother.belief().predict([46])
    assert math.hypot(prediction.poses[-1, 0] - 13.0, prediction.poses[-1, 1] - 9.0) <= 0.25


def test_the_path_may_be_any_sequence_of_cells():
    belief = small_drive(1, 10, world=open_world()).smoother.belief()
    paths = [44, 45, 56], (44, 45, 56), np.array([44, 45, 56]), np.array([44, 45, 56], dtype=np.int32)
    first, *others = (belief.predict(path).pose_covariances for path in paths)
    for other in others:
        np.testing.assert_array_equal(other, first)


@pytest.mark.parametrize("sights", [True, False])
def test_places_in_metres_predict_what_the_centres_of_the_cells_do(sights):
    """Of several cells the first is where the robot is; of places all are driven through."""
    drive = small_drive(1, 10, world=open_world()) if sights else out_of_sight()
    belief = drive.smoother.belief()
    path = random_path(drive, 3, 5)
    of_cells, of_places = belief.predict(path), belief.predict(GRID.centres(path[1:]))
    assert (of_cells.sightings > 0) == sights
    for name in ("poses", "pose_covariances", "landmark_covariances", "virtual_map"):
        np.testing.assert_array_equal(getattr(of_places, name), getattr(of_cells, name), err_msg=name)
    for name in ("sightings", "uncertainty", "peak_trace"):
        assert getattr(of_places, name) == getattr(of_cells, name), name
    one = belief.predict([46]).pose_covariances
    np.testing.assert_array_equal(belief.predict([(13.0, 9.0)]).pose_covariances, one)


def test_places_need_not_be_centres_and_may_be_any_sequence_of_pairs():
    belief = small_drive(1, 0, world=open_world()).smoother.belief()
    places = (
        [(10, 9), (11, 10)],
        ((10, 9), (11, 10)),
        np.array([[10, 9], [11, 10]]),
        np.array([[10.0, 11.0], [9.0, 10.0]]).T,
    )
    first, *others = (belief.predict(place).poses for place in places)
    assert math.hypot(first[-1, 0] - 11.0, first[-1, 1] - 10.0) <= 0.25
    assert min(np.hypot(first[:, 0] - 10.0, first[:, 1] - 9.0)) <= 0.25
    for other in others:
        np.testing.assert_array_equal(other, first)


@pytest.mark.parametrize(
    ("path", "named"),
    [
        ([], r"shape \(0,\)"),
        (np.empty((0, 2)), r"shape \(0, 2\)"),
        (44, r"shape \(\)"),
        ([[1.0, 2.0, 0.3]], r"shape \(1, 3\)"),
        (np.zeros((2, 2, 2)), r"shape \(2, 2, 2\)"),
        ([44.0, 45.0], "type float64"),
        ([True, False], "type bool"),
        (["44", "45"], "type <U2"),
        ([None, 45], "type object"),
        ([[9.0, float("nan")]], "leaves the map at"),
        ([[9.0, float("inf")]], "leaves the map at"),
        ([44, 100], r"\[44, 100\] leaves the map; its cells are 0 to 99"),
        ([-1], r"\[-1\] leaves the map"),
        ([44, -56], "leaves the map"),
        ([[9.0, 9.0], [9.0]], "inhomogeneous"),
        ([["9", "west"]], "could not convert|type <U4"),
    ],
)
def test_what_is_no_path_is_refused(path, named):
    belief = small_drive(1, 0, world=open_world()).smoother.belief()
    with pytest.raises(ValueError, match=named):
        belief.predict(path)


@pytest.mark.parametrize("path", [[[9.0, 9.0], [20.5, 9.0]], [[9.0, -0.5]], [["9", "8"]], [[{}, 8.0]]])
def test_places_off_the_map_and_what_is_no_number_are_refused(path):
    belief = small_drive(1, 0, world=open_world()).smoother.belief()
    with pytest.raises(ValueError, match=r"leaves the map|type"):
        belief.predict(path)


def test_the_peak_trace_is_the_largest_of_the_whole_trajectory():
    """Ahead of the robot, where nothing is sighted, or behind it."""
    peaks = []
    for drive in (out_of_sight(), small_drive(0, 40), small_drive(5, 30, world=open_world())):
        belief = drive.smoother.belief()
        prediction = belief.predict(path_to(drive, 4, 4))
        traces = np.trace(prediction.pose_covariances, axis1=1, axis2=2)
        assert prediction.peak_trace == pytest.approx(traces.max(), rel=1e-12)
        assert belief.peak_trace == pytest.approx(np.trace(belief.pose_covariances, axis1=1, axis2=2).max(), rel=1e-12)
        peaks.append(traces.argmax() >= len(belief.poses))
    assert {True, False} == set(peaks)


def test_the_belief_stays_unmodified_and_read_only():
    drive = small_drive(0, 25, world=open_world())
    belief = drive.smoother.belief()
    before = snapshot(belief)
    for path in (path_to(drive, 4, 8), path_to(drive, 0, 0)):
        prediction = belief.predict(path)
        assert prediction.uncertainty > 0.0
    for name, array in arrays_of(belief).items():
        np.testing.assert_array_equal(array, before[name], err_msg=name)
        assert not array.flags.writeable, name
    with pytest.raises(ValueError, match="read-only"):
        belief.pose_covariances[0, 0, 0] = 1.0


def test_the_prediction_comes_true_when_every_measurement_is_as_expected():
    """Driven without noise by the smoother itself: covariances and U at the end are those predicted."""
    drive = small_drive(5, 30, world=open_world())
    belief = drive.smoother.belief()
    path = path_to(drive, 4, 4)
    prediction = belief.predict(path)
    commands, poses, sightings = expected_drive(belief, path)
    assert sightings
    smoother = drive.smoother
    for k, command in enumerate(commands):
        seen = [(belief.landmark_ids[m], b, r) for pose, m, b, r in sightings if pose == k]
        smoother.update(belief.scenario.noise.odometry(command), scan_of(seen))
    np.testing.assert_allclose(smoother.poses, np.vstack((belief.poses, poses)), atol=5e-3)
    assert worst_difference(prediction.pose_covariances, smoother.pose_covariances) < 0.02
    assert worst_difference(prediction.landmark_covariances, smoother.landmark_covariances) < 0.02
    assert prediction.uncertainty == pytest.approx(smoother.virtual_map.uncertainty, rel=2e-3)


def test_landmarks_too_near_are_not_sighted():
    """Nearer than 0.1 m the sensor ignores a landmark: the last pose passes over it."""
    drive = small_drive(1, 0, world=open_world([[9.0, 11.0]]), landmark_count=1, min_landmark_range=1.2)
    belief = drive.smoother.belief()
    prediction = belief.predict([44, 54])
    distances = np.hypot(*(prediction.poses[:, :2] - belief.landmarks[0]).T)
    assert prediction.sightings == np.count_nonzero(distances >= 1.2) < len(distances)
