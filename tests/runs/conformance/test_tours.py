"""Tours: real rollouts that show what each is named for, without any trace of the world."""

import dataclasses
import gc

import numpy as np
import pytest

from explore_bench.robot.planning.candidates import Ground
from explore_bench.robot.planning.shortest_paths import search_grid
from explore_bench.runs.conformance.tours import (
    CORNERS,
    LARGE,
    LIDAR,
    MANY_CANDIDATES,
    NO_LANDMARK,
    ONE_CANDIDATE,
    ORDINARY,
    SITUATIONS,
    SMALL,
    TRIALS,
    observations,
)
from explore_bench.world.kinds import KINDS

ALL = (*ORDINARY, *SITUATIONS)
AMONG_LANDMARKS = [tour for tour in ALL if tour.kind == "landmark"]
WORLD_TYPES = tuple(kind.load("world") for kind in KINDS.values())


def name_of(tour):
    return tour.name


def test_one_candidate_is_one_at_every_decision():
    assert {len(seen.candidates) for seen in observations(ONE_CANDIDATE)} == {1}


def test_many_candidates_are_sixty_at_every_decision():
    assert {len(seen.candidates) for seen in observations(MANY_CANDIDATES)} == {60}


def test_no_landmark_is_seen_where_there_is_none_and_one_from_the_first_decision_elsewhere():
    """A strategy that needs a landmark is to fail in one place only."""
    assert {len(seen.belief.landmarks) for seen in observations(NO_LANDMARK)} == {0}
    for tour in AMONG_LANDMARKS:
        if tour is not NO_LANDMARK:
            assert min(len(seen.belief.landmarks) for seen in observations(tour)) >= 1, tour.name


def test_there_is_a_choice_everywhere_but_with_one_candidate():
    for tour in ALL:
        if tour is not ONE_CANDIDATE:
            assert min(len(seen.candidates) for seen in observations(tour)) >= 2, tour.name


def test_the_corners_are_the_four_of_the_map_and_the_robot_begins_in_them():
    n = CORNERS[0].scenario.grid.columns
    cells = set()
    for tour in CORNERS:
        x, y, _ = observations(tour)[0].pose
        cells.add((int(x // tour.scenario.cell_size), int(y // tour.scenario.cell_size)))
    assert cells == {(0, 0), (0, n - 1), (n - 1, 0), (n - 1, n - 1)}


def test_the_ordinary_ones_are_of_20_m_and_smaller():
    assert LARGE.scenario.size == 20.0 > SMALL.scenario.size
    assert sum(len(observations(tour)) for tour in ORDINARY) >= 20


def test_own_trials_are_in_other_worlds_than_the_tours():
    assert {tour.scenario for tour in TRIALS} == {tour.scenario for tour in ORDINARY}
    assert not {tour.world().digest for tour in TRIALS} & {tour.world().digest for tour in ALL}


def test_every_kind_of_world_has_an_ordinary_one():
    assert {tour.kind for tour in ORDINARY} == set(KINDS)
    assert {tour.kind for tour in TRIALS} == set(KINDS)


def test_a_lidar_shows_a_fine_map_and_no_landmark_and_leads_into_no_corner():
    """Strategies with a fault of a situation are to fail there, and not in an ordinary world."""
    assert len(observations(LIDAR)) == LIDAR.decisions
    last = LIDAR.scenario.edge - 1
    for seen in observations(LIDAR):
        assert seen.belief.fine is not None and not len(seen.belief.landmarks)
        assert {int(place // LIDAR.scenario.cell_size) for place in seen.pose[:2]} - {0, last}


@pytest.mark.parametrize("tour", AMONG_LANDMARKS, ids=name_of)
def test_every_path_is_the_shortest_over_known_free_cells(tour):
    for seen in observations(tour):
        n, belief = tour.scenario.grid.columns, seen.belief
        ground = Ground(tour.scenario, seen.pose, belief.known, belief.occupancy > 0.5 + 1e-9, belief.landmarks)
        free = belief.known & ~ground.blocked
        cost, _ = search_grid(free, ground.own_cell)
        for cell, path, length in zip(seen.candidates, seen.paths, seen.path_lengths, strict=True):
            assert 0 <= cell < n * n and belief.known.reshape(-1)[cell]
            assert length == pytest.approx(cost[cell] * tour.scenario.cell_size)
            assert path[-1] == cell


@pytest.mark.parametrize("tour", ALL, ids=name_of)
def test_nothing_keeps_the_world_of_a_tour(tour):
    digest = tour.world().digest
    observations(tour)
    gc.collect()
    assert digest not in [held.digest for held in gc.get_objects() if isinstance(held, WORLD_TYPES)]


@pytest.mark.parametrize("tour", ALL, ids=name_of)
def test_arrays_are_read_only(tour):
    for seen in observations(tour):
        for array in (seen.candidates, seen.path_lengths, seen.positions, *seen.paths, seen.belief.occupancy):
            assert not array.flags.writeable
        assert not seen.roads.free.flags.writeable
        if seen.belief.fine is not None:
            assert not seen.belief.fine.known.flags.writeable and not seen.belief.fine.occupied.flags.writeable


def test_a_tour_with_choices_follows_them_to_their_end():
    first = observations(LARGE)
    choices = tuple(int(seen.path_lengths.argmin()) for seen in first)
    again = observations(dataclasses.replace(LARGE, choices=choices))
    assert len(again) == len(first)
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.belief.poses, other.belief.poses)
        assert np.array_equal(one.candidates, other.candidates)
    farthest = int(first[0].path_lengths.argmax())
    other = observations(dataclasses.replace(LARGE, choices=(farthest, 0)))
    assert len(other) == 2
    assert not np.array_equal(other[1].belief.poses, first[1].belief.poses)


def test_no_tour_is_as_long_as_a_slow_trial():
    """The strategy that fails late relies on it."""
    assert max(seen.step for tour in ALL for seen in observations(tour)) < 200
