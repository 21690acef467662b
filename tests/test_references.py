"""References: tours of known worlds, the bound below which none is, and the clairvoyant that drives along them."""

import csv
import itertools
import math
from collections import defaultdict
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from handmade import TINY
from hypothesis import given, strategies as st

from baselines.reference.accurate import accurate_tour, foreseeing, foretold, objective
from baselines.reference.bound import least_steps, most_shown
from baselines.reference.clairvoyant import (
    MOST_CELLS,
    TOURS,
    Clairvoyant,
    planned,
    planned_for_accuracy,
    site_of,
    stored,
)
from baselines.reference.tour import best_tour, greedy_tour, steps_of, straight_toward_all, toward_all
from explore_bench.errors import RequestError
from explore_bench.geometry import Grid
from explore_bench.records.provenance import scenario_digest
from explore_bench.robot.landmark.driver import Driver
from explore_bench.runs.suites import plan
from explore_bench.strategies.contract import Observation, Target
from explore_bench.strategies.registry import strategies
from explore_bench.trial.loop import rollout
from explore_bench.trial.run import run_trial
from explore_bench.trial.seeding import stream
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import CHEN_2020, PAPER

ROOT = Path(__file__).parents[1]


class Quiet:
    """A stream without noise."""

    def standard_normal(self, shape=None):
        return 0.0 if shape is None else np.zeros(shape)


def world_of(scenario, number=0, purpose="calibrate"):
    return draw_world(scenario, stream(purpose, 0, scenario.size, number, "world"))


def streams(scenario, number=0, purpose="calibrate"):
    return tuple(stream(purpose, 0, scenario.size, number, role) for role in ("motion", "sensor"))


def first_observation(scenario, world):
    return next(event for event in rollout(scenario, world, Quiet(), Quiet()) if isinstance(event, Observation))


def drive(scenario, world, noise=None, aim="time"):
    """Status, rows and answers of the clairvoyant in a world, without noise unless some is given."""
    strategy = Clairvoyant(aim)
    strategy.reset_with_world(np.random.default_rng(0), world)
    events, answer, rows, answers = rollout(scenario, world, *(noise or (Quiet(), Quiet()))), None, [], []
    while True:
        try:
            event = events.send(answer)
        except StopIteration as stop:
            return stop.value.status, rows, answers, strategy.notes
        answer = None
        if isinstance(event, Step):
            rows.append(event)
        else:
            answer = strategy.choose(event)
            answers.append(answer)


# Tours


@pytest.mark.parametrize(("size", "number"), [(20.0, 0), (20.0, 1), (30.0, 0)])
def test_without_noise_a_tour_takes_the_steps_that_it_says(size, number):
    """In the simulator itself, step by step: the plan is no estimate."""
    scenario = PAPER.replace(size=size)
    status, rows, answers, notes = drive(scenario, world_of(scenario, number))
    assert status == "explored"
    assert rows[-1].step == notes["tour"]
    assert notes["bound"] <= notes["tour"]
    assert all(isinstance(answer, Target) for answer in answers)


def test_a_robot_that_drives_straight_has_tours_too():
    """Up to a few steps: a drive can only end where the ground is known to be free, which may take another one."""
    status, rows, _, notes = drive(CHEN_2020, world_of(CHEN_2020))
    assert status == "explored"
    assert abs(rows[-1].step - notes["tour"]) <= 4


def test_annealing_beats_every_greedy_tour():
    site = site_of(first_observation(PAPER, world_of(PAPER)), world_of(PAPER))
    greedy = min(steps_of(site, greedy_tour(site, greed))[0] for greed in (0.0, 0.5, 1.0, 2.0))
    assert best_tour(site, np.random.default_rng(0), 3000).steps < 0.95 * greedy


def test_a_tour_is_the_same_whoever_asks():
    site = site_of(first_observation(TINY, world_of(TINY)), world_of(TINY))
    first, second = planned(site, TINY), planned(site, TINY)
    assert first[0].views.tolist() == second[0].views.tolist()
    assert first[1] == second[1]


