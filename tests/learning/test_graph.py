"""The exploration graph on observations drawn by hand, and against the definition on those of real rollouts.

Maps drawn by hand have 5 × 5 cells of 2 m; cell 7 is the third of the second row, its centre (5, 3). Nodes are
numbered as the graph orders them: trajectory, landmarks, obstacles, candidates.
"""

import dataclasses
import itertools
import math
import time

import numpy as np
import pytest
from handmade_graphs import InRange, reordered_observation
from hypothesis import given, strategies as st

from baselines.learned.graph import (
    CHEN_2020,
    CURRENT,
    EQUATION_4,
    FEATURES,
    FRONTIER,
    LANDMARK,
    OBSTACLE,
    TRAJECTORY,
    exploration_graph,
)
from explore_bench.errors import RequestError
from explore_bench.geometry import Grid, cell_of, centre_of
from explore_bench.robot.belief import Belief
from explore_bench.robot.planning.roads import Roads
from explore_bench.strategies.contract import Observation
from explore_bench.trial.loop import rollout
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

CELL = 2.0


def see(track, landmarks=(), obstacles=(), candidates=(), heading=0.0, edge=5, **constants):
    """Make what a robot sees that drove along points [m]: landmarks at points, obstacles and candidates in cells."""
    scenario = Scenario(size=CELL * edge, landmark_count=0, obstacle_count=0, **constants)
    n = scenario.grid.columns
    poses = np.array([(x, y, 0.0) for x, y in track])
    poses[-1, 2] = heading
    occupancy, known = np.full(n * n, 0.5), np.zeros(n * n, dtype=bool)
    occupancy[list(obstacles)], known[list(obstacles)] = 0.7, True
    belief = Belief(
        scenario=scenario,
        poses=poses,
        pose_covariances=np.tile(0.01 * np.eye(3), (len(poses), 1, 1)),
        landmarks=np.array(landmarks, dtype=float).reshape(-1, 2),
        landmark_covariances=np.tile(0.01 * np.eye(2), (len(landmarks), 1, 1)),
        landmark_ids=np.arange(len(landmarks)),
        occupancy=occupancy.reshape(n, n),
        known=known.reshape(n, n),
        virtual_map=np.tile([1.0, 0.0, 1.0], (n, n, 1)),
        uncertainty=2.0 * n * n,
        peak_trace=0.03,
        graph=InRange(),
    )
    cells = np.array(candidates, dtype=np.int64)
    own = cell_of(scenario.grid, *track[-1])
    positions = scenario.grid.centres(cells)
    return Observation(
        belief=belief,
        step=len(poses) - 1,
        decision=0,
        candidates=cells,
        positions=positions,
        paths=tuple(np.array([own, cell]) for cell in candidates),
        path_lengths=np.hypot(*(positions - poses[-1, :2]).T),
        roads=Roads(scenario.grid, np.ones((n, n), dtype=bool), own),
    )


def believing(observation, **fields):
    """Return the observation with other beliefs."""
    return dataclasses.replace(observation, belief=dataclasses.replace(observation.belief, **fields))


def with_cells(observation, **values):
    """Return the observation with some cells of its grids changed: occupancy={3: 0.9}."""
    grids = {name: getattr(observation.belief, name).copy() for name in values}
    for name, changes in values.items():
        for cell, value in changes.items():
            grids[name][divmod(cell, observation.scenario.grid.columns)] = value
    return believing(observation, **grids)


def graph(observation, columns=EQUATION_4, **options):
    return exploration_graph(observation, columns, **options)


def column(observation, name, **options):
    """Values of one feature column in its unit, shape (N,)."""
    return graph(observation, [name], **options).features[:, 0] * FEATURES[name].scale


def edges(made):
    """Pairs of joined nodes, the smaller number first."""
    return set(zip(*(ends.tolist() for ends in np.nonzero(np.triu(made.adjacency))), strict=True))


def edges_of(*arguments, **options):
    return edges(graph(see(*arguments, **options)))


