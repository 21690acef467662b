"""Tiny trials as they were: any change of what is simulated, believed, planned or chosen shows here.

After a change that is meant, write them anew with `python tests/trial/test_golden.py` and look at the difference. All
constants are in the files, so that a new calibration changes nothing.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from explore_bench.geometry import cell_of
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.landmark.constants import LandmarkScenario

FOLDER = Path(__file__).parent / "golden"

SCENARIO = {
    "size": 12.0,
    "cell_size": 2.0,
    "landmark_count": 2,
    "landmark_clearance": None,
    "landmarks_occupy": False,
    "obstacle_count": 4,
    "margin": 0.0,
    "map": None,
    "sensor_range": 5.0,
    "min_landmark_range": 0.1,
    "bearing_sigma_deg": 0.5,
    "range_sigma": 0.02,
    "occlusion": False,
    "step_length": 0.5,
    "turn_threshold_deg": 15.0,
    "arrival_radius": 0.25,
    "odometry_sigma": 0.07,
    "turn_sigma": 0.001,
    "heading_sigma_deg": 0.2,
    "prior_sigma": 0.05,
    "prior_heading_sigma_deg": 0.01,
    "start_moves": 0,
    "planner": "grid",
    "frontier_neighbours": 1,
    "withhold": True,
    "relinearize_threshold": 0.01,
    "relinearize_interval": 1,
    "virtual_sigma": 1.0,
    "fusion": "trace",
    "first_sight": "fuse",
    "key_pose_spacing": 0.0,
    "hit": 0.7,
    "miss": 0.3,
    "occupancy_clamp": 0.05,
    "candidates_per_robot": 5,
    "candidates_per_landmark": 3,
    "path_tolerance": 1.0,
    "coverage": 0.95,
    "steps_per_cell": 10.0,
    "stuck_decisions": 20,
}
STRATEGIES = {
    "nearest": ("baselines.nearest:Nearest", {}),
    "uncertainty": ("baselines.uncertainty:Uncertainty", {"weight": 1.0}),
}
TRIAL = 4
TOLERANCE = 1e-6
FLOATS = ("true_x", "true_y", "true_heading", "x", "y", "heading", "cov_xx", "cov_xy", "cov_yy", "cov_hh")
FLOATS += ("uncertainty", "peak_trace", "peak_position_trace", "explored", "path_length", "turned")
FLOATS += ("nearest_drive", "chosen_drive")
COUNTS = ("step", "decisions", "collisions", "mislabelled", "nearest_waits", "landmarks")


def played(name):
    """Return a trial as plain values."""
    factory, parameters = STRATEGIES[name]
    scenario = LandmarkScenario(**SCENARIO)
    result = run_trial(TrialSpec(name, factory, scenario, TRIAL, parameters, purpose="calibrate"))
    made = [result.snapshots[step] for step in sorted(result.snapshots)]
    return {
        "scenario": SCENARIO,
        "strategy": [factory, parameters],
        "obstacles": np.flatnonzero(result.world.obstacles).tolist(),
        "landmarks": result.world.landmarks.round(9).tolist(),
        "status": result.status.value,
        "reason": result.reason,
        "cells": [cell_of(scenario.grid, step.x, step.y) for step in result.steps],
        "decided_at": sorted(result.snapshots),
        "candidates": [snapshot.candidates for snapshot in made],
        "choices": [snapshot.choice for snapshot in made],
        "last_map": list(made[-1].map),
        "counts": {column: [getattr(step, column) for step in result.steps] for column in COUNTS},
        "floats": {column: [round(getattr(step, column), 9) for step in result.steps] for column in FLOATS},
    }


@pytest.fixture(scope="module", params=STRATEGIES)
def both(request):
    """Return the values that are stored and those of now."""
    return json.loads((FOLDER / f"{request.param}.json").read_text()), played(request.param)


def test_the_stored_trial_is_of_the_same_scenario_and_strategy(both):
    stored, now = both
    assert (stored["scenario"], stored["strategy"]) == (now["scenario"], now["strategy"])
    assert LandmarkScenario.model_fields.keys() - SCENARIO.keys() <= {"kind", "landmark_density", "obstacle_density"}, (
        "a new constant: name it in SCENARIO, lest its default be part of the reference"
    )


def test_the_world_is_as_it_was(both):
    stored, now = both
    assert now["obstacles"] == stored["obstacles"]
    assert np.array(now["landmarks"]) == pytest.approx(np.array(stored["landmarks"]), abs=TOLERANCE)


@pytest.mark.parametrize(
    "part", ["status", "reason", "cells", "decided_at", "candidates", "choices", "last_map", "counts"]
)
def test_what_is_counted_and_decided_is_as_it_was(both, part):
    stored, now = both
    assert now[part] == stored[part]


@pytest.mark.parametrize("column", FLOATS)
def test_numbers_are_as_they_were(both, column):
    stored, now = both
    assert now["floats"][column] == pytest.approx(stored["floats"][column], abs=TOLERANCE)


def test_the_stored_trials_are_worth_comparing(both):
    """Several decisions, landmarks seen, obstacles believed, an uncertainty that falls."""
    stored, _ = both
    assert stored["status"] == "explored"
    assert len(stored["choices"]) >= 4
    assert stored["counts"]["landmarks"][-1] == 2
    assert stored["floats"]["uncertainty"][-1] < 0.5 * stored["floats"]["uncertainty"][0]


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for strategy in STRATEGIES:
        text = json.dumps(played(strategy), indent=None, separators=(",", ":"))
        (FOLDER / f"{strategy}.json").write_text(text.replace('],"', '],\n"').replace('},"', '},\n"') + "\n")
