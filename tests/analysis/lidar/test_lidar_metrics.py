"""Metrics of the lidar kind by hand, and the rule for trials that did not explore."""

import math

import numpy as np
import pytest
from handmade_lidar import lidar_record, perfect_map
from lidar_worlds import SMALL, drawn

from explore_bench.analysis.lidar.metrics import METRICS
from explore_bench.analysis.metrics import METRICS as COMMON, metrics_of
from explore_bench.report.tables import heading

UNFINISHED = ["step_limit", "stuck", "failed"]
LIMIT = SMALL.time_limit
FARTHEST = SMALL.max_speed * SMALL.time_limit


def value(name, made):
    return METRICS[name].value(made)


def test_they_are_those_of_the_kind_and_no_other_kind_has_any():
    assert metrics_of("lidar") == METRICS
    assert metrics_of("landmark") == {}
    assert not METRICS.keys() & COMMON.keys()


def test_every_metric_says_what_it_is_and_no_two_have_the_same_heading():
    for metric in METRICS.values():
        assert metric.symbol.strip()
        assert metric.unit.strip()
        assert metric.equation.strip()
        assert metric.better in ("lower", "higher", None)
    headings = [heading(metric) for metric in (COMMON | METRICS).values()]
    assert len(set(headings)) == len(headings)


# Seconds and metres

RUN = {
    "explored": [0.3, 0.7, 0.9, 0.95, 0.98],
    "seconds": [0.0, 10.0, 25.0, 50.0, 80.0],
    "path_length": [0.0, 4.0, 9.0, 20.0, 30.0],
}


def test_times_and_ways_are_those_of_the_first_key_pose_that_reaches_the_share():
    made = lidar_record(**RUN)
    names = ("t90_seconds", "t98_seconds", "simulated_seconds", "l90")
    assert [value(name, made) for name in names] == [25.0, 80.0, 80.0, 9.0]


@pytest.mark.parametrize("status", UNFINISHED)
def test_what_was_not_reached_counts_the_limit_and_what_was_reached_counts_as_it_is(status):
    made = lidar_record(status, **RUN | {"explored": [0.3, 0.7, 0.9, 0.95, 0.97]})
    names = ("t90_seconds", "t98_seconds", "simulated_seconds", "l90")
    assert [value(name, made) for name in names] == [25.0, LIMIT, LIMIT, 9.0]
    assert value("l90", lidar_record(status, **RUN | {"explored": [0.1] * 5})) == FARTHEST


def test_a_share_beyond_what_exploring_asks_for_is_not_defined():
    made = lidar_record(scenario=SMALL.replace(coverage=0.95), **RUN | {"explored": [0.3, 0.7, 0.9, 0.94, 0.96]})
    assert math.isnan(value("t98_seconds", made))


def test_equations_2_and_3_per_second_and_per_metre():
    """16 cells, U₀ = 32 to 8 in 80 s and 30 m, max tr Σ = 0.25."""
    made = lidar_record(uncertainty=[32.0, 20.0, 15.0, 10.0, 8.0], peak_trace=[0.1, 0.25, 0.25, 0.25, 0.25], **RUN)
    assert SMALL.cell_count == 16
    assert value("error_seconds", made) == pytest.approx(80 / 16 * 0.5)
    assert value("error_metres", made) == pytest.approx(30 / 16 * 0.5)
    assert value("efficiency_seconds", made) == pytest.approx(24.0 / 80)
    assert value("efficiency_metres", made) == pytest.approx(24.0 / 30)


@pytest.mark.parametrize("status", UNFINISHED)
def test_an_unfinished_trial_counts_the_limits_and_at_least_twice_the_prior_variance(status):
    made = lidar_record(status, uncertainty=[32.0, 20.0, 15.0, 10.0, 8.0], peak_trace=[0.1] * 5, **RUN)
    assert value("error_seconds", made) == pytest.approx(LIMIT / 16 * math.sqrt(2.0))
    assert value("error_metres", made) == pytest.approx(FARTHEST / 16 * math.sqrt(2.0))
    assert value("efficiency_seconds", made) == pytest.approx(24.0 / LIMIT)
    assert value("efficiency_metres", made) == pytest.approx(24.0 / FARTHEST)


def test_stopping_early_never_pays():
    """Whatever an unfinished trial did, the same one scores no better than if it had explored at its last second."""
    for name in ("t98_seconds", "l90", "error_seconds", "error_metres"):
        assert value(name, lidar_record("stuck", **RUN)) >= value(name, lidar_record(**RUN))
    for name in ("efficiency_seconds", "efficiency_metres"):
        low = RUN | {"uncertainty": [8.0] * 5}
        assert value(name, lidar_record("stuck", **low)) < value(name, lidar_record(**low))