TRACK = ((1.0, 1.0), (3.0, 1.0), (5.0, 1.0), (5.0, 3.0))
LANDMARKS = ((2.0, 4.5), (8.0, 3.0))
OBSTACLES = (5, 11)  # at (1, 3) and (3, 5)
CANDIDATES = (12, 14, 17)  # at (5, 5), (9, 5) and (5, 7)
WHOLE = see(TRACK, LANDMARKS, OBSTACLES, CANDIDATES)
"""Nodes 0 to 3 are the track, 4 and 5 landmarks, 6 and 7 obstacles, 8 to 10 candidates."""


# The nodes


def test_the_flags_are_those_of_table_1():
    assert (TRAJECTORY, CURRENT, LANDMARK, FRONTIER, OBSTACLE) == (-1, 0, 1, 2, -2)
    assert column(WHOLE, "flag").tolist() == [-1, -1, -1, 0, 1, 1, -2, -2, 2, 2, 2]


def test_the_counts_say_which_rows_are_trajectory_and_candidates():
    made = graph(WHOLE)
    assert (made.trajectory, made.candidates) == (4, 3)
    assert made.features.shape == (11, 5)
    assert made.adjacency.shape == (11, 11)
    assert made.features.dtype == made.adjacency.dtype == np.float32


def test_at_the_start_the_only_trajectory_node_is_the_present_position():
    made = graph(see([(5.0, 5.0)], candidates=[7]), ["flag"])
    assert made.features.tolist() == [[0], [2]]
    assert (made.trajectory, made.candidates) == (1, 1)
    assert edges(made) == {(0, 1)}


def test_poses_in_one_cell_are_one_node_at_the_latest_of_them():
    """Poses at x = 0.5, 1.5 in cell 0 and 2.5, 3.5 in cell 1: nodes at 1.5 and 3.5, 2 m apart."""
    observation = see([(0.5, 1.0), (1.5, 1.0), (2.5, 1.0), (3.5, 1.0)])
    np.testing.assert_allclose(column(observation, "distance"), [2.0, 0.0], atol=1e-6)
    assert graph(observation).trajectory == 2


def test_cells_come_in_the_order_of_their_latest_visit():
    """Cells 0, 1, 2, 1 again: 0 was left first, then 2, and the robot is in 1, off its centre by half a metre."""
    observation = see([(1.0, 1.0), (3.0, 1.0), (5.0, 1.0), (3.5, 1.0)])
    made = graph(observation, ["flag", "distance"])
    np.testing.assert_allclose(made.features, [[-1, 0.25], [-1, 0.15], [0, 0.0]], atol=1e-6)


def test_the_last_trajectory_node_is_the_present_pose_also_where_it_was_before():
    """Round a block of four cells and back: the first cell's node moves to the end."""
    observation = see([(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0), (1.0, 1.5)])
    assert column(observation, "flag").tolist() == [-1, -1, -1, 0]
    expected = [math.hypot(2.0, 0.5), math.hypot(2.0, 1.5), 1.5, 0.0]
    np.testing.assert_allclose(column(observation, "distance"), expected, atol=1e-6)


def test_estimates_beyond_the_map_belong_to_the_nearest_cell():
    """A robot believed 0.3 m outside of cell 5 is in the cell of its pose before, a landmark outside has a cell."""
    observation = see([(0.2, 3.0), (-0.3, 3.0)], landmarks=[(10.5, 10.5)], candidates=[6])
    observation = with_cells(observation, occupancy={5: 0.3, 24: 0.9, 6: 0.2})
    np.testing.assert_allclose(column(observation, "occupancy"), [0.3, 0.9, 0.2], atol=1e-6)


@pytest.mark.parametrize(
    ("occupancy", "known", "is_node"),
    [(0.7, True, True), (0.51, True, True), (0.5, True, False), (0.3, True, False), (0.7, False, False)],
)
def test_an_obstacle_is_a_known_cell_believed_occupied(occupancy, known, is_node):
    observation = with_cells(see([(1.0, 1.0)]), occupancy={13: occupancy}, known={13: known})
    assert column(observation, "flag").tolist() == [0, -2] if is_node else [0]
    assert len(graph(observation).features) == 1 + is_node


def test_obstacles_come_by_their_cells():
    observation = see([(1.0, 1.0)], obstacles=[24, 2, 10])
    expected = [math.hypot(4.0, 0.0), math.hypot(0.0, 4.0), math.hypot(8.0, 8.0)]
    np.testing.assert_allclose(column(observation, "distance")[1:], expected, atol=1e-5)


