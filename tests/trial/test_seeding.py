"""Named random streams: disjoint, repeatable, and refused where the name is wrong."""

from itertools import product

import numpy as np
import pytest

from explore_bench.errors import RequestError
from explore_bench.trial.seeding import PURPOSES, ROLES, stream

KEYS = list(product(PURPOSES, (0, 1, 2**40), (20.0, 30.0, 40.0), range(5), ROLES))


def first_numbers(key, count=4):
    return tuple(stream(*key).bit_generator.random_raw(count).tolist())


def test_the_four_purposes_are_those_of_the_protocol():
    assert set(PURPOSES) == {"evaluate", "validate", "train", "calibrate"}


def test_streams_of_different_names_share_no_first_number():
    """Purposes, roots, sizes, trials and roles are all told apart, and never lead to one another's numbers."""
    numbers = [number for key in KEYS for number in first_numbers(key)]
    assert len(KEYS) > 1000
    assert len(set(numbers)) == len(numbers)


@pytest.mark.parametrize("key", KEYS[::197])
def test_a_name_gives_the_same_numbers_each_time(key):
    assert first_numbers(key, 100) == first_numbers(key, 100)


def test_drawing_from_one_stream_leaves_the_others_alone():
    expected = first_numbers(("evaluate", 0, 20.0, 0, "motion"))
    stream("evaluate", 0, 20.0, 0, "world").random(1000)
    assert first_numbers(("evaluate", 0, 20.0, 0, "motion")) == expected


def test_streams_of_neighbouring_trials_are_uncorrelated():
    normals = np.array([stream("evaluate", 0, 20.0, trial, "motion").standard_normal(4000) for trial in range(8)])
    correlation = np.corrcoef(normals) - np.eye(8)
    assert np.abs(correlation).max() < 4.5 / np.sqrt(4000)


def test_sizes_are_told_apart_to_the_millimetre():
    at = {size: first_numbers(("evaluate", 0, size, 0, "world")) for size in (20.0, 20.001, 20.0000001)}
    assert at[20.0] != at[20.001]
    assert at[20.0] == at[20.0000001]


@pytest.mark.parametrize("role", ROLES)
def test_the_first_robot_s_streams_are_those_of_a_trial_and_each_further_one_has_its_own(role):
    key = ("evaluate", 0, 20.0, 3, role)
    assert first_numbers((*key, 0)) == first_numbers(key)
    assert first_numbers((*key, 1), 100) == first_numbers((*key, 1), 100)
    numbers = [number for robot in range(4) for number in first_numbers((*key, robot))]
    assert len(set(numbers)) == 4 * 4


def test_a_second_robot_s_streams_share_no_first_number_with_any_first_one_s():
    numbers = [number for key in KEYS[::7] for robot in (0, 1) for number in first_numbers((*key, robot))]
    assert len(set(numbers)) == len(numbers)


def test_the_benchmark_s_own_worlds_stay_what_they_are():
    """Changing these numbers changes every world and all noise of the benchmark."""
    assert first_numbers(("evaluate", 0, 20.0, 0, "world"), 2) == (1309465695317828978, 8758085795807278203)
    assert first_numbers(("train", 3, 40.0, 17, "motion"), 2) == (12970749590225331919, 15017601996481202777)


def test_an_unknown_purpose_is_refused_by_name_with_the_near_spelling():
    with pytest.raises(RequestError, match=r"purpose 'evaluat' .*'evaluate'"):
        stream("evaluat", 0, 20.0, 0, "world")


def test_an_unknown_role_is_refused_by_name_with_the_near_spelling():
    with pytest.raises(RequestError, match=r"role 'sensors' .*'sensor'"):
        stream("evaluate", 0, 20.0, 0, "sensors")
