"""What a worker process is given and gives back. It writes nothing: the one who asks keeps the shard."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from explore_bench.records.encoding import encode
from explore_bench.records.provenance import trial_key
from explore_bench.trial.run import TrialResult, run_trial
from explore_bench.trial.spec import Outcome, Status, TrialSpec
from explore_bench.world.kinds import draw_world

PROCESS_DIED = "its worker process died (killed, or out of memory)"


@dataclass(frozen=True, slots=True)
class Task:
    """A trial to run, the key under which it will be stored, and the seconds that it may take."""

    spec: TrialSpec
    key: str
    timeout: float


@dataclass(frozen=True, slots=True)
class Report:
    """How a trial went, and the shard to be stored under the key."""

    key: str
    shard: bytes
    outcome: Outcome


def make_task(spec: TrialSpec, timeout: float) -> Task:
    """Task of a trial, with the key that its code has now."""
    return Task(spec, trial_key(spec), timeout)


def perform(task: Task, here: TrialSpec | None = None) -> Report:
    """Run a trial in this process; `here` is the same trial with the paths that its files have on this machine."""
    begin = time.perf_counter()
    result = run_trial(here or task.spec, task.timeout)
    return _report(task, replace(result, spec=task.spec), time.perf_counter() - begin)


def lost(task: Task, reason: str) -> Report:
    """Failed trial of which nothing is left but the reason; it is worth another try."""
    spec = task.spec
    result = TrialResult(
        spec=spec,
        world=draw_world(spec.scenario, spec.generator("world")),
        status=Status.FAILED,
        reason=reason,
        steps=[],
        snapshots={},
        final_poses=np.empty((0, 3)),
        final_covariances=np.empty((0, 3)),
        decision_seconds=[],
        seconds=0.0,
        transient=True,
    )
    return _report(task, result, 0.0)


def _report(task: Task, result: TrialResult, seconds: float) -> Report:
    outcome = Outcome(
        spec=result.spec,
        status=result.status,
        reason=result.reason,
        steps=max(len(result.steps) - 1, 0),
        seconds=seconds,
        decision_seconds=tuple(result.decision_seconds),
    )
    return Report(task.key, encode(result), outcome)


def warm_up(spec: TrialSpec) -> None:
    """Compile and cache the harness's kernels in this process, lest each worker compile its own."""
    task = "explore_bench.runs.workers.task:WarmUp"
    run_trial(TrialSpec("warm-up", task, spec.scenario.tiny, trial=0, purpose="calibrate"))


class WarmUp:
    """Touches whatever a strategy may call."""

    def reset(self, rng: Any) -> None:
        """Begin a trial."""

    def choose(self, observation: Any) -> int:
        """Predict along the first path, and take it."""
        return 0 * int(observation.belief.predict(observation.paths[0]).uncertainty + len(observation.reachable.cells))
