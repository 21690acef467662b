"""The sensor: what is in range, its noise, the look-up of the cells around, and occlusion."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st

from explore_bench.geometry import Grid
from explore_bench.trial.seeding import stream
from explore_bench.world.floor_plan import floor_plan
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.sensor import Sensor
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario
from explore_bench.world.signals import FREE, HIDDEN, OCCUPIED

EDGE, CELL = 10, 2.0
poses = st.tuples(st.floats(-3.0, 23.0), st.floats(-3.0, 23.0), st.floats(-math.pi, math.pi))
seeds = st.integers(0, 2**32)


class Silent:
    """A generator whose standard normals are all 0."""

    def standard_normal(self, shape):
        return np.zeros(shape)


def world_with(obstacles=(), landmarks=()):
    """Make a 10 × 10 world of 2 m cells, obstacles given by row and column."""
    blocked = np.zeros((EDGE, EDGE), dtype=bool)
    for row, column in obstacles:
        blocked[row, column] = True
    places = np.array(landmarks, dtype=float).reshape(-1, 2)
    return LandmarkWorld(Grid(EDGE, EDGE, CELL), blocked, places, (1.0, 1.0, 0.0))


def random_world(seed, density=1.5):
    return draw_world(Scenario(obstacle_density=density), stream("train", seed, 20.0, 0, "world"))


def scan_of(world, pose, rng=None, **constants):
    return Sensor(Scenario(**constants), world, rng or Silent()).scan(pose)


def sighted(*arguments, **constants):
    return scan_of(*arguments, **constants).sightings


def look_up(scan, forward, left):
    """Read the value at a point of the robot's frame, as the docstring of Patch says: origin + R(heading) q."""
    view = scan.view
    c, s = math.cos(view.heading), math.sin(view.heading)
    column = math.floor((view.origin[0] + c * forward - s * left) / CELL)
    row = math.floor((view.origin[1] + s * forward + c * left) / CELL)
    assert 0 <= row < len(view.cells)
    assert 0 <= column < len(view.cells)
    return view.cells[row, column]


def true_value(world, x, y):
    column, row = math.floor(x / CELL), math.floor(y / CELL)
    inside = 0 <= row < EDGE and 0 <= column < EDGE
    return FREE if inside and not world.obstacles[row, column] else OCCUPIED


# Landmarks


def test_bearing_and_range_worked_by_hand():
    """Facing +y at (5, 5): a landmark at (2, 9) is 5 m away, atan2(3, 4) to the left; one at (8, 5) to the right."""
    found = sighted(world_with(landmarks=[(2.0, 9.0), (8.0, 5.0)]), (5.0, 5.0, math.pi / 2))
    assert found.landmarks.tolist() == [0, 1]
    assert found.bearings == pytest.approx([math.atan2(3.0, 4.0), -math.pi / 2])
    assert found.ranges == pytest.approx([5.0, 3.0])


def test_bearings_are_wrapped():
    found = sighted(world_with(landmarks=[(9.0, 9.0)]), (11.0, 11.0, math.radians(170.0)))
    assert found.bearings == pytest.approx([math.radians(-135.0 - 170.0 + 360.0)])


@pytest.mark.parametrize(
    ("distance", "seen"), [(0.0, False), (0.124, False), (0.125, True), (3.0, True), (5.0, True), (5.001, False)]
)
def test_a_landmark_is_sighted_from_the_least_to_the_greatest_range(distance, seen):
    found = sighted(world_with(landmarks=[(10.0 + distance, 10.0)]), (10.0, 10.0, 2.0), min_landmark_range=0.125)
    assert len(found.landmarks) == len(found.bearings) == len(found.ranges) == seen


def test_ids_are_rows_of_the_world_ascending():
    landmarks = [(19.0, 19.0), (9.0, 11.0), (1.0, 19.0), (11.0, 11.0), (11.0, 9.0)]
    assert sighted(world_with(landmarks=landmarks), (10.0, 10.0, 0.0)).landmarks.tolist() == [1, 3, 4]


