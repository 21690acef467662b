"""The robot's last map beside the truth: maps drawn by hand, right and wrong in one way each."""

import numpy as np
import pytest
from handmade_lidar import lidar_record, perfect_map
from lidar_worlds import SMALL, drawn

from explore_bench.analysis.lidar.map_quality import map_quality
from explore_bench.analysis.lidar.metrics import METRICS
from explore_bench.trial.snapshot import FREE, OCCUPIED, UNKNOWN

WORLD = drawn(8.0, (3.0, 4.0, 0.1, 5.0), start=(1.0, 1.0, 0.0))
"""A room of 8 m with a wall of 1 m across that leaves 3 m at its end."""


def quality(cells, world=WORLD, **columns):
    return map_quality(lidar_record(world=world, fine_map=cells, **{"x": [1.0], "y": [1.0], **columns}))


def moved(cells, columns):
    """The same map, so many cells to the right."""
    result = np.full_like(cells, UNKNOWN)
    result[:, columns:] = cells[:, :-columns]
    return result


def test_a_perfect_map_is_perfect():
    own = quality(perfect_map(WORLD))
    for within in (1, 2):
        assert own.wall_precision(within) == own.wall_recall(within) == own.wall_f1(within) == 1.0
    assert own.free_iou() == own.covered() == 1.0


def test_a_map_of_nothing_is_worth_nothing():
    own = quality(perfect_map(WORLD, right=False))
    assert (own.wall_precision(2), own.wall_recall(2), own.wall_f1(2)) == (0.0, 0.0, 0.0)
    assert own.free_iou() == own.covered() == 0.0


@pytest.mark.parametrize(("shift", "one", "two"), [(1, True, True), (2, False, True), (3, False, False)])
def test_walls_are_right_within_one_and_two_cells(shift, one, two):
    """Walls along x stay where they are, so a good third of all cells is right whatever the shift."""
    world = drawn(8.0, (3.0, 4.0, 0.5, 5.0), free=[(0.5, 7.5, 0.5, 7.5)])
    own = quality(moved(perfect_map(world), shift), world)
    for within, right in ((1, one), (2, two)):
        assert (own.wall_precision(within) > 0.99) == right
        assert (own.wall_recall(within) > 0.97) == right
        assert (own.wall_f1(within) > 0.98) == right
        assert own.wall_f1(within) > 0.35


@pytest.mark.parametrize("name", ["wall_precision", "wall_recall", "wall_f1"])
def test_the_metrics_of_walls_are_those_within_as_many_cells_as_their_names_say(name):
    made = lidar_record(world=WORLD, fine_map=moved(perfect_map(WORLD), 2), x=[1.0], y=[1.0])
    one, two = (METRICS[f"{name}_{within}"].value(made) for within in (1, 2))
    own = map_quality(made)
    assert (one, two) == (getattr(own, name)(1), getattr(own, name)(2))
    assert one < two


def test_precision_asks_for_what_is_there_and_recall_for_what_is_missing():
    """A third of the walls is not in the map; then a wall stands in the map where there is none."""
    cells = perfect_map(WORLD)
    less = np.where((cells == OCCUPIED) & (np.arange(80)[:, None] >= 40), UNKNOWN, cells)
    assert quality(less).wall_precision(1) == 1.0
    assert 0.4 < quality(less).wall_recall(1) < 0.7
    more = cells.copy()
    more[60:62, 20:60] = OCCUPIED
    assert quality(more).wall_recall(1) == 1.0
    wrong = 80 / (more == OCCUPIED).sum()
    assert quality(more).wall_precision(1) == pytest.approx(1.0 - wrong)
    precision = 1.0 - wrong
    assert quality(more).wall_f1(1) == pytest.approx(2 * precision / (1 + precision))


def test_surfaces_that_nothing_that_counts_faces_are_not_asked_for():
    """A chamber that nobody reaches, and the far side of the wall around it."""
    world = drawn(8.0, (5.0, 5.1, 5.0, 8.0), (5.0, 8.0, 5.0, 5.1), counted=[(0.2, 4.8, 0.2, 7.8), (4.8, 7.8, 0.2, 4.8)])
    cells = perfect_map(world)
    cells[52:, 52:] = UNKNOWN
    assert quality(cells, world).wall_recall(1) == 1.0
    cells[:, 49:52] = np.where(cells[:, 49:52] == OCCUPIED, UNKNOWN, cells[:, 49:52])
    assert quality(cells, world).wall_recall(1) < 1.0


