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
from hypothesis import given, strategies as st

import baselines.entropy
from baselines.clairvoyant import Clairvoyant, views
from baselines.entropy import Entropy, information_gain
from baselines.nearest import Nearest
from baselines.random_walk import Random
from baselines.uncertainty import WEIGHT, Uncertainty
from explore_bench.robot.belief import Belief
from explore_bench.strategies.contract import Observation
from explore_bench.strategies.loading import load_factory, make_strategy
from explore_bench.strategies.registry import strategies
from explore_bench.trial.loop import rollout
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import Step
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
    """One object that plays two trials chooses in the second as a fresh one does."""
    world = draw_world(PAPER, spec_of(name, PAPER, 0, purpose="calibrate").generator("world"))
    used, fresh = make(name), make(name)

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


def test_the_weight_of_the_benchmark_is_the_tuned_one():
    sweep = pd.read_csv(Path(__file__).parents[1] / "docs" / "studies" / "uncertainty-weight.csv")
    assert Uncertainty().weight == sweep.loc[sweep["objective"].idxmin(), "weight"]
    assert strategies()["uncertainty"].parameters == {}


def test_candidates_differ_in_what_they_promise(observation):
    """Else none of the tests above would tell one choice from another."""
    assert np.ptp(predicted_uncertainty(observation)) > 0.1
    assert np.ptp(observation.path_lengths) > 0.1


# Clairvoyant


def test_the_clairvoyant_is_a_reference_and_has_no_ordinary_door():
    entry = strategies()["clairvoyant"]
    assert entry.reference
    assert entry.published == {}
    assert not hasattr(Clairvoyant(), "reset")
    assert hasattr(Clairvoyant(), "reset_with_world")


def test_no_ordinary_strategy_has_the_door_of_the_reference():
    for name in READY:
        assert hasattr(make(name), "reset_with_world") == (name == "clairvoyant")


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