def test_noise_has_no_bias_and_the_scenario_s_spread():
    scenario = Scenario(bearing_sigma_deg=0.5, range_sigma=0.02)
    sensor = Sensor(scenario, world_with(landmarks=[(13.0, 14.0)]), np.random.default_rng(1))
    found = [sensor.scan((10.0, 10.0, 0.3)).sightings for _ in range(4000)]
    bearings = np.array([one.bearings[0] for one in found]) - (math.atan2(4.0, 3.0) - 0.3)
    ranges = np.array([one.ranges[0] for one in found]) - 5.0
    assert bearings.mean() == pytest.approx(0.0, abs=4 * math.radians(0.5) / math.sqrt(4000))
    assert ranges.mean() == pytest.approx(0.0, abs=4 * 0.02 / math.sqrt(4000))
    assert bearings.std() == pytest.approx(math.radians(0.5), rel=0.05)
    assert ranges.std() == pytest.approx(0.02, rel=0.05)
    assert abs(np.corrcoef(bearings, ranges)[0, 1]) < 0.07


@given(seeds)
def test_twice_the_sigmas_are_twice_the_errors(seed):
    world, pose = world_with(landmarks=[(8.0, 9.0), (11.0, 13.0)]), (10.0, 10.0, 0.0)
    truth = sighted(world, pose)
    once = sighted(world, pose, np.random.default_rng(seed))
    twice = sighted(world, pose, np.random.default_rng(seed), bearing_sigma_deg=1.0, range_sigma=0.04)
    assert twice.bearings - truth.bearings == pytest.approx(2 * (once.bearings - truth.bearings), abs=1e-12)
    assert twice.ranges - truth.ranges == pytest.approx(2 * (once.ranges - truth.ranges), abs=1e-12)


@given(seeds, st.lists(poses, min_size=3, max_size=3))
@settings(max_examples=40)
def test_the_noise_of_a_sighting_depends_on_the_scan_s_number_and_the_landmark_only(seed, where):
    """Whatever was seen before, and whatever else is seen now: two normals a landmark of the world, each scan."""
    world = world_with(landmarks=[(3.0, 3.0), (9.0, 11.0), (11.0, 9.0), (17.0, 17.0)])
    sensor = Sensor(Scenario(), world, np.random.default_rng(seed))
    normals = np.random.default_rng(seed).standard_normal((4, 4, 2))
    sigmas = np.array([math.radians(0.5), 0.02])
    for number, pose in enumerate([*where, (10.0, 10.0, 0.0)]):
        found, truth = sensor.scan(pose).sightings, sighted(world, pose)
        errors = np.stack((found.bearings - truth.bearings, found.ranges - truth.ranges), axis=1)
        assert np.allclose(errors / sigmas, normals[number, found.landmarks], atol=1e-9)
    assert len(found.landmarks) == 2


# The look-up of the cells around


@given(st.integers(0, 20), poses, st.floats(0.0, 5.0), st.floats(-math.pi, math.pi))
def test_a_point_of_the_robot_s_frame_maps_to_the_true_value_of_its_cell(trial, pose, distance, bearing):
    """Everywhere in range, also where the robot stands off the map; outside the map all reads occupied."""
    world = random_world(trial)
    x = pose[0] + distance * math.cos(pose[2] + bearing)
    y = pose[1] + distance * math.sin(pose[2] + bearing)
    assume(all(abs(math.remainder(value, CELL)) > 1e-6 for value in (x, y)))
    value = look_up(scan_of(world, pose), distance * math.cos(bearing), distance * math.sin(bearing))
    assert value == true_value(world, x, y)


def test_rows_and_columns_are_not_exchanged():
    """Facing +y at (9, 9): the obstacle ahead, at (9, 13), is 4 m forward; nothing lies to the right."""
    scan = scan_of(world_with([(6, 4)]), (9.0, 9.0, math.pi / 2))
    assert look_up(scan, 4.0, 0.0) == OCCUPIED
    assert look_up(scan, 0.0, -4.0) == look_up(scan, 0.0, 4.0) == look_up(scan, -4.0, 0.0) == FREE


