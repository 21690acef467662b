"""Each rule that scores candidates: worth by hand, and a choice that is not the nearest frontier's."""

import functools
import inspect
import itertools
import math

import numpy as np
import pytest
from handmade_observations import in_landmark_world, in_lidar_world, letters_of
from lidar_worlds import SMALL
from test_visible import OPENINGS, TWO_ENDS, by_letter

from baselines.field import terms
from baselines.field.believed import costs, stands
from baselines.field.graph_optimality import Edges, GraphOptimality, spanning_trees
from baselines.field.joint_entropy import JointEntropy
from baselines.field.potential import PotentialField
from baselines.field.sampled import BayesianOptimization, NextBestView
from baselines.field.scores import (
    Burgard,
    CostUtility,
    DistanceAdvantage,
    EntropyReduction,
    HeadingAware,
    InformationGain,
    Makarenko,
    RrtRevenue,
    VisiblePerMetre,
)
from baselines.field.tour import FrontierTour, length_of, open_tour
from baselines.field.transform import ExplorationTransform
from baselines.nearest import Nearest
from explore_bench.errors import RequestError
from explore_bench.runs.suites import FAMILIES, plan
from explore_bench.strategies.contract import Target
from explore_bench.strategies.loading import make_strategy
from explore_bench.strategies.registry import strategies
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec

FIELD = {name: entry for name, entry in strategies().items() if entry.factory.startswith("baselines.field")}
MIRRORED = (
    *("################",) * 4,
    "????########????",
    *("???.########.???",) * 3,
    "???a...R....b???",
    *("???.########.???",) * 3,
    "????########????",
    *("################",) * 3,
)
"""The same opening on both sides, the left one nearer."""


def chosen(rows, strategy, observation):
    strategy.reset(np.random.default_rng(0))
    return letters_of(rows)[strategy.choose(observation)]


# Scores


def test_distance_advantage_takes_the_near_end_before_the_long_rest():
    """Advantage of the end 43 · 2 / 9 − 4 m, of the nearest 26 · 2 / 9 − 2 m."""
    rows = ["#" * 10] * 4 + ["b.Ra......"] + ["#" * 10] * 5
    observation = in_landmark_world(rows)
    worth = by_letter(rows, DistanceAdvantage().worth(observation))
    assert worth == pytest.approx({"a": 52 / 9 - 2, "b": 86 / 9 - 4})
    assert chosen(rows, DistanceAdvantage(), observation) == "b"
    assert chosen(rows, Nearest(), observation) == "a"


def test_distance_advantage_looks_at_the_frontiers_within_reach_and_one_more():
    rows = ["#" * 10] * 4 + ["c..Ra...b."] + ["#" * 10] * 5
    observation = in_landmark_world(rows)
    worth = by_letter(rows, DistanceAdvantage(reach=2.5).worth(observation))
    assert np.isfinite([worth["a"], worth["c"]]).all()
    assert worth["b"] == -math.inf
    assert np.isfinite(DistanceAdvantage(reach=2.5, most=1).worth(observation)).sum() == 1


def test_without_the_distance_it_is_the_remotest():
    rows = ["#" * 10] * 4 + ["..b.Ra...c"] + ["#" * 10] * 5
    observation = in_landmark_world(rows)
    assert chosen(rows, DistanceAdvantage(distance=0.0), observation) == "c"
    assert chosen(rows, DistanceAdvantage(), observation) == "a"


def test_cost_utility_prefers_the_longer_frontier_by_metres():
    """The pocket's frontier is too short; else 3 · 2 − 0.5 against 3 · 3 − 3.5 m would tie: 5.5."""
    observation = in_lidar_world(OPENINGS)
    assert by_letter(OPENINGS, CostUtility().worth(observation)) == {"a": -math.inf, "b": -5.5}
    assert by_letter(OPENINGS, CostUtility(least=0.0).worth(observation)) == {"a": -5.5, "b": -5.5}
    assert chosen(OPENINGS, CostUtility(), observation) == "b"
    assert chosen(OPENINGS, Nearest(), observation) == "a"


