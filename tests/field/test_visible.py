"""What is visible from a place, the frontiers, and each term by hand."""

import math

import numpy as np
import pytest
from handmade_observations import in_landmark_world, in_lidar_world, letters_of
from hypothesis import given, strategies as st

from baselines.field import terms
from baselines.field.believed import finest_map, frontiers, lengths_from, stands
from baselines.field.views import expected_reach, in_view, unknown_in_view
from explore_bench.robot.occupancy import shannon_entropy

OPENINGS = (
    *("################",) * 4,
    "############????",
    *("############.???",) * 3,
    "#?a...R.....b???",
    *("############.???",) * 3,
    "############????",
    *("################",) * 3,
)
"""Cells of half a metre: to the left, 2 m away, a pocket of one cell; to the right, 3 m away, an opening."""

TWO_ENDS = (
    *("############",) * 2,
    "###########?",
    *("##########.?",) * 2,
    "?a.R......b?",
    *("##########.?",) * 2,
    "###########?",
    *("############",) * 3,
)
"""Cells of 2 m: a corridor with an end at 4 m to the left and one at 14 m to the right."""


def cell(observation, column, row_from_the_top):
    grid = finest_map(observation).grid
    return (grid.rows - 1 - row_from_the_top) * grid.columns + column


def by_letter(rows, values):
    return dict(zip(letters_of(rows), np.asarray(values).tolist(), strict=True))


def test_a_wall_hides_and_unknown_cells_do_not():
    row = "R.?.????#???...."
    observation = in_lidar_world(["." * 16] * 7 + [row] + ["." * 16] * 8, reach=7.9)
    view = in_view(observation, np.array([observation.pose[:2]]))[0]
    seen = [bool(view[cell(observation, column, 7)]) for column in range(13)]
    assert seen == [True] * 8 + [False] * 5, "through the unknown up to the wall, and not beyond"
    unknown = unknown_in_view(observation, np.array([observation.pose[:2]]))[0]
    assert [bool(unknown[cell(observation, column, 7)]) for column in range(8)] == [c == "?" for c in row[:8]]


def test_in_a_landmark_world_it_is_what_is_in_range():
    observation = in_landmark_world(TWO_ENDS)
    view = unknown_in_view(observation, observation.positions)
    centres = observation.scenario.grid.centres()
    for place, own in zip(observation.positions, view, strict=True):
        near = np.hypot(*(centres - place).T) <= 5.0
        assert (own == (near & ~observation.belief.known.reshape(-1))).all()


def test_only_what_is_wanted_is_looked_at():
    for observation in (in_lidar_world(OPENINGS), in_landmark_world(TWO_ENDS)):
        map_ = finest_map(observation)
        everything = in_view(observation, observation.positions)
        assert (in_view(observation, observation.positions, map_.known) == everything & map_.known.reshape(-1)).all()


def test_the_unknown_area_in_view_by_hand():
    """The pocket is one cell of (0.5 m)², the opening 29; of 4 m² each, the ends are 1 cell and 5."""
    assert by_letter(OPENINGS, terms.area(in_lidar_world(OPENINGS))) == {"a": 0.25, "b": 7.25}
    assert by_letter(TWO_ENDS, terms.area(in_landmark_world(TWO_ENDS))) == {"a": 4.0, "b": 4.0 * 5}


def test_the_area_within_a_radius_counts_behind_walls():
    observation = in_lidar_world(OPENINGS)
    assert by_letter(OPENINGS, terms.area_within(observation, 1.0)) == {"a": 0.25, "b": 4 * 0.25}
    hidden = ("#?#R", "####", "#..a", "####")
    walled = in_lidar_world([line + "#" * 4 for line in hidden] + ["#" * 8] * 4, reach=3.0)
    assert terms.area_within(walled, 1.5).tolist() == [0.25]
    assert terms.area(walled).tolist() == [0.0]


def test_a_frontier_is_as_long_as_its_cells_and_as_near_as_the_nearest():
    found = frontiers(in_lidar_world(OPENINGS))
    assert by_letter(OPENINGS, found.length) == {"a": 0.5, "b": 7 * 0.5}
    assert by_letter(OPENINGS, found.nearest) == {"a": 2.0, "b": 3.0}
    found = frontiers(in_landmark_world(TWO_ENDS))
    assert by_letter(TWO_ENDS, found.length) == {"a": 2.0, "b": 2.0 * 5}
    assert by_letter(TWO_ENDS, found.nearest) == {"a": 4.0, "b": 14.0}


def test_a_candidate_on_no_frontier_has_one_cell_s_length_and_its_own_distance():
    found = frontiers(in_landmark_world(("....", "R.a.", "....", "...?")))
    assert (found.number.tolist(), found.length.tolist(), found.nearest.tolist()) == ([0], [2.0], [4.0])


def test_a_candidate_is_looked_at_from_the_nearest_cell_that_can_be_reached():
    observation = in_landmark_world(TWO_ENDS)
    assert stands(observation).tolist() == observation.candidates.tolist()


