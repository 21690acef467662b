"""Distances from obstacles, unsafe time and changes of speed, worked by hand."""

import pytest
from lidar_worlds import SMALL, drawn

from explore_bench.trial.lidar.ride import SAFE_DISTANCE, Ride
from explore_bench.world.lidar.motion import Wheels

WALL = 0.1  # of a world drawn by hand, where its inner face lies


def room(start_x=4.0):
    return drawn(8.0, start=(start_x, 4.0, 0.0))


def at(distance):
    """Pose whose hull is so far from the wall at the left [m]."""
    return (WALL + SMALL.robot_radius + distance, 4.0, 0.0)


def test_clearance_is_the_least_distance_of_the_hull_the_start_included():
    ride = Ride(SMALL, room(at(0.5)[0]))
    assert ride.clearance == pytest.approx(0.5, abs=0.01)
    for distance, least in ((1.0, 0.5), (0.3, 0.3), (0.7, 0.3)):
        ride.tick(at(distance), 0.0)
        assert ride.clearance == pytest.approx(least, abs=0.01)


def test_no_hull_is_left_where_the_vehicle_touches():
    ride = Ride(SMALL, room())
    touching = WALL - 0.5 * SMALL.resolution + Wheels.of(SMALL).touch
    ride.tick((touching, 4.0, 0.0), 0.0)
    assert ride.clearance == pytest.approx(0.0, abs=1e-9)


def test_unsafe_time_is_that_of_the_ticks_nearer_than_the_safe_distance():
    ride = Ride(SMALL, room())
    for distance in (1.0, SAFE_DISTANCE + 0.02, SAFE_DISTANCE - 0.02, 0.01, 1.0):
        ride.tick(at(distance), 0.0)
    assert ride.unsafe_seconds == pytest.approx(2 * SMALL.tick)


def test_changes_of_speed_add_up_whichever_way():
    """0 → 0.5 → 0.2 → 0.2 → −0.1: 0.5 + 0.3 + 0 + 0.3."""
    ride = Ride(SMALL, room())
    for speed in (0.5, 0.2, 0.2, -0.1):
        ride.tick((4.0, 4.0, 0.0), speed)
    assert ride.speed_change == pytest.approx(1.1)
