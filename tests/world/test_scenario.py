"""The physical constants: the paper's counts, what is refused and how."""

import math
import pickle

import pytest
from hypothesis import example, given, strategies as st
from pydantic import ValidationError

from explore_bench.errors import RequestError
from explore_bench.geometry import Grid
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import CHEN_2020, PAPER

NUMBERS = [name for name, field in LandmarkScenario.model_fields.items() if "float" in str(field.annotation)]


def assert_one_sentence(error):
    message = str(error.value)
    assert "\n" not in message
    assert message.endswith((".", "?"))


# The paper's protocol


@pytest.mark.parametrize(
    ("size", "cells", "landmarks", "uncertainty", "steps"),
    [(20.0, 100, 3, 200.0, 1000), (30.0, 225, 7, 450.0, 2250), (40.0, 400, 12, 800.0, 4000)],
)
def test_the_paper_s_maps(size, cells, landmarks, uncertainty, steps):
    """3 landmarks per 100 cells make 3, 6.75 → 7 and 12; U₀ = 2 σ₀² n_g; the limit is 10 n_g steps."""
    scenario = PAPER.replace(size=size)
    assert scenario.cell_count == cells
    assert scenario.landmarks == landmarks
    assert scenario.prior_uncertainty == pytest.approx(uncertainty)
    assert scenario.step_limit == steps


@pytest.mark.parametrize(("size", "edge"), [(20.0, 10), (30.0, 15), (40.0, 20)])
def test_obstacles_grow_with_the_edge_rounded_half_up(size, edge):
    scenario = PAPER.replace(size=size)
    exact = scenario.obstacle_density * edge
    assert exact - 0.5 < scenario.obstacles <= exact + 0.5


@pytest.mark.parametrize(("size", "obstacles"), [(20.0, 15), (30.0, 23), (40.0, 30)])
def test_one_and_a_half_obstacles_per_cell_of_edge(size, obstacles):
    assert Scenario(size=size, obstacle_density=1.5).obstacles == obstacles


def test_halves_are_rounded_up_not_to_even():
    scenario = Scenario(size=10.0, landmark_density=2.0, obstacle_density=0.5)
    assert (scenario.landmarks, scenario.obstacles) == (1, 3)  # of 0.5 and 2.5


def test_counts_replace_densities():
    scenario = Scenario(landmark_count=0, obstacle_count=40)
    assert (scenario.landmarks, scenario.obstacles) == (0, 40)


def test_the_constants_that_the_paper_gives():
    assert (PAPER.size, PAPER.cell_size, PAPER.landmark_density) == (20.0, 2.0, 3.0)
    assert (PAPER.sensor_range, PAPER.occlusion, PAPER.coverage) == (5.0, False, 0.9)
    assert (PAPER.candidates_per_robot, PAPER.candidates_per_landmark) == (5, 3)


def test_chen_2020_is_expressed():
    chen = CHEN_2020
    assert (chen.size, chen.margin, chen.landmarks, chen.obstacles) == (40.0, 20.0, 8, 0)
    assert (chen.sensor_range, chen.coverage) == (math.nextafter(6.0, 0.0), math.nextafter(0.85, 1.0)), "both strict"
    assert (chen.candidates_per_robot, chen.candidates_per_landmark) == (1, 1)
    assert (chen.step_length, chen.planner, chen.start_moves) == (2.0, "straight", 4)


# Values


def test_scenarios_are_immutable():
    with pytest.raises(ValidationError):
        PAPER.size = 30.0


def test_scenarios_are_equal_and_hash_by_value_whatever_was_asked_of_them():
    asked, fresh = Scenario(size=30.0), Scenario(size=30.0)
    assert asked.grid == Grid(15, 15, 2.0)
    assert asked == fresh
    assert hash(asked) == hash(fresh)
    assert asked != Scenario(size=40.0)
    assert pickle.loads(pickle.dumps(asked)) == fresh


def test_replace_keeps_the_rest_and_validates_anew():
    changed = CHEN_2020.replace(coverage=0.5)
    assert (changed.coverage, changed.landmarks, changed.step_length) == (0.5, 8, 2.0)
    assert CHEN_2020.coverage == math.nextafter(0.85, 1.0)
    with pytest.raises(RequestError, match=r"coverage.*1\.5"):
        CHEN_2020.replace(coverage=1.5)


# Kinds of world


