"""The candidate sets of `belief-attention`: kernels on grids drawn by hand, features of observations recomputed."""

import math

import numpy as np
import pytest
from handmade_graphs import reordered_observation
from hypothesis import given, settings, strategies as st
from scipy import ndimage

from baselines.learned import candidate_features as plus
from baselines.learned.candidate_features import BLOCK_COLUMNS, CANDIDATE_COLUMNS, STATE_COLUMNS, candidate_set
from explore_bench.geometry import Grid
from explore_bench.strategies.contract import Observation
from explore_bench.trial.loop import rollout
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenarios import PAPER


def observations(size=20.0, trial=0, count=8):
    """Observations of a rollout that takes the first candidate, on a calibration world."""
    spec = TrialSpec("x", "x:x", PAPER.replace(size=size), trial, purpose="calibrate")
    world = draw_world(spec.scenario, spec.generator("world"))
    events = rollout(spec.scenario, world, spec.generator("motion"), spec.generator("sensor"))
    found, choice = [], None
    while len(found) < count:
        try:
            event = events.send(choice)
        except StopIteration:
            break
        choice = 0 if isinstance(event, Observation) else None
        if choice == 0:
            found.append(event)
    return found


@pytest.fixture(scope="module")
def seen():
    return observations() + observations(size=30.0, trial=1)


def column(one, name):
    return one.candidates[:, CANDIDATE_COLUMNS.index(name)].astype(float)


def state(one, name):
    return float(one.state[STATE_COLUMNS.index(name)])


def close(a, b, tolerance=1e-5):
    np.testing.assert_allclose(a, b, rtol=tolerance, atol=1e-6)


def test_shapes_and_finite_numbers(seen):
    for observation in seen:
        one = candidate_set(observation)
        assert one.candidates.shape == (len(observation.candidates), len(CANDIDATE_COLUMNS))
        assert one.blocks.shape[1] == len(BLOCK_COLUMNS)
        assert one.places.shape == (len(one.candidates) + len(one.blocks), 2)
        for array in (one.candidates, one.blocks, one.places, one.state):
            assert np.isfinite(array).all()
            assert np.abs(array).max() < 30, "of order one"


@settings(max_examples=15)
@given(data=st.data())
def test_the_order_of_the_candidates_is_that_of_their_rows_and_of_nothing_else(seen, data):
    observation = data.draw(st.sampled_from(seen))
    count = len(observation.candidates)
    order = np.array(data.draw(st.permutations(range(count))))
    shuffled = reordered_observation(observation, order)
    before, after = candidate_set(observation), candidate_set(shuffled)
    np.testing.assert_array_equal(after.candidates, before.candidates[order])
    np.testing.assert_array_equal(after.places, np.concatenate((before.places[:count][order], before.places[count:])))
    np.testing.assert_array_equal(after.blocks, before.blocks)
    np.testing.assert_array_equal(after.state, before.state)


def test_paths_and_predictions(seen):
    for observation in seen[::3]:
        one, belief = candidate_set(observation), observation.belief
        ahead = [belief.predict(path) for path in observation.paths]
        steps = np.array([len(prediction.poses) for prediction in ahead])
        reduction = np.array([belief.uncertainty - prediction.uncertainty for prediction in ahead])
        traces = [np.trace(prediction.pose_covariances, axis1=1, axis2=2) for prediction in ahead]
        now = np.trace(belief.pose_covariances, axis1=1, axis2=2).max()
        close(column(one, "length"), observation.path_lengths / 10)
        close(column(one, "excess_length"), (observation.path_lengths - observation.path_lengths.min()) / 10)
        close(column(one, "steps"), steps / 10)
        close(column(one, "reduction"), reduction / 10)
        close(column(one, "reduction_a_step"), reduction / steps)
        close(column(one, "sigma"), [math.sqrt(trace[-1]) for trace in traces])
        close(column(one, "peak"), [0.5 * math.log(trace.max() / now) for trace in traces], 1e-4)
        close(column(one, "sightings"), [math.log1p(prediction.sightings) for prediction in ahead])


