"""SLAM on scripted drives: loops close where places are the same and only there, its map and its marginals follow."""

import itertools
import math

import gtsam
import numpy as np
import pytest
from lidar_worlds import cluttered, drawn, driven, errors_of, ranges_at, way_through

from explore_bench.geometry import between, compose
from explore_bench.robot.lidar.closures import LOOP_SPACING, chains
from explore_bench.robot.lidar.filtering import rotated
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.robot.lidar.matcher import LOOP, SEQUENTIAL, Match
from explore_bench.robot.lidar.pose_graph import PoseGraph, joins_of
from explore_bench.robot.lidar.slam import (
    ANCHOR_SPACING,
    SETTLE_SHARE,
    WINDOW,
    Slam,
    search_window,
)
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import RangeScan

SHORT = LidarScenario(size=14.0, sensor_range=4.0)
RING = [(2.0, 2.0), (12.0, 2.0), (12.0, 12.0), (2.0, 12.0), (2.0, 2.0)]


def ring_world():
    """A corridor of 2.4 m around a block, with posts along it."""
    rng = np.random.default_rng(4)
    posts = [(x, x + 0.3, y, y + 0.3) for x, y in [(0.9, 5.2), (12.9, 4.4), (5.6, 0.9), (8.1, 12.9), (3.0, 10.4)]]
    posts += [(x, x + w, 3.2, 3.2 + h) for x, w, h in zip((4.0, 6.5, 9.0), *rng.uniform(0.2, 0.5, (2, 3)), strict=True)]
    return drawn(
        14.0,
        *posts,
        free=[(0.8, 13.2, 0.8, 3.2), (0.8, 13.2, 10.8, 13.2), (0.8, 3.2, 0.8, 13.2), (10.8, 13.2, 0.8, 13.2)],
    )


@pytest.fixture(scope="module")
def looped():
    """Once around the ring and a bit more: the SLAM, the true poses and the shifts."""
    poses = way_through(*RING, (9.0, 2.0))
    slam, shifts = driven(ring_world(), poses, SHORT, seed=2)
    return slam, poses, shifts


def test_a_drive_around_a_loop_closes_it_rightly(looped):
    slam, poses, shifts = looped
    assert len(slam.poses) == len(slam.covariances) == len(poses)
    assert len(slam.closures) >= 2
    for closure in slam.closures:
        assert closure.robust
        assert closure.later - closure.earlier > WINDOW
        x, y, turn = between(between(poses[closure.earlier], poses[closure.later]), closure.motion)
        assert math.hypot(x, y) < 0.1
        assert abs(turn) < 0.01
    assert errors_of(slam, poses).max() < 0.2
    assert (np.array(shifts)[[closure.later - 1 for closure in slam.closures]] > 0.0).all()


def test_a_loop_is_closed_now_and_then_and_not_at_every_key_pose(looped):
    slam, _, _ = looped
    made = [closure.later for closure in slam.closures]
    assert all(other - one >= LOOP_SPACING for one, other in itertools.pairwise(made))


def test_a_closed_loop_brings_the_robot_nearer_to_where_it_is(looped):
    """Against the same drive without a search for loops."""
    slam, poses, _ = looped
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("explore_bench.robot.lidar.slam.chains_due", lambda *_: [])
        open_, shifts = driven(ring_world(), poses, SHORT, seed=2)
    assert not open_.closures
    assert not any(shifts)
    assert np.trace(slam.covariances[-1]) < 0.3 * np.trace(open_.covariances[-1])
    assert errors_of(slam, poses)[-5:].mean() < errors_of(open_, poses)[-5:].mean()


def test_links_that_agree_wait_and_those_that_do_not_move_the_graph_at_once(monkeypatch):
    """Three times around the ring: what the later rounds tell is little, and no link waits for longer than it may."""
    looks, look_back = [], Slam._look_back

    def watched(slam, first):
        disagreement = look_back(slam, first)
        looks.append((disagreement, slam._unsettled))
        return disagreement

    monkeypatch.setattr(Slam, "_look_back", watched)
    slam, shifts = driven(ring_world(), way_through(*RING, *RING[1:], *RING[1:]), SHORT, seed=2)
    assert len(looks) == len(shifts)
    settled, limit = np.array(shifts) > 0.0, 0.5 * SHORT.map_resolution
    waiting, disagreeing = (np.array(column) for column in zip(*[(u, d > limit) for d, u in looks], strict=True))
    assert disagreeing.sum() >= 1
    assert settled[disagreeing].all()
    assert not settled[~waiting].any()
    assert (waiting & ~settled).sum() >= 10
    waited = 0
    for newest, waits in enumerate(waiting & ~settled, start=1):
        waited = waited + 1 if waits else 0
        assert waited <= SETTLE_SHARE * newest
    assert slam._unsettled == (waiting & ~settled)[-1]