def test_without_obstacles_the_graph_is_that_of_the_other_nodes():
    bare, full = graph(WHOLE, obstacles=False), graph(WHOLE)
    others = [0, 1, 2, 3, 4, 5, 8, 9, 10]
    assert (bare.trajectory, bare.candidates) == (4, 3)
    np.testing.assert_array_equal(bare.features, full.features[others])
    np.testing.assert_array_equal(bare.adjacency, full.adjacency[np.ix_(others, others)])


def test_a_candidate_in_a_visited_cell_is_a_node_of_its_own():
    observation = see(TRACK, candidates=[0])
    assert column(observation, "flag").tolist() == [-1, -1, -1, 0, 2]
    assert (0, 4) not in edges(graph(observation))


# The edges


def test_the_edges_of_a_whole_drawing():
    """(i) along the track; (ii) 0 and 1 to landmark 4, 2 and 3 to 5; (iii), (iv) and (v) as worked below."""
    assert edges(graph(WHOLE)) == {
        *((0, 1), (1, 2), (2, 3)),
        *((0, 4), (1, 4), (2, 5), (3, 5)),
        *((3, 8), (5, 9), (4, 10)),
        (4, 5),
        *((0, 6), (3, 7)),
    }


def test_rule_1_joins_cells_that_follow_each_other():
    assert edges_of(TRACK) == {(0, 1), (1, 2), (2, 3)}


def test_rule_1_goes_by_the_way_driven_and_not_by_the_order_of_the_nodes():
    """Cells 0, 1, 2, 1: nodes are 0, 2, 1, and nobody drove from 0 to 2."""
    assert edges_of([(1.0, 1.0), (3.0, 1.0), (5.0, 1.0), (3.5, 1.0)]) == {(0, 2), (1, 2)}


def test_rule_1_keeps_the_edges_of_all_visits():
    """Round a block and back to its first cell: four nodes in a ring, the last one the first cell."""
    assert edges_of([(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0), (1.5, 1.0)]) == {(0, 1), (1, 2), (2, 3), (0, 3)}


def test_rule_1_joins_neighbours_only_where_the_robot_went_from_one_to_the_other():
    """A hairpin: the first cell lies beside the last one."""
    assert (0, 3) not in edges_of([(1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0)])


def test_rule_1_spans_a_jump_of_the_estimate():
    assert edges_of([(1.0, 1.0), (7.0, 5.0)]) == {(0, 1)}


def test_rule_1_joins_no_cell_with_itself():
    assert edges_of([(0.5, 1.0), (1.0, 1.0), (1.5, 1.0)]) == set()


def test_rule_2_joins_each_trajectory_node_with_its_nearest_landmark():
    """Landmarks 3 and 4 at x = 0 and 10, nodes at x = 1, 3 and 7."""
    found = edges_of([(1.0, 5.0), (3.0, 5.0), (7.0, 5.0)], landmarks=[(0.0, 5.0), (10.0, 5.0)])
    assert found == {(0, 1), (1, 2), (3, 4), (0, 3), (1, 3), (2, 4)}


def test_rule_2_goes_by_the_latest_pose_in_the_cell():
    """Between landmarks at x = 1 and 6.5 the middle is 3.75; the cell's centre is at 3, a pose of it at 3.9."""
    landmarks = [(1.0, 1.0), (6.5, 1.0)]
    assert edges_of([(3.0, 1.0), (3.9, 1.0)], landmarks) == {(1, 2), (0, 2)}
    assert edges_of([(3.9, 1.0), (3.0, 1.0)], landmarks) == {(1, 2), (0, 1)}


def test_rule_2_is_void_while_no_landmark_is_seen():
    assert edges_of([(5.0, 5.0)], candidates=[6, 24]) == {(0, 1), (0, 2)}


def test_rule_3_joins_a_candidate_with_the_nearest_landmark_where_that_is_nearer_than_the_robot():
    """From (5, 5) the candidate at (9, 5) is 4 m away, the landmark at (9, 8) 3 m and the one at (7, 9) further."""
    observation = see([(5.0, 5.0)], landmarks=[(7.0, 9.0), (9.0, 8.0)], candidates=[14])
    assert {pair for pair in edges(graph(observation)) if 3 in pair} == {(2, 3)}


