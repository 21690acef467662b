"""Worker processes of this machine, through joblib."""

from __future__ import annotations

import multiprocessing
import os
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from explore_bench.runs.workers import GRACE, THREAD_SETTINGS, IncompleteError
from explore_bench.runs.workers.task import PROCESS_DIED, Report, Task, lost, perform, warm_up

warnings.filterwarnings("ignore", r"\d+ tasks ", UserWarning, "joblib")  # what an interrupted run leaves runs again
warnings.filterwarnings("ignore", "A worker stopped ", UserWarning, "joblib")  # one that has grown is replaced

AHEAD = 2
"""Trials handed out for each worker before their turn."""

PARENT_SECONDS = 1.0
"""How often a worker looks whether its parent is still there."""

TIMEOUTS = (TimeoutError, multiprocessing.TimeoutError)

LOST = (TerminatedWorkerError, *TIMEOUTS)
"""Errors of `calls` when a process ended or hung, and took results with it."""

Result = TypeVar("Result")


def default_workers() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_here(tasks: Sequence[Task], workers: int, backend: str, timeout: float) -> Generator[Report]:
    """Run tasks in processes of this machine and yield their reports in the order in which they end.

    When a worker process dies, the trials that may have killed it run again, each in a process of its own; one whose
    process dies again has failed.

    Raises
    ------
    IncompleteError : when a trial could not be interrupted.
    """
    jobs = 1 if backend == "sequential" else min(workers, len(tasks))
    waiting = dict(enumerate(tasks))
    with one_thread_each():
        if backend != "sequential":
            warm_up(tasks[0].spec)
        try:
            while waiting:
                try:
                    for number, report in calls(_numbered, list(waiting.items()), jobs, backend, timeout):
                        del waiting[number]
                        yield report
                except TerminatedWorkerError:
                    for number in list(waiting)[: AHEAD * jobs]:  # joblib hands tasks out in order
                        yield _alone(waiting.pop(number), backend, timeout)
        except TIMEOUTS:
            raise IncompleteError(
                f"a trial took longer than {timeout:g} s and could not be interrupted; mend its strategy"
            ) from None


def calls(
    function: Callable[..., Result], arguments: Iterable[tuple[Any, ...]], jobs: int, backend: str, seconds: float
) -> Iterator[Result]:
    """Results of calls as they end: in other processes, which a strategy might end, unless the backend is sequential.

    Raises
    ------
    TerminatedWorkerError, TimeoutError : LOST, when a process died, or none answered for `seconds` and GRACE.
    """
    parallel = joblib.Parallel(
        n_jobs=1 if backend == "sequential" else max(jobs, 2),
        backend=backend,
        return_as="generator_unordered",
        pre_dispatch=AHEAD * jobs if jobs > 1 else 1,  # one at a time is one worker at work
        timeout=None if backend == "sequential" else seconds + GRACE,
    )
    here = 0 if backend == "sequential" else os.getpid()
    yield from parallel(joblib.delayed(_called)(here, function, *each) for each in arguments)


def _called(parent: int, function: Callable[..., Result], *arguments: Any) -> Result:
    """Result of a call, in a process that ends with its parent."""
    if parent and parent == os.getppid():
        _end_with(parent)
    return function(*arguments)


@cache
def _end_with(parent: int) -> None:
    """End this process when its parent is gone, however that ended: nobody waits for the results any more."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_SECONDS)
        os._exit(1)

    threading.Thread(target=watch, name="parent", daemon=True).start()


def _numbered(number: int, task: Task) -> tuple[int, Report]:
    return number, perform(task)


def _alone(task: Task, backend: str, timeout: float) -> Report:
    """Run a trial in a process that runs nothing else; should that die, the trial has failed."""
    try:
        return next(calls(perform, [(task,)], 1, backend, timeout))
    except TerminatedWorkerError:
        return lost(task, PROCESS_DIED)


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Set the environment that worker processes inherit, and restore it."""
    # joblib's own process, which tidies up after one that was killed, would complain of what it found
    told = ",".join(filter(None, (os.environ.get("PYTHONWARNINGS"), "ignore:resource_tracker")))
    settings = THREAD_SETTINGS | {"PYTHONWARNINGS": told}
    old = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    try:
        yield
    finally:
        for name, value in old.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