def test_outside_the_map_reads_occupied():
    scan = scan_of(world_with(), (1.0, 19.0, 0.0))
    assert look_up(scan, -2.0, 0.0) == look_up(scan, 0.0, 2.0) == OCCUPIED
    assert look_up(scan, 2.0, 0.0) == look_up(scan, 0.0, -2.0) == FREE


def test_the_look_up_does_not_tell_where_in_the_map_the_robot_is():
    """Moved by whole cells over equal ground, the scan is the same."""
    here, there = (scan_of(world_with(), pose) for pose in ((8.5, 9.25, 1.0), (10.5, 11.25, 1.0)))
    assert np.array_equal(here.view.cells, there.view.cells)
    assert here.view.origin == there.view.origin


@given(st.integers(0, 20), poses)
def test_without_occlusion_nothing_is_hidden(trial, pose):
    assert not np.any(scan_of(random_world(trial), pose).view.cells == HIDDEN)


# Occlusion


def test_an_obstacle_hides_the_cell_behind_it_and_stays_in_sight():
    """Robot in cell (5, 3), obstacle in (5, 4), facing +x."""
    world = world_with([(5, 4), (5, 5)])
    open_scan, scan = (scan_of(world, (7.0, 11.0, 0.0), occlusion=hides) for hides in (False, True))
    assert look_up(scan, 2.0, 0.0) == OCCUPIED
    assert look_up(scan, 4.0, 0.0) == HIDDEN
    assert look_up(open_scan, 4.0, 0.0) == OCCUPIED
    assert look_up(scan, -4.0, 0.0) == look_up(scan, 0.0, 4.0) == look_up(scan, 2.0, 2.0) == FREE


def test_an_obstacle_hides_the_landmark_behind_it_only_where_occlusion_is_asked_for():
    world = world_with([(5, 4)], landmarks=[(11.0, 11.0), (3.0, 11.0), (7.0, 14.0)])
    assert sighted(world, (7.0, 11.0, 0.0)).landmarks.tolist() == [0, 1, 2]
    assert sighted(world, (7.0, 11.0, 0.0), occlusion=True).landmarks.tolist() == [1, 2]


def test_hidden_landmarks_keep_their_noise_from_the_others():
    """Occlusion changes who is seen, not which normals the others get."""
    world = world_with([(5, 4)], landmarks=[(11.0, 11.0), (3.0, 11.0)])
    all_, some = (
        sighted(world, (7.0, 11.0, 0.0), np.random.default_rng(4), occlusion=hides) for hides in (False, True)
    )
    assert all_.ranges[1] == some.ranges[0]
    assert all_.bearings[1] == some.bearings[0]


def length_inside(box, start, end):
    """Share of the segment that runs inside an axis-aligned box (x0, y0, x1, y1): Liang and Barsky's clipping."""
    low, high = 0.0, 1.0
    for axis in (0, 1):
        step = end[axis] - start[axis]
        if step == 0.0:
            if not box[axis] <= start[axis] <= box[axis + 2]:
                return -1.0
            continue
        bounds = sorted(((box[axis] - start[axis]) / step, (box[axis + 2] - start[axis]) / step))
        low, high = max(low, bounds[0]), min(high, bounds[1])
    return high - low


@settings(max_examples=60)
@given(st.integers(0, 20), st.floats(0.1, 19.9), st.floats(0.1, 19.9))
def test_a_cell_is_hidden_where_an_obstacle_s_square_cuts_the_line_to_its_centre(trial, x, y):
    world = random_world(trial, density=2.5)
    scan = scan_of(world, (x, y, 0.0), occlusion=True)
    own = (math.floor(y / CELL), math.floor(x / CELL))
    reach = len(scan.view.cells) // 2
    for i, j in np.ndindex(scan.view.cells.shape):
        cell = own[0] - reach + i, own[1] - reach + j
        centre = (cell[1] + 0.5) * CELL, (cell[0] + 0.5) * CELL
        cuts = [
            length_inside((c * CELL, r * CELL, (c + 1) * CELL, (r + 1) * CELL), (x, y), centre)
            for r, c in np.argwhere(world.obstacles).tolist()
            if (r, c) not in (own, cell)
        ]
        if any(abs(cut) < 1e-9 for cut in cuts):
            continue  # a line through a corner may be judged either way
        hidden = any(cut > 0.0 for cut in cuts)
        assert scan.view.cells[i, j] == (HIDDEN if hidden else true_value(world, *centre))