def test_rule_3_joins_a_candidate_with_the_robot_where_that_is_nearer_than_all_landmarks():
    """The landmark at (9, 9.5) is 4.5 m from the candidate."""
    observation = see([(5.0, 5.0)], landmarks=[(9.0, 9.5)], candidates=[14])
    assert {pair for pair in edges(graph(observation)) if 2 in pair} == {(0, 2)}


def test_rule_3_knows_the_present_position_and_no_earlier_one():
    """Candidate 0 lies beside the first pose; it is joined with the robot all the same."""
    found = edges_of([(3.0, 1.0), (5.0, 1.0), (7.0, 1.0)], candidates=[0])
    assert {pair for pair in found if 3 in pair} == {(2, 3)}


def test_rule_4_joins_all_landmarks_with_each_other():
    landmarks = [(1.0, 1.0), (9.0, 1.0), (1.0, 9.0), (9.0, 9.0)]
    found = edges_of([(2.0, 2.5)], landmarks)
    assert found == {(0, 1), *itertools.combinations(range(1, 5), 2)}


def test_rule_4_leaves_a_single_landmark_alone():
    assert edges_of([(2.5, 2.5)], [(1.0, 1.0)]) == {(0, 1)}


def test_rule_5_joins_each_obstacle_with_the_nearest_trajectory_node():
    """Obstacle 10, at (1, 5), is 2 m from the first node; 14, at (9, 5), 2 m from the last; a landmark stands in both.

    Cells 10 and 14 are nodes 5 and 6.
    """
    observation = see([(1.0, 3.0), (5.0, 3.0), (9.0, 3.0)], [(1.0, 5.0), (9.0, 5.0)], obstacles=[10, 14])
    assert {pair for pair in edges(graph(observation)) if 5 in pair} == {(0, 5)}
    assert {pair for pair in edges(graph(observation)) if 6 in pair} == {(2, 6)}


def test_rule_5_joins_no_obstacle_with_another():
    assert edges_of([(1.0, 1.0)], obstacles=[12, 13, 14]) == {(0, 1), (0, 2), (0, 3)}


def test_an_edge_weighs_one():
    assert set(graph(WHOLE).adjacency.ravel().tolist()) == {0.0, 1.0}


def test_a_weighted_edge_weighs_its_length():
    """2 m along the track, √(1 + 12.25) to a landmark, 2 m from robot to candidate, and so on."""
    adjacency = graph(WHOLE, weighted=True).adjacency
    lengths = [
        *((0, 1, 2.0), (1, 2, 2.0), (2, 3, 2.0)),
        *((0, 4, math.sqrt(13.25)), (1, 4, math.sqrt(13.25)), (2, 5, math.sqrt(13.0)), (3, 5, 3.0)),
        *((3, 8, 2.0), (5, 9, math.sqrt(5.0)), (4, 10, math.sqrt(15.25))),
        (4, 5, math.sqrt(38.25)),
        *((0, 6, 2.0), (3, 7, math.sqrt(8.0))),
    ]
    expected = np.zeros((11, 11))
    for i, j, length in lengths:
        expected[i, j] = expected[j, i] = length
    np.testing.assert_allclose(adjacency, expected, rtol=1e-6)


def test_a_weighted_edge_is_as_long_as_from_the_latest_poses():
    """Poses 0.5, 1.5 | 2.5, 3.5: nodes 2 m apart, though the border was crossed by a step of 1 m."""
    adjacency = graph(see([(0.5, 1.0), (1.5, 1.0), (2.5, 1.0), (3.5, 1.0)]), weighted=True).adjacency
    np.testing.assert_allclose(adjacency, [[0.0, 2.0], [2.0, 0.0]])


# The features


def test_columns_come_as_asked_for():
    both = graph(WHOLE, ["flag", "distance"]).features
    np.testing.assert_array_equal(both, graph(WHOLE, ["distance", "flag"]).features[:, ::-1])
    assert graph(WHOLE, []).features.shape == (11, 0)


