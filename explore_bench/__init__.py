"""A benchmark of robot-exploration strategies: one simulator, paired seeded trials, tables with intervals.

PUBLIC is the one list of names for strategies, plugins and scripts: `from explore_bench import Observation`. Each is
imported when it is first used, from the module that the list names; docs/plugins.md shows them with what they are.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from explore_bench.analysis.claims import Claim as Claim, comparisons as comparisons
    from explore_bench.analysis.training_curve import (
        CURVE_COLUMNS as CURVE_COLUMNS,
        CURVE_WINDOW as CURVE_WINDOW,
        VALIDATION_COLUMNS as VALIDATION_COLUMNS,
        curve_path as curve_path,
        validations_path as validations_path,
    )
    from explore_bench.compiled import jit as jit
    from explore_bench.errors import (
        RequestError as RequestError,
        describe as describe,
        unknown as unknown,
        writing as writing,
    )
    from explore_bench.files import parse_json as parse_json, read_text as read_text
    from explore_bench.geometry import (
        Array as Array,
        Grid as Grid,
        Pose as Pose,
        cell_of as cell_of,
        cells_of as cells_of,
        cells_within as cells_within,
        centre_of as centre_of,
        compose as compose,
        room_within as room_within,
        wrap_angle as wrap_angle,
    )
    from explore_bench.geometry.rays import cast as cast, leaps as leaps
    from explore_bench.records.provenance import (
        installed_version as installed_version,
        scenario_digest as scenario_digest,
    )
    from explore_bench.robot.belief import Belief as Belief, FineMap as FineMap, Prediction as Prediction
    from explore_bench.robot.landmark.driver import Driver as Driver, next_command as next_command
    from explore_bench.robot.landmark.graph import expecting as expecting
    from explore_bench.robot.lidar.terrain import spread as spread
    from explore_bench.robot.occupancy import (
        OCCUPIED_ABOVE as OCCUPIED_ABOVE,
        renyi_entropy as renyi_entropy,
        shannon_entropy as shannon_entropy,
    )
    from explore_bench.robot.planning.frontier import frontier_cells as frontier_cells
    from explore_bench.robot.planning.roads import Reachable as Reachable, Roads as Roads
    from explore_bench.robot.planning.shortest_paths import search_grid as search_grid, trace_path as trace_path
    from explore_bench.runs.choices import agreement_of_choices as agreement_of_choices
    from explore_bench.runs.conformance import check as check
    from explore_bench.runs.runner import run as run
    from explore_bench.strategies.contract import (
        Observation as Observation,
        Reference as Reference,
        Strategy as Strategy,
        Target as Target,
    )
    from explore_bench.strategies.entry import Entry as Entry, Published as Published, parse_factory as parse_factory
    from explore_bench.trial.decision_process import Course as Course, DecisionProcess as DecisionProcess
    from explore_bench.trial.error_and_efficiency import Score as Score, score as score
    from explore_bench.trial.features import (
        CANDIDATE_COLUMNS as CANDIDATE_COLUMNS,
        STATE_COLUMNS as STATE_COLUMNS,
        features as features,
    )
    from explore_bench.trial.loop import rollout as rollout
    from explore_bench.trial.reward import REWARD_WEIGHTS as REWARD_WEIGHTS, RewardWeights as RewardWeights
    from explore_bench.trial.run import run_trial as run_trial
    from explore_bench.trial.seeding import stream as stream
    from explore_bench.trial.spec import Status as Status, TrialSpec as TrialSpec
    from explore_bench.trial.steps import Step as Step
    from explore_bench.world.kinds import World as World, draw_world as draw_world
    from explore_bench.world.landmark.constants import LandmarkScenario as LandmarkScenario
    from explore_bench.world.landmark.world import LandmarkWorld as LandmarkWorld
    from explore_bench.world.lidar.constants import LidarScenario as LidarScenario
    from explore_bench.world.lidar.world import LidarWorld as LidarWorld
    from explore_bench.world.scenario import Scenario as Scenario
    from explore_bench.world.scenarios import PAPER as PAPER, load_scenario as load_scenario

PUBLIC: dict[str, str] = {
    # what a strategy sees and answers
    "Observation": "strategies.contract",
    "Target": "strategies.contract",
    "Strategy": "strategies.contract",
    "Reference": "strategies.contract",
    "Reachable": "robot.planning.roads",
    "Roads": "robot.planning.roads",
    "Belief": "robot.belief",
    "FineMap": "robot.belief",
    "Prediction": "robot.belief",
    # how it is registered, checked and claimed about
    "Entry": "strategies.entry",
    "Published": "strategies.entry",
    "parse_factory": "strategies.entry",
    "Claim": "analysis.claims",
    "comparisons": "analysis.claims",
    "check": "runs.conformance",
    # what to compute with
    "Array": "geometry",
    "Pose": "geometry",
    "Grid": "geometry",
    "cell_of": "geometry",
    "cells_of": "geometry",
    "cells_within": "geometry",
    "room_within": "geometry",
    "centre_of": "geometry",
    "compose": "geometry",
    "wrap_angle": "geometry",
    "cast": "geometry.rays",
    "leaps": "geometry.rays",
    "frontier_cells": "robot.planning.frontier",
    "search_grid": "robot.planning.shortest_paths",
    "trace_path": "robot.planning.shortest_paths",
    "spread": "robot.lidar.terrain",
    "Driver": "robot.landmark.driver",
    "next_command": "robot.landmark.driver",
    "expecting": "robot.landmark.graph",
    "OCCUPIED_ABOVE": "robot.occupancy",
    "shannon_entropy": "robot.occupancy",
    "renyi_entropy": "robot.occupancy",
    "jit": "compiled",
    # worlds and trials
    "Scenario": "world.scenario",
    "LandmarkScenario": "world.landmark.constants",
    "PAPER": "world.scenarios",
    "load_scenario": "world.scenarios",
    "World": "world.kinds",
    "LandmarkWorld": "world.landmark.world",
    "LidarScenario": "world.lidar.constants",
    "LidarWorld": "world.lidar.world",
    "draw_world": "world.kinds",
    "stream": "trial.seeding",
    "TrialSpec": "trial.spec",
    "Status": "trial.spec",
    "Step": "trial.steps",
    "rollout": "trial.loop",
    "run_trial": "trial.run",
    "run": "runs.runner",
    "agreement_of_choices": "runs.choices",
    # learning
    "Course": "trial.decision_process",
    "DecisionProcess": "trial.decision_process",
    "RewardWeights": "trial.reward",
    "REWARD_WEIGHTS": "trial.reward",
    "CANDIDATE_COLUMNS": "trial.features",
    "STATE_COLUMNS": "trial.features",
    "features": "trial.features",
    "score": "trial.error_and_efficiency",
    "Score": "trial.error_and_efficiency",
    "CURVE_COLUMNS": "analysis.training_curve",
    "CURVE_WINDOW": "analysis.training_curve",
    "VALIDATION_COLUMNS": "analysis.training_curve",
    "curve_path": "analysis.training_curve",
    "validations_path": "analysis.training_curve",
    "scenario_digest": "records.provenance",
    "installed_version": "records.provenance",
    # files of others, errors
    "read_text": "files",
    "parse_json": "files",
    "RequestError": "errors",
    "describe": "errors",
    "unknown": "errors",
    "writing": "errors",
}
"""Public name → module of this package that defines it."""

__all__ = sorted(PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in PUBLIC:
        raise AttributeError(f"module 'explore_bench' has no attribute '{name}'")
    return getattr(importlib.import_module(f"explore_bench.{PUBLIC[name]}"), name)
