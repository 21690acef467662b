"""Candidates on small maps drawn by hand, and against the definition on random ones.

In the drawings '?' is unknown, '.' known and free, '#' known and occupied; the first line is row 0, cells of 2 m.
"""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import ndimage

from explore_bench.robot.planning.candidates import Ground, Withheld, find_candidates
from explore_bench.world.scenario import Scenario

CELL = 2.0


def scenario_of(edge, **constants):
    return Scenario(size=CELL * edge, landmark_count=0, obstacle_count=0, **constants)


def ground(drawing, robot, landmarks=(), **constants):
    """Make the ground of a drawing, the robot in the centre of a cell, landmarks in the centres of cells."""
    signs = np.array([list(row) for row in drawing])
    scenario = scenario_of(len(signs), **constants)
    return Ground(
        scenario=scenario,
        pose=(*scenario.grid.centre_of(robot), 0.3),
        known=signs != "?",
        occupied=signs == "#",
        landmarks=scenario.grid.centres(np.array(landmarks, dtype=int)),
    )


def cells_of(*arguments, withheld=None, **constants):
    found = find_candidates(ground(*arguments, **constants), withheld or Withheld())
    return None if found is None else found.cells.tolist()


CORNER = ("...?", "...?", "...?", "????")  # frontiers 2, 6, 8, 9, 10

STRIP = ("???????", ".......", "???????", "???????", "???????", "???????", "???????")  # row 1: cells 7 to 13

TWO_ROOMS = ("?.#.?", "..#.?", "###.?", "....?", "?????")  # the room of 1, 5 and 6 is walled in


# What a frontier is


def test_frontiers_are_known_free_cells_beside_unknown_ones_corners_included():
    assert cells_of(CORNER, 0) == [2, 6, 8, 9, 10]


def test_an_occupied_cell_is_no_frontier():
    assert cells_of(("..#?", "...?", "...?", "????"), 0) == [6, 8, 9, 10]


def test_an_unknown_cell_at_the_corner_is_enough():
    assert cells_of(("...", "...", "..?"), 0) == [4, 5, 7]


def test_the_robot_s_own_cell_is_no_candidate():
    assert cells_of(CORNER, 10) == [2, 6, 8, 9]


def test_a_landmark_s_cell_is_no_candidate():
    assert cells_of(CORNER, 0, [9]) == [2, 6, 8, 10]


def test_a_frontier_that_known_free_cells_do_not_join_is_left_out():
    assert cells_of(TWO_ROOMS, 18, candidates_per_robot=9) == [3, 8, 13, 15, 16, 17]
    assert cells_of(TWO_ROOMS, 6, candidates_per_robot=9) == [1, 5]


def test_a_gap_between_two_corners_is_no_way():
    assert cells_of((".#?", "#.?", "???"), 4, candidates_per_robot=9) is None


def test_a_map_all_known_has_no_candidates():
    assert find_candidates(ground(("...", ".#.", "..."), 0), Withheld()) is None


# Which are chosen


def test_the_five_nearest_to_the_robot():
    """In a strip all cells but the robot's own are frontiers: from cell 8 the five nearest are 7 and 9 to 12."""
    assert cells_of(STRIP, 8) == [7, 9, 10, 11, 12]


def test_the_three_nearest_to_a_landmark_beside_them():
    """A landmark seen at the strip's far end (row 0) adds 11, 12 and 13 to the five nearest to the robot."""
    assert cells_of(STRIP, 7, [6]) == [8, 9, 10, 11, 12, 13]


def test_a_frontier_chosen_twice_is_one_candidate_and_not_replaced():
    """The landmark above the robot has its three nearest among the robot's five."""
    assert cells_of(STRIP, 8, [1]) == [7, 9, 10, 11, 12]


def test_the_numbers_are_the_scenario_s():
    assert cells_of(STRIP, 7, [6], candidates_per_robot=2, candidates_per_landmark=1) == [8, 9, 13]


def test_ties_go_to_the_lower_cell():
    """Four frontiers at the same distance from the middle; one, two or three may be taken."""
    cross = ("?.?", "...", "?.?")
    for count, expected in ((1, [1]), (2, [1, 3]), (3, [1, 3, 5])):
        assert cells_of(cross, 4, candidates_per_robot=count) == expected