def test_as_its_code_computes_it_the_distance_hardly_counts():
    """3 · 4 − 2 against 3 · 14 − 10 m as it is meant, 0.15 · 4 − 2 against 0.15 · 14 − 10 as it is computed."""
    observation = in_landmark_world(TWO_ENDS)
    assert by_letter(TWO_ENDS, CostUtility().worth(observation)) == pytest.approx({"a": -10.0, "b": -32.0})
    code = strategies()["cost-utility-code"]
    worth = CostUtility(**code.parameters).worth(observation)
    assert by_letter(TWO_ENDS, worth) == pytest.approx({"a": 2 - 0.6, "b": 10 - 2.1})
    assert chosen(TWO_ENDS, CostUtility(), observation) == "a"
    assert chosen(TWO_ENDS, CostUtility(**code.parameters), observation) == "b"
    assert chosen(TWO_ENDS, CostUtility(size=0.0), observation) == "a"


def test_where_no_frontier_is_long_enough_all_count():
    observation = in_lidar_world(OPENINGS)
    assert np.isfinite(CostUtility(least=9.0).worth(observation)).all()


def test_information_gain_weighs_the_logarithm_of_what_is_seen():
    observation = in_lidar_world(OPENINGS)
    expected = {"a": 0.75 * math.log(1 + 4) - 2.0, "b": 0.75 * math.log(1 + 116) - 3.0}
    assert by_letter(OPENINGS, InformationGain().worth(observation)) == pytest.approx(expected)
    assert chosen(OPENINGS, InformationGain(), observation) == "b"
    assert chosen(OPENINGS, InformationGain(gain=0.0), observation) == "a"


def test_visible_per_metre_is_a_quotient_and_leaves_short_frontiers_out():
    observation = in_lidar_world(OPENINGS)
    assert by_letter(OPENINGS, VisiblePerMetre().worth(observation)) == {"a": -math.inf, "b": 7.25 / 3}
    assert by_letter(OPENINGS, VisiblePerMetre(least=0.0).worth(observation)) == {"a": 0.125, "b": 7.25 / 3}
    assert chosen(OPENINGS, VisiblePerMetre(least=0.0), observation) == "b"


def test_the_heading_decides_between_two_alike():
    observation = in_lidar_world(MIRRORED)
    worth = by_letter(MIRRORED, HeadingAware().worth(observation))
    assert worth == pytest.approx({"a": 7.25 * math.exp(-0.14 - 0.3), "b": 7.25 * math.exp(-0.175)})
    assert chosen(MIRRORED, HeadingAware(), observation) == "b"
    for control in ("heading-aware-no-heading", "heading-aware-no-distance", "visible-unknown"):
        worth = HeadingAware(**FIELD[control].parameters).worth(observation)
        nearer = chosen(MIRRORED, HeadingAware(**FIELD[control].parameters), observation) == "a"
        assert nearer == (control != "heading-aware-no-distance"), worth


def test_visible_unknown_goes_where_most_is_seen():
    strategy = HeadingAware(**FIELD["visible-unknown"].parameters)
    observation = in_landmark_world(TWO_ENDS)
    assert by_letter(TWO_ENDS, strategy.worth(observation)) == {"a": 4.0, "b": 20.0}
    assert chosen(TWO_ENDS, strategy, observation) == "b"


def test_burgard_goes_round_where_an_obstacle_may_be():
    rows = ["#" * 8] * 3 + ["#au.R..b"] + ["#" * 8] * 4
    observation = in_landmark_world(rows, occupancy={"u": 0.45})
    worth = by_letter(rows, Burgard().worth(observation))
    assert worth == pytest.approx({"a": 1 - 2 * (0.05 + 0.25 + 0.25), "u": 1 - 2 * (0.05 + 0.25), "b": 1 - 2 * 0.15})
    assert chosen(rows, Burgard(), observation) == "b"
    assert chosen(rows, Nearest(), observation) == "u"
    assert Burgard(0.1).choose(observation) == Burgard(50.0).choose(observation), "for one robot β changes nothing"


