"""Runs the missing trials of a plan and keeps the books; the processes are those of `workers`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, redirect_stdout
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from explore_bench.errors import RequestError, unknown
from explore_bench.records.provenance import trial_key
from explore_bench.records.store import Store, missing
from explore_bench.runs.workers import BACKENDS, IncompleteError
from explore_bench.runs.workers.local import default_workers, results_of, run_here
from explore_bench.runs.workers.memory import share_of_memory
from explore_bench.runs.workers.process import READY, Answer, Job
from explore_bench.runs.workers.task import Report, import_of, make_task, owner_of
from explore_bench.strategies.loading import StrategyError, make_strategy
from explore_bench.trial.containment import Signals, one_process, time_limit
from explore_bench.trial.spec import Outcome, TrialSpec
from explore_bench.world.kinds import draw_world

if TYPE_CHECKING:
    import pandas as pd

DEFAULT_TIMEOUT = 600.0
"""Seconds that one trial may take."""

CHECK_SECONDS = 60.0
"""Seconds that a strategy may take to be made before the run; one that is slower is left to the limit of its trials."""


def crew(backend: str = "processes", workers: int | None = None, scheduler: str | None = None) -> int:
    """Return how many trials run at a time: as many as asked for, or a processor or a thread of the cluster each.

    Raises
    ------
    RequestError : where the three do not fit together, or no worker of the scheduler is found.
    """
    if backend not in BACKENDS:
        raise unknown("backend", backend, BACKENDS)
    if backend != "dask":
        if scheduler is not None:
            raise RequestError(
                f"scheduler '{scheduler}' is one of dask, not of the backend '{backend}'; add --backend dask."
            )
        return workers or default_workers()
    if scheduler is None:
        raise RequestError("backend 'dask' has no scheduler; give its address with --scheduler, like tcp://host:8786.")
    if workers is not None:
        raise RequestError(
            f"workers is {workers}, but a scheduler's workers are started with 'dask worker'; leave it out."
        )
    if not (find_spec("dask") and find_spec("distributed")):
        raise RequestError("backend 'dask' is not installed; pip install 'explore-bench[dask]'.")
    from explore_bench.runs.workers.cluster import thread_count

    return thread_count(scheduler)


def execute(
    specs: Sequence[TrialSpec],
    store: Store,
    workers: int,
    backend: str = "processes",
    timeout: float = DEFAULT_TIMEOUT,
    scheduler: str | None = None,
    memory: float | None = None,
) -> Iterator[Outcome]:
    """Run trials in parallel, store each as it ends and yield its outcome, in the order in which they end.

    Those of the shipped strategies come first, then those of each foreign one together.

    Raises
    ------
    RequestError : where a shard cannot be written, or the cluster is not as it must be.
    IncompleteError : where the run ended early.
    """
    if not specs:
        return
    longest_first = sorted(
        specs, key=lambda spec: (owner_of(spec), -spec.scenario.cell_count, spec.trial, spec.strategy)
    )
    if backend != "dask":
        memory = memory or share_of_memory(workers)
    tasks = [make_task(spec, timeout, memory) for spec in longest_first]
    reports: Generator[Report]
    if backend == "dask":
        from explore_bench.runs.workers.cluster import run_there

        assert scheduler is not None
        reports = run_there(tasks, scheduler, timeout)
    else:
        reports = run_here(tasks, workers, backend)
    with closing(reports):
        for report in reports:
            store.keep(report.key, report.shard)
            yield report.outcome


def check_runnable(
    specs: Sequence[TrialSpec], workers: int = 1, backend: str = "sequential", timeout: float = DEFAULT_TIMEOUT
) -> None:
    """Make every strategy of a plan once, where its trials will run, to find out what was asked for wrongly.

    One that is broken (does not import, raises, takes too long, ends its process) passes: its trials say so. Of every
    given map one world is drawn.

    Raises
    ------
    RequestError : for the first that does not exist, or whose parameters or weights are wrong, and for a map into which
        the robot does not fit.
    """
    for mapped in {spec.scenario: spec for spec in specs if spec.scenario.map is not None}.values():
        draw_world(mapped.scenario, mapped.generator("world"))
    unique: dict[tuple[str, int | None], TrialSpec] = {}
    for spec in specs:
        if not spec.broken:
            unique.setdefault((spec.strategy, spec.training_seed), spec)
    if backend == "dask":
        workers, backend = default_workers(), "processes"
    seconds = min(timeout, CHECK_SECONDS)
    asked = list(unique.values())
    if backend == "sequential":
        refusals = {number: _refusal(spec, seconds) for number, spec in enumerate(asked)}
    else:
        jobs = [Job(tell_refusal, (spec, seconds), seconds, owner_of(spec), import_of(spec)) for spec in asked]
        refusals = {number: text for number, text in results_of(jobs, workers) if isinstance(text, str)}
    for number in sorted(refusals):
        if refusals[number]:
            raise RequestError(refusals[number])


def tell_refusal(spec: TrialSpec, seconds: float, folder: Path) -> Iterator[Any]:
    """Make a strategy once in this process, and tell what is wrong about asking for it: a Job."""
    yield READY
    yield Answer(_refusal(spec, seconds))


def _refusal(spec: TrialSpec, seconds: float) -> str:
    """What is wrong about asking for a strategy, in a sentence; empty where nothing is."""
    told, sentence = Signals(), ""
    try:
        with redirect_stdout(sys.stderr), time_limit(seconds) as told, one_process():
            make_strategy(spec.factory, spec.arguments)
    except BaseException as error:
        sentence = str(error) if isinstance(error, RequestError) and not isinstance(error, StrategyError) else ""
    if told.interrupted:
        raise KeyboardInterrupt
    return sentence


def run(
    suite: str = "smoke",
    strategies: Sequence[str] = (),
    *,
    sizes: Sequence[float] = (),
    trials: int | None = None,
    workers: int | None = None,
    backend: str = "processes",
    scheduler: str | None = None,
    timeout: float = DEFAULT_TIMEOUT,
    memory: float | None = None,
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
    workers, backend, scheduler : processes; "processes", "sequential" (in this process, for a debugger) or "dask"; the
        address of a scheduler where that is dask.
    timeout, memory : seconds and memory [GiB] that a trial may take; the latter by default what the machine has, over
        the number of processes.
    scenario : a Scenario, or a name or TOML file of one, instead of the paper's.
    results : folder of the records.
    progress : called with the outcome of every trial that runs.

    Raises
    ------
    RequestError : where the request or the folder is wrong.
    IncompleteError : where the run ended early.
    """
    from explore_bench.runs.suites import plan
    from explore_bench.world.scenario import Scenario
    from explore_bench.world.scenarios import load_scenario

    workers = crew(backend, workers, scheduler)
    if not isinstance(scenario, Scenario | str | None):
        raise RequestError(f"scenario is {scenario!r}; give a Scenario, the name of one or a TOML file.")
    strategies = [strategies] if isinstance(strategies, str) else strategies
    name = Path(scenario).name if isinstance(scenario, str) else None if scenario is None else "custom"
    physics = load_scenario(scenario) if isinstance(scenario, str) else scenario
    asked = plan(suite, strategies, sizes, trials, seed, physics, name)
    check_runnable(asked.specs, workers, backend, timeout)
    store = Store(Path(results))
    store.open(seed, "evaluate", asked.scenario)
    store.take(asked.specs)
    to_do = list(missing(store, asked.specs))
    return asked_for(complete(to_do, store, workers, backend, timeout, progress, scheduler, memory), asked.specs)