def test_a_map_that_cannot_be_explored_has_no_tour():
    """Of two halves with a wall between, only one can be seen."""
    obstacles = np.zeros((12, 12), dtype=bool)
    obstacles[:, 4:8] = True
    scenario = Scenario(size=24.0, landmark_count=0, obstacle_count=48, coverage=0.9, sensor_range=3.0)
    world = LandmarkWorld(scenario.grid, obstacles, np.empty((0, 2)), (3.0, 3.0, 0.0))
    site = site_of(first_observation(scenario, world), world)
    assert best_tour(site, np.random.default_rng(0), 200).steps == math.inf


def best_possible(scenario, world, limit):
    """Return the fewest steps of any sequence of choices among the candidates, by trying them all."""
    best, open_plans = limit, [()]
    while open_plans:
        tried = open_plans.pop()
        events, choice, steps, made = rollout(scenario, world, Quiet(), Quiet()), None, 0, 0
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
            elif made < len(tried):
                choice, made = tried[made], made + 1
            else:
                open_plans += [(*tried, index) for index in range(len(event.candidates))]
                break
    return best


@pytest.mark.parametrize("number", range(3))
def test_on_a_small_map_no_sequence_of_choices_is_faster(number):
    """All of them tried. The tour may stop anywhere, so it may well be faster than any."""
    scenario = TINY.replace(coverage=0.9)
    world = world_of(scenario, number)
    steps = drive(scenario, world)[1][-1].step
    assert steps <= best_possible(scenario, world, steps + 1)


CORRIDOR = Scenario(
    size=40.0,
    sensor_range=5.0,
    landmark_count=0,
    obstacle_count=380,
    step_length=0.5,
    coverage=0.24,
)
"""One row of 20 free cells. From a cell in it the sensor sees 5 cells of its own row and the next two, 3 of the row
after; with both ends seen from columns 2 and 17, 96 of 400 cells are known."""


def corridor(column, heading):
    obstacles = np.ones((20, 20), dtype=bool)
    obstacles[10] = False
    return LandmarkWorld(CORRIDOR.grid, obstacles, np.empty((0, 2)), (2.0 * column + 1.0, 21.0, heading))