def test_makarenko_adds_three_utilities():
    """a: nothing but near; b: far, most unknown, best located."""
    observation = in_landmark_world(TWO_ENDS, variances={"a": 0.5, "b": 0.2})
    assert by_letter(TWO_ENDS, Makarenko().worth(observation)) == {"a": 1.0, "b": 2.0}
    assert by_letter(TWO_ENDS, Makarenko(2.0, 1.5, 0.5).worth(observation)) == {"a": 1.5, "b": 2.5}
    assert chosen(TWO_ENDS, Makarenko(), observation) == "b"
    without = {
        name: Makarenko(**FIELD[f"makarenko-no-{name}"].parameters).worth(observation).tolist()
        for name in ("information", "navigation", "localizability")
    }
    assert without == {"information": [1.0, 1.0], "navigation": [0.0, 2.0], "localizability": [1.0, 1.0]}


def test_utilities_that_are_all_the_same_decide_nothing():
    observation = in_landmark_world(TWO_ENDS)
    assert Makarenko(0.0, 0.0, 1.0).worth(observation).tolist() == [1.0, 1.0]


def test_entropy_reduction_goes_where_a_scan_tells_most():
    observation = in_lidar_world(OPENINGS)
    worth = by_letter(OPENINGS, EntropyReduction().worth(observation))
    assert worth["a"] == pytest.approx(1.0)
    assert worth["b"] > 9.0, "the first column alone is nine cells"
    assert chosen(OPENINGS, EntropyReduction(), observation) == "b"
    each = 1.0 - (-0.7 * math.log2(0.7) - 0.3 * math.log2(0.3))
    flat = by_letter(TWO_ENDS, EntropyReduction().worth(in_landmark_world(TWO_ENDS)))
    assert flat["b"] > flat["a"] > each


def test_the_revenue_of_rrt_doubles_what_is_close():
    observation = in_lidar_world(OPENINGS)
    assert by_letter(OPENINGS, RrtRevenue().worth(observation)) == pytest.approx({"a": 6 * 0.25 - 2, "b": 6.0 - 3})
    single = RrtRevenue(**FIELD["rrt-revenue-no-hysteresis"].parameters)
    assert by_letter(OPENINGS, single.worth(observation)) == pytest.approx({"a": 0.75 - 2, "b": 3.0 - 3})
    assert by_letter(OPENINGS, RrtRevenue(close=2.5).worth(observation)) == pytest.approx({"a": -0.5, "b": 0.0})
    assert chosen(OPENINGS, RrtRevenue(), observation) == "b"


def test_on_cells_of_2_m_the_revenue_is_the_straight_distance():
    """So it runs in lidar worlds only."""
    observation = in_landmark_world(TWO_ENDS)
    assert RrtRevenue().worth(observation).tolist() == (-observation.path_lengths).tolist()


# Tours


def test_the_tour_takes_the_short_side_first():
    rows = ["#" * 10] * 4 + ["#b.Rac.d.e"] + ["#" * 10] * 5
    observation = in_landmark_world(rows)
    assert chosen(rows, FrontierTour(), observation) == "b", "4 + 16 m, not 12 + 16"
    assert chosen(rows, Nearest(), observation) == "a"


def places(count, seed):
    at = np.random.default_rng(seed).uniform(0, 20, (count + 1, 2))
    away = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))
    return away[0, 1:], away[1:, 1:]


@pytest.mark.parametrize("count", [1, 2, 3, 5, 7])
def test_a_short_tour_is_the_shortest(count):
    begins, between = places(count, count)
    best = min(length_of(np.array(order), begins, between) for order in itertools.permutations(range(count)))
    order = open_tour(begins, between)
    assert sorted(order.tolist()) == list(range(count))
    assert length_of(order, begins, between) == pytest.approx(best)


@pytest.mark.parametrize("count", [13, 30])
def test_a_long_tour_visits_all_and_no_exchange_shortens_it(count):
    begins, between = places(count, count)
    order = open_tour(begins, between)
    assert sorted(order.tolist()) == list(range(count))
    length = length_of(order, begins, between)
    for i, j in itertools.combinations(range(count + 1), 2):
        other = np.concatenate((order[:i], order[i:j][::-1], order[j:]))
        assert length_of(other, begins, between) > length - 1e-6
    for i, k in itertools.product(range(count), range(count)):
        rest = np.delete(order, i)
        assert length_of(np.insert(rest, k, order[i]), begins, between) > length - 1e-6


