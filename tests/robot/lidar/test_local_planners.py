"""Both local planners drive the true robot on maps of a few walls, perfectly localized: they arrive and never touch."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from explore_bench.geometry import Grid
from explore_bench.geometry.rays import clearance_at
from explore_bench.robot.lidar.driving import Limits, look_ahead, roll_out, turn_in_place
from explore_bench.robot.lidar.dwa import DynamicWindow
from explore_bench.robot.lidar.local_planner import local_planner
from explore_bench.robot.lidar.pursuit import Pursuit
from explore_bench.robot.planning.roads import Roads
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.motion import Vehicle
from explore_bench.world.lidar.world import LidarWorld, clearance_of

SCENARIO = LidarScenario(odometry_noise=0.0, heading_noise=0.0)
TOLERANCE = 0.25
PLANNERS = {name: local_planner(SCENARIO.replace(local_planner=name)) for name in ("pursuit", "dwa")}
both = pytest.mark.parametrize("planner", PLANNERS.values(), ids=PLANNERS)


class Room(NamedTuple):
    """What is true, and what the robot makes of it on its coarser map."""

    world: LidarWorld
    map_grid: Grid
    believed: np.ndarray


def room_of(walls, start, size=6.0, free=None):
    """Wall in a square room; walls are (x0, x1, y0, y1) [m]; where `free` is given, all is wall but these."""
    edge = round(size / 0.05)
    solid = np.full((edge, edge), free is not None)
    for blocked, boxes in ((False, free or ()), (True, walls)):
        for x0, x1, y0, y1 in boxes:
            columns, rows = (slice(round(a / 0.05), round(b / 0.05)) for a, b in ((x0, x1), (y0, y1)))
            solid[rows, columns] = blocked
    coarse = solid.reshape(edge // 2, 2, edge // 2, 2).any(axis=(1, 3))
    world = LidarWorld(Grid(edge, edge, 0.05), solid, ~solid, start)
    return Room(world, Grid(edge // 2, edge // 2, 0.1), clearance_of(coarse, 0.1))


def path_through(room, goal):
    grid = room.map_grid
    free = room.believed >= SCENARIO.lethal_radius
    cells = Roads(grid, free, grid.cell_of(*room.world.start[:2])).path_to(grid.cell_of(*goal))
    assert len(cells)
    return grid.centres(cells)


def drive(planner, room, path, seconds=60.0):
    """Drive until the end of the path is within TOLERANCE or the time is over; the vehicle, its track, the seconds."""
    vehicle = Vehicle(SCENARIO, room.world, np.random.default_rng(0))
    track = [vehicle.pose]
    for _ in range(round(seconds / SCENARIO.tick)):
        if math.dist(vehicle.pose[:2], path[-1]) <= TOLERANCE:
            break
        vehicle.move(planner.command(vehicle.pose, vehicle.velocity, path, room.believed, room.map_grid))
        track.append(vehicle.pose)
    return vehicle, np.array(track), SCENARIO.tick * (len(track) - 1)


def lanes(offset):
    """An L of lanes 0.8 m wide: along x, then up along y; the offset moves the walls within the map's cells."""
    low, high = 1.0 + offset, 1.8 + offset
    return (
        [(0.5, 4.2 + offset, low, high), (3.4 + offset, 4.2 + offset, low, 5.0)],
        (1.2, low + 0.4),
        (3.8 + offset, 4.4),
    )


OPEN = room_of((), (3.0, 3.0, 0.0))
STRAIGHT = np.stack((np.arange(3.0, 5.0, 0.1), np.full(20, 3.0)), axis=1)
LIMITS = Limits.of(SCENARIO)


# Closed loop


@both
@pytest.mark.parametrize("offset", [0.0, 0.05])
def test_round_a_corner_with_the_clearance_that_a_world_grants(planner, offset):
    """A passage of 0.40 m on both sides of the robot's centre, whether its walls fall on the map's cells or between."""
    free, start, goal = lanes(offset)
    room = room_of((), (*start, 0.0), free=free)
    path = path_through(room, goal)
    vehicle, _, seconds = drive(planner, room, path)
    assert math.dist(vehicle.pose[:2], path[-1]) <= TOLERANCE
    assert vehicle.collisions == 0
    assert seconds < 30.0


