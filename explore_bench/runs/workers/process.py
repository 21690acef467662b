"""A process that runs trials for a worker of a cluster, as the worker processes of one machine do.

Time limits need the main thread of a process, seeds and compiled code one thread at a time, numerical libraries
their settings before they are imported: a worker's thread offers none of it. And a trial that kills its process, or
cannot be interrupted, takes no worker of the cluster with it.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from explore_bench.errors import RequestError
from explore_bench.runs.workers import GRACE, THREAD_SETTINGS
from explore_bench.runs.workers.parcel import OtherCodeError, Parcel, unpack
from explore_bench.runs.workers.task import PROCESS_DIED, Report, lost, perform, warm_up

START = 300.0
"""Seconds that a process may take to import and compile before its first trial."""

READY = "ready"

_own = threading.local()


class ProcessDiedError(RuntimeError):
    """The process is no more."""


class TrialProcess:
    """A child process that runs one trial after the other."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="explore-bench-")
        self._pipe, theirs = multiprocessing.Pipe()
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-c",
                f"from {__name__} import serve; serve()",
                str(theirs.fileno()),
                self._folder.name,
            ],
            pass_fds=[theirs.fileno()],
            env=os.environ | THREAD_SETTINGS,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()

    def run(self, parcel: Parcel) -> Report:
        """Run a trial.

        Raises
        ------
        ProcessDiedError : when the process ended on the way.
        TimeoutError : when the trial could not be interrupted.
        RequestError : when it cannot be run there.
        """
        limit = parcel.task.timeout
        try:
            self._pipe.send(parcel)
            answer = self._receive(START, f"was not begun within {START:g} s")
            if answer == READY:
                answer = self._receive(
                    limit + GRACE, f"took longer than the {limit:g} s allowed and was not interrupted"
                )
        except (EOFError, ConnectionError):
            raise ProcessDiedError from None
        if isinstance(answer, RequestError):
            raise answer
        assert isinstance(answer, Report)
        return answer

    def _receive(self, seconds: float, otherwise: str) -> Any:
        if not self._pipe.poll(seconds):
            raise TimeoutError(otherwise)
        return self._pipe.recv()

    def end(self) -> None:
        """Kill the process and all that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._pipe.close()
        self._folder.cleanup()


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
    try:
        return _run_once(parcel)
    except ProcessDiedError:
        return lost(parcel.task, PROCESS_DIED)


def _run_once(parcel: Parcel) -> Report:
    """Run a task in this thread's process; whatever goes wrong, the next task has another."""
    process = _own.process = getattr(_own, "process", None) or TrialProcess()
    try:
        return process.run(parcel)
    except BaseException as error:
        _own.process = None
        process.end()
        if isinstance(error, TimeoutError):
            return lost(parcel.task, str(error))
        raise


def serve() -> None:
    """Run trials that come through a pipe until it is closed: the main function of a trial process."""
    descriptor, folder = int(sys.argv[1]), Path(sys.argv[2])
    threading.Thread(target=_end_with, args=(os.getppid(), folder), daemon=True).start()
    pipe = Connection(descriptor)
    warm = False
    with contextlib.suppress(EOFError, ConnectionError):
        while True:
            parcel = pipe.recv()
            try:
                here = unpack(parcel, folder)
                if not warm:
                    warm_up(here)
                    warm = True
                pipe.send(READY)
                pipe.send(perform(parcel.task, here))
            except RequestError as error:
                pipe.send(error)
    shutil.rmtree(folder, ignore_errors=True)


def _end_with(parent: int, folder: Path) -> None:
    """End this process, whatever it does, when its parent has ended."""
    while os.getppid() == parent:
        time.sleep(1.0)
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)