@pytest.mark.parametrize(("column", "heading"), [(6, math.pi), (13, 0.0), (6, 0.0), (13, math.pi)])
def test_in_a_corridor_it_goes_to_the_near_end_first_and_turns_once(column, heading):
    """Near end, then far end: 4 + 15 cells of 4 steps and one or two turns; the other way 11 + 15 cells.

    The last cell of each end comes in range a step or two before the robot stands in column 2 or 17.
    """
    status, rows, answers, _ = drive(CORRIDOR, corridor(column, heading))
    assert status == "explored"
    assert 4 * 19 - 8 <= rows[-1].step <= 4 * 19 + 2
    near = column - 1 if column < 10 else column + 1
    assert [int(answers[0].position[0] // 2), answers[0].position[1]] == [near, 21.0]


def test_mirrored_worlds_take_as_many_steps():
    world = corridor(6, math.pi)
    mirrored = LandmarkWorld(world.grid, world.obstacles[:, ::-1].copy(), world.landmarks, (27.0, 21.0, 0.0))
    assert drive(CORRIDOR, world)[1][-1].step == drive(CORRIDOR, mirrored)[1][-1].step


def test_the_next_cells_lead_from_everywhere_to_everywhere_on_shortest_paths():
    free = np.array([[True, True, True], [True, False, True], [True, True, True]])
    toward = toward_all(Grid(3, 3, 2.0), free, 0)
    assert toward[0, 8] in (1, 3)
    assert (toward[4] == -1).all() and (toward[:, 4] == -1).all()
    assert toward[0].tolist()[1:4] == [1, 1, 3]
    driver = Driver(2.0, 0.1, 0.1, open_loop=True)
    assert straight_toward_all(Grid(3, 3, 2.0), free, driver, 6.0)[0, 8] == 8
    near = straight_toward_all(Grid(3, 3, 2.0), free, driver, 4.5)
    assert near[0, 8] != 8, "it is out of range"
    assert near[near[0, 8], 8] == 8


# The lower bound


def shown_by(x, y, angle, length, reach):
    """Lattice points that a run of this length shows and that are not in range where it begins, counted one by one."""
    c, s = math.cos(angle), math.sin(angle)
    side = math.ceil(length + reach) + 2
    points = np.stack(np.meshgrid(np.arange(-side, side + 1), np.arange(-side, side + 1)), axis=-1).reshape(-1, 2)
    dx, dy = points[:, 0] - x, points[:, 1] - y
    along = np.clip(c * dx + s * dy, 0.0, length)
    in_range = np.hypot(dx - along * c, dy - along * s) <= reach
    return int((in_range & (np.hypot(dx, dy) > reach)).sum())


@given(
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(0.0, 2 * math.pi),
    st.integers(1, 12),
)
def test_no_run_shows_more_than_the_most(x, y, angle, steps):
    assert shown_by(x, y, angle, 0.35 * steps, 2.5) <= most_shown(0.35, 2.5, 12)[steps]


def test_some_runs_show_nearly_as_much():
    """Along a row, half a cell off its middle, six rows are in range: 6 more cells for each cell of the way."""
    most = most_shown(0.35, 2.5, 60)
    along = shown_by(0.5, 0.5, 0.0, 21.0, 2.5)
    assert along >= 0.9 * most[60]


def test_a_bound_worked_by_hand():
    """Nothing missing takes no step, a cell one, and 60 m of a straight corridor of cells at least their way."""
    grid = Grid(10, 10, 2.0)
    assert least_steps(0, 90, 0.7, 5.0, grid) == 0
    assert least_steps(-3, 90, 0.7, 5.0, grid) == 0
    assert least_steps(1, 22, 0.7, 5.0, grid) == 1
    bounds = [least_steps(missing, missing + 20, 0.7, 5.0, grid) for missing in range(80)]
    assert bounds == sorted(bounds)
    assert least_steps(60, 80, 1.4, 5.0, grid) < least_steps(60, 80, 0.7, 5.0, grid)
    assert least_steps(60, 80, 0.7, 8.0, grid) < least_steps(60, 80, 0.7, 5.0, grid)


def test_what_a_way_sweeps_bounds_it_as_well():
    """90 cells of 4 m² from a disc of 5 m: (90 − K) / w of way, K = (25π + 20 + 4) / 4 and w = 10 + √8 over 4."""
    widened, width = (25 * math.pi + 2 * 2.0 * 2 * 5.0 + 4.0) / 4.0, (10.0 + 2.0 * math.sqrt(2.0)) / 4.0
    least = math.ceil((90 - widened) / width / 0.7)
    assert least_steps(1, 90, 0.7, 5.0, Grid(10, 10, 2.0)) >= least


# What is stored


def rows():
    with TOURS.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_every_world_of_the_benchmark_has_its_tour():
    worlds = {(spec.scenario.size, spec.trial) for spec in plan("paper", ["clairvoyant"]).specs}
    assert {(float(row["size"]), int(row["trial"])) for row in rows()} == worlds
    for row in rows()[::17]:
        scenario = PAPER.replace(size=float(row["size"]))
        world = world_of(scenario, int(row["trial"]), "evaluate")
        assert (scenario_digest(scenario), world.digest) == (row["scenario"], row["world"])


@pytest.mark.parametrize("size", [20.0, 30.0, 40.0])
def test_stored_tours_take_the_steps_that_they_say(size):
    scenario = PAPER.replace(size=size)
    for number in (0, 49):
        world = world_of(scenario, number, "evaluate")
        tour = stored()[scenario_digest(scenario), world.digest].tour
        site = site_of(first_observation(scenario, world), world)
        assert steps_of(site, tour.views)[0] == tour.steps


def test_a_stored_tour_is_what_the_plan_gives():
    world = world_of(PAPER, 7, "evaluate")
    # of a trial: the noise of its first scan is in the belief that an accurate tour is planned with
    events = rollout(PAPER, world, *streams(PAPER, 7, "evaluate"))
    observation = next(event for event in events if isinstance(event, Observation))
    site = site_of(observation, world)
    tour, bound = planned(site, PAPER)
    kept, kept_bound, accurate = stored()[scenario_digest(PAPER), world.digest]
    assert (tour.views.tolist(), tour.steps, bound) == (kept.views.tolist(), kept.steps, kept_bound)
    assert planned_for_accuracy(site, observation, world).tolist() == accurate.tolist()


@pytest.mark.parametrize("size", [20.0, 30.0, 40.0])
def test_accurate_tours_are_foretold_to_be_better_than_the_fastest(size):
    scenario = PAPER.replace(size=size)
    gains = []
    for number in range(0, 50, 7):
        world = world_of(scenario, number, "evaluate")
        observation = first_observation(scenario, world)
        site, belief = site_of(observation, world), foreseeing(observation.belief, world)
        plan_ = stored()[scenario_digest(scenario), world.digest]
        fast, accurate = (objective(foretold(site, belief, views)) for views in (plan_.tour.views, plan_.accurate))
        gains.append(fast - accurate)
    assert min(gains) > -0.02  # of the trial's own first scan, not of this one without noise
    assert np.mean(gains) > 0.15


def fastest():
    """Fewest steps of any stored trial of any suite that explored, by size and world; references aside."""
    folders = (ROOT / "results" / suite for suite in ("", "field", "robustness", "reference"))
    trials = pd.concat([pd.read_csv(folder / "trials.csv") for folder in folders])
    known = {name for name, entry in strategies().items() if entry.reference}
    trials = trials[(trials["scenario"] == "paper") & (trials["status"] == "explored")]
    trials = trials[~trials["strategy"].isin(known)]
    return trials.groupby(["size", "trial"])["steps"].min().to_dict()


def test_stored_trials_beat_hardly_any_tour_and_no_bound():
    """A tour is faster than the fastest of all trials in at least 95 % of the worlds of every size."""
    best, beaten = fastest(), defaultdict(list)
    for row in rows():
        steps = best[float(row["size"]), int(row["trial"])]
        assert int(row["bound"]) <= steps
        assert int(row["bound"]) <= float(row["steps"])
        beaten[row["size"]].append(steps < float(row["steps"]))
    assert {size: len(own) for size, own in beaten.items()} == {"20": 50, "30": 50, "40": 50}
    assert all(np.mean(own) <= 0.05 for own in beaten.values())


def test_the_bound_is_in_the_median_half_of_the_tour_but_on_the_smallest_maps():
    """It knows nothing of the border; docs/clairvoyant.md says so."""
    shares = defaultdict(list)
    for row in rows():
        shares[row["size"]].append(int(row["bound"]) / float(row["steps"]))
    assert np.median(list(itertools.chain(*shares.values()))) >= 0.5
    assert {size: np.median(own) >= 0.5 for size, own in shares.items()} == {"20": False, "30": True, "40": True}


# Tours for e and η


@pytest.mark.parametrize(("size", "number"), [(20.0, 0), (20.0, 1), (28.0, 2)])
def test_without_noise_a_trial_has_the_e_and_eta_that_were_foretold(size, number):
    """The belief is propagated to the very step at which the trial ends, over landmarks not seen before."""
    scenario = PAPER.replace(size=size)
    world = world_of(scenario, number)
    observation = first_observation(scenario, world)
    site, belief = site_of(observation, world), foreseeing(observation.belief, world)
    fast, _ = planned(site, scenario)
    said = foretold(site, belief, fast.views)
    status, rows, _, notes = drive(scenario, world)
    assert status is Status.EXPLORED
    assert (said.time, notes["tour"]) == (rows[-1].step, rows[-1].step)
    assert said.uncertainty == pytest.approx(rows[-1].uncertainty, rel=1e-5)
    assert said.peak_trace == pytest.approx(rows[-1].peak_trace, rel=1e-5)
    views = accurate_tour(site, belief, fast.views, np.random.default_rng(0), 1500)
    better = foretold(site, belief, views)
    assert objective(better) < objective(said)


def test_a_tour_that_explores_too_little_is_worth_nothing():
    world = world_of(PAPER)
    observation = first_observation(PAPER, world)
    site, belief = site_of(observation, world), foreseeing(observation.belief, world)
    assert foretold(site, belief, site.views[:0]) is None
    assert objective(None) == math.inf


def test_a_reference_that_plans_for_e_and_eta_fills_their_columns_alone():
    entry = strategies()["clairvoyant-accurate"]
    assert entry.reference
    assert entry.fills("trajectory_error") and entry.fills("exploration_efficiency")
    assert not entry.fills("t90") and not entry.fills("regret")
    status, _, _, notes = drive(TINY, world_of(TINY), aim="accuracy")
    assert status is Status.EXPLORED
    assert notes == {}  # regret is to the fastest tour
    with pytest.raises(ValueError, match="there is no aim 'speed'; choose one of 'time', 'accuracy'"):
        Clairvoyant("speed")


# Trials of the clairvoyant


def spec_of(number, scenario=PAPER):
    entry = strategies()["clairvoyant"]
    return TrialSpec("clairvoyant", entry.factory, scenario, number, reference=True)


def test_what_hides_behind_an_obstacle_is_not_planned_for_ever():
    """In this world a cell that is in range of every view the plan can think of is in sight of none."""
    result = run_trial(spec_of(17, PAPER.replace(occlusion=True)))
    assert result.status is Status.EXPLORED
    assert len(result.steps) < 400


def test_it_is_a_reference_that_plans_for_the_time_alone():
    entry = strategies()["clairvoyant"]
    assert entry.reference
    assert entry.published == {}
    assert entry.fills("t90") and entry.fills("regret")
    assert not entry.fills("trajectory_error") and not entry.fills("exploration_efficiency")
    assert strategies()["nearest"].fills("trajectory_error")


def test_a_trial_keeps_what_it_says_of_the_world():
    result = run_trial(spec_of(3))
    assert result.status is Status.EXPLORED
    tour, bound, _ = stored()[scenario_digest(PAPER), result.world.digest]
    assert result.notes == {"tour": tour.steps, "bound": bound}
    assert run_trial(TrialSpec("nearest", "baselines.nearest:Nearest", TINY, 0)).notes == {}


@pytest.mark.parametrize("number", range(4))
def test_with_noise_it_still_explores_and_takes_little_longer(number):
    result = run_trial(spec_of(number))
    assert result.status is Status.EXPLORED
    assert result.steps[-1].step < 1.4 * result.notes["tour"]


def test_a_map_that_is_too_large_is_refused():
    scenario = PAPER.replace(size=104.0)
    assert scenario.cell_count > MOST_CELLS
    result = run_trial(spec_of(0, scenario))
    assert result.status is Status.FAILED
    assert "clairvoyant plans on grids of up to 2601 cells, not 2704; leave it out." in result.reason


def test_a_world_of_another_kind_is_refused():
    strategy = Clairvoyant()
    strategy.reset_with_world(np.random.default_rng(0), world_of(TINY))

    class Other:
        scenario = Scenario(kind="lidar")

    with pytest.raises(RequestError, match="plans in landmark worlds, not in kind 'lidar'"):
        strategy.choose(Other())