@pytest.mark.parametrize("values", [{}, {"kind": "landmark"}, {"kind": "landmark", "size": 30.0}])
def test_a_scenario_is_one_of_its_kind_of_world_landmarks_by_default(values):
    scenario = Scenario(**values)
    assert type(scenario) is LandmarkScenario
    assert scenario.kind == "landmark"
    assert scenario == LandmarkScenario(**values)


@pytest.mark.parametrize("change", [{}, {"size": 30.0}, {"map": ("...", "...")}, {"landmark_count": 2}])
def test_the_kind_goes_through_dumps_copies_and_pickles(change):
    scenario = Scenario(**change)
    assert scenario.model_dump()["kind"] == "landmark"
    for copy in (Scenario(**scenario.model_dump()), scenario.replace(), pickle.loads(pickle.dumps(scenario))):
        assert type(copy) is LandmarkScenario
        assert copy == scenario
    assert scenario.replace(kind="landmark", coverage=0.5) == scenario.replace(coverage=0.5)
    assert (type(scenario.blind), type(scenario.tiny)) == (LandmarkScenario, LandmarkScenario)


@pytest.mark.parametrize(
    ("kind", "named"),
    [
        ("landmarks", "kind of world 'landmarks' is unknown; did you mean 'landmark'?"),
        ("sea", "kind of world 'sea' is unknown; choose one of landmark, lidar."),
        (3, "kind of world '3' is unknown"),
        (["landmark"], "is unknown"),
    ],
)
def test_an_unknown_kind_is_refused_with_the_nearest(kind, named):
    with pytest.raises(RequestError) as error:
        Scenario(kind=kind)
    assert named in str(error.value)
    assert_one_sentence(error)


def test_a_scenario_of_one_kind_is_not_made_with_another_s_name():
    for made in (PAPER.replace, LandmarkScenario):
        with pytest.raises(RequestError, match=r"'kind' is 'sea'") as error:
            made(kind="sea")
        assert_one_sentence(error)


# Refusals


@pytest.mark.parametrize(
    ("wrong", "right"),
    [("sensor_rang", "sensor_range"), ("odometry_sigm", "odometry_sigma"), ("obstacles_count", "obstacle_count")],
)
def test_an_unknown_key_is_refused_with_the_near_spelling(wrong, right):
    with pytest.raises(RequestError, match=f"'{wrong}'.*did you mean '{right}'") as error:
        Scenario(**{wrong: 1.0})
    assert_one_sentence(error)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("size", -20.0),
        ("size", float("nan")),
        ("size", float("inf")),
        ("size", "large"),
        ("cell_size", 0.0),
        ("landmark_density", -1.0),
        ("landmark_count", -1),
        ("landmark_count", 2.5),
        ("obstacle_count", "many"),
        ("range_sigma", 0.0),
        ("odometry_sigma", -0.07),
        ("turn_threshold_deg", 91.0),
        ("occlusion", "perhaps"),
        ("fusion", "volume"),
        ("first_sight", None),
        ("hit", 1.0),
        ("miss", 0.0),
        ("occupancy_clamp", 0.5),
        ("candidates_per_robot", -1),
        ("coverage", 0.0),
        ("coverage", 1.01),
        ("steps_per_cell", 0.0),
        ("stuck_decisions", 0),
    ],
)
def test_a_value_out_of_range_is_refused_by_key_and_value(key, value):
    with pytest.raises(RequestError) as error:
        Scenario(**{key: value})
    assert f"'{key}'" in str(error.value)
    assert repr(value) in str(error.value)
    assert_one_sentence(error)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"size": 21.0}, ("size", "21", "cell_size", "2")),
        ({"size": 2.0}, ("size", "2", "1 × 1 cells")),
        ({"size": 1000.0}, ("size", "1000", "500 × 500 cells")),
        ({"obstacle_count": 97}, ("97 obstacles", "3 landmarks", "100")),
        ({"miss": 0.6}, ("miss", "0.6", "0.5")),
        ({"hit": 0.4}, ("hit", "0.4", "0.5")),
        ({"min_landmark_range": 5.0}, ("min_landmark_range", "5", "sensor_range")),
        ({"candidates_per_robot": 0, "candidates_per_landmark": 0}, ("candidates_per_robot", "0")),
    ],
)
def test_values_that_do_not_go_together_are_refused_by_name(values, named):
    with pytest.raises(RequestError) as error:
        Scenario(**values)
    assert all(part in str(error.value) for part in named)
    assert_one_sentence(error)


