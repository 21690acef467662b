"""Workers of a dask cluster, through joblib: the only importer of distributed, imported with that backend only."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import joblib
from distributed import Client
from joblib._dask import DaskDistributedBackend

from explore_bench.errors import RequestError
from explore_bench.strategy import describe
from explore_bench.workers import GRACE, IncompleteError
from explore_bench.workers.parcel import pack
from explore_bench.workers.process import START, run_apart
from explore_bench.workers.task import Report, Task

CONNECT = 15.0
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


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """Client of a scheduler that has a worker.

    Raises
    ------
    RequestError : where no such scheduler, or no worker of it, is found within CONNECT seconds.
    """
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong is said in one sentence
    try:
        client = Client(scheduler, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise RequestError(
            f"scheduler '{scheduler}' cannot be reached ({describe(error)}); start one with 'dask scheduler' and give "
            "its address, like tcp://host:8786."
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECT)
        except TimeoutError:
            raise RequestError(
                f"scheduler '{scheduler}' has no worker; start some with 'dask worker {scheduler}'."
            ) from None
        yield client


def thread_count(scheduler: str) -> int:
    """Trials that the workers of a scheduler run at a time: one a thread."""
    with connected(scheduler) as client:
        return sum(client.nthreads().values())


def run_there(tasks: Sequence[Task], scheduler: str, timeout: float) -> Generator[Report]:
    """Run tasks on the workers of a scheduler and yield their reports in the order in which they end.

    A worker that dies is replaced by others, which run its trials again.

    Raises
    ------
    RequestError : where the scheduler is not found, or a worker has other code than this machine.
    IncompleteError : where the cluster is lost, or for too long nothing comes from it.
    """
    patience = START + 2 * (timeout + GRACE)
    with connected(scheduler) as client:
        parallel = joblib.Parallel(
            backend=Backend(client=client), return_as="generator_unordered", batch_size=1, timeout=patience
        )
        try:
            yield from parallel(joblib.delayed(run_apart)(pack(task)) for task in tasks)
        except (GeneratorExit, RequestError):
            raise
        except TimeoutError:
            raise IncompleteError(f"nothing came from the workers of '{scheduler}' for {patience:g} s") from None
        except Exception as error:
            raise IncompleteError(f"the workers of '{scheduler}' gave up ({describe(error)})") from None