@both
@pytest.mark.parametrize("heading", [0.0, math.pi / 2, -math.pi / 2])
def test_through_a_door_that_is_passed_along_its_wall(planner, heading):
    """The path turns around the jamb into a door of 0.8 m in a wall of 0.1 m."""
    room = room_of([(3.0, 3.1, 0.0, 2.6), (3.0, 3.1, 3.4, 6.0)], (2.55, 0.8, heading))
    path = path_through(room, (3.55, 0.8))
    vehicle, track, seconds = drive(planner, room, path)
    assert math.dist(vehicle.pose[:2], path[-1]) <= TOLERANCE
    assert vehicle.collisions == 0
    crossing = np.flatnonzero(np.diff(track[:, 0] > 3.05))
    assert len(crossing) == 1
    assert 2.6 < track[crossing[0], 1] < 3.4
    assert seconds < 45.0


@both
def test_a_goal_behind_is_turned_to_within_a_lane(planner):
    """In a lane of 0.8 m there is no room for an arc."""
    room = room_of((), (3.0, 1.4, math.pi), free=[(0.5, 5.5, 1.0, 1.8)])
    path = path_through(room, (5.0, 1.4))
    vehicle, track, seconds = drive(planner, room, path)
    assert math.dist(vehicle.pose[:2], path[-1]) <= TOLERANCE
    assert vehicle.collisions == 0
    assert track[:, 0].min() > 2.7
    assert seconds < 20.0


@both
def test_pillars_are_passed_whatever_their_places(planner):
    """Ten rooms of pillars, crossed along the shortest path, at more than half of the full speed."""
    rng = np.random.default_rng(3)
    for _ in range(10):
        corners = rng.integers(24, 88, (8, 2)) * 0.05
        room = room_of([(x, x + 0.4, y, y + 0.4) for x, y in corners], (0.7, 0.7, rng.uniform(-math.pi, math.pi)))
        path = path_through(room, (5.3, 5.3))
        vehicle, _, seconds = drive(planner, room, path)
        assert vehicle.collisions == 0
        assert math.dist(vehicle.pose[:2], path[-1]) <= TOLERANCE
        assert vehicle.length / seconds > 0.5 * SCENARIO.max_speed


@both
@pytest.mark.parametrize("heading", [0.0, 0.4, math.pi / 2])
def test_a_path_that_a_wall_has_blocked_ends_before_the_wall(planner, heading):
    """The map has learned of a wall across the path since it was planned; the robot comes at full speed."""
    room = room_of([(3.5, 3.6, 0.0, 6.0)], (1.0, 3.0, heading))
    path = np.stack((np.arange(1.0, 5.5, 0.1), np.full(45, 3.0)), axis=1)
    vehicle, track, _ = drive(planner, room, path, seconds=20.0)
    assert vehicle.collisions == 0
    assert 2.0 < track[-1, 0] < 3.5 - SCENARIO.robot_radius
    assert np.ptp(track[-20:, :2], axis=0) == pytest.approx([0.0, 0.0], abs=1e-3)


@both
def test_a_wall_seen_late_is_braked_for(planner):
    """At full speed the map first shows a wall when it is 0.5 m ahead: no contact."""
    room = room_of([(3.5, 3.6, 0.0, 6.0)], (1.0, 3.0, 0.0))
    empty = room_of((), room.world.start)
    path = np.stack((np.arange(1.0, 5.5, 0.1), np.full(45, 3.0)), axis=1)
    vehicle = Vehicle(SCENARIO, room.world, np.random.default_rng(0))
    fastest = 0.0
    for _ in range(100):
        believed = room.believed if vehicle.pose[0] > 3.0 else empty.believed
        vehicle.move(planner.command(vehicle.pose, vehicle.velocity, path, believed, room.map_grid))
        fastest = max(fastest, vehicle.velocity[0])
    assert fastest == pytest.approx(SCENARIO.max_speed, abs=0.01)
    assert vehicle.collisions == 0
    assert vehicle.velocity[0] == 0.0


