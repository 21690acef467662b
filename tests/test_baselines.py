"""The strategies of baselines/: what each chooses, and that only the reference is told the truth."""

import dataclasses
import inspect
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from handmade import TINY
from hasty import Hasty
from hypothesis import given, strategies as st

import baselines.entropy
from baselines.entropy import Entropy, information_gain
from baselines.entropy_per_metre import EntropyPerMetre
from baselines.nearest import Nearest
from baselines.random_walk import Random
from baselines.uncertainty import WEIGHT, Uncertainty
from explore_bench.errors import RequestError
from explore_bench.robot.belief import Belief
from explore_bench.strategies.contract import Observation
from explore_bench.strategies.loading import load_factory, make_strategy
from explore_bench.strategies.registry import strategies
from explore_bench.trial.loop import rollout
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

READY = {name: entry for name, entry in strategies().items() if entry.ready}


def spec_of(name, scenario=TINY, trial=0, **fields):
    """Return a trial of a strategy, of a learned one with the weights of its first training seed."""
    entry = strategies()[name]
    seed, weights = next(iter(entry.weights.items()), (None, None))
    fields |= {"training_seed": seed, "weights": weights}
    return TrialSpec(name, entry.factory, scenario, trial, dict(entry.parameters), entry.reference, **fields)


def make(name):
    spec = spec_of(name)
    return make_strategy(spec.factory, spec.arguments)


def begin(scenario, trial=0, world=None):
    spec = TrialSpec("none", "none:none", scenario, trial, purpose="calibrate")
    world = world or draw_world(scenario, spec.generator("world"))
    return rollout(scenario, world, spec.generator("motion"), spec.generator("sensor"))


def observe(decisions, trial=0, scenario=PAPER):
    """Return the observation after so many decisions for the nearest."""
    events, choice = begin(scenario, trial), None
    while True:
        event = events.send(choice)
        choice = None
        if isinstance(event, Observation):
            if event.decision == decisions:
                return event
            choice = int(event.path_lengths.argmin())


@pytest.fixture(scope="module", params=[(0, 0), (3, 0), (6, 1), (8, 2)])
def observation(request):
    return observe(*request.param)


def varied(observation, **fields):
    return dataclasses.replace(observation, **fields)


def lengths_of(values):
    return SimpleNamespace(candidates=np.arange(len(values)), path_lengths=np.array(values, dtype=float))


# All of them


@pytest.mark.parametrize("name", READY)
def test_every_strategy_explores_and_does_so_twice_alike(name):
    """A learned one may be a poor one and go on to the step limit; it does not fail."""
    first, second = run_trial(spec_of(name)), run_trial(spec_of(name))
    good = (Status.EXPLORED, Status.STEP_LIMIT) if READY[name].trainer else (Status.EXPLORED,)
    assert first.status in good, first.reason
    assert first.steps == second.steps


@pytest.mark.parametrize("name", READY)
def test_nothing_is_kept_from_one_trial_to_the_next(name, observation):
    """One object that plays two trials chooses in the second as a fresh one does; a reference plans in a hurry."""
    world = draw_world(PAPER, spec_of(name, PAPER, 0, purpose="calibrate").generator("world"))
    entry = READY[name]
    used, fresh = (Hasty(**entry.parameters) if entry.reference else make(name) for _ in range(2))

    def reset(made, seed):
        rng = np.random.default_rng(seed)
        made.reset_with_world(rng, world) if READY[name].reference else made.reset(rng)

    reset(used, 1)
    for _ in range(3):
        used.choose(observation)
    reset(used, 7)
    reset(fresh, 7)
    assert [used.choose(observation) for _ in range(3)] == [fresh.choose(observation) for _ in range(3)]


@pytest.mark.parametrize("name", strategies())
def test_every_strategy_says_in_its_module_where_it_comes_from(name):
    """Also one that is not trained."""
    module = inspect.getmodule(load_factory(strategies()[name].factory))
    assert len(module.__doc__) > 60


@pytest.mark.parametrize("name", [name for name in READY if READY[name].trainer])
def test_a_learned_strategy_draws_nothing(name, observation):
    """What it chooses follows from its weights and what it saw."""
    one, other = make(name), make(name)
    one.reset(np.random.default_rng(1))
    other.reset(np.random.default_rng(2))
    for _ in range(3):
        choice = one.choose(observation)
        assert choice == other.choose(observation)
        assert type(choice) is int
        assert 0 <= choice < len(observation.candidates)


# Random