def test_ties_from_a_landmark_go_to_the_lower_cell():
    """From the landmark in row 0 above cell 10, cells 9 and 11 tie for the second place."""
    chosen = cells_of(STRIP, 13, [3], candidates_per_robot=0, candidates_per_landmark=2)
    assert chosen == [9, 10]


def test_distance_is_measured_from_the_robot_not_from_its_cell():
    near_right = ground(("?.?", "...", "?.?"), 4, candidates_per_robot=1)
    x, y, heading = near_right.pose
    shifted = Ground(
        near_right.scenario, (x + 0.5, y, heading), near_right.known, near_right.occupied, np.empty((0, 2))
    )
    assert find_candidates(shifted, Withheld()).cells.tolist() == [5]


# Paths


def test_paths_run_from_the_robot_s_cell_to_the_candidate_with_their_length_in_metres():
    found = find_candidates(ground(CORNER, 0), Withheld())
    assert [path.tolist() for path in found.paths][:2] == [[0, 1, 2], [0, 1, 6]]
    assert {path[0] for path in found.paths} == {0}
    assert [path[-1] for path in found.paths] == found.cells.tolist()
    assert found.lengths == pytest.approx([4.0, 2 + 2 * math.sqrt(2), 4.0, 2 + 2 * math.sqrt(2), 4 * math.sqrt(2)])


def test_paths_go_round_obstacles_and_landmarks():
    for drawing, landmarks in ((("...?", ".#.?", "...?", "????"), []), (CORNER, [5])):
        found = find_candidates(ground(drawing, 0, landmarks), Withheld())
        assert found.cells.tolist() == [2, 6, 8, 9, 10]
        assert not any(5 in path for path in found.paths)
        assert found.lengths[-1] == pytest.approx(8.0)


def test_the_robot_may_leave_a_cell_that_it_believes_blocked():
    assert cells_of(("#..?", "...?", "...?", "????"), 0) == [2, 6, 8, 9, 10]
    assert cells_of(CORNER, 0, [0]) == [2, 6, 8, 9, 10]


def test_estimates_off_the_map_count_for_the_nearest_cell():
    inside = ground(CORNER, 0)
    landmarks = np.array([[5.0, -3.0]])  # cell 2
    outside = Ground(inside.scenario, (-0.4, -0.9, 0.0), inside.known, inside.occupied, landmarks)
    found = find_candidates(outside, Withheld())
    assert outside.own_cell == 0
    assert found.cells.tolist() == [6, 8, 9, 10]
    assert {path[0] for path in found.paths} == {0}


def test_unknown_cells_count_as_free_where_no_frontier_can_be_reached_otherwise():
    found = find_candidates(ground((".?.", "###", "###"), 0), Withheld())
    assert found.cells.tolist() == [2]
    assert found.paths[0].tolist() == [0, 1, 2]
    assert found.lengths == pytest.approx([4.0])


def test_unknown_cells_do_not_count_as_free_while_a_frontier_can_be_reached():
    """Cell 3 lies behind unknown ground; cell 1 can be reached through known ground."""
    assert cells_of(("..?.", "####", "####", "####"), 0) == [1]


def test_a_robot_walled_in_by_what_it_believes_drives_through_it():
    """Every free cell of a world can be reached, so a map without a way out is wrong."""
    assert cells_of((".#?.", "##??", "????", "????"), 0) == [3]


def test_obstacles_are_driven_through_only_where_nothing_else_is_left():
    assert cells_of((".#?.", "..??", "????", "????"), 0) == [4, 5]


# Withheld frontiers


def withholding(cells, drawing):
    known = ground(drawing, 0).known
    withheld = Withheld()
    for cell in cells:
        withheld.add(cell, known)
    return withheld


def test_a_withheld_frontier_is_left_out_and_another_takes_its_place():
    assert cells_of(STRIP, 8, withheld=withholding([9], STRIP)) == [7, 10, 11, 12, 13]


def test_a_withheld_frontier_returns_when_an_unknown_neighbour_becomes_known():
    changed = ("...?", "...?", "...?", "?.??")  # cell 13, below 8, 9 and 10
    withheld = withholding([2, 9], CORNER)
    assert cells_of(CORNER, 0, withheld=withheld) == [6, 8, 10]
    assert 9 in cells_of(changed, 0, withheld=withheld)
    assert 2 not in cells_of(changed, 0, withheld=withheld)