def test_what_a_path_reveals(seen):
    """Against sets of cells in plain numpy, and regions by scipy."""
    for observation in seen:
        one, scenario, known = candidate_set(observation), observation.scenario, observation.belief.known.reshape(-1)
        n, reach = scenario.grid.columns, scenario.sensor_range
        middles = scenario.grid.centres()
        labels, _ = ndimage.label(~known.reshape(n, n), np.ones((3, 3)))
        labels = labels.reshape(-1)
        target = math.ceil(scenario.coverage * n * n - 1e-9)
        for i, path in enumerate(observation.paths):
            near = [np.hypot(*(middles - middle).T) <= reach for middle in scenario.grid.centres(path)]
            revealed = np.any(near, axis=0) & ~known
            touched = [(labels == label).sum() for label in set(labels[revealed])]
            left = [((labels == label) & ~revealed).sum() for label in set(labels[revealed])]
            close(column(one, "revealed")[i], revealed.sum() / 10)
            close(column(one, "revealed_at_end")[i], (near[-1] & ~known).sum() / 10)
            close(column(one, "finishing")[i], min(revealed.sum() / (target - known.sum()), 1))
            close(column(one, "region")[i], sum(touched) / n**2)
            close(column(one, "region_closed")[i], revealed.sum() / max(sum(touched), 1))
            close(column(one, "pocket")[i], max((math.exp(-x / 5) for x in left if x), default=0.0))
            wide = np.hypot(*(middles - observation.positions[i]).T) <= 2 * reach
            close(column(one, "around")[i], (wide & ~known).sum() / 50)


def test_the_distance_to_the_nearest_other_candidate(seen):
    observation = next(o for o in seen if len(o.candidates) > 2)
    apart = column(candidate_set(observation), "apart") * 10
    for i, place in enumerate(observation.positions):
        others = np.delete(observation.positions, i, axis=0)
        assert apart[i] == pytest.approx(min(np.hypot(*(others - place).T).min(), 20.0), rel=1e-5)


def test_blocks_hold_what_is_unknown(seen):
    for observation in seen:
        one, known = candidate_set(observation), observation.belief.known
        unknown, cells = (one.blocks[:, BLOCK_COLUMNS.index(name)] for name in ("unknown", "cells"))
        assert float((unknown * cells * 16).sum()) == pytest.approx((~known).sum(), rel=1e-5)
        assert (unknown > 0).all()
        middles = one.places[len(one.candidates) :].astype(float) * 10
        distances = np.hypot(*(middles - np.array(observation.pose[:2])).T)
        close(one.blocks[:, BLOCK_COLUMNS.index("distance")] * 10, distances, 1e-4)


def test_blocks_of_a_map_whose_edge_is_no_multiple_of_theirs():
    known = np.ones((6, 6), dtype=bool)
    known[5, 5] = known[0, 0] = False
    features, middles = plus._blocks(known, Grid(6, 6, 2.0), 0.0, 0.0)
    close(features, [[1 / 16, 1.0, math.hypot(4, 4) / 10], [1 / 4, 0.25, math.hypot(10, 10) / 10]])
    close(middles, [[4.0, 4.0], [10.0, 10.0]])


def test_regions_are_joined_across_corners():
    known = np.ones((4, 4), dtype=bool)
    known[0, 0] = known[1, 1] = known[3, 0] = False
    labels, sizes = plus._regions(known)
    assert labels[0] == labels[5] != labels[12]
    assert sorted(sizes.tolist()) == [1, 2]


def test_the_state(seen):
    for observation in seen:
        one, belief, scenario = candidate_set(observation), observation.belief, observation.scenario
        assert state(one, "explored") == pytest.approx(belief.explored)
        assert state(one, "uncertainty") == pytest.approx(belief.uncertainty / scenario.prior_uncertainty)
        assert state(one, "time") == pytest.approx(observation.step / scenario.cell_count)
        assert state(one, "candidates") == pytest.approx(len(observation.candidates) / 10)
        traces = np.trace(belief.pose_covariances, axis1=1, axis2=2)
        assert state(one, "sigma") == pytest.approx(math.sqrt(traces[-1]), rel=1e-5)
        assert state(one, "peak") == pytest.approx(0.5 * math.log(traces.max()), rel=1e-5)
        assert state(one, "slack") == pytest.approx(0.5 * math.log(traces.max() / traces[-1]), abs=1e-5)


def test_reading_changes_nothing(seen):
    observation = seen[-1]
    before = [observation.belief.known.copy(), observation.belief.virtual_map.copy(), observation.positions.copy()]
    first, second = candidate_set(observation), candidate_set(observation)
    assert np.array_equal(first.candidates, second.candidates)
    after = [observation.belief.known, observation.belief.virtual_map, observation.positions]
    assert all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