def test_places_without_a_way_between_them_do_not_break_the_tour():
    begins, between = places(4, 4)
    between[2, :2] = between[:2, 2] = np.inf
    assert sorted(open_tour(begins, between).tolist()) == [0, 1, 2, 3]


# Fields


def test_the_potential_leads_to_the_longer_frontier():
    """Of the cells beside the robot the right one is lower: 1/5 + 7/5 against 1/3 + 7/7."""
    observation = in_lidar_world(OPENINGS)
    assert chosen(OPENINGS, PotentialField(), observation) == "b"
    assert chosen(OPENINGS, Nearest(), observation) == "a"


def test_the_potential_of_what_was_passed_is_higher():
    """Both sides alike but nearer to the left, where the robot comes from: it goes on."""
    grid = in_lidar_world(MIRRORED).roads.grid
    row = 16 - 1 - 8
    came = [(*grid.centre_of(row * 16 + column), 0.0) for column in (3, 4, 5, 6)]
    observation = in_lidar_world(MIRRORED, poses=came)
    assert chosen(MIRRORED, PotentialField(), observation) == "b"
    assert chosen(MIRRORED, PotentialField(**FIELD["potential-field-no-revisits"].parameters), observation) == "a"


def test_the_transform_avoids_a_narrow_way_and_without_danger_takes_it():
    room = "#" * 11 + "." * 11 + "##"
    rows = ["#" * 24] * 5 + [room] * 6 + ["#?####a....R.........b?#"] + [room] * 6 + ["#" * 24] * 6
    observation = in_lidar_world(rows, edge=0.25, reach=4.0)
    assert chosen(rows, Nearest(), observation) == "a"
    assert chosen(rows, ExplorationTransform(), observation) == "b"
    mapex = ExplorationTransform(**FIELD["exploration-transform-mapex"].parameters)
    assert chosen(rows, mapex, observation) == "b"
    none = ExplorationTransform(**FIELD["exploration-transform-no-danger"].parameters)
    assert chosen(rows, none, observation) == "a"


def test_the_danger_of_hector_and_of_mapex_by_hand():
    """Along a corridor of one cell of 0.5 m a metre costs 1 + 50 · (1.5 − 0.5) m for MapEx; Hector's margin is less."""
    rows = ["#" * 16] * 7 + ["#a..R" + "#" * 11] + ["#" * 16] * 8
    observation = in_lidar_world(rows)
    price = np.full((16, 16), 0.5) * (1 + 50 * 1.0)
    assert costs(observation, price, stands(observation)).tolist() == pytest.approx([1.5 * 51])


# Graphs and entropies


def test_the_spanning_trees_of_a_triangle():
    """A path 0–1 of weight 2, then node 2 joined to both by 3 and 5: 2 · 3 + 2 · 5 + 3 · 5."""
    now = Edges(np.array([[0, 1]]), np.array([2.0]))
    loop = Edges(np.array([[1, 2], [0, 2]]), np.array([3.0, 5.0]))
    tail = Edges(np.array([[1, 2]]), np.array([3.0]))
    found = np.exp(spanning_trees(2, now, [loop, tail], np.array([1, 1])))
    assert found.tolist() == pytest.approx([31.0, 6.0], rel=1e-6)


def test_spanning_trees_are_the_determinant_of_the_whole_laplacian():
    rng = np.random.default_rng(3)
    count, more = 9, 3
    chain = np.stack((np.arange(count - 1), np.arange(1, count)), axis=1)
    now = Edges(np.concatenate((chain, [[1, 6]])), rng.uniform(1, 5, count))
    added = Edges(np.array([[8, 9], [9, 10], [10, 11], [11, 2], [10, 4], [0, 9]]), rng.uniform(1, 5, 6))
    whole = np.zeros((count + more, count + more))
    for (i, j), weight in zip(np.concatenate((now.ends, added.ends)), [*now.weights, *added.weights], strict=True):
        whole[[i, j], [i, j]] += weight
        whole[i, j] -= weight
        whole[j, i] -= weight
    expected = np.linalg.slogdet(whole[1:, 1:])[1]
    assert spanning_trees(count, now, [added], np.array([more]))[0] == pytest.approx(expected, rel=1e-6)