def test_changes_farther_off_do_not_return_it():
    changed = ("...?", "...?", "...?", "???.")
    withheld = withholding([2], CORNER)
    assert 2 not in cells_of(changed, 0, withheld=withheld)


def test_a_frontier_withheld_anew_is_withheld_as_it_is_now():
    changed = ("...?", "...?", "...?", "?.??")
    withheld = withholding([9], CORNER)
    withheld.add(9, ground(changed, 0).known)
    assert 9 not in cells_of(changed, 0, withheld=withheld)


def test_withheld_frontiers_return_when_nothing_else_is_left():
    assert cells_of(CORNER, 0, withheld=withholding([2, 6, 8, 9, 10], CORNER)) == [2, 6, 8, 9, 10]


def test_a_frontier_behind_unknown_ground_comes_before_a_withheld_one():
    drawing = ("..?.", "####", "####", "####")
    assert cells_of(drawing, 0, withheld=withholding([1], drawing)) == [3]


# The definition, on random maps


@st.composite
def grounds(draw):
    n = draw(st.integers(3, 7))
    signs = draw(st.lists(st.sampled_from("??....#"), min_size=n * n, max_size=n * n))
    cells = st.integers(0, n * n - 1)
    drawing = ["".join(signs[row * n : row * n + n]) for row in range(n)]
    return ground(drawing, draw(cells), draw(st.lists(cells, max_size=3)))


@given(grounds())
def test_candidates_are_what_the_definition_says(field):
    """Frontiers by a dilation of the unknown, reach by connected components, the choice by sorting."""
    own = field.own_cell
    blocked = field.occupied.copy()
    for x, y in field.landmarks:
        blocked[int(y // CELL), int(x // CELL)] = True
    beside_unknown = ndimage.binary_dilation(~field.known, np.ones((3, 3)))
    frontier = field.known & ~blocked & beside_unknown
    expected = set()
    for passable in (field.known & ~blocked, ~blocked, np.ones_like(blocked)):
        passable = passable.copy()
        passable[divmod(own, len(passable))] = True
        rooms = ndimage.label(passable)[0]
        reached = np.flatnonzero(frontier & (rooms == rooms[divmod(own, len(passable))]))
        cells = [cell for cell in reached.tolist() if cell != own]
        for point, count in [(field.pose[:2], 5), *((tuple(landmark), 3) for landmark in field.landmarks)]:
            near = sorted(cells, key=lambda cell: (math.dist(field.scenario.grid.centre_of(cell), point), cell))
            expected |= set(near[:count])
        if expected:
            break
    found = find_candidates(field, Withheld())
    assert ([] if found is None else found.cells.tolist()) == sorted(expected)


@given(grounds())
def test_every_candidate_is_reachable_by_the_roads_with_the_same_length(field):
    found = find_candidates(field, Withheld())
    if found is None:
        return
    cells, lengths = found.roads.reachable
    assert found.roads.start == field.own_cell
    assert found.roads.grid == field.scenario.grid
    assert set(found.cells.tolist()) <= set(cells.tolist())
    assert found.lengths == pytest.approx(lengths[np.searchsorted(cells, found.cells)], rel=1e-12)
    for cell in found.cells.tolist():
        assert found.roads.path_to(cell)[[0, -1]].tolist() == [field.own_cell, cell]


# The roads beside the candidates


def test_the_roads_are_those_of_known_free_cells_while_a_frontier_can_be_reached_through_them():
    found = find_candidates(ground(("..?.", "####", "####", "####"), 0), Withheld())
    assert found.roads.reachable.cells.tolist() == [1]
    assert found.roads.reachable.lengths == pytest.approx([2.0])


def test_where_unknown_cells_count_as_free_the_roads_lead_through_them():
    found = find_candidates(ground((".?.", "###", "###"), 0), Withheld())
    assert found.roads.reachable.cells.tolist() == [1, 2]
    assert found.roads.path_to(2).tolist() == [0, 1, 2]


def test_where_believed_obstacles_are_driven_through_the_roads_lead_everywhere():
    found = find_candidates(ground((".#?.", "##??", "????", "????"), 0), Withheld())
    assert found.roads.reachable.cells.tolist() == list(range(1, 16))
