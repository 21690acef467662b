"""Scan matching against the truth: dense rooms, far walls, corridors, thin walls, and what its covariance says."""

import math

import numpy as np
import pytest
from lidar_worlds import cluttered, drawn, surfaces_at

from explore_bench.geometry import Grid, between
from explore_bench.robot.lidar.matcher import (
    FIELD_RESOLUTION,
    LOOP,
    POINT_SPACING,
    SMEAR,
    Matcher,
    Surfaces,
    Window,
    response,
    search,
    smear,
    surfaces_of,
)

NO_PRIOR = np.zeros((3, 3))
SIGMA = 0.01


def matched(world, seen_from, taken_at, prediction, information=NO_PRIOR, reach=10.0, seed=0, **options):
    """Match of a noisy scan with those of key frames whose poses are true."""
    rng = np.random.default_rng(seed)
    frames = [surfaces_at(world, pose, reach, SIGMA, rng) for pose in seen_from]
    hits = surfaces_at(world, taken_at, reach, SIGMA, rng).hits
    return match_with(frames, seen_from, hits, prediction, information, reach=reach, **options)


def match_with(frames, poses, hits, prediction, information=NO_PRIOR, reach=10.0, **options):
    """Match of a scan with frames at these poses."""
    matcher = Matcher(reach)
    for frame in frames:
        matcher.keep(frame)
    return matcher.match(hits, prediction, information, 0, np.array(poses), **options)


def off(pose, x, y, heading):
    return pose[0] + x, pose[1] + y, pose[2] + heading


def error(match, truth):
    """Distance [m] and turn [rad] of a match from where the scan was taken."""
    x, y, turn = between(truth, match.pose)
    return math.hypot(x, y), abs(turn)


# Surfaces


def test_hits_are_where_the_beams_ended_in_range():
    ranges = np.array([2.0, 3.0, np.inf, 5.1])
    hits = surfaces_of(ranges, 5.0).hits
    np.testing.assert_allclose(hits, [[2.0, 0.0], [0.0, 3.0]], atol=1e-12)


def test_a_wall_becomes_a_line_without_gaps_whose_normals_look_at_the_lidar():
    """A wall 9 m ahead, of which the hits are 16 cm apart."""
    angles = math.tau * np.arange(360) / 360
    ahead = np.abs(np.angle(np.exp(1j * angles))) < 0.3
    ranges = np.where(ahead, 9.0 / np.cos(angles), np.inf)
    surfaces = surfaces_of(ranges, 10.0)
    order = np.argsort(surfaces.points[:, 1])
    np.testing.assert_allclose(surfaces.points[:, 0], 9.0, atol=1e-9)
    assert np.diff(surfaces.points[order, 1]).max() <= POINT_SPACING + 1e-9
    assert np.ptp(surfaces.points[:, 1]) == pytest.approx(np.ptp(surfaces.hits[:, 1]))
    np.testing.assert_allclose(surfaces.normals, np.tile((-1.0, 0.0), (len(surfaces.normals), 1)), atol=1e-9)
    assert np.diff(np.sort(surfaces.hits[:, 1])).max() > 0.15


def test_the_first_and_the_last_beam_are_neighbours():
    room = np.full(360, 3.0)
    surfaces = surfaces_of(room, 10.0)
    assert len(surfaces.hits) == 360
    assert (np.hypot(*surfaces.normals.T) > 0.99).all()


@pytest.mark.parametrize(("near", "far"), [(2.0, 3.0), (2.0, 2.3), (1.0, 1.2), (4.0, 6.0)])
def test_two_objects_one_behind_the_other_are_not_joined(near, far):
    ranges = np.full(360, np.inf)
    ranges[10:20], ranges[20:30] = near, far
    points = surfaces_of(ranges, 10.0).points
    distances = np.hypot(*points.T)
    assert not np.any((distances > near + 1e-9) & (distances < far - 0.01 * far))
    assert (distances <= near + 1e-9).sum() >= 10
    assert (distances >= far - 0.01 * far).sum() >= 10