def test_lengths_between_are_those_of_drives():
    observation = in_landmark_world(("R.#a", "..#.", "..#.", "...."))
    lengths = lengths_from(observation, stands(observation))
    assert lengths[0, observation.roads.start] == pytest.approx(observation.path_lengths[0])
    assert observation.path_lengths[0] == pytest.approx(2.0 * (math.sqrt(2) + 7)), "no corner is cut"
    assert lengths[0, observation.candidates[0]] == 0.0
    assert (np.isfinite(lengths[0]) == observation.roads.free.reshape(-1)).all()


def test_the_turn_is_nothing_ahead_and_one_behind():
    for heading, expected in ((0.0, (1.0, 0.0)), (math.pi, (0.0, 1.0)), (math.pi / 2, (0.5, 0.5))):
        observation = in_landmark_world(TWO_ENDS, heading=heading)
        assert by_letter(TWO_ENDS, terms.turn(observation)) == pytest.approx(dict(zip("ab", expected, strict=True)))


def test_a_ray_gets_on_through_unknown_cells_with_the_probability_that_they_are_open():
    rows = ["#" * 16] * 7 + ["R.a????#??" + "#" * 6] + ["#" * 16] * 8
    observation = in_lidar_world(rows, reach=7.0)
    for prior in (0.5, 0.1):
        chances = expected_reach(observation, observation.positions, prior)[0]
        along = [chances[cell(observation, column, 7)] for column in range(10)]
        assert along[3:7] == pytest.approx([(1.0 - prior) ** k for k in range(4)])
        assert along[8:] == [0.0, 0.0], "behind a known wall"
    bits = terms.entropy_reduction(observation, observation.positions, 0.5)
    assert bits.tolist() == pytest.approx([1.0 + 0.5 + 0.25 + 0.125])


@given(st.floats(0.05, 0.95))
def test_the_information_of_one_observation_is_the_expected_drop_of_entropy(p):
    """By Bayes: with hit 0.7 and miss 0.3 the sensor is right in 7 of 10 cases."""
    occupied, free = 0.7 * p, 0.3 * (1 - p)
    seen = occupied + free
    entropies = shannon_entropy(np.array([p, occupied / seen, 0.3 * p / (1 - seen)]))
    expected = entropies[0] - seen * entropies[1] - (1 - seen) * entropies[2]
    assert terms.mutual_information(np.array([p]), 0.7, 0.3)[0] == pytest.approx(expected, abs=1e-12)


def test_an_uneven_sensor_model_keeps_its_likelihood_ratios():
    """The ratios of hit 0.8 and miss 0.3 are 4 and 3/7.

    So P(seen | free) = (1 − 3/7) / (4 − 3/7) = 0.16, and of an occupied cell 0.64.
    """
    p, of_occupied, of_free = 0.5, 0.64, 0.16
    seen = 0.5 * (of_occupied + of_free)
    after = shannon_entropy(np.array([0.8, 0.3]))
    expected = 1.0 - seen * after[0] - (1 - seen) * after[1]
    assert terms.mutual_information(np.array([p]), 0.8, 0.3)[0] == pytest.approx(expected)


def test_remoteness_is_the_mean_drive_to_the_free_cells_near_the_robot():
    """Along a corridor of ten cells of 2 m, the robot on the third: from the fourth 26 · 2 / 9 m, from the end 43."""
    rows = ["#" * 10] * 4 + ["b.Ra......"] + ["#" * 10] * 5
    assert by_letter(rows, terms.remoteness(in_landmark_world(rows), 15.25)) == pytest.approx(
        {"a": 26 * 2 / 9, "b": 43 * 2 / 9}
    )
    near = terms.remoteness(in_landmark_world(rows), 4.5)
    assert by_letter(rows, near) == pytest.approx({"a": (3 + 2 + 0 + 1) * 2 / 4, "b": (0 + 1 + 3 + 4) * 2 / 4})
    assert terms.remoteness(in_landmark_world(rows), 0.5).tolist() == [0.0, 0.0], "no cell is as near"


def test_traversal_is_length_times_probability():
    rows = ["#" * 8] * 3 + ["#au.R..b"] + ["#" * 8] * 4
    observation = in_landmark_world(rows, occupancy={"u": 0.45})
    ways = by_letter(rows, terms.traversal(observation))
    assert ways["a"] == pytest.approx(2.0 * (0.05 + 0.25 + 0.25))
    assert ways["b"] == pytest.approx(2.0 * 0.05 * 3)


def test_localizability_is_the_trace_at_the_end_of_the_drive():
    observation = in_landmark_world(TWO_ENDS, variances={"a": 0.5, "b": 0.2})
    assert by_letter(TWO_ENDS, terms.localizability(observation)) == pytest.approx({"a": 1.5, "b": 0.6})


def test_the_entropy_of_a_gaussian_by_hand():
    covariances = np.array([np.diag([4.0, 1.0, 0.25]), np.eye(3) * math.e])
    own = 1.5 * math.log(2 * math.pi * math.e)
    assert terms.pose_entropy(covariances) == pytest.approx(own + 0.5 * np.mean([0.0, 3.0]))
