"""Runs the missing trials of a plan in worker processes and keeps the books: the only importer of joblib."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import joblib
import numpy as np
from joblib.externals.loky.process_executor import TerminatedWorkerError

from explore_bench.errors import RequestError, unknown
from explore_bench.provenance import trial_key
from explore_bench.records import Store, missing
from explore_bench.simulator.world import draw_world
from explore_bench.spec import Outcome, Status, TrialSpec
from explore_bench.strategy import make_strategy
from explore_bench.trial import TrialResult, run_trial

if TYPE_CHECKING:
    import pandas as pd

BACKENDS = ("loky", "sequential")
DEFAULT_TIMEOUT = 600.0
"""Seconds that one trial may take."""

AHEAD = 2
"""Trials handed out for each worker before their turn."""

GRACE = 60.0
"""Seconds beyond its limit after which a trial that cannot be interrupted ends the run."""

THREAD_SETTINGS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "TBB_NUM_THREADS",
)


class IncompleteError(RuntimeError):
    """A run ended before its plan was done; what it finished is stored (exit code 3)."""


def default_workers() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def execute(
    specs: Sequence[TrialSpec],
    store: Store,
    workers: int,
    backend: str = "loky",
    timeout: float = DEFAULT_TIMEOUT,
) -> Iterator[Outcome]:
    """Run trials in parallel, store each as it ends and yield its outcome, in the order in which they end.

    When a worker process dies, the trials that may have killed it run again, each in a process of its own; one whose
    process dies again is stored as failed.

    Raises
    ------
    IncompleteError : when a trial could not be interrupted.
    """
    if not specs:
        return
    longest_first = sorted(specs, key=lambda spec: (-spec.scenario.cell_count, spec.trial, spec.strategy))
    jobs = 1 if backend == "sequential" else min(workers, len(specs))
    waiting = dict(enumerate(longest_first))
    with _environment(dict.fromkeys(THREAD_SETTINGS, "1")):
        if jobs > 1:
            warm_up(specs[0])
        try:
            while waiting:
                try:
                    for number, outcome in _parallel(waiting, store, jobs, backend, timeout):
                        del waiting[number]
                        yield outcome
                except TerminatedWorkerError:
                    for number in list(waiting)[: AHEAD * jobs]:  # joblib hands tasks out in order
                        yield _alone(waiting.pop(number), store, backend, timeout)
        except (TimeoutError, multiprocessing.TimeoutError):
            raise IncompleteError(
                f"a trial took longer than {timeout:g} s and could not be interrupted; mend its strategy"
            ) from None


def _parallel(
    specs: dict[int, TrialSpec], store: Store, jobs: int, backend: str, timeout: float
) -> Iterator[tuple[int, Outcome]]:
    """Outcomes of numbered trials as they end."""
    parallel = joblib.Parallel(
        n_jobs=jobs,
        backend=backend,
        return_as="generator_unordered",
        pre_dispatch=f"{AHEAD}*n_jobs",
        timeout=timeout + GRACE if jobs > 1 else None,
    )
    tasks = (
        joblib.delayed(_run_and_store)(number, spec, trial_key(spec), store, timeout)
        for number, spec in list(specs.items())
    )
    yield from parallel(tasks)


def _alone(spec: TrialSpec, store: Store, backend: str, timeout: float) -> Outcome:
    """Run a trial in a process that runs nothing else; should that die, the trial has failed."""
    try:
        return next(outcome for _, outcome in _parallel({0: spec}, store, 2, backend, timeout))
    except TerminatedWorkerError:
        result = TrialResult(
            spec=spec,
            world=draw_world(spec.scenario, spec.generator("world")),
            status=Status.FAILED,
            reason="its worker process died (killed, or out of memory)",
            steps=[],
            snapshots={},
            final_poses=np.empty((0, 3)),
            final_covariances=np.empty((0, 3)),
            decision_seconds=[],
            seconds=0.0,
            transient=True,
        )
        store.write(result, trial_key(spec))
        return Outcome(spec, result.status, result.reason, 0, 0.0, ())


def warm_up(spec: TrialSpec) -> None:
    """Compile and cache the harness's kernels in this process, lest each worker compile its own."""
    size = spec.scenario.cell_size * 5
    tiny = spec.scenario.replace(map=None, size=size, landmark_count=2, obstacle_count=1, coverage=1.0)
    run_trial(TrialSpec("warm-up", "explore_bench.runner:WarmUp", tiny, trial=0, purpose="calibrate"))