def test_random_uses_its_stream_and_nothing_else():
    one, other = Random(), Random()
    one.reset(np.random.default_rng(5))
    other.reset(np.random.default_rng(5))
    rng = np.random.default_rng(5)
    for count in (3, 9, 1, 40, 7):
        seen = SimpleNamespace(candidates=np.arange(100, 100 + count))
        np.random.default_rng().normal()
        assert one.choose(seen) == other.choose(seen) == rng.integers(count)


def test_random_chooses_every_candidate_equally_often():
    strategy = Random()
    strategy.reset(np.random.default_rng(0))
    counts = np.bincount([strategy.choose(lengths_of([1, 2, 3, 4])) for _ in range(4000)], minlength=4)
    assert len(counts) == 4
    assert np.abs(counts - 1000).max() < 5 * math.sqrt(4000 * 0.25 * 0.75)


def test_random_differs_between_worlds_and_not_between_sizes_of_noise():
    spec = spec_of("random")
    other = spec_of("random", TINY.replace(odometry_sigma=TINY.odometry_sigma / 2))
    draws = [s.generator("strategy").integers(10**9) for s in (spec, other, spec_of("random", trial=1))]
    assert draws[0] == draws[1] != draws[2]


# Nearest


@given(st.lists(st.floats(0.1, 100.0), min_size=1, max_size=30))
def test_nearest_takes_the_shortest_path_and_the_first_among_equals(lengths):
    assert Nearest().choose(lengths_of(lengths)) == lengths.index(min(lengths))


def test_nearest_goes_by_the_path_and_not_by_the_distance(observation):
    assert observation.path_lengths[Nearest().choose(observation)] == observation.path_lengths.min()


# Entropy


def gain(occupancy, delta=0.5, scenario=PAPER):
    return information_gain(np.array(occupancy, dtype=float), 1.0 + 1.0 / delta, scenario)


def in_view(position, scenario):
    """Whether the strategy counts a cell at this place, shape (n_g,)."""
    return scenario.grid.in_reach(position[None], scenario.sensor_range)[0]


def shannon(p):
    return -p * math.log2(p) - (1 - p) * math.log2(1 - p)


def test_the_gain_of_an_unknown_cell_worked_by_hand():
    """H(0.5) = 1; after a miss p = 0.3. α = 1 + 1/δ = 2 at δ = 1: H₂ = −log₂(0.09 + 0.49) = 0.7859."""
    scenario = Scenario(hit=0.7, miss=0.3)
    assert gain([0.5], 1.0, scenario) == pytest.approx(1.0 + math.log2(0.3**2 + 0.7**2))
    assert gain([0.5], 0.5, scenario) == pytest.approx(1.0 + math.log2(0.3**3 + 0.7**3) / 2)


def test_the_gain_of_a_known_free_cell_worked_by_hand():
    """Odds of p = 0.3 times 3/7: p′ = 9/58."""
    after = 9 / 58
    expected = shannon(0.3) + math.log2(after**2 + (1 - after) ** 2)
    assert gain([0.3], 1.0, Scenario(hit=0.7, miss=0.3)) == pytest.approx(expected)


def test_an_occupied_cell_is_expected_to_be_seen_occupied():
    assert gain([0.7], 1.0) == pytest.approx(gain([0.3], 1.0))


def test_a_certain_cell_stays_within_the_clamp():
    clamp = PAPER.occupancy_clamp
    expected = shannon(clamp) + math.log2(clamp**2 + (1 - clamp) ** 2)
    assert gain([clamp], 1.0) == pytest.approx(expected)


def test_with_a_certain_pose_the_gain_is_to_the_min_entropy():
    """The limit of a vanishing δ: α → ∞ and H_∞ = −log₂ 0.7."""
    expected = 1.0 + math.log2(0.7)
    assert gain([0.5], 1e-9, Scenario(hit=0.7, miss=0.3)) == pytest.approx(expected, abs=1e-6)


def test_with_a_lost_pose_the_gain_is_to_shannon_s_entropy():
    """The limit of a growing δ: α → 1."""
    assert gain([0.5], 1e9, Scenario(hit=0.7, miss=0.3)) == pytest.approx(1.0 - shannon(0.3), abs=1e-6)


@given(st.lists(st.floats(0.05, 0.95), max_size=20), st.floats(1e-3, 1e3))
def test_the_gain_rises_with_unknown_cells(others, delta):
    """One more in view, or one in the place of a cell that was seen often."""
    clamp = PAPER.occupancy_clamp
    assert gain([*others, 0.5], delta) > gain(others, delta)
    assert gain([*others, 0.5], delta) > gain([*others, clamp], delta)
    assert gain([*others, 0.5], delta) > gain([*others, 1.0 - clamp], delta)


