"""A benchmark of robot-exploration strategies: one simulator, paired seeded trials, tables with intervals.

Everything here is imported when first used: `explore_bench.run(...)` runs trials, `Observation`, `Strategy` and
`Entry` are what a strategy needs.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from explore_bench.errors import RequestError
    from explore_bench.runs.runner import run
    from explore_bench.strategies.contract import Observation, Reference, Strategy
    from explore_bench.strategies.entry import Entry
    from explore_bench.trial.rollout import rollout
    from explore_bench.trial.run import run_trial
    from explore_bench.trial.spec import TrialSpec
    from explore_bench.world.landmark.world import World
    from explore_bench.world.scenario import Scenario
    from explore_bench.world.scenario_file import load_scenario

_HOME = {
    "Entry": "strategies.entry",
    "Observation": "strategies.contract",
    "Reference": "strategies.contract",
    "RequestError": "errors",
    "Scenario": "world.scenario",
    "Strategy": "strategies.contract",
    "TrialSpec": "trial.spec",
    "World": "world.landmark.world",
    "load_scenario": "world.scenario_file",
    "rollout": "trial.rollout",
    "run": "runs.runner",
    "run_trial": "trial.run",
}

__all__ = [
    "Entry",
    "Observation",
    "Reference",
    "RequestError",
    "Scenario",
    "Strategy",
    "TrialSpec",
    "World",
    "load_scenario",
    "rollout",
    "run",
    "run_trial",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'explore_bench' has no attribute '{name}'")
    return getattr(importlib.import_module(f"explore_bench.{_HOME[name]}"), name)
