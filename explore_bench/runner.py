"""Runs the missing trials of a plan in worker processes and keeps the books: the only importer of joblib."""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
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
from explore_bench.strategy import StrategyError, make_strategy
from explore_bench.trial import OutOfTime, TrialResult, one_process, run_trial, time_limit

if TYPE_CHECKING:
    import pandas as pd

BACKENDS = ("loky", "sequential")
DEFAULT_TIMEOUT = 600.0
"""Seconds that one trial may take."""

AHEAD = 2
"""Trials handed out for each worker before their turn."""

CHECK_SECONDS = 60.0
"""Seconds that a strategy may take to be made before the run; one that is slower is left to the limit of its trials."""

GRACE = 60.0
"""Seconds beyond its limit after which a trial that cannot be interrupted ends the run."""

TIMEOUTS = (TimeoutError, multiprocessing.TimeoutError)

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
        if backend != "sequential":
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
        except TIMEOUTS:
            raise IncompleteError(
                f"a trial took longer than {timeout:g} s and could not be interrupted; mend its strategy"
            ) from None


def _parallel(
    specs: dict[int, TrialSpec], store: Store, jobs: int, backend: str, timeout: float
) -> Iterator[tuple[int, Outcome]]:
    """Outcomes of numbered trials as they end."""
    tasks = (
        joblib.delayed(_run_and_store)(number, spec, trial_key(spec), store, timeout)
        for number, spec in list(specs.items())
    )
    yield from _workers(jobs, backend, timeout)(tasks)


def _workers(jobs: int, backend: str, timeout: float) -> joblib.Parallel:
    """Processes for trials; unless the backend is sequential never this one, which a strategy might end."""
    return joblib.Parallel(
        n_jobs=1 if backend == "sequential" else max(jobs, 2),
        backend=backend,
        return_as="generator_unordered",
        pre_dispatch=AHEAD * jobs if jobs > 1 else 1,  # one at a time is one worker at work
        timeout=None if backend == "sequential" else timeout + GRACE,
    )


def _alone(spec: TrialSpec, store: Store, backend: str, timeout: float) -> Outcome:
    """Run a trial in a process that runs nothing else; should that die, the trial has failed."""
    try:
        return next(outcome for _, outcome in _parallel({0: spec}, store, 1, backend, timeout))
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


def check_runnable(
    specs: Sequence[TrialSpec], workers: int = 1, backend: str = "sequential", timeout: float = DEFAULT_TIMEOUT
) -> None:
    """Make every strategy of a plan once, where its trials will run, to find out what was asked for wrongly.

    One that is broken (does not import, raises, takes too long, ends its process) passes: its trials say so.

    Raises
    ------
    RequestError : for the first that does not exist, or whose parameters or weights are wrong.
    """
    unique: dict[tuple[str, int | None], TrialSpec] = {}
    for spec in specs:
        if not spec.broken:
            unique.setdefault((spec.strategy, spec.training_seed), spec)
    tasks = [joblib.delayed(_refusal)(i, spec, min(timeout, CHECK_SECONDS)) for i, spec in enumerate(unique.values())]
    jobs = 1 if backend == "sequential" else min(workers, len(tasks))
    refusals: dict[int, str] = {}
    if tasks:
        with _environment(dict.fromkeys(THREAD_SETTINGS, "1")), suppress(TerminatedWorkerError, *TIMEOUTS):
            refusals.update(_workers(jobs, backend, min(timeout, CHECK_SECONDS))(tasks))
    sentences = [refusals[i] for i in sorted(refusals) if refusals[i]]
    if sentences:
        raise RequestError(sentences[0])


def _refusal(number: int, spec: TrialSpec, seconds: float) -> tuple[int, str]:
    """What is wrong about asking for a strategy, in a sentence; empty where nothing is."""
    try:
        with redirect_stdout(sys.stderr), time_limit(seconds), one_process():
            make_strategy(spec.factory, spec.arguments)
    except StrategyError:
        pass
    except RequestError as error:
        return number, str(error)
    except OutOfTime:
        pass
    return number, ""


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
    strategies : instead of the suite's own: names, "module:factory" or "file.py:factory", with parameters in brackets
        where they take any, "entropy[alpha=0.5]".
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
    check_runnable(asked.specs, workers or default_workers(), backend, timeout)
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