def test_two_objects_side_by_side_are_not_joined_across_the_gap():
    """Two posts 40 cm apart, with beams between that return nothing; and two far hits more than half a metre apart."""
    ranges = np.full(360, np.inf)
    ranges[0:5], ranges[12:17] = 3.0, 3.0
    angles = np.arctan2(*surfaces_of(ranges, 10.0).points.T[::-1])
    assert not np.any((angles > math.radians(4.1)) & (angles < math.radians(11.9)))
    few = np.full(8, 3.0)
    assert len(surfaces_of(few, 10.0).points) == 8


def test_a_lone_hit_faces_nowhere():
    ranges = np.full(360, np.inf)
    ranges[7] = 2.0
    surfaces = surfaces_of(ranges, 10.0)
    assert len(surfaces.points) == 1
    assert not surfaces.normals.any()


# The field


def field_of(frames, poses, viewpoint, side=400):
    grid = Grid(side, side, FIELD_RESOLUTION, -0.5 * side * FIELD_RESOLUTION, -0.5 * side * FIELD_RESOLUTION)
    field = np.full((side, side), 7.0, dtype=np.float32)
    points, normals = np.concatenate([f.points for f in frames]), np.concatenate([f.normals for f in frames])
    starts = np.cumsum([0] + [len(f.points) for f in frames])
    owners = np.zeros((side, side), dtype=np.int16)
    smear(points, normals, starts, np.array(poses, dtype=float), viewpoint, field, owners, grid)
    return field, owners, grid


def test_the_field_of_a_point_is_a_gaussian_around_it():
    point = np.array([[0.613, -0.207]])
    frame = Surfaces(point, point, np.zeros((1, 2)))
    field, _, grid = field_of([frame], [(1.0, 0.5, math.pi / 2)], (0.0, 0.0, 0.0))
    x, y = 1.0 + 0.207, 0.5 + 0.613
    away = np.hypot(*(grid.centres() - (x, y)).T).reshape(field.shape)
    expected = np.exp(-0.5 * (away / SMEAR) ** 2)
    near = away <= 2.0 * SMEAR - FIELD_RESOLUTION
    np.testing.assert_allclose(field[near], expected[near], atol=0.02)
    assert near.sum() > 20
    assert not field[away > 4.0 * SMEAR].any(), "the field was cleared before"


def test_where_two_surfaces_meet_the_nearer_one_counts():
    points = np.array([[0.0, 0.0], [0.06, 0.0]])
    both, *_ = field_of([Surfaces(points, points, np.zeros((2, 2)))], [(0.0, 0.0, 0.0)], (0.0, 0.0, 0.0))
    singles = [
        field_of([Surfaces(p, p, np.zeros((1, 2)))], [(0.0, 0.0, 0.0)], (0.0, 0.0, 0.0))[0]
        for p in (points[:1], points[1:])
    ]
    np.testing.assert_array_equal(both, np.maximum(*singles))


def test_a_scan_s_response_is_the_mean_over_its_points():
    wall = np.column_stack((np.full(41, 1.0), np.linspace(-1.0, 1.0, 41)))
    field, _, grid = field_of([Surfaces(wall, wall, np.zeros((41, 2)))], [(0.0, 0.0, 0.0)], (0.0, 0.0, 0.0))
    on = np.array([[1.0, 0.3], [1.0, -0.4]])
    full = response((0.0, 0.0, 0.0), on, field, grid)
    assert full > 0.9
    beside = np.array([[1.0, 0.3], [1.0, -0.4], [0.3, 0.0], [0.2, 0.0]])
    assert response((0.0, 0.0, 0.0), beside, field, grid) == pytest.approx(0.5 * full)
    assert response((-1.0, 0.0, 0.0), on + (1.0, 0.0), field, grid) == pytest.approx(full)
    assert response((100.0, 0.0, 0.0), on, field, grid) == 0.0
    assert response((0.0, 0.0, 0.0), np.empty((0, 2)), field, grid) == 0.0


# Matching


