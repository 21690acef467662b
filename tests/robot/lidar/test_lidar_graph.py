"""Predictions against gtsam: links as they would be made, closures where the way leads back, cells and metres."""

import itertools
import math

import numpy as np
import pytest
from lidar_worlds import drawn, way_through

from explore_bench.geometry import between, compose
from explore_bench.robot.belief import Belief, FineMap, peak_traces
from explore_bench.robot.lidar.graph import EXPECTED_LAG, LidarGraph
from explore_bench.robot.lidar.odometry import OdometryModel
from explore_bench.robot.lidar.pose_graph import Link, PoseGraph
from explore_bench.robot.lidar.slam import KEY_DISTANCE, KEY_TURN, MATCH_COVARIANCE, WINDOW, anchor_at
from explore_bench.robot.virtual_map import prior_of
from explore_bench.world.lidar.constants import LidarScenario

SCENARIO = LidarScenario(size=20.0, sensor_range=6.0)
MATCHED = np.diag((0.01**2, 0.01**2, 0.002**2))


def links_between(poses, start=0, scenario=SCENARIO, matched=MATCHED):
    """Odometry and a match with its anchor for each pose from one on."""
    found = []
    for newest in range(max(start, 1), len(poses)):
        motion = between(poses[newest - 1], poses[newest])
        noise = OdometryModel.of(scenario).covariance(motion, math.hypot(*motion[:2]), abs(motion[2]))
        found.append(Link(newest - 1, newest, motion, noise + MATCH_COVARIANCE))
        anchor = anchor_at(max(newest - EXPECTED_LAG, 0), newest)
        found.append(Link(anchor, newest, between(poses[anchor], poses[newest]), matched))
    return found


def marginals_of(poses, links):
    graph = PoseGraph(poses[0])
    for pose in poses[1:]:
        graph.add_pose(pose)
    for link in links:
        graph.add_link(link)
    return graph.covariances()[0]