def test_a_trial_explored_at_the_start_has_no_efficiency():
    made = lidar_record(explored=[0.99], uncertainty=[8.0])
    assert math.isnan(value("efficiency_seconds", made))
    assert value("error_seconds", made) == 0.0


# Poses


def straight(count=9, bend=0.0, **final):
    """A way of 0.5 m a key pose along x, estimated with a scale of 1.02 and turned by `bend` [rad]."""
    x = 0.5 * np.arange(count)
    own = {"final_x": 1.02 * x * math.cos(bend), "final_y": 1.02 * x * math.sin(bend), "final_heading": [bend] * count}
    return lidar_record(true_x=x, true_y=[0.0] * count, path_length=x, final=own | final)


def test_the_relative_error_is_that_of_the_motion_over_a_metre():
    """2 % of 1 m, wherever the whole lies and however it is turned."""
    assert value("relative_pose_error", straight()) == pytest.approx(0.02, abs=1e-5)
    assert value("relative_pose_error", straight(bend=1.0)) == pytest.approx(0.02, abs=1e-5)


def test_a_wrong_heading_is_an_error_of_the_next_metre():
    """Headings 0.1 rad off with places that are right: 1 m away things are 0.1 m off."""
    x = 0.5 * np.arange(9)
    made = straight(final_x=x, final_y=[0.0] * 9, final_heading=[0.1] * 9)
    assert value("relative_pose_error", made) == pytest.approx(2 * math.sin(0.05), abs=1e-5)


def test_turns_in_place_are_passed_over():
    """Pairs are a metre of way apart, not two key poses."""
    x = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    made = lidar_record(
        true_x=x,
        path_length=x,
        final={"final_x": [0.0, 0.0, 0.0, 0.0, 1.1], "final_y": [0.0] * 5, "final_heading": [0.0] * 5},
    )
    assert value("relative_pose_error", made) == pytest.approx(0.1, abs=1e-6)


def test_a_trial_of_less_than_a_metre_has_no_relative_error():
    assert math.isnan(value("relative_pose_error", straight(2)))


def test_the_error_of_headings_is_in_degrees_and_wraps():
    made = lidar_record(
        true_heading=[3.1, -3.1, 0.0, 0.0], final={"final_heading": [-3.1, 3.1, 0.0, 0.0], "final_x": [0.0] * 4}
    )
    assert value("heading_error", made) == pytest.approx(math.degrees((2 * math.pi - 6.2) / math.sqrt(2.0)), rel=1e-4)


# Map, loops and drive


def test_a_map_is_compared_with_the_truth_of_the_record():
    world = drawn(8.0, (3.0, 4.0, 0.1, 5.0))
    made = lidar_record(world=world, fine_map=perfect_map(world), x=[1.0], y=[1.0])
    names = [name for name in METRICS if name.startswith("wall_") or name in ("free_iou", "covered")]
    assert len(names) == 8
    assert {value(name, made) for name in names} == {1.0}
    assert {math.isnan(value(name, lidar_record(world=world, rows=1))) for name in names} == {True}


def test_counts_and_shares_are_those_of_the_last_row():
    made = lidar_record(
        seconds=[0.0, 40.0],
        closures=[0, 5],
        false_closures=[0, 2],
        missed_closures=[0, 1],
        decisions=[0, 8],
        in_vain=[0, 2],
        clearance=[0.5, 0.2],
        unsafe_seconds=[0.0, 1.0],
        speed_change=[0.0, 10.0],
    )
    expected = {"true_closures": 3, "false_closures": 2, "missed_closures": 1, "in_vain": 0.25}
    expected |= {"clearance": 0.2, "unsafe": 0.025, "smoothness": 0.25}
    assert {name: value(name, made) for name in expected} == pytest.approx(expected)


@pytest.mark.parametrize("status", ["failed", "stuck"])
def test_what_adds_up_along_the_way_says_nothing_of_a_trial_that_broke_off(status):
    names = ("true_closures", "false_closures", "missed_closures", "in_vain", "clearance", "unsafe", "smoothness")
    for made in (lidar_record(status, decisions=[0, 2], seconds=[0.0, 9.0]), lidar_record("failed", rows=0)):
        assert all(math.isnan(value(name, made)) for name in (*names, "relative_pose_error", "heading_error"))


def test_shares_of_nothing_are_not_defined():
    assert math.isnan(value("in_vain", lidar_record(decisions=[0])))
    assert math.isnan(value("unsafe", lidar_record(seconds=[0.0])))


def test_every_metric_of_a_trial_without_rows_has_a_value_or_none():
    made = lidar_record("failed", rows=0)
    assert value("t90_seconds", made) == LIMIT
    assert value("l90", made) == FARTHEST
    for metric in METRICS.values():
        assert isinstance(metric.value(made), float)
