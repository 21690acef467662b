"""SE(2) arithmetic and the grid: inverse properties, hand-worked values, brute force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from explore_bench.geometry import (
    between,
    cell_of,
    cells_in_reach,
    centre_of,
    centres,
    compose,
    distance_to_segment,
    wrap_angle,
)

metres = st.floats(-100.0, 100.0)
angles = st.floats(-10.0, 10.0)
poses = st.tuples(metres, metres, angles)
sides = st.integers(1, 25)
cell_sizes = st.sampled_from([0.25, 0.5, 1.0, 2.0, 4.0])
quarters = st.integers(-400, 400).map(lambda k: k / 4.0)


def assert_same_pose(pose, expected, tolerance=1e-9):
    assert pose[:2] == pytest.approx(expected[:2], abs=tolerance)
    assert math.remainder(pose[2] - expected[2], math.tau) == pytest.approx(0.0, abs=tolerance)


def test_compose_worked_by_hand():
    assert_same_pose(compose((1.0, 2.0, math.pi / 2), (3.0, 1.0, math.pi)), (0.0, 5.0, -math.pi / 2))


def test_between_worked_by_hand():
    assert_same_pose(between((1.0, 2.0, math.pi / 2), (0.0, 5.0, math.pi)), (3.0, 1.0, math.pi / 2))


@given(poses, poses)
def test_between_undoes_compose(pose, delta):
    assert_same_pose(between(pose, compose(pose, delta)), delta)


@given(poses, poses)
def test_compose_undoes_between(origin, pose):
    assert_same_pose(compose(origin, between(origin, pose)), pose)


@given(poses, poses, poses)
def test_compose_is_associative(a, b, c):
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)))


@given(st.floats(-1e4, 1e4))
def test_wrapped_angles_lie_in_the_half_open_turn_and_point_the_same_way(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.remainder(wrapped - angle, math.tau) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi, -3 * math.pi, np.nextafter(-math.pi, -4.0)])
def test_half_a_turn_either_way_wraps_to_plus_pi(angle):
    assert wrap_angle(float(angle)) == pytest.approx(math.pi, abs=1e-12)


@given(sides, cell_sizes, st.data())
def test_a_cell_holds_its_own_centre(cells, cell_size, data):
    cell = data.draw(st.integers(0, cells**2 - 1))
    assert cell_of(*centre_of(cell, cells, cell_size), cells, cell_size) == cell


def test_cells_run_along_x_first_and_their_lower_edges_belong_to_them():
    assert cell_of(0.0, 0.0, 10, 2.0) == 0
    assert cell_of(1.999, 0.0, 10, 2.0) == 0
    assert cell_of(2.0, 0.0, 10, 2.0) == 1
    assert cell_of(0.0, 2.0, 10, 2.0) == 10
    assert centre_of(23, 10, 2.0) == (7.0, 5.0)


@given(sides, cell_sizes, metres, metres)
def test_a_point_outside_goes_to_the_nearest_cell(cells, cell_size, x, y):
    """The nearest cell is the one whose square is at the least distance from the point."""
    cell = cell_of(x, y, cells, cell_size)
    low = np.arange(cells) * cell_size
    off_x = np.maximum(np.maximum(low - x, x - low - cell_size), 0.0)
    off_y = np.maximum(np.maximum(low - y, y - low - cell_size), 0.0)
    assert off_x[cell % cells] == off_x.min()
    assert off_y[cell // cells] == off_y.min()


def test_points_beyond_each_corner_are_clamped():
    assert cell_of(-5.0, 100.0, 10, 2.0) == 90
    assert cell_of(100.0, -5.0, 10, 2.0) == 9
    assert cell_of(20.0, 20.0, 10, 2.0) == 99
    assert cell_of(-0.001, -0.001, 10, 2.0) == 0


def test_many_centres_are_the_centres_of_each():
    indices = np.arange(49).reshape(7, 7)
    expected = [[centre_of(int(cell), 7, 0.5) for cell in row] for row in indices]
    assert centres(indices, 7, 0.5).shape == (7, 7, 2)
    assert np.array_equal(centres(indices, 7, 0.5), expected)


@given(quarters, st.integers(0, 80).map(lambda k: k / 4.0), sides, cell_sizes)
def test_cells_in_reach_are_those_that_brute_force_finds(coordinate, reach, cells, cell_size):
    """All numbers are dyadic, so that centres exactly at the reach are judged without rounding."""
    first, last = cells_in_reach(coordinate, reach, cells, cell_size)
    found = [i for i in range(cells) if abs((i + 0.5) * cell_size - coordinate) <= reach]
    assert list(range(first, last + 1)) == found


@given(metres, st.floats(0.0, 20.0), sides, st.floats(0.1, 5.0))
def test_cells_in_reach_of_any_numbers_but_for_rounding(coordinate, reach, cells, cell_size):
    first, last = cells_in_reach(coordinate, reach, cells, cell_size)
    for i in range(cells):
        distance = abs((i + 0.5) * cell_size - coordinate)
        if distance < reach - 1e-9:
            assert first <= i <= last
        elif distance > reach + 1e-9:
            assert not first <= i <= last


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((2.0, 3.0), 3.0),  # beside the middle
        ((-3.0, 4.0), 5.0),  # before the first end
        ((7.0, -4.0), 5.0),  # beyond the second
        ((4.0, 0.0), 0.0),  # at an end
        ((1.0, 0.0), 0.0),  # on it
    ],
)
def test_distance_to_a_segment_worked_by_hand(point, distance):
    assert distance_to_segment(*point, 0.0, 0.0, 4.0, 0.0) == pytest.approx(distance, abs=1e-12)


def test_distance_to_a_slanted_segment_and_to_a_point():
    assert distance_to_segment(0.0, 5.0, 0.0, 0.0, 4.0, 3.0) == pytest.approx(4.0)
    assert distance_to_segment(3.0, 4.0, 0.0, 0.0, 0.0, 0.0) == pytest.approx(5.0)


@settings(max_examples=50)
@given(*[st.floats(-10.0, 10.0)] * 6)
def test_distance_to_a_segment_is_the_least_to_its_points(x, y, x0, y0, x1, y1):
    t = np.linspace(0.0, 1.0, 2001)
    sampled = np.hypot(x0 + t * (x1 - x0) - x, y0 + t * (y1 - y0) - y).min()
    spacing = math.hypot(x1 - x0, y1 - y0) / 2000
    distance = distance_to_segment(x, y, x0, y0, x1, y1)
    assert distance <= sampled + 1e-9
    assert distance >= sampled - spacing
