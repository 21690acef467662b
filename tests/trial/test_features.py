"""The features of an observation: worked by hand, bounded, ordered, and never too many."""

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from handmade import TINY
from hypothesis import given, settings, strategies as st

from baselines.learned.graph import sums_in_view
from explore_bench.geometry import between, centre_of
from explore_bench.robot.planning.roads import Roads
from explore_bench.strategies.contract import Observation
from explore_bench.trial.decision_process import Course
from explore_bench.trial.features import CANDIDATE_COLUMNS, STATE_COLUMNS, candidate_limit, features
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

CANDIDATE, STATE = list(CANDIDATE_COLUMNS), list(STATE_COLUMNS)


def column(seen, name):
    """Values of a column of the candidates that are some."""
    return seen.candidates[: len(seen.order), CANDIDATE.index(name)]


def observations(scenario, root=0, episodes=1):
    """Observations of random decisions."""
    course = Course(scenario, "train", root)
    for number in range(episodes):
        process, rng = course.begin(number), course.generator(number, "learning")
        while process.observation is not None:
            yield process.observation
            process.decide(int(rng.integers(len(process.observation.candidates))))


@pytest.fixture(scope="module")
def seen_by_hand():
    """A map of 10 × 10 cells, the robot in cell (2, 2) looking along y, two candidates, a landmark.

    Known are the columns x < 8 m; σ₀ = 2 m; the virtual map is 1 m² in known cells and the prior in the others.
    """
    scenario = Scenario(virtual_sigma=2.0, landmark_count=4)
    known = np.zeros((10, 10), dtype=bool)
    known[:, :4] = True
    virtual_map = np.where(known[..., None], (0.5, 0.0, 0.5), (4.0, 0.0, 4.0))
    covariances = np.array([np.diag((0.5, 0.4, 0.1)), np.diag((0.16, 0.09, 0.01))])
    belief = SimpleNamespace(
        scenario=scenario,
        pose=(5.0, 5.0, math.pi / 2),
        poses=np.array([(3.0, 5.0, 0.0), (5.0, 5.0, math.pi / 2)]),
        pose_covariances=covariances,
        landmarks=np.array([(5.0, 15.0)]),
        known=known,
        virtual_traces=virtual_map[..., 0] + virtual_map[..., 2],
        uncertainty=200.0,
        peak_trace=float(np.trace(covariances[0])),
        explored=0.4,
        view=lambda places: scenario.grid.in_reach(places, scenario.sensor_range),
    )
    cells = np.array([23, 63])  # (7, 5) m, to the right, and (7, 13) m, ahead
    paths = np.array([22, 23]), np.array([22, 32, 42, 52, 63])
    positions = np.array([(7.0, 5.0), (7.0, 13.0)])
    lengths = np.array([2.0, 6.0 + math.sqrt(8.0)])
    roads = Roads(scenario.grid, known, 22)
    return features(Observation(belief, 250, 7, cells, positions, paths, lengths, roads))


def test_the_candidates_worked_by_hand(seen_by_hand):
    """Of the 21 cells in a full view those in the columns at 9 m (5) and 11 m (3) are unknown."""
    far = math.hypot(2.0, 8.0)
    expected = {
        "present": (1.0, 1.0),
        "ahead": (0.0, 8.0 / (far + 10.0)),
        "left": (-2.0 / 12.0, -2.0 / (far + 10.0)),
        "length": (2.0 / 12.0, (6.0 + math.sqrt(8.0)) / (16.0 + math.sqrt(8.0))),
        "turn": (0.5, 0.0),
        "unknown": (8.0 / 21.0, 8.0 / 21.0),
        "trace": (1.0 / 8.0, 1.0 / 8.0),
        "view_trace": (1.0 / 8.0, 1.0 / 8.0),
        "landmark": (5.0 / (5.0 + math.hypot(2.0, 10.0)), 5.0 / (5.0 + math.hypot(2.0, 2.0))),
    }
    assert seen_by_hand.order.tolist() == [0, 1]
    for name in CANDIDATE:
        assert column(seen_by_hand, name) == pytest.approx(expected[name], abs=1e-6), name


def test_the_state_worked_by_hand(seen_by_hand):
    """U₀ = 2 · 2² · 100; the limit is 1000 steps; 5 + 3 · 4 candidates are the most."""
    expected = {
        "explored": 0.4,
        "uncertainty": 200.0 / 800.0,
        "sigma": 0.5 / 1.5,
        "peak": 1.0 / 2.0,
        "steps": 0.25,
        "landmarks": 0.25,
        "candidates": 2.0 / 17.0,
    }
    assert seen_by_hand.state.tolist() == pytest.approx([expected[name] for name in STATE])


def test_the_rows_that_pad_are_zero(seen_by_hand):
    assert seen_by_hand.candidates.shape == (17, len(CANDIDATE))
    assert not seen_by_hand.candidates[2:].any()