@pytest.mark.parametrize("name", FEATURES)
def test_a_column_has_a_meaning_and_a_finite_value_for_every_node(name):
    feature = FEATURES[name]
    assert feature.meaning.strip()
    assert feature.symbol.strip()
    assert feature.scale > 0
    made = graph(WHOLE, [name]).features
    assert made.shape == (11, 1)
    assert np.isfinite(made).all()


def test_the_columns_of_equation_4_and_of_chen_et_al():
    assert EQUATION_4 == ("distance", "bearing", "shannon", "renyi", "flag")
    assert CHEN_2020 == ("trace", "distance", "bearing", "occupancy", "flag")
    assert {*EQUATION_4, *CHEN_2020} <= FEATURES.keys()


def test_a_path_length_is_that_of_the_planned_path_and_the_straight_distance_of_what_is_no_candidate():
    observation = dataclasses.replace(WHOLE, path_lengths=WHOLE.path_lengths + [1.5, 20.0, 0.25][: len(CANDIDATES)])
    found, straight = column(observation, "path_length"), column(observation, "distance")
    np.testing.assert_allclose(found[-len(CANDIDATES) :], observation.path_lengths, rtol=1e-6)
    np.testing.assert_array_equal(found[: -len(CANDIDATES)], straight[: -len(CANDIDATES)])
    assert (found[-len(CANDIDATES) :] > straight[-len(CANDIDATES) :] + 0.2).all()


def test_an_unknown_column_is_refused_with_the_nearest_name():
    with pytest.raises(RequestError) as refused:
        graph(WHOLE, ["flag", "distanse"])
    assert str(refused.value) == "feature column 'distanse' is unknown; did you mean 'distance'?"


def test_distance_is_from_the_robot():
    """From (1, 1): a landmark 3 m along x and 4 m along y, a candidate 8 m along x, an obstacle 6 m along y."""
    observation = see([(3.0, 1.0), (1.0, 1.0)], [(4.0, 5.0)], obstacles=[15], candidates=[4])
    np.testing.assert_allclose(column(observation, "distance"), [2.0, 0.0, 5.0, 6.0, 8.0], rtol=1e-6)
    np.testing.assert_allclose(graph(observation, ["distance"]).features[:, 0], [0.2, 0.0, 0.5, 0.6, 0.8], rtol=1e-6)


@pytest.mark.parametrize(
    ("heading", "degrees"),
    [
        (0.0, (0, 90, 180, -90, 45)),
        (math.pi / 2, (-90, 0, 90, 180, -45)),
        (-math.pi / 2, (90, 180, -90, 0, 135)),
        (math.pi, (180, -90, 0, 90, -135)),
        (math.radians(-135), (135, -135, -45, 45, 180)),
        (math.radians(30), (-30, 60, 150, -120, 15)),
    ],
)
def test_bearing_is_from_the_heading_and_lies_within_half_a_turn(heading, degrees):
    """From (5, 5) candidates lie ahead along x, along y, behind, to the right, and along the diagonal."""
    observation = see([(5.0, 5.0)], candidates=[13, 17, 11, 7, 18], heading=heading)
    bearings = column(observation, "bearing")
    assert bearings[0] == 0.0, "the robot itself"
    np.testing.assert_allclose(np.degrees(bearings[1:]), degrees, atol=1e-4)
    np.testing.assert_allclose(graph(observation, ["bearing"]).features[1:, 0], np.array(degrees) / 180, atol=1e-6)


def test_shannon_sums_over_the_cells_in_range():
    """2.1 m reach from a cell's centre to those of the cells beside it, for the corner's candidate to cells 1 and 5.

    An unknown cell has 1 bit; H(0.3) = H(0.7) = 0.8813 and H(0.05) = 0.2864.
    """
    observation = see([(5.0, 5.0)], candidates=[0, 13], sensor_range=2.1)
    observation = with_cells(observation, occupancy={12: 0.3, 7: 0.7, 5: 0.05})
    h3, h05 = 0.8812908992306927, 0.28639695711595625
    expected = [2 * h3 + 3.0, 2.0 + h05, h3 + 4.0]
    np.testing.assert_allclose(column(observation, "shannon"), expected, rtol=1e-6)
    np.testing.assert_allclose(graph(observation, ["shannon"]).features[:, 0], np.array(expected) / 10, rtol=1e-6)