def test_what_counts_only_as_far_as_a_passage_from_walls_still_borders_on_them():
    """In drawn worlds the last 10 cm before a wall do not count."""
    world = drawn(8.0, counted=[(0.2, 7.8, 0.2, 7.8)])
    assert quality(perfect_map(world), world).due.sum() == 4 * 80 - 4
    assert quality(perfect_map(world, right=False), world).wall_recall(2) == 0.0


def test_intersection_over_union_by_hand():
    """Of the free cells that count 100 are unknown, and 50 cells of the wall across are believed free."""
    cells = perfect_map(WORLD)
    due = (cells == FREE).sum()
    cells[70:75, 20:40] = UNKNOWN
    cells[10:20, 33:38] = FREE
    assert quality(cells).free_iou() == pytest.approx((due - 100) / (due + 50))


def test_free_space_that_does_not_count_is_left_out_of_the_union():
    world = drawn(8.0, (3.0, 4.0, 0.1, 7.9), counted=[(0.1, 3.0, 0.1, 7.9)])
    cells = perfect_map(world)
    seen = cells.copy()
    seen[10:20, 45:70] = FREE
    assert quality(cells, world).free_iou() == quality(seen, world).free_iou() == 1.0


# Coverage of the believed map


def test_a_map_smeared_beyond_the_walls_covers_no_more_than_there_is():
    """All is believed free, out to the border: every place that counts is covered, and no more than that."""
    assert quality(np.full((80, 80), FREE, dtype=np.uint8)).covered() == 1.0
    assert quality(np.full((80, 80), FREE, dtype=np.uint8)).free_iou() < 0.95


def test_a_map_that_drift_has_moved_covers_less_though_as_much_is_known():
    """The wall across is believed a metre to the right: where it truly is nothing counts, where it seems to be all."""
    cells = perfect_map(drawn(8.0, (4.0, 5.0, 0.1, 5.0)))
    cells[cells == UNKNOWN] = OCCUPIED
    own = quality(cells)
    assert own.counted[cells == UNKNOWN].sum() == 0, "all that counts is known"
    assert own.covered() == pytest.approx(1.0 - 4.9 / (7.8 * 7.8 - 4.9), abs=0.001)


def test_what_false_walls_shut_off_from_the_robot_is_not_covered():
    """A wall is believed to close the way to the right half; the robot believes to be on one or the other side."""
    cells = perfect_map(WORLD)
    cells[50:80, 35:37] = OCCUPIED
    left, right = quality(cells).covered(), quality(cells, x=[6.0]).covered()
    assert 0.97 < left + right < 1.0, "all but the cells of the false wall"
    assert 0.35 < left < 0.5
    assert 0.5 < right < 0.65


def test_a_robot_that_believes_to_be_in_a_wall_covers_nothing():
    assert quality(perfect_map(WORLD), x=[3.5]).covered() == 0.0


def test_the_cell_that_counts_is_where_the_robot_believes_to_be_at_the_end():
    cells = perfect_map(WORLD)
    cells[50:80, 35:37] = OCCUPIED
    assert quality(cells, x=[1.0, 6.0], y=[1.0, 1.0]).covered() == quality(cells, x=[6.0]).covered()


def test_a_trial_of_which_no_map_was_kept_has_none():
    assert map_quality(lidar_record(rows=0, status="failed")) is None


def test_maps_of_finer_and_coarser_cells_are_compared_with_the_same_truth():
    coarse = SMALL.replace(map_resolution=0.2)
    made = lidar_record(scenario=coarse, world=WORLD, fine_map=perfect_map(WORLD, coarse), x=[1.0], y=[1.0])
    assert map_quality(made).wall_f1(1) == 1.0
    same = SMALL.replace(map_resolution=0.05)
    made = lidar_record(scenario=same, world=WORLD, fine_map=perfect_map(WORLD, same), x=[1.0], y=[1.0])
    assert map_quality(made).covered() == map_quality(made).free_iou() == 1.0
