"""The rollout: rows, decisions and endings, also in a given map."""

import math
from itertools import pairwise

import numpy as np
import pytest
from handmade import HALLS
from playing import (
    PAPER,
    SMALL,
    at_random,
    begin,
    decisions_of,
    farthest,
    first_observation,
    nearest,
    play,
    reachable_from,
    steps_of,
)

from explore_bench.errors import RequestError
from explore_bench.geometry import centre_of
from explore_bench.strategies.contract import Target
from explore_bench.trial.explorer import ChoiceError
from explore_bench.trial.run import Status
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario


def known_around(belief, cell):
    row, column = divmod(cell, belief.scenario.grid.columns)
    return belief.known[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].tolist()


# Rows


@pytest.fixture(scope="module", params=[0, 1, 2, 3])
def played(request):
    """Trials at 20 m with random choices."""
    return play(PAPER, at_random(request.param), request.param)


def test_row_0_is_the_start_known_and_scanned(played):
    first = played[0][0]
    assert isinstance(first, Step)
    assert (first.step, first.decisions, first.path_length, first.turned, first.collisions) == (0, 0, 0.0, 0.0, 0)
    assert (first.x, first.y, first.heading) == pytest.approx((first.true_x, first.true_y, first.true_heading), abs=0.2)
    assert 0.0 < first.explored < 0.9
    assert first.uncertainty < PAPER.prior_uncertainty


def test_steps_are_numbered_without_a_gap(played):
    assert [row.step for row in steps_of(played[0])] == list(range(len(steps_of(played[0]))))


def test_every_step_turns_or_drives_within_the_step_length(played):
    rows = steps_of(played[0])
    for before, after in pairwise(rows):
        turned, driven = after.turned - before.turned, after.path_length - before.path_length
        assert (turned > 1e-9) != (driven > 1e-9)
        assert driven <= PAPER.step_length + 1e-9
        assert turned == 0.0 or math.radians(15.0) - 1e-9 < turned <= math.pi + 1e-9


def test_counts_never_fall(played):
    for name in ("decisions", "path_length", "turned", "collisions", "landmarks"):
        assert (np.diff([getattr(row, name) for row in steps_of(played[0])]) >= 0).all(), name


def test_the_trial_ends_at_the_first_row_that_reaches_the_coverage(played):
    events, ending = played
    explored = [row.explored for row in steps_of(events)]
    assert ending.status is Status.EXPLORED
    assert ending.reason == ""
    assert explored[-1] >= 0.9
    assert max(explored[:-1]) < 0.9


def test_every_decision_has_a_straight_step(played):
    lengths = [0.0] + [rows[-1].path_length for _, rows in decisions_of(played[0])]
    assert np.all(np.diff(lengths) > 0.0)


def test_observations_and_rows_number_the_decisions(played):
    for number, (observation, rows) in enumerate(decisions_of(played[0])):
        assert observation.decision == number
        assert {row.decisions for row in rows} == {number + 1}
        assert rows[0].step == observation.step + 1