def test_shannon_goes_by_the_place_of_a_node_and_not_by_its_cell():
    """A landmark at (3.9, 5.9) has four centres within 1.6 m, 1.27 to 1.56 m off; its own cell's has only itself."""
    observation = see([(5.0, 5.0)], landmarks=[(3.9, 5.9)], candidates=[11], sensor_range=1.6)
    np.testing.assert_allclose(column(observation, "shannon"), [1.0, 4.0, 1.0], rtol=1e-6)


def test_a_cell_at_the_range_itself_is_in_range():
    observation = see([(5.0, 5.0)], candidates=[4], sensor_range=2.0)
    np.testing.assert_allclose(column(observation, "shannon"), [5.0, 3.0], rtol=1e-6)


def test_cell_shannon_is_of_the_node_s_own_cell():
    observation = with_cells(see([(5.0, 5.0)], candidates=[13, 14]), occupancy={12: 0.3, 13: 0.05})
    np.testing.assert_allclose(column(observation, "cell_shannon"), [0.88129090, 0.28639696, 1.0], rtol=1e-6)


def test_renyi_is_of_the_node_s_cell_with_an_order_from_its_virtual_landmark():
    """β = 1 + 1 / tr Σ: traces 1, 0.5 and 2 give orders 2, 3 and 1.5 at p = 0.3, 0.2 and 0.1; β = 2 at 0.5 is 1 bit."""
    observation = see([(5.0, 5.0)], candidates=[13, 14, 17])
    observation = with_cells(
        observation,
        occupancy={12: 0.3, 13: 0.2, 14: 0.1},
        virtual_map={12: (0.4, 9.0, 0.6), 13: (0.25, 0.1, 0.25), 14: (1.5, 0.0, 0.5), 17: (0.5, 0.0, 0.5)},
    )
    expected = [
        -math.log2(0.3**2 + 0.7**2),
        math.log2(0.2**3 + 0.8**3) / -2.0,
        math.log2(0.1**1.5 + 0.9**1.5) / -0.5,
        1.0,
    ]
    np.testing.assert_allclose(column(observation, "renyi"), expected, rtol=1e-6)


def test_the_trace_of_a_pose_is_of_its_position():
    """Poses of cell 0 twice, then of cell 1: the latest of each; variances of x and y only."""
    covariances = np.array([np.diag([9.0, 9.0, 9.0]), np.diag([0.1, 0.2, 5.0]), np.diag([0.3, 0.4, 7.0])])
    covariances[:, 0, 1] = covariances[:, 1, 0] = 0.05
    observation = believing(see([(0.5, 1.0), (1.5, 1.0), (3.0, 1.0)]), pose_covariances=covariances)
    np.testing.assert_allclose(column(observation, "trace"), [0.3, 0.7], rtol=1e-6)


def test_the_trace_of_a_landmark_is_its_own_and_that_of_other_nodes_their_virtual_landmark_s():
    observation = see([(5.0, 5.0)], [(3.0, 3.0), (7.0, 7.0)], obstacles=[10], candidates=[14])
    landmarks = np.array([[[0.01, 0.3], [0.3, 0.02]], [[0.5, 0.0], [0.0, 0.25]]])
    observation = believing(observation, landmark_covariances=landmarks)
    observation = with_cells(
        observation, virtual_map={6: (8.0, 0.0, 8.0), 12: (8.0, 0.0, 8.0), 10: (0.6, 0.3, 0.5), 14: (0.9, -0.3, 0.7)}
    )
    np.testing.assert_allclose(column(observation, "trace"), [0.02, 0.03, 0.75, 1.1, 1.6], rtol=1e-6)


def test_occupancy_is_of_the_node_s_cell():
    observation = see([(1.0, 1.0), (3.0, 1.0)], [(5.5, 1.5)], obstacles=[3], candidates=[4])
    observation = with_cells(observation, occupancy={0: 0.1, 1: 0.2, 2: 0.3, 3: 0.95})
    np.testing.assert_allclose(column(observation, "occupancy"), [0.1, 0.2, 0.3, 0.95, 0.5], rtol=1e-6)