def test_in_a_dense_room_a_scan_finds_its_place():
    """Ten key frames of 1 cm noise, and a prediction that is off by up to 10 cm and 4°."""
    places = [(1.0 + 0.5 * k, 5.0, 0.3 * k) for k in range(10)]
    away, turned = [], []
    for seed in range(20):
        world = cluttered(seed=seed, clear=[place[:2] for place in places])
        rng = np.random.default_rng(seed)
        truth = (rng.uniform(2.0, 5.0), 5.0 + rng.uniform(-0.2, 0.2), rng.uniform(-3.0, 3.0))
        wrong = off(truth, *rng.uniform(-0.1, 0.1, 2), rng.uniform(-0.07, 0.07))
        match = matched(world, places, truth, wrong, seed=seed)
        x, y = error(match, truth)
        away.append(x)
        turned.append(y)
        assert match.response > 0.8
    assert max(away) < 0.005, away
    assert max(turned) < 0.002, turned


def test_matches_have_no_bias():
    """Not even one of a millimetre: a window of matches drifts by the sum of theirs."""
    errors = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        places = [(5.0 + 0.3 * k, 5.0 + rng.uniform(-0.2, 0.2), rng.uniform(-3.0, 3.0)) for k in range(-6, 7)]
        world = cluttered(seed=seed, clear=[place[:2] for place in places])
        truth = (5.0 + rng.uniform(-0.3, 0.3), 5.0 + rng.uniform(-0.3, 0.3), rng.uniform(-3.0, 3.0))
        wrong = off(truth, *rng.uniform(-0.05, 0.05, 2), rng.uniform(-0.03, 0.03))
        pose = np.array(matched(world, places, truth, wrong, seed=seed).pose) - truth
        errors.append((*pose[:2], math.remainder(pose[2], math.tau)))
    assert np.abs(np.mean(errors, axis=0)).max() < 0.0006, np.mean(errors, axis=0)
    assert np.std(errors, axis=0).max() < 0.002


def test_a_loop_s_search_finds_what_is_half_a_metre_away():
    world = cluttered(seed=1, clear=[(5.0, 5.0)])
    truth = (5.2, 4.9, 1.0)
    match = matched(world, [(5.0, 5.0, 0.0)], truth, off(truth, 0.42, -0.31, math.radians(9.0)), window=LOOP)
    assert error(match, truth)[0] < 0.02
    assert error(match, truth)[1] < 0.005


