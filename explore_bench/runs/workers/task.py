"""What a worker process is given and gives back. It writes nothing: the one who asks keeps the shard."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from explore_bench.records.encoding import encode
from explore_bench.records.provenance import trial_key
from explore_bench.runs.witness import run_witnessed
from explore_bench.runs.workers import SHIPPED
from explore_bench.runs.workers.fork_server import Call
from explore_bench.runs.workers.memory import memory_limit, share_of_memory
from explore_bench.runs.workers.process import READY, Answer
from explore_bench.strategies.entry import parse_factory
from explore_bench.trial.run import TrialResult, run_trial
from explore_bench.trial.spec import Outcome, Status, TrialSpec
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenario import Scenario

_warm: set[str] = set()


@dataclass(frozen=True, slots=True)
class Task:
    """A trial to run, the key under which it will be stored, and the seconds and the memory [GiB] that it may take.

    Without a limit of memory it is the share of a processor of the machine that runs it.
    """

    spec: TrialSpec
    key: str
    timeout: float
    memory: float | None = None

    @property
    def owner(self) -> str:
        """Whose code it runs: that of a foreign strategy, or nobody's in particular."""
        return owner_of(self.spec)


@dataclass(frozen=True, slots=True)
class Report:
    """How a trial went, and the shard to be stored under the key."""

    key: str
    shard: bytes
    outcome: Outcome


def owner_of(spec: TrialSpec) -> str:
    """Strategy whose code a trial runs beside that of this project; empty where there is none."""
    return "" if shipped_module(spec) else f"{spec.strategy} ({spec.factory})"


def shipped_module(spec: TrialSpec) -> str:
    """Module of this project that has a trial's strategy; empty where none has."""
    place, _ = parse_factory(spec.factory)
    return place if place.partition(".")[0] in SHIPPED else ""


def import_of(spec: TrialSpec) -> Call | None:
    """What imports the strategy of a trial, if it is shipped: a preparation."""
    module = shipped_module(spec)
    return (import_module, (module,)) if module else None


def preparation_of(spec: TrialSpec) -> Call:
    """What imports and compiles all that a trial runs, as far as that is this project's."""
    return _prepare, (import_of(spec), spec.scenario.tiny)


def make_task(spec: TrialSpec, timeout: float, memory: float | None = None) -> Task:
    """Task of a trial, with the key that its code has now."""
    return Task(spec, trial_key(spec), timeout, memory)


def run_task(task: Task, folder: Path) -> Iterator[Any]:
    """Run a trial in a process of its own or its owner's: a Job.

    One that failed for want of time or memory may have left what others would trip over: its Answer is the last.
    """
    yield from perform_ready(task, task.spec)


def perform_ready(task: Task, here: TrialSpec) -> Iterator[Any]:
    """Run a task once all is compiled; `here` is its trial with the paths that its files have on this machine."""
    warm_up(here.scenario.tiny)
    yield READY
    with memory_limit(task.memory or share_of_memory(os.cpu_count() or 1)):
        begin = time.perf_counter()
        result, told = run_witnessed(here, task.timeout)
        seconds = time.perf_counter() - begin
    yield Answer(_report(task, result, told, seconds), last=result.transient)


def perform(task: Task) -> Report:
    """Run a trial in this process."""
    begin = time.perf_counter()
    result, told = run_witnessed(task.spec, task.timeout)
    return _report(task, result, told, time.perf_counter() - begin)


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
    return _report(task, result, reason, 0.0)


def _report(task: Task, result: TrialResult, told: str, seconds: float) -> Report:
    result = replace(result, spec=task.spec)
    outcome = Outcome(
        spec=task.spec,
        status=result.status,
        reason=told,
        steps=max(len(result.steps) - 1, 0),
        seconds=seconds,
        decision_seconds=tuple(result.decision_seconds),
    )
    return Report(task.key, encode(result), outcome)


def _prepare(first: Call | None, scenario: Scenario) -> None:
    if first:
        function, arguments = first
        function(*arguments)
    warm_up(scenario)


def warm_up(scenario: Scenario) -> None:
    """Compile and cache all that trials of a scenario run, in this process and once; a tiny one does."""
    if repr(scenario) in _warm:
        return
    run_trial(TrialSpec("warm-up", f"{__name__}:WarmUp", scenario, trial=0, purpose="calibrate"))
    _warm.add(repr(scenario))


class WarmUp:
    """Touches whatever a strategy may call."""

    def reset(self, rng: Any) -> None:
        """Begin a trial."""

    def choose(self, observation: Any) -> int:
        """Predict along the first path, and take it."""
        return 0 * int(observation.belief.predict(observation.paths[0]).uncertainty + len(observation.reachable.cells))
