"""The standard deviations of a scenario, and the odometry that they give a command."""

import math
from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given, strategies as st

from explore_bench.world.landmark.constants import NoiseModel
from explore_bench.world.scenario import Scenario
from explore_bench.world.signals import Odometry

NOISE = NoiseModel(0.05, 0.001, straight=0.07, turn=0.002, heading=0.003, bearing=0.01, range=0.02)
commands = st.one_of(
    st.tuples(st.just(0.0), st.floats(0.01, 2.0)), st.tuples(st.floats(-3.1, 3.1).filter(bool), st.just(0.0))
)


def test_noise_model_takes_degrees_as_radians():
    scenario = Scenario(
        prior_sigma=0.11,
        prior_heading_sigma_deg=3.0,
        odometry_sigma=0.12,
        turn_sigma=0.13,
        heading_sigma_deg=6.0,
        bearing_sigma_deg=9.0,
        range_sigma=0.14,
    )
    expected = NoiseModel(0.11, math.pi / 60, 0.12, 0.13, math.pi / 30, math.pi / 20, 0.14)
    assert astuple(scenario.noise) == pytest.approx(astuple(expected))
    assert scenario.sight_sigmas == pytest.approx((math.pi / 20, 0.14))


def test_a_straight_step_and_a_turn_have_their_own_noise():
    assert NOISE.odometry((0.0, 0.5)) == Odometry((0.5, 0.0, 0.0), (0.07, 0.07, 0.003))
    assert NOISE.odometry((-1.2, 0.0)) == Odometry((0.0, 0.0, -1.2), (0.002, 0.002, 0.003))


@given(st.lists(commands, max_size=9))
def test_the_odometries_of_many_commands_are_the_odometry_of_each(many):
    motions, sigmas = NOISE.odometries(np.array(many).reshape(-1, 2))
    each = [NOISE.odometry(command) for command in many]
    assert motions.shape == sigmas.shape == (len(many), 3)
    assert [tuple(row) for row in motions.tolist()] == [one.motion for one in each]
    assert [tuple(row) for row in sigmas.tolist()] == [one.sigmas for one in each]
