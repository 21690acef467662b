"""Workers of a dask cluster, through joblib: the only importer of distributed, imported with that backend only."""

from __future__ import annotations

import asyncio
import logging
import multiprocessing
from collections.abc import Callable, Generator, Sequence
from typing import Any

import joblib
from distributed import Client, Security, rpc
from distributed.utils import LoopRunner
from joblib._dask import DaskDistributedBackend

from explore_bench.errors import RequestError, describe
from explore_bench.runs.workers import GRACE, IncompleteError
from explore_bench.runs.workers.apart import run_apart
from explore_bench.runs.workers.parcel import pack
from explore_bench.runs.workers.process import START
from explore_bench.runs.workers.task import Report, Task

logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # what it finds is said in one sentence

CONNECT = 30.0
"""Seconds within which a scheduler, and a worker of it, must be found."""


class Backend(DaskDistributedBackend):  # type: ignore[misc]
    """joblib's, except that a task that dask gave up is an error at once and a lone worker is used."""

    def effective_n_jobs(self, n_jobs: int) -> int:
        """Threads of all workers, at least 2: with one, joblib would not ask the cluster."""
        return max(super().effective_n_jobs(n_jobs), 2)

    def submit(self, func: Any, callback: Callable[[Any], None] | None = None) -> Any:
        """Submit a batch; joblib's own backend never calls back for one whose workers died."""
        future = super().submit(func, callback)

        def tell(done: Any) -> None:
            if callback and done.exception() is not None:
                callback(done.exception())

        future.add_done_callback(tell)
        return future

    def retrieve_result_callback(self, out: Any) -> Any:
        """Return a batch's result, or raise its error."""
        if isinstance(out, BaseException):
            raise out
        return super().retrieve_result_callback(out)


def thread_count(scheduler: str) -> int:
    """Trials that the workers of a scheduler run at a time: one a thread.

    Raises
    ------
    RequestError : where no such scheduler, or no worker of it, is found in time.
    """
    try:
        threads: int = LoopRunner().run_sync(_count_threads, scheduler)
    except Exception as error:  # also what it makes of another service's answer
        raise RequestError(
            f"scheduler '{scheduler}' cannot be reached ({describe(error)}); start one with 'dask scheduler' and give "
            "its address, like tcp://host:8786."
        ) from None
    if not threads:
        raise RequestError(f"scheduler '{scheduler}' has no worker; start some with 'dask worker {scheduler}'.")
    return threads


async def _count_threads(scheduler: str) -> int:
    """Threads of all workers, as soon as there are any; 0 where none comes within CONNECT seconds."""
    security = Security().get_connection_args("client")
    async with rpc(scheduler, timeout=CONNECT, connection_args=security) as remote:
        for _ in range(max(int(CONNECT), 1)):
            known = await asyncio.wait_for(remote.identity(), 2 * CONNECT)
            if known["workers"]:
                break
            await asyncio.sleep(1.0)
    return sum(worker["nthreads"] for worker in known["workers"].values())


def run_there(tasks: Sequence[Task], scheduler: str, timeout: float) -> Generator[Report]:
    """Run tasks on the workers of a scheduler and yield their reports in the order in which they end.

    Trials of a worker that dies run again on the others.

    Raises
    ------
    RequestError : where the scheduler is not found, or a worker has other code than this machine.
    IncompleteError : where the cluster is lost, or for too long nothing comes from it.
    """
    patience = START + 2 * (timeout + GRACE)
    thread_count(scheduler)
    with Client(scheduler, timeout=CONNECT, set_as_default=False) as client:
        parallel = joblib.Parallel(
            backend=Backend(client=client), return_as="generator_unordered", batch_size=1, timeout=patience
        )
        try:
            yield from parallel(joblib.delayed(run_apart)(pack(task)) for task in tasks)
        except RequestError:
            raise
        except (TimeoutError, multiprocessing.TimeoutError):
            raise IncompleteError(f"nothing came from the workers of '{scheduler}' for {patience:g} s") from None
        except Exception as error:
            raise IncompleteError(f"the workers of '{scheduler}' gave up ({describe(error)})") from None