def test_covariances_are_those_of_the_graph_that_its_links_make(looped):
    slam, _, _ = looped
    graph = PoseGraph(tuple(slam.poses[0].tolist()))
    for pose in slam.poses[1:].tolist():
        graph.add_pose(tuple(pose))
    for link in slam.links:
        graph.add_link(link)
    expected, _ = graph.covariances()
    np.testing.assert_allclose(np.diag(slam.covariances[-1]), np.diag(expected[-1]), rtol=0.02)
    np.testing.assert_allclose(graph.optimize(), slam.poses, atol=0.03)  # matches since the last closure pull


def test_the_newest_covariance_is_exact_at_every_key_pose():
    """Before any closure, whether it was filtered or computed anew."""
    world, poses = cluttered(10.0, 12, 3, [(x, 5.0) for x in range(1, 10)]), way_through((1.0, 5.0), (9.0, 5.0))
    poses += way_through((9.0, 5.0), (1.0, 5.0))
    scenario = LidarScenario(size=10.0)
    checked = 0
    for count in range(2, len(poses), 6):
        slam, _ = driven(world, poses[:count], scenario)
        graph = PoseGraph(tuple(slam.poses[0].tolist()))
        for pose in slam.poses[1:].tolist():
            graph.add_pose(tuple(pose))
        for link in slam.links:
            graph.add_link(link)
        full = graph.covariances()[0][-1]
        scale = np.sqrt(np.outer(np.diag(full), np.diag(full)))
        np.testing.assert_allclose(slam.covariances[-1] / scale, full / scale, atol=0.02)
        np.testing.assert_allclose(np.diag(slam.covariances[-1]), np.diag(full), rtol=0.005)
        checked += 1
    assert checked >= 5


def test_every_key_pose_is_tied_to_the_one_before_and_to_an_anchor_in_its_window(looped):
    slam, poses, _ = looped
    for newest in range(1, len(poses)):
        odometry, match = [link for link in slam.links if link.later == newest][:2]
        assert odometry.earlier == newest - 1
        assert max(newest - WINDOW, 0) <= match.earlier < newest
        assert match.earlier % ANCHOR_SPACING == 0 or match.earlier == newest - 1


def assert_map_is_of_its_scans(slam):
    """It is the map built from nothing, of scans that lie within half a cell of where their poses are."""
    anew = GridMap(SHORT)
    for pose, placed, ranges in zip(slam.poses.tolist(), slam._placed, slam._ranges, strict=True):
        assert math.hypot(placed[0] - pose[0], placed[1] - pose[1]) <= 0.5 * SHORT.map_resolution
        assert abs(placed[2] - pose[2]) * 0.5 * SHORT.sensor_range <= 0.5 * SHORT.map_resolution
        anew.insert(placed, ranges)
    np.testing.assert_array_equal(slam.map.passes, anew.passes)
    np.testing.assert_array_equal(slam.map.hits, anew.hits)


def test_the_map_after_closures_is_the_one_built_anew(looped):
    assert_map_is_of_its_scans(looped[0])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_scans_that_a_closure_moves_are_traced_anew(axis):
    """A closure by hand that bends the whole drive, some of it by less than half a cell."""
    poses = way_through(*RING)
    slam, _ = driven(ring_world(), poses, SHORT)
    before, bend = slam.map.hits.copy(), np.zeros((len(poses), 3))
    bend[:, axis] = np.linspace(0.0, 0.1 if axis == 2 else 0.4, len(poses))
    slam.poses = slam.poses + bend
    slam._replace()
    assert (slam.map.hits != before).sum() > 100
    assert slam._placed[1] != tuple(slam.poses[1].tolist()), "what hardly moved stays"
    assert_map_is_of_its_scans(slam)