@given(st.lists(st.floats(0.05, 0.95), min_size=1, max_size=20), st.floats(1e-3, 1e2), st.floats(1.1, 10.0))
def test_the_gain_falls_with_the_uncertainty_of_the_pose(occupancy, delta, factor):
    assert gain([0.5, *occupancy], factor * delta) < gain([0.5, *occupancy], delta)


@given(st.lists(st.floats(0.05, 0.95), min_size=1, max_size=20), st.floats(1e-6, 1e6))
def test_the_gain_is_finite(occupancy, delta):
    assert math.isfinite(gain(occupancy, delta))


def test_the_cells_in_view_are_those_whose_centre_is_in_range():
    """From the centre of a 10 × 10 map of 2 m cells, 5 m: checked one by one."""
    scenario = Scenario(size=20.0, sensor_range=5.0)
    view = in_view(np.array([9.0, 5.0]), scenario)
    for cell in range(100):
        x, y = (cell % 10 + 0.5) * 2.0, (cell // 10 + 0.5) * 2.0
        assert view[cell] == (math.hypot(x - 9.0, y - 5.0) <= 5.0)


def test_entropy_chooses_the_largest_gain_over_the_cells_in_view(observation):
    gains = []
    for position, path in zip(observation.positions, observation.paths, strict=True):
        delta = np.trace(observation.belief.predict(path).pose_covariances[-1])
        total = 0.0
        for cell in np.flatnonzero(in_view(position, observation.scenario)):
            total += gain([observation.belief.occupancy.ravel()[cell]], delta, observation.scenario)
        gains.append(total)
    choice = Entropy().choose(observation)
    assert gains[choice] == pytest.approx(max(gains), abs=1e-8)


@pytest.mark.parametrize("lost", range(3), ids=["along x", "along y", "in heading"])
def test_entropy_avoids_the_candidate_where_it_would_be_lost(observation, monkeypatch, lost):
    """With one and the same view everywhere, the pose's predicted covariance decides."""
    positions = np.tile(observation.positions[:1], (len(observation.positions), 1))
    variances = dict(zip(map(id, observation.paths), np.linspace(2.0, 0.1, len(observation.paths)), strict=True))

    def predicted(belief, path):
        covariance = 0.1 * np.eye(3)
        covariance[lost, lost] = variances[id(path)]
        return SimpleNamespace(pose_covariances=covariance[None])

    monkeypatch.setattr(Belief, "predict", predicted)
    assert Entropy().choose(varied(observation, positions=positions)) == len(observation.paths) - 1


def test_entropy_takes_the_shorter_path_among_equal_gains(observation, monkeypatch):
    monkeypatch.setattr(baselines.entropy, "information_gain", lambda occupancy, order, scenario: 1.0)
    assert Entropy().choose(observation) == observation.path_lengths.argmin()


# Uncertainty


def predicted_uncertainty(observation):
    return np.array([observation.belief.predict(path).uncertainty for path in observation.paths])


def test_without_a_weight_uncertainty_takes_the_least_predicted_u(observation):
    predicted = predicted_uncertainty(observation)
    assert predicted[Uncertainty(0.0).choose(observation)] == pytest.approx(predicted.min(), abs=1e-8)


def test_with_a_huge_weight_uncertainty_takes_the_shortest_path(observation):
    choice = Uncertainty(1e6).choose(observation)
    assert observation.path_lengths[choice] == pytest.approx(observation.path_lengths.min())


@pytest.mark.parametrize("weight", [0.3, 1.0, WEIGHT, 10.0])
def test_in_between_uncertainty_weighs_u_against_the_length(observation, weight):
    cost = predicted_uncertainty(observation) + weight * observation.path_lengths
    assert cost[Uncertainty(weight).choose(observation)] == pytest.approx(cost.min(), abs=1e-8)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("uncertainty", Uncertainty().weight),
        ("entropy", strategies()["entropy-path"].parameters["weight"]),
        ("entropy-per-metre", EntropyPerMetre().offset),
    ],
)
def test_the_constants_of_the_benchmark_are_the_tuned_ones(name, value):
    sweep = pd.read_csv(Path(__file__).parents[1] / "docs" / "studies" / "path-weights.csv")
    sweep = sweep[sweep["strategy"] == name]
    assert len(sweep) >= 8
    assert value == sweep.loc[sweep["objective"].idxmin(), "value"]
    tried = sorted(sweep["value"])
    at = tried.index(value)
    assert 0.0 < tried[at - 1] < value < tried[at + 1]  # between two that are worse, neither of them 0


