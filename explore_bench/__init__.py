"""A benchmark of robot-exploration strategies: one simulator, paired seeded trials, tables with intervals.

Everything here is imported when first used: `explore_bench.run(...)` runs trials, `Observation`, `Strategy` and
`Entry` are what a strategy needs.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from explore_bench.errors import RequestError
    from explore_bench.runner import run
    from explore_bench.scenario import Scenario
    from explore_bench.scenario_file import load_scenario
    from explore_bench.simulator.world import World
    from explore_bench.spec import TrialSpec
    from explore_bench.strategy import Entry, Observation, Reference, Strategy
    from explore_bench.trial import rollout, run_trial

_HOME = {
    "Entry": "strategy",
    "Observation": "strategy",
    "Reference": "strategy",
    "RequestError": "errors",
    "Scenario": "scenario",
    "Strategy": "strategy",
    "TrialSpec": "spec",
    "World": "simulator.world",
    "load_scenario": "scenario_file",
    "rollout": "trial",
    "run": "runner",
    "run_trial": "trial",
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