def test_what_can_be_seen_from_a_cell_is_what_lies_in_range_of_its_centre():
    scenario = Scenario(size=12.0, sensor_range=5.0)
    seen = views(scenario)
    for cell in range(36):
        wanted = np.flatnonzero(in_view(np.array([(cell % 6 + 0.5) * 2.0, (cell // 6 + 0.5) * 2.0]), scenario))
        assert sorted(seen[cell][seen[cell] >= 0]) == wanted.tolist()


@pytest.fixture(scope="module")
def times():
    """Return the steps of three strategies on eight calibration worlds of 20 m."""
    names = ("clairvoyant", "nearest", "random")
    runs = {n: [run_trial(spec_of(n, PAPER, trial, purpose="calibrate")) for trial in range(8)] for n in names}
    assert all(run.status is Status.EXPLORED for own in runs.values() for run in own)
    return {name: np.array([run.steps[-1].step for run in own]) for name, own in runs.items()}


def test_the_clairvoyant_is_faster_than_the_nearest_and_random_on_average(times):
    assert times["clairvoyant"].mean() < 0.9 * times["nearest"].mean()
    assert times["clairvoyant"].mean() < 0.6 * times["random"].mean()


def test_the_clairvoyant_loses_hardly_any_world(times):
    assert (times["clairvoyant"] <= times["nearest"]).sum() >= 6
    assert (times["clairvoyant"] <= times["random"]).all()


CORRIDOR = Scenario(
    size=40.0,
    cell_size=2.0,
    sensor_range=5.0,
    landmark_count=0,
    obstacle_count=380,
    step_length=0.5,
    turn_threshold_deg=15.0,
    arrival_radius=0.25,
    odometry_sigma=1e-3,
    heading_sigma_deg=1e-3,
    turn_sigma=1e-3,
    path_tolerance=1.0,
    candidates_per_robot=5,
    coverage=0.24,
)
"""One row of 20 free cells. From a cell in it the sensor sees 5 cells of its own row and the next two, 3 of the row
after; with both ends seen from columns 2 and 17, 96 of 400 cells are known."""


def corridor(column, heading):
    obstacles = np.ones((20, 20), dtype=bool)
    obstacles[10] = False
    return LandmarkWorld(CORRIDOR.grid, obstacles, np.empty((0, 2)), (2.0 * column + 1.0, 21.0, heading))


def play(strategy, scenario, world):
    """Return the steps that a strategy takes and the columns of the targets that it chooses."""
    if isinstance(strategy, Clairvoyant):
        strategy.reset_with_world(np.random.default_rng(0), world)
    events, choice, steps, chosen = begin(scenario, world=world), None, 0, []
    while True:
        try:
            event = events.send(choice)
        except StopIteration as stop:
            assert stop.value.status is Status.EXPLORED
            return steps, chosen
        choice = None
        if isinstance(event, Step):
            steps = event.step
        else:
            choice = strategy.choose(event)
            chosen.append(int(event.candidates[choice]) % 20)


@pytest.mark.parametrize(
    ("column", "heading", "first"), [(6, math.pi, 4), (13, 0.0, 15), (6, 0.0, 4), (13, math.pi, 15)]
)
def test_in_a_corridor_the_clairvoyant_goes_to_the_near_end_first_and_turns_once(column, heading, first):
    """Near end, then far end: 4 + 15 cells of 4 steps and one turn at most two; the other way 11 + 15 cells."""
    steps, chosen = play(Clairvoyant(), CORRIDOR, corridor(column, heading))
    assert chosen[0] == first
    towards = [column, *chosen]
    turns = sum((a - b) * (c - b) > 0 for a, b, c in zip(towards, towards[1:], towards[2:], strict=False))
    assert turns == 1
    assert 4 * 19 - 4 <= steps <= 4 * 19 + 2


def best_possible(scenario, world, limit):
    """Return the fewest steps of any sequence of choices, by trying them all."""
    best, open_plans = limit, [()]
    while open_plans:
        plan = open_plans.pop()
        events, choice, steps, made = begin(scenario, world=world), None, 0, 0
        while True:
            try:
                event = events.send(choice)
            except StopIteration as stop:
                if stop.value.status is Status.EXPLORED:
                    best = min(best, steps)
                break
            choice = None
            if isinstance(event, Step):
                steps = event.step
                if steps >= best:
                    break
            elif made < len(plan):
                choice, made = plan[made], made + 1
            else:
                open_plans += [(*plan, index) for index in range(len(event.candidates))]
                break
    return best


@pytest.mark.parametrize("trial", range(3))
def test_on_a_small_map_hardly_any_sequence_of_choices_is_faster(trial):
    """All of them tried, without noise. The plan counts whole cells, so a few steps may be lost."""
    scenario = TINY.replace(odometry_sigma=1e-3, heading_sigma_deg=1e-3, coverage=0.9)
    spec = TrialSpec("none", "none:none", scenario, trial, purpose="calibrate")
    world = draw_world(scenario, spec.generator("world"))
    steps, _ = play(Clairvoyant(), scenario, world)
    best = best_possible(scenario, world, steps + 1)
    assert steps <= best + 2


def test_in_a_mirrored_world_the_clairvoyant_takes_as_many_steps():
    world = corridor(6, math.pi)
    mirrored = LandmarkWorld(world.grid, world.obstacles[:, ::-1].copy(), world.landmarks, (27.0, 21.0, 0.0))
    assert play(Clairvoyant(), CORRIDOR, world)[0] == play(Clairvoyant(), CORRIDOR, mirrored)[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in READY if not READY[name].reference])
def test_hardly_any_trial_gets_stuck_at_20_m(name):
    """At most one, of a hundred or of the twenty that a learned strategy tries."""
    trials = range(20 if READY[name].trainer else 100)
    statuses = [run_trial(spec_of(name, PAPER, trial, purpose="calibrate")).status for trial in trials]
    assert statuses.count(Status.STUCK) <= 1
    assert Status.FAILED not in statuses