@given(st.sampled_from(NUMBERS), st.floats())
@example("landmark_density", 1e307)
@example("obstacle_density", 1e308)
@example("cell_size", 5e-324)
@example("steps_per_cell", 1e308)
def test_no_number_makes_anything_but_a_scenario_or_a_refusal(key, value):
    """A refusal is a RequestError, never another exception; what is accepted can be asked for its counts."""
    try:
        scenario = Scenario(**{key: value})
    except RequestError:
        return
    assert scenario.landmarks + scenario.obstacles < scenario.cell_count
    assert scenario.step_limit >= 0


# Given maps


MAP = ("#####", "#..S#", "#...#", "##.##", "#####")


def test_the_size_follows_from_a_map():
    scenario = Scenario(map=list(MAP))
    assert (scenario.map, scenario.size, scenario.grid.columns) == (MAP, 10.0, 5)
    assert Scenario(map=MAP, cell_size=0.5, arrival_radius=0.1).size == 2.5
    assert Scenario(map=("....", "....")).size == 8.0
    assert Scenario(map=MAP, size=10.0) == scenario


def test_counts_follow_from_a_map():
    """7 cells can be reached and 10 obstacles share a side with one: 17 cells count, so 3 per 100 are 0.51 → 1."""
    scenario = Scenario(map=MAP, obstacle_count=3)
    assert (scenario.obstacles, scenario.landmarks) == (18, 1)
    assert scenario.cell_count == 25
    assert Scenario(map=MAP, landmark_density=20.0).landmarks == 3
    assert Scenario(map=MAP, landmark_count=100).landmarks == 5, "two cells stay open"


def test_a_map_is_part_of_a_scenario_s_value():
    scenario = Scenario(map=MAP)
    assert pickle.loads(pickle.dumps(scenario)) == scenario
    assert hash(Scenario(map=list(MAP))) == hash(scenario)
    assert scenario != Scenario(map=MAP[::-1])
    assert Scenario(**scenario.model_dump()) == scenario


def test_replace_lets_the_size_follow_the_map():
    scenario = Scenario(map=MAP)
    assert scenario.replace(cell_size=1.0).size == 5.0
    assert scenario.replace(occlusion=True).map == MAP
    assert scenario.replace(map=("...", "...", "...")).size == 6.0
    assert scenario.replace(map=None).size == 10.0
    assert PAPER.replace(size=30.0).replace(map=MAP).size == 10.0


def test_a_robot_may_know_all_constants_but_the_map():
    scenario = Scenario(map=MAP, landmark_count=100, sensor_range=7.0)
    blind = scenario.blind
    assert blind.map is None
    assert (blind.size, blind.landmarks, blind.sensor_range) == (10.0, 5, 7.0)
    assert (blind.step_limit, blind.prior_uncertainty) == (scenario.step_limit, scenario.prior_uncertainty)
    assert PAPER.blind is PAPER


def test_the_most_landmarks_that_a_map_may_hold_leave_a_valid_blind_scenario():
    assert Scenario(map=("...", "...", "..."), landmark_count=10**9, obstacle_density=9.0).blind.landmarks == 7


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"map": "rooms.png"}, ("'rooms.png'", "--map")),
        ({"map": 3}, ("'map'", "3")),
        ({"map": ["..", 3]}, ("'map'", "3")),
        ({"map": []}, ("empty", "two free cells")),
        ({"map": ["", ""]}, ("no free cell",)),
        ({"map": ["..", "x."]}, ("row 2", "'x'", "# (obstacle)")),
        ({"map": ["SS"]}, ("2 starts",)),
        ({"map": ["##", "##"]}, ("no free cell",)),
        ({"map": ["??", "??"]}, ("no free cell",)),
        ({"map": ["#.", ".#"]}, ("no two free cells",)),
        ({"map": ["." * 201]}, ("402 m", "201 × 201 cells", "40000")),
        ({"map": ["." * 10**6]}, ("size", "2000000")),
        ({"map": ["...."], "size": 20.0}, ("20 m", "8 m", "leave it out")),
        ({"map": ["...."], "cell_size": "big"}, ("'cell_size'", "'big'")),
    ],
)
def test_what_is_no_map_is_refused(values, named):
    with pytest.raises(RequestError) as error:
        Scenario(**values)
    assert all(part in str(error.value) for part in named)
    assert_one_sentence(error)
