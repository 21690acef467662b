"""What every kind of belief shares: the largest traces of a trajectory."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from explore_bench.robot.belief import peak_traces

TWO = np.array([np.diag([1.0, 2.0, 0.5]), np.diag([0.5, 0.75, 9.0])])
"""The first has the larger position block, 3 against 1.25, the second the larger trace, 10.25 against 3.5."""


def test_peak_traces_by_hand():
    assert peak_traces(TWO) == (10.25, 3.0)
    assert peak_traces(TWO[:1]) == (3.5, 3.0)
    assert peak_traces(TWO[1:]) == (10.25, 1.25)


def test_what_lies_beside_the_diagonal_does_not_count():
    assert peak_traces(np.array([[[1.0, 7.0, 7.0], [7.0, 2.0, 7.0], [7.0, 7.0, 0.5]]])) == (3.5, 3.0)


def test_peak_traces_are_at_least_those_given():
    assert peak_traces(TWO, 20.0, 2.0) == (20.0, 3.0)
    assert peak_traces(TWO, 1.0, 5.0) == (10.25, 5.0)
    assert peak_traces(np.empty((0, 3, 3)), 2.0, 1.0) == (2.0, 1.0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.data())
def test_peak_traces_go_on_from_those_of_earlier_poses(seed, count, data):
    roots = np.random.default_rng(seed).normal(size=(count, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1)
    full = max(np.trace(one) for one in covariances)
    position = max(np.trace(one[:2, :2]) for one in covariances)
    cut = data.draw(st.integers(0, count))
    assert peak_traces(covariances) == pytest.approx((full, position), rel=1e-12)
    assert peak_traces(covariances[cut:], *peak_traces(covariances[:cut])) == peak_traces(covariances)