# Whatever the robot sees


def observations(scenario, trial, every):
    """Some observations of a rollout that drives to the nearest candidate on a calibration world."""
    spec = TrialSpec("none", "none:none", scenario, trial, purpose="calibrate")
    world = draw_world(scenario, spec.generator("world"))
    events, choice, seen = rollout(scenario, world, spec.generator("motion"), spec.generator("sensor")), None, []
    while True:
        try:
            event = events.send(choice)
        except StopIteration:
            return seen
        choice = None
        if isinstance(event, Observation):
            choice = int(event.path_lengths.argmin())
            if event.decision % every == 0:
                seen.append(event)


@pytest.fixture(scope="module")
def real():
    """Observations on four worlds of 20 m, the first and the later ones."""
    return [seen for trial in range(4) for seen in observations(PAPER, trial, 4)]


@pytest.fixture(scope="module")
def large():
    """The last but one observation of a world of 40 m."""
    return observations(PAPER.replace(size=40.0), 0, 1)[-2]


def defined(observation, obstacles=True):
    """Places and flags of the nodes and the edges between them, by the definition and without any haste."""
    belief, grid = observation.belief, observation.scenario.grid
    track = [cell_of(grid, x, y) for x, y, _ in belief.poses]
    latest = {cell: i for i, cell in enumerate(track)}
    order = sorted(latest, key=latest.get)
    nodes = [(-1, *belief.poses[latest[cell], :2]) for cell in order[:-1]] + [(0, *belief.poses[-1, :2])]
    nodes += [(1, *place) for place in belief.landmarks]
    blocked = (belief.known & (belief.occupancy > 0.5 + 1e-9)).ravel()
    nodes += [(-2, *centre_of(grid, cell)) for cell in range(grid.cells) if obstacles and blocked[cell]]
    nodes += [(2, *centre_of(grid, cell)) for cell in observation.candidates]

    def nearest(i, flags):
        others = [j for j, node in enumerate(nodes) if node[0] in flags]
        return min(others, key=lambda j: math.dist(nodes[i][1:], nodes[j][1:]), default=None)

    found = {frozenset((order.index(a), order.index(b))) for a, b in itertools.pairwise(track) if a != b}
    seen = {-1: (1,), 0: (1,), 2: (0, 1), -2: (-1, 0)}
    for i, node in enumerate(nodes):
        if node[0] in seen and (other := nearest(i, seen[node[0]])) is not None:
            found.add(frozenset((i, other)))
    found |= {frozenset(pair) for pair in itertools.combinations([i for i, x in enumerate(nodes) if x[0] == 1], 2)}
    return np.array([node[1:] for node in nodes]), [node[0] for node in nodes], found


def test_the_real_observations_hold_all_kinds_of_nodes(real):
    """Else they would prove little."""
    assert len(real) >= 10
    assert {flag for seen in real for flag in column(seen, "flag")} == {-2, -1, 0, 1, 2}


@pytest.mark.parametrize("obstacles", [True, False])
def test_real_graphs_are_those_of_the_definition(real, large, obstacles):
    for observation in (*real, large):
        places, flags, found = defined(observation, obstacles)
        made = graph(observation, obstacles=obstacles)
        assert {frozenset(pair) for pair in edges(made)} == found
        assert column(observation, "flag", obstacles=obstacles).tolist() == flags
        away = np.hypot(*(places - observation.belief.poses[-1, :2]).T)
        np.testing.assert_allclose(column(observation, "distance", obstacles=obstacles), away, rtol=1e-5, atol=1e-5)


def test_real_entropies_in_range_are_those_of_the_definition(real):
    for observation in real[::3]:
        places, _, _ = defined(observation)
        p = observation.belief.occupancy.ravel()
        bits = -p * np.log2(p) - (1 - p) * np.log2(1 - p)
        middles = observation.scenario.grid.centres()
        away = np.hypot(*np.moveaxis(middles[None] - places[:, None], -1, 0))
        expected = ((away <= observation.scenario.sensor_range) * bits).sum(axis=1)
        np.testing.assert_allclose(column(observation, "shannon"), expected, rtol=1e-5)


