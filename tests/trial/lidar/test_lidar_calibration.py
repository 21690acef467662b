"""What 40 dense calibration worlds and one of each floor plan have to show, with the nearest candidate chosen.

EXPLORE_BENCH_SCENES=300 tries as many dense ones (five minutes of processor time).
"""

import math
import os
from typing import NamedTuple

import numpy as np
import pytest
from lidar_worlds import play

from explore_bench.trial.spec import Status
from explore_bench.world.lidar.constants import LidarScenario

TRIALS = range(1000, 1000 + int(os.environ.get("EXPLORE_BENCH_SCENES", "40")))


class Outcome(NamedTuple):
    """One trial: how it ended, and how far the final estimate of its trajectory is from the truth."""

    status: Status
    collisions: int
    closures: int
    false_closures: int
    decisions: int
    ate: float
    worst: float
    nees: float


def outcome_of(scenario, trial):
    """Root mean square and largest error [m] of the final trajectory, and the mean of its normalized squared errors."""
    rows, _, ending = play(scenario, trial=trial)
    true = np.array([(row.true_x, row.true_y, row.true_heading) for row in rows])
    errors = ending.belief.poses - true
    errors[:, 2] = np.remainder(errors[:, 2] + math.pi, math.tau) - math.pi
    away = np.hypot(*errors[:, :2].T)
    solved = np.linalg.solve(ending.belief.pose_covariances[1:], errors[1:, :, None])[..., 0]
    last = rows[-1]
    return Outcome(
        ending.status,
        last.collisions,
        last.closures,
        last.false_closures,
        last.decisions,
        math.sqrt(np.mean(away**2)),
        away.max(),
        float(np.mean(np.sum(errors[1:] * solved, axis=1))),
    )


@pytest.fixture(scope="module")
def dense():
    return [outcome_of(LidarScenario(), trial) for trial in TRIALS]


@pytest.mark.slow
def test_dense_worlds_are_explored_without_a_contact_or_a_false_closure(dense):
    explored = np.mean([outcome.status == Status.EXPLORED for outcome in dense])
    made, false = (sum(getattr(outcome, name) for outcome in dense) for name in ("closures", "false_closures"))
    print(f"explored {explored:.4f} of {len(dense)}, closures {made}, false {false}")
    assert explored >= 0.99
    assert sum(outcome.collisions for outcome in dense) == 0
    assert false <= 0.005 * made
    assert max(outcome.decisions for outcome in dense) <= 150


@pytest.mark.slow
def test_dense_worlds_are_mapped_to_centimetres(dense):
    ates, worst = np.array([outcome.ate for outcome in dense]), np.array([outcome.worst for outcome in dense])
    print(f"ATE mean {ates.mean():.4f}, largest {ates.max():.4f}; largest errors {np.sort(worst)[-5:].round(3)}")
    assert ates.mean() <= 0.025
    assert np.mean(worst <= 0.06) >= 0.95, worst


@pytest.mark.slow
def test_covariances_of_the_final_trajectory_are_honest(dense):
    """0.3 to 3 times the 3 degrees of freedom, in the median over trials."""
    nees = np.array([outcome.nees for outcome in dense])
    print(f"NEES median {np.median(nees):.2f}, mean {nees.mean():.2f}, largest {nees.max():.2f}")
    assert 0.9 <= np.median(nees) <= 9.0


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["office", "rooms", "maze", "hall"])
def test_floor_plans_are_explored_without_a_false_closure(scene):
    outcome = outcome_of(LidarScenario(scene=scene), 1000)
    print(scene, outcome)
    assert outcome.status == Status.EXPLORED
    assert outcome.false_closures == 0
    assert outcome.collisions == 0
    assert outcome.worst < 0.15
