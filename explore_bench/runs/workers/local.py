"""Processes of this machine: so many at a time, each for the shipped strategies or for a foreign one."""

from __future__ import annotations

import os
from collections.abc import Generator, Sequence
from multiprocessing.connection import wait
from typing import Any

from explore_bench.runs.workers.process import Job, LostError, Process, ProcessDiedError
from explore_bench.runs.workers.task import Report, Task, lost, perform, preparation_of, run_task


def default_workers() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_here(tasks: Sequence[Task], workers: int, backend: str) -> Generator[Report]:
    """Run tasks on this machine and yield their reports in the order in which they end.

    They run in processes of their own, unless the backend is sequential: then one after the other in this one, where
    a debugger can follow and nothing is contained.
    """
    if backend == "sequential":
        yield from map(perform, tasks)
        return
    jobs = [Job(run_task, (task,), task.timeout, task.owner, preparation_of(task.spec)) for task in tasks]
    for number, found in results_of(jobs, workers):
        yield lost(tasks[number], str(found)) if isinstance(found, LostError) else found


def results_of(jobs: Sequence[Job], workers: int) -> Generator[tuple[int, Any]]:
    """Have jobs done by so many processes; yields the number and the result of each as they end.

    A job whose process dies is done once more in a new one; the result of one that is lost is a LostError.

    Raises
    ------
    RequestError : the first of a job.
    """
    waiting, again = list(range(len(jobs))), set[int]()
    idle: list[Process] = []
    doing: dict[Process, int] = {}
    try:
        while waiting or doing:
            while waiting and len(doing) < workers:
                process, number = _next(jobs, waiting, idle, doing)
                process.begin(jobs[number])
                doing[process] = number
            wait([each.pipe for each in doing], min(each.patience for each in doing))
            for process, number in list(doing.items()):
                try:
                    answer = process.take()
                except LostError as error:
                    del doing[process]
                    process.end()
                    if isinstance(error, ProcessDiedError) and number not in again:
                        again.add(number)
                        waiting.insert(0, number)
                    else:
                        yield number, error
                    continue
                if answer is None:
                    continue
                del doing[process]
                if answer.last:
                    process.end()
                else:
                    idle.append(process)
                yield number, answer.value
    finally:
        for process in (*idle, *doing):
            process.end()


def _next(
    jobs: Sequence[Job], waiting: list[int], idle: list[Process], doing: dict[Process, int]
) -> tuple[Process, int]:
    """Take out what is to be done next, and the process for it: for an owner that has one already, if possible."""
    for process in idle:
        for number in waiting:
            if jobs[number].owner == process.owner:
                idle.remove(process)
                waiting.remove(number)
                return process, number
    while idle:
        idle.pop().end()
    served = {process.owner for process in doing}
    number = next((number for number in waiting if jobs[number].owner not in served), waiting[0])
    waiting.remove(number)
    return Process(jobs[number]), number