def test_a_match_tames_the_odometry_s_bias():
    """Ten metres straight on and back with a scale error of 1.5 %, which alone is off by 15 cm at the far end."""
    poses = way_through((1.5, 5.0), (8.5, 5.0)) + way_through((8.5, 5.0), (1.5, 5.0))
    world = cluttered(10.0, 12, 3, [pose[:2] for pose in poses])
    slam, _ = driven(world, poses, LidarScenario(size=10.0), bias=0.015)
    assert errors_of(slam, poses).max() < 0.03
    assert slam.unmatched == 0


def test_a_featureless_corridor_costs_no_more_than_odometry_does():
    """14 m with a bias of 1.5 %: no edge is off by more than 5 cm, and the pose says along which axis it may be."""
    world = drawn(16.0, free=[(0.5, 15.5, 7.0, 9.0)])
    poses = way_through((4.5, 8.0), (11.5, 8.0))
    slam, _ = driven(world, poses, LidarScenario(size=16.0, sensor_range=3.5), bias=0.015)
    for (one, other), (est, est_other) in zip(
        itertools.pairwise(poses), itertools.pairwise([tuple(p) for p in slam.poses.tolist()]), strict=True
    ):
        x, y, _ = between(between(one, other), between(est, est_other))
        assert math.hypot(x, y) < 0.05
    assert errors_of(slam, poses)[-1] < 0.25
    assert slam.covariances[-1, 0, 0] > 10.0 * slam.covariances[-1, 1, 1]


def twin_rooms():
    """Two rooms with the same furniture in the same places, wall to wall, and a corridor around from door to door."""
    furniture = [(0.3, 0.9, 2.2, 2.6), (2.3, 2.7, 0.4, 1.5), (0.2, 0.5, 0.3, 0.6)]
    rooms, boxes = [(0.5, 3.5, 1.0, 4.0), (3.6, 6.6, 1.0, 4.0)], []
    for x0, _, y0, _ in rooms:
        boxes += [(x0 + a, x0 + b, y0 + c, y0 + d) for a, b, c, d in furniture]
    free = [*rooms, (1.6, 2.6, 4.0, 13.0), (1.6, 10.9, 12.0, 13.0), (9.9, 10.9, 4.0, 13.0), (4.7, 5.7, 3.9, 5.4)]
    return drawn(14.0, *boxes, free=[*free, (4.7, 10.9, 4.4, 5.4)])


TWINS = [(2.1, 1.5), (2.1, 12.5), (10.4, 12.5), (10.4, 4.9), (5.2, 4.9), (5.2, 1.4), (5.2, 2.6)]


def test_two_identical_rooms_close_no_loop(monkeypatch):
    """They are 3.1 m apart and 30 m by the way between, so that each is tried against the other."""
    monkeypatch.setattr("explore_bench.robot.lidar.slam.WINDOW", 30)
    poses = way_through(*TWINS) + way_through((5.2, 2.6), (5.2, 1.4), (5.6, 1.7), (5.2, 1.4), (5.2, 2.6))
    slam, _ = driven(twin_rooms(), poses, SHORT)
    tried = 0
    for newest in range(len(poses) - 12, len(poses)):
        links = joins_of([link for link in slam.links if link.later <= newest])
        tried += any(not chain.linked for chain in chains(slam.poses[: newest + 1], links, newest - 30))
    assert tried >= 4, "the other room is looked at"
    assert slam.closures == []
    assert errors_of(slam, poses).max() < 0.3


def test_the_twins_would_be_taken_for_one_where_the_robot_believes_that_it_is_there():
    """What keeps them apart is where they are: scans of the one match the other's."""
    world = twin_rooms()
    one, other = (ranges_at(world, (x, 2.6, 0.0), reach=1.4) for x in (2.1, 5.2))
    both = np.isfinite(one) & np.isfinite(other)
    assert both.sum() > 70
    assert np.median(np.abs(one[both] - other[both])) < 0.02


def returned(before, after, drift):
    """SLAM of a robot that comes back to where it was, off by a drift [m], and finds the world as it is `after`.

    On the way it sees nothing, so that odometry alone, which is off, leads back.
    """
    out = way_through((2.0, 5.0), (7.0, 5.0))
    scenario = LidarScenario(size=10.0)
    slam, _ = driven(before, out, scenario)
    nothing = RangeScan(np.full(360, np.inf))
    away = [(7.0 + 0.5 * k, 5.0, 0.0) for k in range(1, 16)]
    back = [(2.0 + 0.5 * k, 5.0, 0.0) for k in range(11)]
    last = out[-1]
    for pose in [*away, *back]:
        motion = between(last, pose)
        if pose is back[0]:
            motion = (motion[0] + drift, *motion[1:])
        scan = RangeScan(ranges_at(after, pose)) if pose in back else nothing
        slam.update(motion, abs(motion[0]), 0.0, scan)
        last = pose
    return slam, [*out, *away, *back]


