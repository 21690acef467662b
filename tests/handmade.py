"""Records, strategies' files and small plans that several test modules share; nothing here is a test."""

from __future__ import annotations

import dataclasses
import json
import os
import textwrap

import numpy as np
import pandas as pd

from explore_bench.records.encoding import TrialRecord
from explore_bench.runs.suites import plan
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import FINAL_COLUMNS, step_columns
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario

TINY = Scenario(size=12.0, landmark_count=1, obstacle_count=2, coverage=0.8)
"""Explored in some 25 steps and 3 decisions."""

HALLS = (
    "##########",
    "#....#...#",
    "#....#...#",
    "#........#",
    "#....#...#",
    "######.###",
    "#??###.#.#",
    "#.S......#",
    "#........#",
    "##########",
)
"""A given map: two rooms and a hall, one free cell that nobody reaches, and a corner that the map does not know."""

NEAREST = """
    class Plugin:
        def reset(self, rng):
            self.decisions = 0

        def choose(self, observation):
            self.decisions += 1
            if self.decisions > 1:
                return self.later(observation)
            return int(observation.path_lengths.argmin())

        def later(self, observation):
            return int(observation.path_lengths.argmin())
"""


def tiny_plan(names=("nearest", "random"), trials=2, **options):
    """Return the trials of some strategies on tiny worlds."""
    return plan("smoke", list(names), [TINY.size], trials, scenario=TINY, **options).specs


def write_plugin(folder, later="return int(observation.path_lengths.argmin())", name="plugin", head=""):
    """Write a strategy that takes the nearest first and then runs these lines; returns "file.py:Plugin"."""
    source = textwrap.dedent(NEAREST)
    start = source.index("        return int", source.index("def later"))
    body = textwrap.indent(textwrap.dedent(later).strip("\n"), " " * 8)
    file = folder / f"{name}.py"
    file.write_text(f"{textwrap.dedent(head)}\n{source[:start]}{body}\n")
    return f"{file}:Plugin"


def alive(pid):
    """Whether there is a process of this number."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def random_weights(path, seed=0):
    """Write weights of a GCN-obs that has learned nothing, with their card; torch is imported by need."""
    import torch

    from baselines.learned.checkpoint import save_weights
    from baselines.learned.gcn import GCN

    with torch.random.fork_rng():
        torch.manual_seed(seed)
        save_weights(GCN(), path, {"training_seed": seed})


def record(status="explored", scenario=TINY, strategy="nearest", trial=0, final=None, rows=None, reason="", **columns):
    """Return a record with these columns of step rows; the others are plain: numbered steps and unit covariances."""
    count = rows if rows is not None else len(next(iter(columns.values())))
    steps = {name: np.zeros(count, dtype=column.dtype) for name, column in step_columns(scenario.kind).items()}
    steps["step"] = np.arange(count, dtype=np.int32)
    for name in ("cov_xx", "cov_yy", "cov_hh"):
        steps[name] = np.ones(count)
    steps["uncertainty"] = np.full(count, scenario.prior_uncertainty)
    for name, values in columns.items():
        assert name in steps, name
        steps[name] = np.asarray(values, dtype=step_columns(scenario.kind)[name].dtype)
    estimates = {name: np.full(count, np.nan, dtype=np.float32) for name in FINAL_COLUMNS}
    for name, values in (final or {}).items():
        estimates[name] = np.asarray(values, dtype=np.float32)
    world = LandmarkWorld(
        scenario.grid, np.zeros(scenario.grid.shape, dtype=bool), np.zeros((0, 2)), (1.0, 1.0, float(trial))
    )
    spec = TrialSpec(strategy, f"made.by.hand:{strategy.replace('-', '_')}", scenario, trial)
    return TrialRecord(spec, Status(status).value, reason, steps, estimates, world, transient=False)


def with_spec(made, **changes):
    """Return the record with another specification."""
    return dataclasses.replace(made, spec=dataclasses.replace(made.spec, **changes))


def write_thresholds(folder, **changes):
    """Write a thresholds.toml that tolerates a loss of 5 % of e of `Mine` at 20 m, or what the changes say."""
    values = {"metric": "trajectory_error", "strategy": "Mine", "size": 20.0, "tolerance": 0.05, "reason": "test"}
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f"{key} = {json.dumps(value)}" for key, value in (values | changes).items()]
    (folder / "thresholds.toml").write_text("\n".join(["[[threshold]]", *lines, ""]))


def trial_rows(values, strategy="Mine", seed=None, size=20.0, scenario="paper", world="w", status="explored"):
    """Rows of trials.csv with the same value of e and of η, one a world."""
    rows = [
        {
            "strategy": strategy,
            "training_seed": seed,
            "size": size,
            "trial": i,
            "scenario": scenario,
            "world": f"{world}{i}",
            "status": status,
            "trajectory_error": value,
            "exploration_efficiency": value,
        }
        for i, value in enumerate(values)
    ]
    return pd.DataFrame(rows).astype({"training_seed": "Int64"})