def test_a_scan_10_m_from_every_wall_does_not_lock_onto_the_beads():
    """Between two hits of the key frame there is wall too: without it the same scan is drawn to the hits."""
    world = drawn(20.0)
    seen_from = (10.0, 10.0, 0.0)
    filled, beads = [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = (10.0 + rng.uniform(-0.15, 0.15), 10.0 + rng.uniform(-0.15, 0.15), rng.uniform(-0.02, 0.02))
        frame = surfaces_at(world, seen_from, 12.0, SIGMA, rng)
        hits = surfaces_at(world, truth, 12.0, SIGMA, rng).hits
        bare = Surfaces(frame.hits, frame.hits, np.zeros_like(frame.hits))
        for errors, given in ((filled, frame), (beads, bare)):
            match = match_with([given], [seen_from], hits, truth, reach=12.0)
            errors.append(error(match, truth)[0])
    assert max(filled) < 0.01, filled
    assert np.mean(beads) > 2.0 * np.mean(filled)


CORRIDOR = drawn(14.0, free=[(0.0, 14.0, 6.0, 8.0)])
ALONG = (0.01, 0.01, 0.005)
PRIOR = np.diag(1.0 / np.square(ALONG))


def in_a_corridor(prediction, information, seed=0):
    """Ranges of 5 m show no end of the 14 m."""
    seen_from = [(5.5 + 0.5 * k, 7.0, 0.0) for k in range(3)]
    return matched(CORRIDOR, seen_from, (7.0, 7.1, 0.0), prediction, information, reach=5.0, seed=seed)


def test_along_a_featureless_corridor_a_match_is_open_and_across_it_is_not():
    covariance = in_a_corridor((7.0, 7.1, 0.0), NO_PRIOR).covariance
    assert math.sqrt(covariance[0, 0]) > 0.5
    assert math.sqrt(covariance[1, 1]) < 0.03
    assert covariance[0, 0] > 100.0 * covariance[1, 1]


def test_the_covariance_of_a_slanted_corridor_stretches_along_it():
    """The same corridor, seen by a robot whose world is turned by 30°."""
    rng = np.random.default_rng(0)
    turn = math.radians(30.0)
    c, s = math.cos(turn), math.sin(turn)
    seen_from = [(6.5, 6.9, 0.05), (6.0, 7.1, 0.0)]
    frames = [surfaces_at(CORRIDOR, pose, 5.0, SIGMA, rng) for pose in seen_from]
    hits = surfaces_at(CORRIDOR, (7.0, 7.0, 0.0), 5.0, SIGMA, rng).hits
    *poses, truth = [(c * x - s * y, s * x + c * y, heading + turn) for x, y, heading in (*seen_from, (7.0, 7.0, 0.0))]
    match = match_with(frames, poses, hits, truth, reach=5.0)
    values, axes = np.linalg.eigh(match.covariance[:2, :2])
    assert values[1] > 100.0 * values[0]
    assert abs(axes[:, 1] @ (c, s)) > 0.999


def test_the_prior_holds_a_corridor_s_open_direction():
    """The error along is that of odometry, 1.5 % of a drive, and nothing that the search adds."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        wrong = off((7.0, 7.1, 0.0), rng.uniform(-0.03, 0.03), rng.uniform(-0.08, 0.08), rng.uniform(-0.03, 0.03))
        weak = np.diag(1.0 / np.square((0.01, 0.1, 0.05)))
        match = in_a_corridor(wrong, weak, seed)
        assert abs(match.pose[0] - wrong[0]) < 2.0 * ALONG[0]
        assert abs(match.pose[0] - 7.0) < 0.05
        assert abs(match.pose[1] - 7.1) < 0.01
        assert abs(match.pose[2]) < 0.005


def test_a_prior_pulls_as_far_as_it_is_sure():
    """It is no penalty of its own: where the scan is sure, an honest prior changes little, an iron one all."""
    world, truth = cluttered(seed=1, clear=[(5.0, 5.0)]), (5.0, 5.0, 0.0)
    wrong = off(truth, 0.06, 0.0, 0.0)
    honest, iron = (
        matched(world, [truth], truth, wrong, np.diag((1.0 / s**2, 1.0 / s**2, 1.0 / s**2))) for s in (0.05, 1e-4)
    )
    assert error(honest, truth)[0] < 0.01
    assert abs(iron.pose[0] - wrong[0]) < 0.002


def test_a_prior_s_axes_are_the_world_s():
    """An information with a cross term draws along its own axis: nothing else is on the field."""
    grid = Grid(200, 200, FIELD_RESOLUTION, -2.5, -2.5)
    field = np.zeros((200, 200), dtype=np.float32)
    information = np.diag((1e4, 1e4, 1e4))
    pose, found, _ = search(np.array([[1.0, 0.0]]), (0.3, 0.2, 0.1), information, Window(0.1, 0.1, 0.05), field, grid)
    assert pose == pytest.approx((0.3, 0.2, 0.1))
    assert found == 0.0


THIN = drawn(8.0, (0.0, 8.0, 3.95, 4.05))
"""A wall of 10 cm across a room, to be seen from below and from above."""


def test_a_thin_wall_attracts_nothing_from_its_other_side():
    below, above = (4.0, 3.0, 0.0), (4.0, 5.0, 0.0)
    frame = surfaces_at(THIN, below, 2.5)
    same, _, grid = field_of([frame], [(0.0, -1.0, 0.0)], (0.5, -1.2, 0.0))
    other, *_ = field_of([frame], [(0.0, -1.0, 0.0)], (0.0, 1.0, 0.0))
    wall = np.abs(grid.centres()[:, 1] + 0.05).reshape(same.shape) < 0.03
    assert same[wall].max() > 0.9
    assert not other[wall].any()
    rng = np.random.default_rng(0)
    hits = surfaces_at(THIN, above, 2.5, SIGMA, rng).hits
    nowhere = match_with([frame], [below], hits, above, reach=2.5)
    assert nowhere.response < 0.02
    seen = surfaces_at(THIN, (4.5, 5.0, 1.0), 2.5)
    beside = match_with([frame, seen], [below, (4.5, 5.0, 1.0)], hits, above, reach=2.5)
    assert abs(beside.pose[1] - above[1]) < 0.005


def test_a_match_is_measured_against_the_frame_that_first_saw_what_it_lies_on():
    """Frames of two rooms, of which the scan sees one; and of three frames of the same place the first."""
    world = drawn(12.0, (5.9, 6.1, 0.0, 12.0))
    left, right = [(2.0 + 0.3 * k, 5.0, 0.0) for k in range(3)], [(9.0 + 0.3 * k, 5.0, 0.0) for k in range(4)]
    assert matched(world, left, (2.2, 5.1, 0.2), (2.2, 5.1, 0.2)).frame == 0
    assert matched(world, [*left, *right], (9.2, 5.1, 0.2), (9.2, 5.1, 0.2)).frame == 3
    assert matched(world, [*right, *left], (2.2, 5.1, 0.2), (2.2, 5.1, 0.2)).frame == 4
    assert matched(world, left, (9.2, 5.1, 0.2), (9.2, 5.1, 0.2), reach=2.0).frame == 2, (
        "where it lies on none, the last"
    )


def test_a_scan_of_another_place_matches_little():
    here, there = cluttered(seed=1, clear=[(5.0, 5.0)]), cluttered(seed=2, clear=[(5.0, 5.0)])
    frame = surfaces_at(here, (5.0, 5.0, 0.0), 4.0)
    hits = surfaces_at(there, (5.0, 5.0, 0.0), 4.0).hits
    pose = (5.0, 5.0, 0.0)
    assert match_with([frame], [pose], hits, pose, reach=4.0, window=LOOP).response < 0.6


def test_a_scan_of_nothing_matches_nothing_and_moves_nowhere():
    frame = surfaces_at(THIN, (4.0, 3.0, 0.0))
    pose = (4.0, 3.0, 0.0)
    match = match_with([frame], [pose], np.empty((0, 2)), pose, PRIOR)
    assert match.response == 0.0
    assert match.pose == pytest.approx(pose)


def test_every_climb_ends_near_to_where_it_began():
    """A handful of points in a field of others has many tops, flat ones and sharp ones; none is climbed for ever."""
    rng = np.random.default_rng(0)
    grid = Grid(120, 120, FIELD_RESOLUTION, -1.5, -1.5)
    field, owners = np.zeros((120, 120), dtype=np.float32), np.zeros((120, 120), dtype=np.int16)
    window = Window(0.1, 0.1, 0.05)
    for _ in range(300):
        points = rng.uniform(-1.0, 1.0, (rng.integers(1, 40), 2))
        starts = np.array([0, len(points)])
        smear(points, np.zeros_like(points), starts, np.zeros((1, 3)), (0.0, 0.0, 0.0), field, owners, grid)
        hits = points[rng.integers(0, len(points), rng.integers(1, 12))] + rng.normal(0.0, 0.02, 2)
        information = np.diag(rng.choice([0.0, 1e2, 1e4, 1e8], 3))
        pose, found, covariance = search(hits, (0.0, 0.0, 0.0), information, window, field, grid)
        assert np.abs(pose[:2]).max() <= 0.1 + 0.1 + 1e-9
        assert abs(pose[2]) <= 0.1 + 0.05 + 1e-9
        assert 0.0 <= found <= 1.0
        assert (np.linalg.eigvalsh(covariance) > 0.0).all()


def test_the_error_of_matches_is_what_their_covariance_says():
    """Normalized squared errors of 3 degrees of freedom over rooms: not far above 3, nor as good as nothing."""
    squared = []
    for seed in range(40):
        world = cluttered(seed=seed, clear=[(5.0, 5.0)])
        rng = np.random.default_rng(seed)
        truth = (5.0 + rng.uniform(-0.2, 0.2), 5.0 + rng.uniform(-0.2, 0.2), rng.uniform(-3.0, 3.0))
        match = matched(world, [(5.0, 5.0, 0.0)], truth, off(truth, 0.03, -0.02, 0.01), seed=seed)
        wrong = np.array(match.pose) - truth
        wrong[2] = math.remainder(wrong[2], math.tau)
        squared.append(float(wrong @ np.linalg.solve(match.covariance, wrong)))
    assert 0.2 < np.mean(squared) < 9.0, np.mean(squared)


def test_equal_scans_give_equal_matches():
    one, other = (in_a_corridor((7.02, 7.13, 0.01), PRIOR) for _ in range(2))
    assert one.pose == other.pose
    assert one.response == other.response
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_match_looks_only_at_the_frames_that_it_is_given():
    """Others, kept before and after them, change nothing, and neither does what was matched before."""
    world, pose = cluttered(seed=1, clear=[(5.0, 5.0)]), (5.0, 5.0, 0.0)
    frames = [surfaces_at(world, (5.0, 5.0 + 0.1 * k, 0.0)) for k in range(3)]
    poses = np.array([(5.0, 5.0 + 0.1 * k, 0.0) for k in range(3)])
    other = surfaces_at(cluttered(seed=2, clear=[(5.0, 5.0)]), pose)
    used = Matcher(10.0)
    for frame in (other, other, *frames, other):
        used.keep(frame)
    used.match(other.hits, pose, NO_PRIOR, 0, np.array([pose, pose]))
    again = used.match(frames[0].hits, pose, NO_PRIOR, 2, poses)
    alone = match_with(frames, poses, frames[0].hits, pose)
    assert again.pose == alone.pose
    assert again.response == alone.response
    assert again.frame == alone.frame + 2


def test_the_field_is_the_highest_of_all_bells_and_its_owner_who_first_reached_half():
    rng = np.random.default_rng(0)
    frames = [Surfaces(points, points, np.zeros_like(points)) for points in rng.uniform(-0.4, 0.4, (5, 12, 2))]
    poses = [(0.1 * k, 0.05 * k, 0.3 * k) for k in range(5)]
    field, owners, grid = field_of(frames, poses, (0.0, 0.0, 0.0))
    bells = []
    for (x, y, heading), frame in zip(poses, frames, strict=True):
        c, s = math.cos(heading), math.sin(heading)
        places = frame.points @ np.array([[c, s], [-s, c]]) + (x, y)
        away = np.abs(grid.centres()[:, None] - places[None])
        bell = np.exp(-0.5 * (away**2).sum(axis=2) / SMEAR**2)
        bells.append(np.where((away < 0.11).all(axis=2), bell, 0.0).max(axis=1).reshape(field.shape))
    near = np.maximum.accumulate(bells)
    assert np.abs(field - near[-1])[(near[-1] > 0.2) & (near[-1] < 0.97)].max() < 0.05
    sure = near[-1] > 0.6
    first = (near > 0.5).argmax(axis=0)
    clear = sure & (np.abs(near - 0.5) > 0.04).all(axis=0)
    assert clear.sum() > 100
    np.testing.assert_array_equal(owners[clear], first[clear])


def test_no_climb_leaves_the_window_wherever_the_scan_is():
    """A parabola through three samples has its top between them only where the middle one is the highest."""
    rng = np.random.default_rng(0)
    room = surfaces_of(np.full(360, 2.0), 5.0)
    for _ in range(60):
        frame = Surfaces(*(part[: rng.integers(1, 12)] for part in room))
        pose = (*rng.uniform(-4.0, 4.0, 2).tolist(), float(rng.uniform(-3.0, 3.0)))
        match = match_with([room], np.zeros((1, 3)), frame.hits, pose, reach=5.0, window=LOOP)
        assert math.hypot(match.pose[0] - pose[0], match.pose[1] - pose[1]) <= 1.2
        assert np.isfinite(match.covariance).all()
