"""What a worker of a cluster does with a parcel: it has a process of its own run it, as this machine's workers are."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

from explore_bench.runs.workers.parcel import OtherCodeError, Parcel, unpack
from explore_bench.runs.workers.process import Job, LostError, Process, ProcessDiedError
from explore_bench.runs.workers.task import Report, lost, perform_ready, preparation_of

_own = threading.local()


def run_apart(parcel: Parcel) -> Report:
    """Run a task in this thread's own process; in a new one where that dies, or has older code.

    Raises
    ------
    OtherCodeError : where the code here is not that of the machine that asks.
    """
    try:
        return _run_once(parcel)
    except (ProcessDiedError, OtherCodeError):
        pass
    except LostError as error:
        return lost(parcel.task, str(error))
    try:
        return _run_once(parcel)
    except LostError as error:
        return lost(parcel.task, str(error))


def _run_once(parcel: Parcel) -> Report:
    """Run a task in this thread's process; whatever goes wrong, the next task has another."""
    task = parcel.task
    process: Process | None = getattr(_own, "process", None)
    if process and process.owner != task.owner:
        _own.process = None
        process.end()
        process = None
    job = Job(run_parcel, (parcel,), task.timeout, task.owner, preparation_of(task.spec))
    process = _own.process = process or Process(job)
    fit = False
    try:
        process.begin(job)
        while (answer := process.take()) is None:
            wait([process.pipe], process.patience)
        fit = not answer.last
        report: Report = answer.value
        return report
    finally:
        if not fit:
            _own.process = None
            process.end()


def run_parcel(parcel: Parcel, folder: Path) -> Iterator[Any]:
    """Run a trial with the files that came with it: a Job."""
    yield from perform_ready(parcel.task, unpack(parcel, folder))