PLACES = [(x, 5.0) for x in np.arange(2.0, 7.1, 0.5)]


@pytest.fixture
def short_window(monkeypatch):
    monkeypatch.setattr("explore_bench.robot.lidar.slam.WINDOW", 12)


@pytest.mark.parametrize(("drift", "closes"), [(0.4, True), (0.56, False)])
def test_a_loop_is_closed_where_it_moves_the_robot_by_no_more_than_half_a_metre(short_window, drift, closes):
    """The search itself would find the place up to 0.6 m away."""
    world = cluttered(10.0, 12, 3, PLACES)
    slam, _ = returned(world, world, drift)
    assert bool(slam.closures) == closes


def test_no_loop_is_closed_where_the_place_looks_another(short_window):
    """The robot believes that it is back where it was, and it sees other furniture in the same room."""
    slam, _ = returned(cluttered(10.0, 12, 3, PLACES), cluttered(10.0, 12, 8, PLACES), 0.1)
    assert slam.closures == []
    assert slam.unmatched == 0


def test_no_loop_is_closed_in_a_corridor_whose_length_tells_nothing(short_window):
    """The match is good, moves the robot by a few centimetres, and is open along the corridor."""
    world = drawn(24.0, free=[(0.0, 24.0, 4.0, 6.0)])
    scenario = LidarScenario(size=24.0, sensor_range=3.0)
    slam, _ = driven(world, way_through((6.0, 5.0), (17.5, 5.0)), scenario, seed=2)
    for pose in way_through((6.0, 5.0), (14.0, 5.0)):
        motion = between(slam.pose, pose)
        slam.update(motion, abs(motion[0]), 0.0, RangeScan(ranges_at(world, pose, reach=3.0)))
    assert slam.unmatched == 0
    assert slam.closures == []


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("sigmas", "near"), [(4.9, True), (5.1, False)])
def test_no_loop_is_closed_five_standard_deviations_from_where_the_graph_has_the_pose(looped, sigmas, near, axis):
    """Those of the relative pose, by differences of gtsam's joint covariance, and of the match together."""
    slam, _, _ = looped
    earlier, newest = 20, len(slam.poses) - 1
    both = gtsam.Marginals(slam._graph._graph, slam._graph._values).jointMarginalCovariance([earlier, newest])
    joint = np.block([[both.at(i, j) for j in (earlier, newest)] for i in (earlier, newest)])
    one, other = (tuple(slam.poses[number].tolist()) for number in (earlier, newest))
    seen, step = between(one, other), 1e-6

    def moved(column):
        errors = np.zeros(6)
        errors[column] = step
        return between(seen, between(compose(one, tuple(errors[:3])), compose(other, tuple(errors[3:]))))

    carry = np.array([moved(column) for column in range(6)]).T / step
    own = np.diag([0.03, 0.02, 0.01]) ** 2
    spread = carry @ joint @ carry.T + own
    error = np.zeros(3)
    error[axis] = sigmas / math.sqrt(np.linalg.inv(spread)[axis, axis])
    match = Match(compose(other, tuple(error)), 0.9, rotated(own, other[2]), earlier)
    assert slam._compatible(match) == near


def test_a_loop_is_closed_only_where_it_is_compatible(monkeypatch):
    asked = []
    monkeypatch.setattr(Slam, "_compatible", lambda slam, match: asked.append(match.frame))
    slam, _ = driven(ring_world(), way_through(*RING, (9.0, 2.0)), SHORT, seed=2)
    assert asked
    assert slam.closures == []