def test_observations_offer_candidates_with_paths_from_the_robot_s_cell(played):
    for observation, _ in decisions_of(played[0]):
        belief, n = observation.belief, PAPER.grid.columns
        count = len(observation.candidates)
        assert count >= 1
        assert observation.positions.shape == (count, 2)
        assert observation.path_lengths.shape == (count,)
        assert len(observation.paths) == count
        assert len(belief.poses) == observation.step + 1
        own = int(observation.pose[1] // 2) * n + int(observation.pose[0] // 2)
        for cell, position, path, length in zip(
            observation.candidates.tolist(),
            observation.positions,
            observation.paths,
            observation.path_lengths,
            strict=True,
        ):
            assert tuple(position) == centre_of(PAPER.grid, cell)
            assert path[-1] == cell
            assert path[0] == own or not (0 < observation.pose[0] < 20 and 0 < observation.pose[1] < 20)
            assert length == pytest.approx(np.hypot(*np.diff(np.divmod(path, n))).sum() * 2.0)
            assert belief.known.reshape(-1)[cell]
            assert belief.occupancy.reshape(-1)[cell] <= 0.5


def test_rows_agree_with_the_belief_and_the_true_map():
    """U, the known share, the pose's covariance and the wrongly labelled cells, computed once more."""
    world = draw_world(PAPER, TrialSpec("none", "none:none", PAPER, 5).generator("world"))
    events, ending = play(PAPER, nearest, 5)
    rows = {row.step: row for row in steps_of(events)}
    beliefs = [(observation.step, observation.belief) for observation, _ in decisions_of(events)]
    for step, belief in [*beliefs, (max(rows), ending.belief)]:
        row = rows[step]
        assert row.uncertainty == pytest.approx(belief.virtual_traces.sum())
        assert row.uncertainty == pytest.approx(belief.uncertainty)
        assert row.explored == pytest.approx(belief.known.mean())
        assert row.mislabelled == np.count_nonzero(belief.known & ((belief.occupancy > 0.5 + 1e-9) != world.obstacles))
        assert (row.x, row.y, row.heading) == belief.pose
        covariance = [row.cov_xx, row.cov_xy, row.cov_xh, row.cov_yy, row.cov_yh, row.cov_hh]
        assert covariance == pytest.approx(belief.pose_covariances[-1][np.triu_indices(3)])
        traces = np.trace(belief.pose_covariances, axis1=1, axis2=2)
        assert row.peak_trace == pytest.approx(traces.max())
        assert row.peak_position_trace == pytest.approx((traces - belief.pose_covariances[:, 2, 2]).max())
        assert row.landmarks == len(belief.landmarks)


def expected_drives(observation, answer):
    """Planned drive to the nearest candidate and to what was answered [m]."""
    lengths = observation.path_lengths
    if isinstance(answer, Target):
        cell = observation.scenario.grid.cell_of(*answer.position)
        return lengths.min(), observation.roads.lengths_to(np.array([cell]))[0]
    return lengths.min(), lengths[answer]


def waits(observation, belief):
    """Whether the candidate that was the nearest is a frontier of this belief, and not the robot's own cell."""
    grid, cell = belief.scenario.grid, int(observation.candidates[observation.path_lengths.argmin()])
    taken = [*np.flatnonzero(belief.occupancy > 0.5 + 1e-9), *(grid.cell_of(x, y) for x, y in belief.landmarks)]
    unknown = not np.all(known_around(belief, cell))
    return unknown and cell not in taken and cell != grid.cell_of(*belief.pose[:2])


def to_the_farthest_cell(observation):
    cells, lengths = observation.reachable
    return Target(observation.scenario.grid.centre_of(int(cells[lengths.argmax()])))


@pytest.mark.parametrize("chooser", [nearest, farthest, at_random(3), to_the_farthest_cell])
def test_rows_keep_the_drives_of_the_decision_under_way_and_whether_its_nearest_frontier_waits(chooser):
    """Against the observations, and at the end of each decision against the belief then."""
    events, ending = play(PAPER, chooser, 3)
    first = steps_of(events)[0]
    assert (first.nearest_drive, first.chosen_drive, first.nearest_waits) == (0.0, 0.0, 0)
    answers = [event[1] for event in events if not isinstance(event, Step)]
    decided, told = decisions_of(events), []
    later = [observation.belief for observation, _ in decided[1:]] + [ending.belief]
    for (observation, rows), answer, belief in zip(decided, answers, later, strict=True):
        assert {(row.nearest_drive, row.chosen_drive) for row in rows} == {expected_drives(observation, answer)}
        assert rows[-1].nearest_waits == waits(observation, belief)
        told.append(rows[-1].nearest_waits)
    if chooser is nearest:
        assert sum(told) < len(told) / 2, "what is driven to is seen"
    if chooser is farthest:
        assert 0 < sum(told) < len(told)


# Decisions


def test_with_little_noise_decisions_end_at_the_target_or_at_a_blocked_path():
    scenario = PAPER.replace(odometry_sigma=1e-3, heading_sigma_deg=1e-3)
    events, _ = play(scenario, at_random(0), 1)
    choices = [event for event in events if not isinstance(event, Step)]
    arrived = 0
    for (observation, choice), (later, _) in pairwise(choices):
        if math.dist(later.pose[:2], observation.positions[choice]) <= scenario.arrival_radius:
            arrived += 1
            continue
        path = observation.paths[choice].tolist()
        needed = set(path)
        for cell, to in pairwise(path):
            needed |= {cell // 10 * 10 + to % 10, to // 10 * 10 + cell % 10}
        blocked = set(np.flatnonzero(later.belief.occupancy > 0.5 + 1e-9).tolist())
        blocked |= {int(y // 2) * 10 + int(x // 2) for x, y in later.belief.landmarks}
        assert needed & blocked
    assert arrived > len(choices) // 2


@pytest.mark.parametrize("trial", range(4))
def test_even_without_any_tolerance_a_decision_has_a_straight_step(trial):
    """The estimate leaves the path's segment at a sighting of a landmark, which may follow the first turn."""
    scenario = PAPER.replace(path_tolerance=1e-9, stuck_decisions=1000, steps_per_cell=1.0)
    events, _ = play(scenario, at_random(trial), trial)
    lengths = [0.0] + [rows[-1].path_length for _, rows in decisions_of(events)[:-1]]
    assert len(lengths) > 10
    assert np.all(np.diff(lengths) > 0.0)


@pytest.mark.parametrize(
    ("sensor_range", "steps"),
    [(2.7, 1), (2.05, 4)],  # sighted from x = 9.5, before the cell, or from x = 10.5, inside it
)
def test_a_landmark_sighted_in_the_target_s_cell_ends_the_decision_unless_the_robot_is_there(sensor_range, steps):
    """From (9, 9) towards the centre of cell 45, (11, 9), with a landmark in its far corner."""
    constants = {"landmark_count": 1, "obstacle_count": 0, "odometry_sigma": 1e-3, "heading_sigma_deg": 1e-3}
    scenario = Scenario(sensor_range=sensor_range, step_length=0.5, **constants)
    world = LandmarkWorld(scenario.grid, np.zeros((10, 10), dtype=bool), np.array([[11.95, 9.95]]), (9.0, 9.0, 0.0))
    events = begin(scenario, world=world)
    next(events)
    row = events.send(next(events).candidates.tolist().index(45))
    while isinstance(row, Step):
        last, row = row, next(events)
    assert last.step == steps
    assert last.landmarks == 1
    assert 45 not in row.candidates


@pytest.mark.parametrize("trial", range(4))
def test_a_frontier_at_which_a_decision_ended_is_not_offered_again_as_it_was(trial):
    """Not before the known cells around it change, unless all that is offered was reached before: no ping-pong.

    A sensor of 2.5 m does not see the corners of the cells around, so that frontiers stay what they are.
    """
    scenario = PAPER.replace(sensor_range=2.5)
    events, _ = play(scenario, nearest, trial)
    choices = [event for event in events if not isinstance(event, Step)]
    reached = {}
    for (before, choice), (observation, _) in pairwise(choices):
        if math.dist(observation.pose[:2], before.positions[choice]) <= scenario.arrival_radius:
            target = int(before.candidates[choice])
            reached[target] = known_around(observation.belief, target)
        as_they_were = [
            reached.get(cell) == known_around(observation.belief, cell) for cell in observation.candidates.tolist()
        ]
        assert not any(as_they_were) or all(as_they_were)
    assert len(reached) > 5


def test_an_arrival_radius_as_wide_as_a_cell_is_refused_or_leaves_a_straight_step_in_every_decision():
    """Within reach of the next cell's centre from the start, the driver alone would command nothing."""
    try:
        scenario = PAPER.replace(arrival_radius=2.5, sensor_range=2.5)
    except RequestError:
        return
    events, _ = play(scenario, nearest)
    lengths = [0.0] + [rows[-1].path_length if rows else 0.0 for _, rows in decisions_of(events)]
    assert np.all(np.diff(lengths) > 0.0)


def test_rows_agree_until_the_first_choice_that_differs():
    first, _ = play(PAPER, nearest, 4)
    second, _ = play(PAPER, lambda observation: (nearest if observation.decision < 4 else farthest)(observation), 4)
    rows, others = steps_of(first), steps_of(second)
    last = decisions_of(first)[3][1][-1].step
    assert rows[: last + 1] == others[: last + 1]
    assert rows != others


# What is answered


@pytest.mark.parametrize("answer", [-1, 99, 10**30, 0.0, 1.5, True, np.True_, None, "0", [0], np.array(0), math.nan])
def test_an_answer_that_is_no_index_raises_and_names_the_value(answer):
    observation, _, events = first_observation(SMALL)
    assert len(observation.candidates) < 99
    with pytest.raises(ChoiceError) as error:
        events.send(answer)
    assert repr(answer) in str(error.value)
    assert f"0 to {len(observation.candidates) - 1}" in str(error.value)


def test_the_first_index_past_the_last_is_refused_and_the_last_is_not():
    observation, _, events = first_observation(SMALL)
    count = len(observation.candidates)
    with pytest.raises(ChoiceError, match=f"answer {count} "):
        events.send(count)
    _, _, events = first_observation(SMALL)
    assert events.send(count - 1).step == 1


@pytest.mark.parametrize("kind", [np.int64, np.int8, np.uint16])
def test_integers_of_numpy_are_indices(kind):
    _, _, events = first_observation(SMALL)
    assert events.send(kind(0)).step == 1


# Endings


def test_the_step_limit_ends_a_trial():
    scenario = SMALL.replace(steps_per_cell=0.2)
    events, ending = play(scenario, nearest)
    assert scenario.step_limit == 7
    assert ending.status is Status.STEP_LIMIT
    assert steps_of(events)[-1].step == 7


def test_coverage_is_looked_at_before_the_step_limit_and_at_once():
    """A map seen whole at the start asks for no decision."""
    tiny = Scenario(size=4.0, landmark_count=0, obstacle_count=0, steps_per_cell=0.01)
    events, ending = play(tiny, nearest)
    assert tiny.step_limit == 0
    assert ending.status is Status.EXPLORED
    assert len(events) == 1


def test_a_robot_walled_in_is_stuck_at_once():
    obstacles = np.zeros((10, 10), dtype=bool)
    obstacles[3:6, 3:6] = True
    obstacles[4, 4] = False
    scenario = Scenario(sensor_range=2.9, landmark_count=0, obstacle_count=8)
    world = LandmarkWorld(scenario.grid, obstacles, np.empty((0, 2)), (9.0, 9.0, 0.5))
    events, ending = play(scenario, nearest, world=world)
    assert ending.status is Status.STUCK
    assert ending.reason == "no frontier can be reached"
    assert len(events) == 1
    assert events[0].explored == 0.09


@pytest.mark.parametrize("limit", [1, 2])
def test_decisions_that_do_not_leave_a_cell_are_stuck(limit):
    """With no tolerance each decision ends after its first straight step of 1 cm."""
    scenario = SMALL.replace(path_tolerance=1e-9, step_length=0.01, stuck_decisions=limit)
    events, ending = play(scenario, nearest)
    assert ending.status is Status.STUCK
    assert f"{limit} decisions did not leave cell" in ending.reason
    assert len(decisions_of(events)) == limit


def test_decisions_in_new_cells_are_not_counted_as_stuck():
    """One decision a cell is allowed; the trial goes on for as long as every decision leaves its cell."""
    events, ending = play(PAPER.replace(stuck_decisions=1), nearest, 2)
    assert ending.status is Status.EXPLORED
    assert len(decisions_of(events)) > 5


# Given maps


ROOMS = Scenario(map=HALLS, occlusion=True)


@pytest.fixture(scope="module")
def mapped():
    return play(ROOMS, nearest)


def test_in_a_map_the_known_share_is_of_the_cells_that_count(mapped):
    events, ending = mapped
    world = draw_world(ROOMS, TrialSpec("none", "none:none", ROOMS, 0).generator("world"))
    rows = {row.step: row for row in steps_of(events)}
    beliefs = [(observation.step, observation.belief) for observation, _ in decisions_of(events)]
    for step, belief in [*beliefs, (max(rows), ending.belief)]:
        assert rows[step].explored == pytest.approx(belief.known[world.counted].mean())
        assert belief.explored == pytest.approx(belief.known.mean())
    assert ending.status is Status.EXPLORED
    assert rows[max(rows)].explored >= 0.9 > rows[max(rows) - 1].explored
    assert ending.belief.explored < rows[max(rows)].explored


def test_u_stays_a_sum_over_all_cells(mapped):
    events, ending = mapped
    last = steps_of(events)[-1]
    assert last.uncertainty == pytest.approx(ending.belief.virtual_traces.sum())
    assert ending.belief.virtual_traces.shape == (10, 10)
    assert last.uncertainty < ROOMS.prior_uncertainty == 200.0


def test_nothing_that_a_strategy_is_shown_holds_the_map(mapped):
    for observation, _ in decisions_of(mapped[0]):
        assert observation.scenario.map is None
        assert observation.scenario == ROOMS.blind
        parts = reachable_from(observation)
        assert any(part is observation.belief.known for part in parts)
        assert not [part for part in parts if isinstance(part, str) and part in ROOMS.map]
    assert mapped[1].belief.scenario.map is None


def test_a_world_of_a_map_may_have_fewer_landmarks_but_not_more():
    crowded = ROOMS.replace(landmark_count=60)
    events, ending = play(crowded, nearest)
    assert isinstance(events[0], Step)
    assert ending.status is Status.EXPLORED
    world = draw_world(crowded, TrialSpec("none", "none:none", crowded, 0).generator("world"))
    with pytest.raises(ValueError, match="make them agree"):
        play(crowded.replace(landmark_count=len(world.landmarks) - 1), nearest, world=world)