def test_the_baselines_themselves_have_no_other_parameters():
    assert all(strategies()[name].parameters == {} for name in ("uncertainty", "entropy", "entropy-per-metre"))


# Entropy and the length of the path


def test_a_weight_takes_from_the_gain(observation, monkeypatch):
    """With a huge one the shortest path is taken; in between, whichever is worth more."""
    lengths = observation.path_lengths
    assert lengths[Entropy(weight=1e6).choose(observation)] == pytest.approx(lengths.min())
    assert Entropy(weight=0.0).choose(observation) == Entropy().choose(observation)
    gains = np.zeros(len(observation.paths))
    farthest = int(lengths.argmax())
    gains[farthest] = 3.0
    excess = float(lengths[farthest] - lengths.min())
    for weight, expected in ((2.9 / excess, lengths[farthest]), (3.1 / excess, lengths.min())):
        told = iter(gains.tolist())
        monkeypatch.setattr(baselines.entropy, "information_gain", lambda *_, told=told: next(told))
        assert lengths[Entropy(weight=weight).choose(observation)] == pytest.approx(expected)


@pytest.mark.parametrize("offset", [0.5, 5.0, 50.0])
def test_entropy_per_metre_takes_the_largest_quotient(observation, offset):
    """Worked anew: Shannon's entropy of every cell whose centre is in range of the candidate."""
    scenario, occupancy = observation.scenario, observation.belief.occupancy.reshape(-1)
    each = -(occupancy * np.log2(occupancy) + (1 - occupancy) * np.log2(1 - occupancy))
    centres = scenario.grid.centres()
    worth = [
        each[np.hypot(*(centres - place).T) <= scenario.sensor_range].sum() / (length + offset)
        for place, length in zip(observation.positions, observation.path_lengths, strict=True)
    ]
    assert worth[EntropyPerMetre(offset).choose(observation)] == pytest.approx(max(worth), abs=1e-8)


@pytest.mark.parametrize(
    ("make_one", "complaint"),
    [
        (lambda: Entropy(weight=-0.1), "weight of the entropy strategy is -0.1"),
        (lambda: Entropy(weight=math.nan), "weight of the entropy strategy is nan"),
        (lambda: EntropyPerMetre(0.0), "offset of the strategy entropy-per-metre is 0.0"),
    ],
)
def test_constants_that_make_no_sense_are_refused(make_one, complaint):
    with pytest.raises(RequestError, match=complaint):
        make_one()


def test_candidates_differ_in_what_they_promise(observation):
    """Else none of the tests above would tell one choice from another."""
    assert np.ptp(predicted_uncertainty(observation)) > 0.1
    assert np.ptp(observation.path_lengths) > 0.1


# References


def test_no_ordinary_strategy_has_the_door_of_the_reference():
    for name in READY:
        assert hasattr(make(name), "reset_with_world") == READY[name].reference
        assert hasattr(make(name), "reset") != READY[name].reference


class Spy:
    """An ordinary strategy that has the door of a reference, too, and looks at whatever it is given."""

    def reset(self, rng):
        assert isinstance(rng, np.random.Generator)

    def reset_with_world(self, rng, world):
        raise AssertionError("it was told the truth")

    def choose(self, observation):
        held = [getattr(observation, field.name) for field in dataclasses.fields(observation)]
        assert not [item for item in held if isinstance(item, LandmarkWorld)]
        return 0


def test_an_ordinary_strategy_is_never_told_the_truth():
    result = run_trial(TrialSpec("spy", f"{__name__}:Spy", TINY, 0))
    assert result.status is Status.EXPLORED, result.reason


def test_only_a_reference_is_told_the_truth():
    result = run_trial(TrialSpec("spy", f"{__name__}:Spy", TINY, 0, reference=True))
    assert "it was told the truth" in result.reason


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in READY if not READY[name].reference])
def test_hardly_any_trial_gets_stuck_at_20_m(name):
    """At most one, of a hundred or of the twenty that one tries which has learned or is in no table of the paper."""
    trials = range(20 if READY[name].trainer or not READY[name].tables else 100)
    statuses = [run_trial(spec_of(name, PAPER, trial, purpose="calibrate")).status for trial in trials]
    assert statuses.count(Status.STUCK) <= 1
    assert Status.FAILED not in statuses