@both
@pytest.mark.parametrize("heading", [0.0, 1.5, math.pi])
def test_a_robot_too_near_to_a_believed_wall_drives_away_from_it(planner, heading):
    """After a correction of the map the robot may stand where no path would go."""
    room = room_of((), (0.225, 3.0, heading))
    path = np.stack((np.arange(0.225, 3.0, 0.1), np.full(28, 3.0)), axis=1)
    assert clearance_at(room.believed, room.map_grid, 0.225, 3.0) < LIMITS.least
    vehicle, _, _ = drive(planner, room, path)
    assert math.dist(vehicle.pose[:2], path[-1]) <= TOLERANCE


# What they share


def test_a_scenario_names_its_planner():
    assert isinstance(PLANNERS["pursuit"], Pursuit)
    assert isinstance(PLANNERS["dwa"], DynamicWindow)


@both
def test_a_path_of_one_waypoint_is_driven_to_and_one_of_none_is_refused(planner):
    vehicle, _, _ = drive(planner, OPEN, np.array([[4.0, 2.0]]))
    assert math.dist(vehicle.pose[:2], (4.0, 2.0)) <= TOLERANCE
    with pytest.raises(ValueError, match="at least one waypoint"):
        planner.command((3.0, 3.0, 0.0), (0.0, 0.0), np.empty((0, 2)), OPEN.believed, OPEN.map_grid)


def test_the_look_ahead_ends_at_a_corner_and_goes_on_once_it_is_turned():
    """Round the end of a wall at y = 3: what lies behind the wall is not aimed at, though it is within reach."""
    room = room_of([(0.0, 3.0, 2.95, 3.05)], (2.8, 2.5, 0.0))
    path = path_through(room, (2.5, 3.55))
    nearest, ahead = look_ahead(LIMITS, (2.85, 2.55, 0.0), path, 2.0, room.believed, room.map_grid)
    assert nearest < ahead < len(path) - 1
    assert path[ahead, 1] < 3.3
    _, later = look_ahead(LIMITS, (*path[ahead], math.pi / 2), path, 2.0, room.believed, room.map_grid)
    assert later > ahead
    _, far = look_ahead(LIMITS, (3.0, 3.0, 0.0), STRAIGHT, 0.6, OPEN.believed, OPEN.map_grid)
    assert far == 6, "six tenths of a metre along the path"


def test_what_is_foreseen_of_a_command_is_what_the_vehicle_does():
    """At the accelerations that it has, from standing and from driving another way."""
    for velocity in [(0.0, 0.0), (0.5, -0.9)]:
        vehicle = Vehicle(SCENARIO, OPEN.world, np.random.default_rng(0))
        vehicle.velocity = velocity
        least, end = roll_out(LIMITS, vehicle.pose, velocity, (0.4, 0.8), 1.7, OPEN.believed, OPEN.map_grid)
        for _ in range(17):
            vehicle.move((0.4, 0.8))
        assert end == pytest.approx(vehicle.pose, abs=1e-3)
        assert least <= clearance_at(OPEN.believed, OPEN.map_grid, *end[:2])


def test_clearance_is_exact_at_centres_linear_between_and_none_off_the_grid():
    grid, field = Grid(2, 3, 0.5, -1.0, 2.0), np.array([[0.0, 1.0, 2.0], [4.0, 5.0, 6.0]])
    assert clearance_at(field, grid, -0.25, 2.75) == 5.0
    assert clearance_at(field, grid, 0.0, 2.5) == 3.5
    assert clearance_at(field, grid, 0.45, 2.1) == 2.0, "no centre is farther out"
    for outside in ((0.51, 2.1), (-1.01, 2.1), (0.4, 1.99), (0.4, 3.01)):
        assert clearance_at(field, grid, *outside) == 0.0
    assert [clearance_at(field, grid, *corner) for corner in ((-1.0, 2.0), (0.5, 2.0), (0.5, 3.0), (-1.0, 3.0))] == [
        *(0.0, 2.0, 6.0, 4.0)
    ]