class WarmUp:
    """Touches whatever a strategy may call."""

    def reset(self, rng: Any) -> None:
        """Begin a trial."""

    def choose(self, observation: Any) -> int:
        """Predict along the first path, and take it."""
        from explore_bench.slam import predict

        return 0 * int(predict(observation.belief, observation.paths[0]).uncertainty)


def check_runnable(specs: Sequence[TrialSpec]) -> None:
    """Import and make every strategy of a plan once.

    Raises
    ------
    RequestError : for the first that cannot be made.
    """
    seen: dict[tuple[str, int | None], TrialSpec] = {}
    for spec in specs:
        seen.setdefault((spec.strategy, spec.training_seed), spec)
    for spec in seen.values():
        made = make_strategy(spec.factory, spec.arguments)
        begin = "reset_with_world" if spec.reference else "reset"
        for method in (begin, "choose"):
            if not callable(getattr(made, method, None)):
                raise RequestError(f"strategy '{spec.strategy}' ({spec.factory}) has no method {method}; add it.")


def run(
    suite: str = "smoke",
    strategies: Sequence[str] = (),
    *,
    sizes: Sequence[float] = (),
    trials: int | None = None,
    workers: int | None = None,
    backend: str = "loky",
    timeout: float = DEFAULT_TIMEOUT,
    scenario: Any = None,
    seed: int = 0,
    results: str | Path = "results",
    progress: Callable[[Outcome], None] | None = None,
) -> pd.DataFrame:
    """Run what is missing of a suite and return the rows of `trials.csv` for the trials asked for.

    Parameters
    ----------
    suite : name of a suite.
    strategies : names, "module:factory" or "file.py:factory" instead of the suite's own.
    sizes, trials, seed : sizes [m], worlds a size and root seed instead of the suite's.
    workers, backend, timeout : processes, joblib backend, and seconds that a trial may take.
    scenario : a Scenario, or a name or TOML file of one, instead of the paper's.
    results : folder of the records.
    progress : called with the outcome of every trial that runs.

    Raises
    ------
    RequestError : where the request or the folder is wrong.
    IncompleteError : where the run ended early.
    """
    from explore_bench.results import select
    from explore_bench.scenario import PAPER, Scenario
    from explore_bench.scenario_file import load_scenario
    from explore_bench.suites import plan

    if backend not in BACKENDS:
        raise unknown("backend", backend, BACKENDS)
    if not isinstance(scenario, Scenario | str | None):
        raise RequestError(f"scenario is {scenario!r}; give a Scenario, the name of one or a TOML file.")
    strategies = [strategies] if isinstance(strategies, str) else strategies
    name = scenario if isinstance(scenario, str) else "paper" if scenario is None else "custom"
    physics = load_scenario(scenario) if isinstance(scenario, str) else scenario
    asked = plan(suite, strategies, sizes, trials, seed, physics, Path(name).name)
    check_runnable(asked.specs)
    store = Store(Path(results))
    store.open(seed, "evaluate", physics or PAPER)
    to_do = list(missing(store, asked.specs))
    return select(complete(to_do, store, workers or default_workers(), backend, timeout, progress), asked.specs)


def complete(
    specs: Sequence[TrialSpec],
    store: Store,
    workers: int,
    backend: str = "loky",
    timeout: float = DEFAULT_TIMEOUT,
    progress: Callable[[Outcome], None] | None = None,
) -> pd.DataFrame:
    """Run trials and write `trials.csv` and `times.csv`, also where the run ends early; returns all rows."""
    from explore_bench.results import write_times, write_trials

    outcomes: list[Outcome] = []
    try:
        for outcome in execute(specs, store, workers, backend, timeout):
            outcomes.append(outcome)
            if progress:
                progress(outcome)
    finally:
        table = write_trials(store)
        write_times(store.folder, outcomes)
    return table


def _run_and_store(number: int, spec: TrialSpec, key: str, store: Store, timeout: float) -> tuple[int, Outcome]:
    begin = time.perf_counter()
    result = run_trial(spec, timeout)
    store.write(result, key)
    return number, Outcome(
        spec=spec,
        status=result.status,
        reason=result.reason,
        steps=max(len(result.steps) - 1, 0),
        seconds=time.perf_counter() - begin,
        decision_seconds=tuple(result.decision_seconds),
    )


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Set environment variables that worker processes inherit, and restore them."""
    old = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in old.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