@pytest.mark.parametrize("seed", range(3))
def test_after_a_blind_stretch_the_robot_stays_as_unsure_as_odometry_left_it(seed):
    """Posts at both ends of a hall, and 5 m between them where nothing is in range: what is seen then is new.

    Matches tell where the robot is among the new posts, and nothing of where those are.
    """
    places = [
        (2, 8),
        (3, 12),
        (4.2, 8.3),
        (5, 11.2),
        (1.2, 10.6),
        (15, 8.2),
        (16.1, 11.3),
        (17, 8.7),
        (18.2, 11),
        (14.5, 12),
    ]
    world = drawn(20.0, *[(x, x + 0.3, y, y + 0.4) for x, y in places])
    poses = way_through((3.0, 10.0), (17.0, 10.0))
    slam, _ = driven(world, poses, LidarScenario(size=20.0, sensor_range=3.0), seed=seed)
    told = [link.later for link in slam.links]
    matched = [number for number in range(len(poses)) if told.count(number) > 1]
    blind = [number for number in range(10, 20) if number not in matched]
    assert len(blind) >= 7
    assert set(range(22, len(poses))) <= set(matched)
    sigmas = np.sqrt(np.trace(slam.covariances[:, :2, :2], axis1=1, axis2=2))
    assert sigmas[-1] >= 0.8 * sigmas[16]
    error = slam.poses[-1] - np.array(poses[-1])
    assert error @ np.linalg.solve(slam.covariances[-1], error) < 30.0


def test_what_matches_nothing_leaves_odometry_alone_and_is_counted():
    world = cluttered(10.0, 10, 1, [(5.0, 5.0)])
    scenario = LidarScenario(size=10.0)
    slam = Slam(scenario, (5.0, 5.0, 0.0), RangeScan(ranges_at(world, (5.0, 5.0, 0.0))))
    nothing = RangeScan(np.full(360, np.inf))
    for count in (1, 2):
        slam.update((0.5, 0.0, 0.1), 0.5, 0.1, nothing)
        assert slam.unmatched == count
    assert slam.pose == pytest.approx(compose(compose((5.0, 5.0, 0.0), (0.5, 0.0, 0.1)), (0.5, 0.0, 0.1)))
    assert [(link.earlier, link.later) for link in slam.links] == [(0, 1), (1, 2)]
    slam.update((0.0, 0.0, 0.0), 0.0, 0.0, RangeScan(ranges_at(world, slam.pose)))
    assert slam.unmatched == 0


def test_equal_scans_give_equal_estimates(looped):
    slam, poses, _ = looped
    again, _ = driven(ring_world(), poses, SHORT, seed=2)
    np.testing.assert_array_equal(again.poses, slam.poses)
    np.testing.assert_array_equal(again.covariances, slam.covariances)
    np.testing.assert_array_equal(again.map.passes, slam.map.passes)


def test_a_bias_that_was_learned_is_made_up_for_where_nothing_matches():
    """Odometry that is 1.5 % short: after ten metres among posts a blind metre is a metre."""
    world = cluttered(20.0, 40, 5, [(x, 10.0) for x in np.arange(2.0, 18.0, 0.5)])
    poses = way_through((2.5, 10.0), (16.5, 10.0))
    slam, _ = driven(world, poses, LidarScenario(size=20.0, odometry_noise=0.0, heading_noise=0.0), bias=-0.015)
    assert slam.odometry.scales[0] == pytest.approx(1.0 / 0.985, abs=0.004)
    last = slam.pose
    slam.update((0.985, 0.0, 0.0), 1.0, 0.0, RangeScan(np.full(360, np.inf)))
    assert math.hypot(slam.pose[0] - last[0], slam.pose[1] - last[1]) == pytest.approx(1.0, abs=0.004)


def test_a_match_searches_as_far_as_odometry_may_have_erred():
    still = np.diag(np.square((0.01, 0.01, 0.01)))
    assert search_window(still) == SEQUENTIAL
    wide = search_window(np.diag(np.square((0.1, 0.02, 0.1))))
    assert wide.reach == pytest.approx(0.3)
    assert wide.turn == pytest.approx(0.3)
    assert search_window(np.eye(3)).reach == LOOP.reach, "and no farther than a field is wide"
    assert search_window(np.eye(3)).turn < math.pi


def test_a_turn_that_odometry_measured_badly_is_found():
    """9° off, under five times the noise: a search of ±6° would have lost the robot for good."""
    world = cluttered(14.0, 20, 2, [(7.0, 7.0)])
    scenario = LidarScenario(size=14.0, odometry_noise=0.06, heading_noise=0.1)
    slam = Slam(scenario, (7.0, 7.0, 0.0), RangeScan(ranges_at(world, (7.0, 7.0, 0.0))))
    slam.update((0.0, 0.0, 0.5), 0.0, 0.5, RangeScan(ranges_at(world, (7.0, 7.0, 0.66))))
    assert slam.pose[2] == pytest.approx(0.66, abs=0.01)