def belief_of(*places, walls=(), scenario=SCENARIO):
    """Belief of a robot that drove through places, all of it known, walls where they are."""
    poses = way_through(*places)
    links = links_between(poses)
    covariances = marginals_of(poses, links)
    edge = scenario.edge
    occupied = drawn(scenario.size, *walls).obstacles
    share = round(scenario.map_resolution / 0.05)
    occupied = occupied.reshape(len(occupied) // share, share, -1, share).any(axis=(1, 3))
    fine = FineMap(scenario.map_grid, np.ones_like(occupied), occupied)
    return Belief(
        scenario=scenario,
        poses=np.array(poses),
        pose_covariances=covariances,
        landmarks=np.empty((0, 2)),
        landmark_covariances=np.empty((0, 2, 2)),
        landmark_ids=np.empty(0, dtype=np.int64),
        occupancy=np.full((edge, edge), 0.5),
        known=np.ones((edge, edge), dtype=bool),
        virtual_map=np.tile(prior_of(scenario), (edge, edge, 1)),
        uncertainty=2.0 * edge * edge,
        peak_trace=peak_traces(covariances)[0],
        graph=LidarGraph(np.array(poses), tuple(links), OdometryModel.of(scenario), fine),
        fine=fine,
    )


STRAIGHT = belief_of((3.0, 3.0), (9.0, 3.0))
AROUND = belief_of((3.0, 3.0), (17.0, 3.0), (17.0, 17.0), (3.0, 17.0), (3.0, 12.0))
"""Most of a ring of 56 m, the end 9 m before its beginning."""


def test_predicted_key_poses_are_half_a_metre_or_half_a_radian_apart_and_end_at_the_place():
    poses = STRAIGHT.predict(np.array([[9.0, 6.3], [12.0, 6.3]])).poses
    assert poses[-1, :2] == pytest.approx((12.0, 6.3))
    last = STRAIGHT.pose
    for pose in poses.tolist():
        x, y, turn = between(last, tuple(pose))
        assert math.hypot(x, y) <= KEY_DISTANCE + 1e-9
        assert abs(turn) < 2.0 * KEY_TURN
        assert abs(y) < 1e-9 or math.hypot(x, y) < 1e-9
        last = tuple(pose)
    corner = np.flatnonzero(np.hypot(*(poses[:, :2] - (9.0, 6.3)).T) < 1e-9)
    assert len(corner) == 1 + math.floor(math.pi / 2 / KEY_TURN)
    assert len(poses) == 3 + 7 + 3 + 6


def test_staying_is_a_key_pose_where_the_robot_is():
    prediction = STRAIGHT.predict(np.array([STRAIGHT.pose[:2]]))
    np.testing.assert_allclose(prediction.poses, [STRAIGHT.pose])
    assert len(prediction.pose_covariances) == len(STRAIGHT.poses) + 1


def test_without_closures_covariances_are_those_of_a_graph_built_by_hand():
    prediction = STRAIGHT.predict(np.array([[13.0, 4.0], [15.0, 8.0]]))
    assert prediction.sightings == 0
    poses = [tuple(pose) for pose in (*STRAIGHT.poses.tolist(), *prediction.poses.tolist())]
    past = len(STRAIGHT.poses)
    links = [*STRAIGHT.graph.links, *links_between(poses, past, matched=MATCH_COVARIANCE)]
    expected = marginals_of(poses, links)
    np.testing.assert_allclose(prediction.pose_covariances, expected, rtol=1e-9, atol=1e-15)
    assert prediction.peak_trace == pytest.approx(np.trace(expected, axis1=1, axis2=2).max())


def test_driving_on_teaches_about_the_past_and_forgets_nothing():
    before, after = STRAIGHT.pose_covariances, STRAIGHT.predict(np.array([[13.0, 3.0]])).pose_covariances
    traces = np.trace(after[: len(before)], axis1=1, axis2=2)
    assert (traces <= np.trace(before, axis1=1, axis2=2) + 1e-12).all()


def test_uncertainty_never_rises_along_a_way():
    """Each further place lets the robot see more or the same."""
    way = np.array([[9.0, 5.0], [9.0, 9.0], [14.0, 9.0], [14.0, 14.0], [3.0, 14.0], [3.0, 4.0]])
    values = [STRAIGHT.predict(way[: k + 1]).uncertainty for k in range(len(way))]
    assert values[0] < STRAIGHT.uncertainty
    assert all(later <= earlier + 1e-9 for earlier, later in itertools.pairwise(values)), values
    assert values[-1] < 0.5 * values[0]


def test_the_uncertainty_is_the_sum_over_the_virtual_map_of_which_no_cell_got_worse():
    prediction = STRAIGHT.predict(np.array([[12.0, 8.0]]))
    traces = prediction.virtual_map[..., 0] + prediction.virtual_map[..., 2]
    assert prediction.virtual_map.shape == STRAIGHT.virtual_map.shape
    assert prediction.uncertainty == pytest.approx(traces.sum())
    assert (traces <= STRAIGHT.virtual_traces + 1e-12).all()
    far = np.hypot(*(SCENARIO.grid.centres() - (12.0, 8.0)).T).reshape(10, 10) > 14.0
    np.testing.assert_array_equal(prediction.virtual_map[far], STRAIGHT.virtual_map[far])


def test_what_a_believed_wall_hides_is_not_expected_to_be_seen():
    walled = belief_of((3.0, 3.0), (9.0, 3.0), walls=[(0.0, 20.0, 6.0, 6.2)])
    way = np.array([[12.0, 3.0]])
    behind = np.s_[4:, :]
    np.testing.assert_array_equal(walled.predict(way).virtual_map[behind], walled.virtual_map[behind])
    open_ = STRAIGHT.predict(way).virtual_map[behind]
    assert (open_ < STRAIGHT.virtual_map[behind] - 1e-6).any()


def test_a_way_back_to_an_early_place_expects_a_closure_and_lowers_the_peak():
    """As long a way elsewhere expects none."""
    back, away = AROUND.predict(np.array([[3.0, 4.0]])), AROUND.predict(np.array([[11.0, 12.0]]))
    assert len(back.poses) == pytest.approx(len(away.poses), abs=6)
    assert back.sightings >= 1
    assert away.sightings == 0
    assert back.peak_trace < 0.8 * AROUND.peak_trace
    assert away.peak_trace > 0.95 * AROUND.peak_trace
    assert np.trace(back.pose_covariances[-1]) < 0.5 * np.trace(away.pose_covariances[-1])


def test_expected_closures_are_those_of_places_out_of_the_window():
    """A loop of fewer key poses than the window is none: the window matches it anyhow."""
    small = belief_of((3.0, 3.0), (9.0, 3.0), (9.0, 9.0), (3.0, 9.0), (3.0, 7.0))
    assert len(small.poses) + 10 < WINDOW
    assert small.predict(np.array([[3.0, 3.0]])).sightings == 0


def test_cells_and_metres_agree():
    """The first of several cells is where the robot is."""
    grid = SCENARIO.grid
    cells = np.array([grid.cell_of(*STRAIGHT.pose[:2]), grid.cell_of(11.0, 5.0), grid.cell_of(13.0, 7.0)])
    by_cells, by_metres = STRAIGHT.predict(cells), STRAIGHT.predict(grid.centres(cells[1:]))
    np.testing.assert_array_equal(by_cells.poses, by_metres.poses)
    np.testing.assert_array_equal(by_cells.pose_covariances, by_metres.pose_covariances)
    assert by_cells.uncertainty == by_metres.uncertainty
    assert by_cells.peak_trace == by_metres.peak_trace


def test_a_prediction_leaves_the_belief_as_it_was():
    before = STRAIGHT.virtual_map.copy(), STRAIGHT.poses.copy(), STRAIGHT.pose_covariances.copy(), STRAIGHT.graph.links
    prediction = STRAIGHT.predict(np.array([[12.0, 8.0]]))
    assert prediction.uncertainty < STRAIGHT.uncertainty
    np.testing.assert_array_equal(STRAIGHT.virtual_map, before[0])
    np.testing.assert_array_equal(STRAIGHT.poses, before[1])
    np.testing.assert_array_equal(STRAIGHT.pose_covariances, before[2])
    assert STRAIGHT.graph.links == before[3]
    assert prediction.landmark_covariances.shape == (0, 2, 2)
    assert compose(STRAIGHT.pose, (0.0, 0.0, 0.0)) == pytest.approx(STRAIGHT.pose)


def test_walls_hide_what_is_behind_them_and_range_ends_the_view():
    """A wall from (8, 0) to (8, 12): from the west, cells east of it are hidden, and seen around its end."""
    belief = belief_of((4.0, 4.0), (6.0, 4.0), walls=[(8.0, 8.3, 0.0, 12.0)])
    grid = belief.scenario.grid
    view = belief.view([[5.0, 5.0], [9.9, 5.0], [5.0, 15.0]])
    assert view.shape == (3, grid.cells)

    def sees(row, x, y):
        return bool(view[row, grid.cell_of(x, y)])

    assert sees(0, 5.0, 9.0)
    assert not sees(0, 10.9, 5.0), "behind the wall"
    assert sees(1, 10.9, 5.0)
    assert not sees(1, 5.0, 5.0)
    assert sees(2, 9.0, 15.0), "past the end of the wall"
    assert not (view & ~grid.in_reach(np.array([[5.0, 5.0], [9.9, 5.0], [5.0, 15.0]]), 6.0)).any()


def test_without_walls_the_view_is_what_is_in_reach():
    belief = belief_of((4.0, 4.0), (6.0, 4.0))
    places = np.array([[10.0, 10.0], [5.3, 12.1]])
    np.testing.assert_array_equal(belief.view(places), SCENARIO.grid.in_reach(places, SCENARIO.sensor_range))


def test_from_inside_a_wall_the_view_is_that_of_the_nearest_free_place():
    belief = belief_of((4.0, 4.0), (6.0, 4.0), walls=[(8.0, 8.5, 0.0, 12.0)])
    inside, beside = belief.view([[8.2, 5.0], [7.95, 5.0]])
    assert inside.sum() > 5
    np.testing.assert_array_equal(inside, beside)


def test_what_are_no_places_is_said():
    for wrong in ([1.0, 2.0], [[1.0, 2.0, 3.0]], [[np.nan, 2.0]]):
        with pytest.raises(ValueError, match="places"):
            STRAIGHT.view(wrong)