def test_a_graph_of_the_start_alone_can_grow():
    nothing = Edges(np.empty((0, 2), dtype=np.int64), np.empty(0))
    step = Edges(np.array([[0, 1]]), np.array([4.0]))
    assert np.exp(spanning_trees(1, nothing, [step], np.array([1]))).tolist() == pytest.approx([4.0])


def test_the_graph_is_better_after_a_drive_past_a_landmark():
    """The right end is farther, and on the way there the known landmark is in range again and again."""
    rows = ["#" * 12] * 5 + ["#a...R.....b"] + ["#" * 12] * 6
    observation = in_landmark_world(rows, landmarks=[(19.0, 13.0)], reach=4.5)
    assert chosen(rows, Nearest(), observation) == "a"
    assert chosen(rows, GraphOptimality(), observation) == "b"


def test_in_a_lidar_world_a_loop_that_is_expected_counts():
    """The robot has come a long way round; near a it would meet the beginning of its way."""
    rows = ["#" * 24] * 11 + ["#a....R....b" + "#" * 12] + ["#" * 24] * 12
    observation = in_lidar_world(rows, poses=[(1.0, 6.0, 0.0), (1.0, 30.0, 0.0)])
    strategy = GraphOptimality(near=2.0)
    worth = dict(zip(letters_of(rows), strategy.worth(observation).tolist(), strict=True))
    assert worth["a"] > worth["b"]
    far = GraphOptimality(near=2.0, far=1000.0).worth(observation)
    assert far[0] == pytest.approx(far[1]), "no loop is expected: the two are alike"


def test_joint_entropy_weighs_trajectory_map_and_way():
    observation = in_landmark_world(TWO_ENDS, variances={"a": 0.01, "b": 0.01})
    expected = by_letter(TWO_ENDS, JointEntropy().expected(observation))
    assert expected["b"] < expected["a"]
    assert chosen(TWO_ENDS, JointEntropy(), observation) == "b"
    assert chosen(TWO_ENDS, JointEntropy(weight=10.0), observation) == "a"
    lost = in_landmark_world(TWO_ENDS, variances={"a": 0.01, "b": 0.3})
    ahead = by_letter(TWO_ENDS, JointEntropy().expected(lost))["b"] - expected["b"]
    count = len(lost.paths[1])  # the pose now, and one at each cell of the way
    assert ahead == pytest.approx(1.5 * math.log(30.0) * (count - 1) / count)


LOOP = ["#" * 12] * 5 + ["#a..R......b"] + ["#" * 12] * 6
ROUND = [(5.0, 13.0, 0.0), (5.0, 23.0, 0.0), (9.0, 23.0, 0.0)]
"""From a cell two before the robot's own a way of 24 m round to it."""


def test_joint_entropy_closes_a_loop_once_where_the_robot_is_unsure():
    observation = in_landmark_world(LOOP, poses=ROUND)
    assert np.linalg.slogdet(observation.belief.pose_covariances[-1])[1] == pytest.approx(math.log(1e-6))
    strategy = JointEntropy(bound=-14.0)
    strategy.reset(np.random.default_rng(0))
    assert strategy.choose(observation) == Target((5.0, 13.0))
    assert type(strategy.choose(observation)) is int, "to no place twice"
    strategy.reset(np.random.default_rng(0))
    assert strategy.choose(observation) == Target((5.0, 13.0)), "nothing is kept from the trial before"


@pytest.mark.parametrize(
    "options", [{"bound": -13.0}, {"bound": -14.0, "far": 100.0}, {"bound": -14.0, "near": 1.0}, {"closing": False}]
)
def test_no_loop_is_closed_for_a_sure_robot_a_short_way_or_a_far_place(options):
    strategy = JointEntropy(**options)
    strategy.reset(np.random.default_rng(0))
    assert type(strategy.choose(in_landmark_world(LOOP, poses=ROUND))) is int


# Places of their own


OPEN = ("????????", "?......?", "?.R..a.?", "?......?", "?......?", "?......#", "?......#", "????????")