@pytest.mark.parametrize("angle", [3.0, -0.5, 0.05])
def test_a_turn_in_place_ends_where_it_shall(angle):
    vehicle = Vehicle(SCENARIO, OPEN.world, np.random.default_rng(0))
    beyond = 0.0
    for _ in range(60):
        left = math.remainder(angle - vehicle.pose[2], math.tau)
        beyond = max(beyond, -math.copysign(left, left * angle))
        vehicle.move(turn_in_place(LIMITS, vehicle.velocity, left))
    assert vehicle.pose[2] == pytest.approx(angle, abs=0.02)
    assert vehicle.pose[:2] == (3.0, 3.0)
    assert beyond < 0.02


def test_who_rolls_brakes_on_the_arc_that_it_is_on_before_it_turns():
    assert turn_in_place(LIMITS, (0.5, 0.4), -1.0) == pytest.approx((0.0, 0.2))
    assert turn_in_place(LIMITS, (0.25, 0.4), -1.0) == (0.0, -1.0)


# What each decides


def commanded(planner, heading, velocity=(0.5, 0.0), room=OPEN, path=STRAIGHT, place=(3.0, 3.0)):
    return planner.command((*place, heading), velocity, path, room.believed, room.map_grid)


def test_pursuit_turns_in_place_only_beyond_its_threshold():
    pursuit = PLANNERS["pursuit"]
    assert commanded(pursuit, -0.75, (0.0, 0.0))[0] > 0.0
    v, w = commanded(pursuit, -0.82, (0.0, 0.0))
    assert (v, w > 0.5) == (0.0, True)
    assert commanded(pursuit, 0.82, (0.0, 0.0))[1] == -w


def test_pursuit_drives_the_arc_through_the_point_aimed_at():
    """0.6 m ahead at a bearing of 0.3: the radius is 0.6 / (2 sin 0.3) = 1.015 m, beyond the 0.9 m that slow it."""
    v, w = commanded(PLANNERS["pursuit"], -0.3)
    assert v == pytest.approx(0.55)
    assert v / w == pytest.approx(0.6 / (2.0 * math.sin(0.3)))


def test_pursuit_slows_in_curves_near_walls_and_before_the_goal():
    pursuit = PLANNERS["pursuit"]
    assert commanded(pursuit, 0.0) == (SCENARIO.max_speed, 0.0)
    curve = 0.6 / (2.0 * math.sin(0.5))
    assert commanded(pursuit, -0.5)[0] == pytest.approx(0.55 * curve / 0.9)
    lane = room_of((), (3.0, 3.0, 0.0), free=[(0.5, 5.5, 2.6, 3.4)])
    room = clearance_at(lane.believed, lane.map_grid, 3.0, 3.0)
    assert commanded(pursuit, 0.0, room=lane)[0] == pytest.approx(0.55 * room / 0.6)
    assert commanded(pursuit, 0.0, place=(4.6, 3.0))[0] == pytest.approx(0.55 * 0.3 / 0.6)


def test_a_dynamic_window_commands_what_a_tick_can_reach():
    for heading in (0.0, 1.0, -2.0):
        for velocity in [(0.0, 0.0), (0.3, 0.5), (0.55, -1.0)]:
            v, w = commanded(PLANNERS["dwa"], heading, velocity)
            assert max(velocity[0] - 0.25, 0.0) <= v <= min(velocity[0] + 0.25, 0.55)
            assert abs(w - velocity[1]) <= 0.32 + 1e-9
            assert abs(w) <= 1.0


def test_a_dynamic_window_drives_straight_at_full_speed_on_a_straight_path():
    assert commanded(PLANNERS["dwa"], 0.0) == (SCENARIO.max_speed, 0.0)


def test_a_dynamic_window_turns_towards_its_path():
    for heading in (0.4, 1.5, -0.4, -1.5):
        assert commanded(PLANNERS["dwa"], heading)[1] * heading < 0.0