@pytest.mark.parametrize("scenario", [TINY, PAPER, PAPER.replace(size=30.0, landmark_count=0)])
def test_every_number_lies_within_its_bounds_and_rows_are_ordered_by_path_length(scenario):
    count = 0
    for observation in observations(scenario):
        seen = features(observation)
        assert seen.candidates.dtype == seen.state.dtype == np.float32
        assert np.isfinite(seen.candidates).all()
        assert np.abs(seen.candidates).max() <= 1.0
        assert seen.state.min() >= 0.0
        assert seen.state.max() <= 1.0
        assert sorted(seen.order) == list(range(len(observation.candidates)))
        assert (np.diff(observation.path_lengths[seen.order]) >= -1e-9).all()
        assert (np.diff(column(seen, "length")) >= 0.0).all()
        count += 1
    assert count > 1


def test_equal_paths_are_ordered_by_cell():
    """Lengths that differ by rounding only are equal."""
    observation = next(observations(PAPER))
    lengths = 4.0 + 1e-12 * np.arange(len(observation.candidates))[::-1]
    seen = features(dataclasses.replace(observation, path_lengths=lengths))
    assert seen.order.tolist() == list(range(len(lengths)))


def test_places_are_those_in_the_robot_s_frame():
    """Against the SE(2) arithmetic of the core, the saturation undone."""
    for observation in observations(PAPER):
        seen = features(observation)
        near = np.hypot(column(seen, "ahead"), column(seen, "left"))
        distances = 10.0 * near / (1.0 - near)
        for row, i in enumerate(seen.order):
            ahead, left, _ = between(observation.pose, (*observation.positions[i], 0.0))
            scale = distances[row] / max(near[row], 1e-9)
            assert column(seen, "ahead")[row] * scale == pytest.approx(ahead, abs=1e-3)
            assert column(seen, "left")[row] * scale == pytest.approx(left, abs=1e-3)


def test_unknown_cells_in_view_are_those_that_another_sum_finds():
    for observation in observations(PAPER.replace(size=30.0)):
        unknown = (~observation.belief.known).astype(float).reshape(-1)
        sums = sums_in_view(observation.belief.view(observation.positions), unknown)
        seen = features(observation)
        assert column(seen, "unknown") * 21.0 == pytest.approx(sums[seen.order], abs=1e-4)


def test_the_turn_is_towards_the_first_waypoint():
    for observation in observations(PAPER):
        seen = features(observation)
        for row, i in enumerate(seen.order):
            point = centre_of(PAPER.grid, int(observation.paths[i][1]))
            ahead, left, _ = between(observation.pose, (*point, 0.0))
            assert column(seen, "turn")[row] == pytest.approx(abs(math.atan2(left, ahead)) / math.pi, abs=1e-6)


# How many


@pytest.mark.parametrize(("size", "limit"), [(20.0, 14), (30.0, 26), (40.0, 41)])
def test_the_limit_is_five_and_three_for_each_landmark(size, limit):
    """3, 7 and 12 landmarks (§4.1)."""
    assert candidate_limit(PAPER.replace(size=size)) == limit


@settings(max_examples=10)
@given(
    size=st.sampled_from([8.0, 12.0, 20.0, 30.0]),
    landmarks=st.integers(0, 6),
    robot=st.integers(0, 6),
    each=st.integers(1, 5),
    root=st.integers(0, 1000),
)
def test_no_decision_has_more_candidates_than_the_limit(size, landmarks, robot, each, root):
    scenario = PAPER.replace(
        size=size,
        landmark_count=landmarks,
        obstacle_count=2,
        candidates_per_robot=max(robot, 1 - min(landmarks, 1)),
        candidates_per_landmark=each,
        steps_per_cell=0.5,
    )
    for observation in observations(scenario, root):
        assert 1 <= len(observation.candidates) <= candidate_limit(scenario)
        assert len(features(observation).order) == len(observation.candidates)


def test_a_narrower_table_keeps_the_shortest_paths():
    observation = max(observations(PAPER.replace(size=30.0)), key=lambda one: len(one.candidates))
    whole, narrow = features(observation), features(observation, 4)
    assert len(whole.order) > 4
    assert narrow.candidates.shape == (4, len(CANDIDATE))
    np.testing.assert_array_equal(narrow.candidates, whole.candidates[:4])
    np.testing.assert_array_equal(narrow.order, whole.order[:4])
    np.testing.assert_array_equal(narrow.state, whole.state)


def test_the_observation_is_left_as_it_was():
    observation = next(observations(PAPER))
    before = observation.path_lengths.copy(), observation.belief.known.copy()
    features(observation)
    np.testing.assert_array_equal(observation.path_lengths, before[0])
    np.testing.assert_array_equal(observation.belief.known, before[1])


def test_the_page_lists_every_column_with_its_meaning():
    page = (Path(__file__).parents[2] / "docs" / "gymnasium.md").read_text(encoding="utf-8")
    for name, meaning in (CANDIDATE_COLUMNS | STATE_COLUMNS).items():
        assert f"| `{name}` | {meaning} |" in page