def test_the_next_best_view_is_the_place_of_the_largest_product():
    observation = in_landmark_world(OPEN)
    strategy = NextBestView()
    strategy.reset(np.random.default_rng(0))
    target = strategy.choose(observation)
    grid, unknown = observation.scenario.grid, ~observation.belief.known.reshape(-1)
    centres = grid.centres()
    pool = [c for c in observation.reachable.cells if math.dist(centres[c], observation.positions[0]) <= 5.0]
    worth = {
        c: 4.0
        * (np.hypot(*(centres - centres[c]).T)[unknown] <= 5.0).sum()
        * math.exp(-0.2 * observation.roads.lengths_to(np.array([c]))[0])
        for c in pool
    }
    assert worth[grid.cell_of(*target.position)] == pytest.approx(max(worth.values()))
    assert target.position != tuple(observation.positions[0])
    free = NextBestView(**FIELD["next-best-view-no-distance"].parameters)
    free.reset(np.random.default_rng(0))
    assert free.choose(observation) != target


@pytest.mark.parametrize("strategy", [NextBestView(), BayesianOptimization()], ids=lambda one: type(one).__name__)
def test_no_place_is_chosen_twice_and_in_the_end_the_nearest_is(strategy):
    observation = in_landmark_world(OPEN)
    strategy.reset(np.random.default_rng(0))
    answers = []
    while not answers or isinstance(answers[-1], Target):
        answers.append(strategy.choose(observation))
        assert len(answers) <= 40
    assert len({answer.position for answer in answers[:-1]}) == len(answers) - 1 > 10
    assert answers[-1] == 0


def test_where_nothing_unknown_is_in_view_the_nearest_candidate_is_taken():
    known = in_landmark_world(("R..a", "....", "....", "b..."), reach=3.0)
    for strategy in (NextBestView(), BayesianOptimization(prior=0.5)):
        strategy.reset(np.random.default_rng(0))
        if isinstance(strategy, NextBestView):
            assert strategy.choose(known) == Nearest().choose(known)
    hidden = in_lidar_world(["R..a####"] + ["########"] * 7, reach=3.0)
    for strategy in (NextBestView(), BayesianOptimization()):
        strategy.reset(np.random.default_rng(0))
        assert strategy.choose(hidden) == 0


def test_with_every_place_computed_the_most_information_is_found():
    observation = in_lidar_world(OPENINGS)
    grid = observation.roads.grid
    strategy = BayesianOptimization(first=200)
    strategy.reset(np.random.default_rng(0))
    place = strategy.choose(observation).position
    everywhere = terms.entropy_reduction(observation, grid.centres(observation.reachable.cells), 0.5)
    assert terms.entropy_reduction(observation, np.array([place]), 0.5)[0] == pytest.approx(everywhere.max())


def test_the_process_knows_what_was_computed_and_nothing_far_away():
    at, values = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]), np.array([1.0, 5.0, 3.0])
    mean, sigma = BayesianOptimization(noise=1e-8)._predict(at, values, np.array([*at, [90.0, 90.0]]))
    assert mean[:3] == pytest.approx((values - 3.0) / values.std(), abs=1e-5)
    assert sigma[:3] == pytest.approx(np.zeros(3), abs=1e-3)
    assert (mean[3], sigma[3]) == pytest.approx((0.0, 1.0), abs=1e-6)


def test_matern_s_kernel_by_hand():
    kernel = BayesianOptimization(scale=2.0)._kernel(np.zeros((1, 2)), np.array([[2.0, 0.0]]))
    assert kernel[0, 0] == pytest.approx((1 + math.sqrt(3)) * math.exp(-math.sqrt(3)))


def test_as_many_places_are_computed_as_are_asked_for_and_the_best_of_them_is_taken(monkeypatch):
    observation, computed = in_lidar_world(OPENINGS), []

    def counted(seen, where, prior, original=terms.entropy_reduction):
        values = original(seen, where, prior)
        computed.extend(zip(map(tuple, where.tolist()), values.tolist(), strict=True))
        return values

    monkeypatch.setattr(terms, "entropy_reduction", counted)
    strategy = BayesianOptimization(first=2, more=4)
    strategy.reset(np.random.default_rng(1))
    place = strategy.choose(observation).position
    assert len(dict(computed)) == len(computed) == 6
    assert dict(computed)[place] == max(dict(computed).values())
    by_distance = BayesianOptimization(first=200, per_metre=True)
    by_distance.reset(np.random.default_rng(1))
    computed.clear()
    place = by_distance.choose(observation).position
    robot = observation.pose[:2]
    assert dict(computed)[place] / math.dist(place, robot) == pytest.approx(
        max(value / math.dist(where, robot) for where, value in computed)
    )