def asked_for(table: pd.DataFrame, specs: Sequence[TrialSpec]) -> pd.DataFrame:
    """Rows of the trials of a plan.

    Raises
    ------
    IncompleteError : where some are lacking: their code was edited while they ran.
    """
    from explore_bench.analysis.tables import select

    rows = select(table, specs)
    lacking = len({(spec.scenario_name, trial_key(spec)) for spec in specs}) - len(rows)
    if lacking > 0:
        raise IncompleteError(
            f"{lacking} of the trials asked for are not in trials.csv, since their code or their weights changed while "
            "they ran; run again"
        )
    return rows


def complete(
    specs: Sequence[TrialSpec],
    store: Store,
    workers: int,
    backend: str = "processes",
    timeout: float = DEFAULT_TIMEOUT,
    progress: Callable[[Outcome], None] | None = None,
    scheduler: str | None = None,
    memory: float | None = None,
) -> pd.DataFrame:
    """Run trials and write `trials.csv` and `times.csv`, also where the run ends early; returns all rows."""
    from explore_bench.analysis.tables import write_trials
    from explore_bench.analysis.times import write_times

    outcomes: list[Outcome] = []
    try:
        for outcome in execute(specs, store, workers, backend, timeout, scheduler, memory):
            outcomes.append(outcome)
            if progress:
                progress(outcome)
    finally:
        table = write_trials(store)
        write_times(store.folder, outcomes)
    return table