@pytest.mark.parametrize("weighted", [False, True])
def test_real_adjacency_is_symmetric_without_loops(real, large, weighted):
    for observation in (WHOLE, *real, large):
        adjacency = graph(observation, weighted=weighted).adjacency
        np.testing.assert_array_equal(adjacency, adjacency.T)
        assert not adjacency.diagonal().any()
        assert (adjacency >= 0).all()


def test_weights_change_no_edge_and_no_feature(real):
    for observation in real:
        plain, weighted = graph(observation), graph(observation, weighted=True)
        assert edges(plain) == edges(weighted)
        np.testing.assert_array_equal(plain.features, weighted.features)


def test_real_features_are_finite_and_of_order_one(real, large):
    for observation in (*real, large):
        features = graph(observation, list(FEATURES)).features
        assert np.isfinite(features).all()
        assert np.abs(features).max() < 20
        bearings = features[:, list(FEATURES).index("bearing")]
        assert (np.abs(bearings) <= 1).all()


@given(data=st.data())
def test_the_order_of_the_candidates_is_that_of_their_rows_and_of_nothing_else(real, data):
    observation = data.draw(st.sampled_from(real))
    weighted = data.draw(st.booleans())
    order = np.array(data.draw(st.permutations(range(len(observation.candidates)))))
    shuffled = reordered_observation(observation, order)
    before = graph(observation, list(FEATURES), weighted=weighted)
    after = graph(shuffled, list(FEATURES), weighted=weighted)
    others = len(before.features) - before.candidates
    rows = np.concatenate((np.arange(others), others + order))
    np.testing.assert_array_equal(after.features, before.features[rows])
    np.testing.assert_array_equal(after.adjacency, before.adjacency[np.ix_(rows, rows)])


@given(st.floats(-math.pi, math.pi), st.lists(st.tuples(st.floats(0, 10), st.floats(0, 10)), min_size=1, max_size=30))
def test_a_walk_anywhere_has_a_node_a_visited_cell_and_edges_along_it(heading, track):
    made = graph(see(track, candidates=[12], heading=heading), ["flag", "bearing"])
    visited = {cell_of(Grid(5, 5, CELL), x, y) for x, y in track}
    assert made.trajectory == len(visited)
    assert made.features[made.trajectory - 1].tolist() == [0, 0]
    assert (np.abs(made.features[:, 1]) <= 1).all()
    reached = {0}
    for _ in visited:
        reached |= {b for pair in edges(made) if reached & {*pair} for b in pair}
    assert reached == set(range(made.trajectory + 1)), "it is connected"


@pytest.mark.parametrize("weighted", [False, True])
def test_nothing_that_is_given_is_changed(weighted):
    observation = see(TRACK, LANDMARKS, OBSTACLES, CANDIDATES)
    given_arrays = {
        f.name: value
        for owner in (observation, observation.belief)
        for f in dataclasses.fields(owner)
        if isinstance(value := getattr(owner, f.name), np.ndarray)
    }
    assert len(given_arrays) == 11
    assert all(array.flags.writeable for array in given_arrays.values())
    copies = {name: array.copy() for name, array in given_arrays.items()}
    made = graph(observation, list(FEATURES), weighted=weighted)
    made.features[:], made.adjacency[:] = -7.0, -7.0
    for name, array in given_arrays.items():
        np.testing.assert_array_equal(array, copies[name], err_msg=name)


def test_two_graphs_of_one_observation_are_equal(large):
    first, second = graph(large), graph(large)
    np.testing.assert_array_equal(first.features, second.features)
    np.testing.assert_array_equal(first.adjacency, second.adjacency)


@pytest.mark.parametrize(("columns", "weighted"), [(EQUATION_4, False), (CHEN_2020, True)])
def test_a_graph_of_40_m_is_built_in_less_than_a_millisecond(large, columns, weighted):
    """Processor time, the best of 20: other processes do not count."""
    assert len(graph(large).features) > 100
    seconds = []
    for _ in range(20):
        begin = time.process_time()
        exploration_graph(large, columns, weighted=weighted)
        seconds.append(time.process_time() - begin)
    assert min(seconds) < 1e-3