# What is asked for


@functools.cache
def strategies_of(suite):
    return {spec.strategy for spec in plan(suite, trials=1).specs}


@pytest.mark.parametrize("name", FIELD)
def test_the_field_takes_part_in_its_own_suites_only(name):
    entry = FIELD[name]
    assert entry.tables == ()
    assert len(entry.suites) == 1
    assert set(entry.suites) < FAMILIES.keys()
    taking_part = [name in strategies_of(suite) for suite in ("field", "field-stage", "paper")]
    assert taking_part == [entry.kinds != ("lidar",), True, False]


@pytest.mark.parametrize("name", [name for name, entry in FIELD.items() if entry.kinds])
def test_a_rule_that_degenerates_on_2_m_cells_is_refused_in_a_landmark_world(name):
    with pytest.raises(RequestError, match=f"strategy '{name}' runs in worlds of kind lidar, not 'landmark'"):
        plan("field", [name])


ONE_EACH = list({entry.factory: name for name, entry in reversed(FIELD.items())}.values())
"""A name for every factory."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ONE_EACH)
def test_every_rule_explores_a_lidar_world(name):
    entry = FIELD[name]
    ended = run_trial(TrialSpec(name, entry.factory, SMALL, 0, dict(entry.parameters), purpose="calibrate"))
    assert ended.status is Status.EXPLORED, ended.reason


NUMBERS = {
    "scores:DistanceAdvantage": {"reach": (0.0, -1.0), "most": (0, 1.5), "distance": (-1.0,)},
    "scores:CostUtility": {"distance": (-1.0,), "size": (-1.0,), "resolution": (0.0,), "least": (-0.1,)},
    "scores:InformationGain": {"gain": (-1.0,), "cell": (0.0,)},
    "scores:VisiblePerMetre": {"least": (-1.0,)},
    "scores:HeadingAware": {"decay": (-0.1,), "turning": (-0.1,)},
    "scores:Burgard": {"beta": (0.0,)},
    "scores:Makarenko": {"information": (-1.0,), "navigation": (-1.0,), "localizability": (-1.0,)},
    "scores:EntropyReduction": {"prior": (0.0, 1.0)},
    "scores:RrtRevenue": {"multiplier": (-1.0,), "radius": (0.0,), "hysteresis": (0.0,), "close": (-1.0,)},
    "sampled:NextBestView": {"decay": (-0.1,), "samples": (0, 2.5)},
    "sampled:BayesianOptimization": {"scale": (0.0,), "noise": (0.0,), "beta": (-1.0,), "first": (0,), "more": (-1,)}
    | {"prior": (1.0,), "samples": (0,), "per_metre": (1, "yes")},
    "transform:ExplorationTransform": {"danger": (-1.0,), "margin": (0.0,), "power": (0.0,)},
    "graph_optimality:GraphOptimality": {"near": (0.0,), "far": (0.0,)},
    "potential:PotentialField": {"revisit": (-1.0,)},
    "joint_entropy:JointEntropy": {"weight": (-1.0,), "bound": (), "near": (0.0,), "far": (0.0,), "prior": (2.0,)}
    | {"closing": (0,)},
}


@pytest.mark.parametrize(
    ("factory", "name", "value"),
    [
        (factory, name, value)
        for factory, constants in NUMBERS.items()
        for name, wrong in constants.items()
        for value in (*wrong, math.nan, "much", *(() if name in ("per_metre", "closing") else (True,)))
    ],
)
def test_constants_that_make_no_sense_are_refused_in_a_sentence(factory, name, value):
    with pytest.raises(RequestError) as caught:
        make_strategy(f"baselines.field.{factory}", {name: value})
    sentence = str(caught.value)
    assert sentence.startswith(f"{name} of ")
    assert f" is {value!r}; give " in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence


def test_every_constant_of_every_rule_is_looked_at():
    for factory, constants in NUMBERS.items():
        place, _, name = factory.partition(":")
        made = getattr(__import__(f"baselines.field.{place}", fromlist=[name]), name)
        assert inspect.signature(made).parameters.keys() == constants.keys(), factory