# Occlusion in given maps

TWO_ROOMS = (
    "##########",
    "#...##...#",
    "#...##...#",
    "#...##...#",
    "#........#",
    "##########",
)


def given_world(landmarks=(), rows=TWO_ROOMS):
    """Make the world of a map by hand, landmarks given in metres."""
    plan = floor_plan(rows)
    places = np.array(landmarks, dtype=float).reshape(-1, 2)
    grid = Grid(*plan.blocked.shape, CELL)
    return LandmarkWorld(grid, plan.blocked, places, (3.0, 9.0, 0.0), np.flatnonzero(~plan.counted))


def patch_rows(scan):
    """Draw a scan's patch, north first."""
    return ["".join(".#?"[value] for value in row) for row in scan.view.cells[::-1]]


def test_walls_of_a_map_hide_what_is_behind_and_the_sensor_sees_their_faces_and_corners():
    """From the middle of the left room, 8 m of range: both walls, the corners where they meet, not the right room."""
    scan = scan_of(given_world(), (5.0, 7.0, 0.3), occlusion=True, sensor_range=8.0)
    assert patch_rows(scan) == [
        "?????????",
        "?????????",
        "??#####??",
        "??#...#??",
        "??#...#??",
        "??#...#??",
        "??#....??",
        "??#####??",
        "?????????",
    ]


def test_without_occlusion_walls_hide_nothing():
    scan = scan_of(given_world(), (5.0, 7.0, 0.3), sensor_range=8.0)
    assert not (scan.view.cells == HIDDEN).any()


def test_a_landmark_behind_a_wall_of_a_map_is_not_sighted_until_the_way_to_it_is_clear():
    world = given_world([(13.0, 7.0), (3.5, 8.5)])
    assert sighted(world, (5.0, 7.0, 0.0), occlusion=True, sensor_range=9.0).landmarks.tolist() == [1]
    assert sighted(world, (5.0, 7.0, 0.0), sensor_range=9.0).landmarks.tolist() == [0, 1]
    assert sighted(world, (13.0, 3.0, 0.0), occlusion=True, sensor_range=9.0).landmarks.tolist() == [0]


def test_a_corner_is_seen_only_with_both_walls_that_meet_there():
    """From the far end of the corridor its lower wall is in sight below the robot only; from its near end, both are."""
    far = patch_rows(scan_of(given_world(), (7.0, 3.0, 0.0), occlusion=True, sensor_range=6.0))
    assert far[3:5] == ["#......", "???#???"]
    near = scan_of(given_world(), (3.0, 3.0, 0.0), occlusion=True, sensor_range=6.0)
    assert [look_up(near, *place) for place in ((-2.0, 0.0), (0.0, -2.0), (-2.0, -2.0))] == [OCCUPIED] * 3


def test_what_the_map_does_not_know_reads_occupied():
    rows = ("#####", "#...#", "#.?.#", "#...#", "#####")
    scan = scan_of(given_world(rows=rows), (3.0, 3.0, 0.0), sensor_range=2.5)
    assert scan.view.cells[3, 3] == OCCUPIED


def test_a_drawn_world_has_no_corner_that_shows():
    """An inner corner of single obstacles stays hidden, as it always was: all its cells count."""
    world = world_with([(2, 1), (1, 2), (2, 2)])
    scan = scan_of(world, (3.0, 3.0, 0.0), occlusion=True)
    assert look_up(scan, 2.0, 2.0) == HIDDEN
