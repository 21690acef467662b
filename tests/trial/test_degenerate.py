"""SLAM that has hardly anything to go by: covariances stay true, or the trial says that the simulator broke down."""

import numpy as np
import pytest
from playing import begin, nearest
from slam_reference import precise_marginals, small_drive, worst_difference

from explore_bench.strategies.contract import Observation
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

TINY = 1e-9
LARGE = 100.0
KINDS = {
    "no landmark": {"landmark_count": 0, "size": 40.0},
    "one landmark": {"landmark_count": 1, "size": 30.0},
    "hardly any noise": {
        "bearing_sigma_deg": 1e-6,
        "range_sigma": 1e-6,
        "odometry_sigma": 1e-6,
        "heading_sigma_deg": 1e-6,
        "turn_sigma": 1e-6,
    },
    "no noise to speak of": dict.fromkeys(
        ("bearing_sigma_deg", "range_sigma", "odometry_sigma", "heading_sigma_deg", "turn_sigma", "prior_sigma"), TINY
    ),
    "a sensor that says nothing": {"bearing_sigma_deg": 1e4, "range_sigma": LARGE},
    "odometry that says nothing": {"odometry_sigma": LARGE, "heading_sigma_deg": 180.0, "steps_per_cell": 5.0},
    "exact odometry": {"odometry_sigma": TINY, "heading_sigma_deg": TINY, "turn_sigma": TINY},
    "exact sightings": {"bearing_sigma_deg": TINY, "range_sigma": TINY},
    "a start that is not known": {"prior_sigma": 1e4, "prior_heading_sigma_deg": 360.0},
    "landmarks everywhere": {"landmark_density": 30.0, "obstacle_count": 0},
}


def is_covariance(matrices):
    """Whether each is finite, symmetric and positive definite, up to rounding."""
    if not np.isfinite(matrices).all():
        return False
    values = np.linalg.eigvalsh(matrices)
    return bool((values > -1e-9 * np.abs(values).max(axis=-1, keepdims=True)).all())


@pytest.mark.parametrize("kind", KINDS)
def test_a_trial_has_covariances_that_are_such_or_says_that_the_simulator_broke_down(kind):
    scenario = PAPER.replace(**KINDS[kind])
    result = run_trial(TrialSpec("nearest", "playing:Nearest", scenario, 0), timeout=300.0)
    assert result.status is not Status.FAILED, result.reason
    if result.status is Status.BROKEN:
        assert result.reason
        return
    xx, xy, yy = result.final_covariances.T
    assert is_covariance(np.stack((np.stack((xx, xy), -1), np.stack((xy, yy), -1)), -2))
    for step in result.steps:
        assert np.isfinite((step.x, step.y, step.heading, step.cov_xx, step.uncertainty)).all()
        assert 0.0 <= step.uncertainty <= scenario.prior_uncertainty * (1 + 1e-9)


def beliefs(scenario, world, most=400):
    """Beliefs at the decisions of a trial in a world of one's own, for so many steps."""
    events, choice, count = begin(scenario, world=world), None, 0
    while count < most:
        try:
            event = events.send(choice)
        except StopIteration:
            return
        choice = None
        if isinstance(event, Observation):
            yield event.belief
            choice = nearest(event)
        else:
            count += 1


def world_with(scenario, landmarks):
    grid = scenario.grid
    start = (*grid.centre_of(grid.cells // 2 + grid.columns // 2), 0.3)
    return LandmarkWorld(grid, np.zeros(grid.shape, dtype=bool), np.array(landmarks(start)), start)


@pytest.mark.parametrize(
    "landmarks",
    [
        lambda start: [start[:2], (3.0, 3.0)],
        lambda start: [(start[0] + 1e-9, start[1]), (3.0, 3.0)],
        lambda start: [(5.0, 5.0), (5.0, 5.0)],
        lambda start: [(5.0, 5.0), (5.0, 5.0 + 1e-12)],
        lambda start: [(start[0] + 2.0, start[1]), (start[0] + 4.0, start[1])],
    ],
    ids=["on the robot", "all but on it", "two in one place", "two nearly so", "all on one line"],
)
@pytest.mark.parametrize("least", [0.0, 0.1])
def test_landmarks_in_odd_places_leave_true_covariances(landmarks, least):
    scenario = Scenario(size=12.0, landmark_count=2, obstacle_count=0, min_landmark_range=least, coverage=1.0)
    found = list(beliefs(scenario, world_with(scenario, landmarks)))
    assert found
    for belief in found:
        assert is_covariance(belief.pose_covariances)
        assert is_covariance(belief.landmark_covariances)


@pytest.mark.parametrize("constants", [{"odometry_sigma": 1e-4}, {"range_sigma": 5.0}, {"heading_sigma_deg": 20.0}])
def test_they_are_those_of_gtsam_under_any_noise(constants):
    drive = small_drive(3, steps=60, **constants)
    found = drive.smoother
    of_poses, of_landmarks = precise_marginals(drive.graph(), found.poses, found.landmarks)
    assert worst_difference(found.pose_covariances, of_poses) < 1e-6
    assert worst_difference(found.landmark_covariances, of_landmarks) < 1e-6


@pytest.mark.slow
def test_five_thousand_steps_leave_true_covariances():
    scenario = PAPER.replace(size=20.0, coverage=1.0, landmark_count=3, withhold=False, stuck_decisions=100_000)
    events, choice, count, last = begin(scenario.replace(steps_per_cell=50.0)), None, 0, None
    while count < 5000:
        try:
            event = events.send(choice)
        except StopIteration as end:
            last = end.value.belief
            break
        choice = None
        if isinstance(event, Observation):
            last, choice = event.belief, len(event.candidates) - 1
        else:
            count += 1
    assert is_covariance(last.pose_covariances)
    assert is_covariance(last.landmark_covariances)
