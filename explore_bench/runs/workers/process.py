"""A process that does jobs for whoever asks, one after the other: trials, and a look at a strategy before them.

It has a main thread of its own, which time limits need. Whoever asks can kill it: a job that dies or cannot be
interrupted takes nothing along.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import select
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from explore_bench.errors import RequestError, describe
from explore_bench.runs.workers import GRACE
from explore_bench.runs.workers.fork_server import LOOK, Call, fork

START = 300.0
"""Seconds that a process may take to import and compile before its job begins."""

UP, READY = "up", "ready"


class LostError(RuntimeError):
    """Nothing is left of a job but the reason."""


class ProcessDiedError(LostError):
    """The process that did the job ended on the way."""


@dataclass(frozen=True, slots=True)
class Job:
    """Something for a process to do.

    Attributes
    ----------
    function : of a module, called with the arguments and a folder for files; what it gives in turn is READY, once what
        takes time only once is done, and an Answer.
    seconds : that it may take from then on.
    owner : whose code it runs: no process works for two.
    preparation : of this project, what takes time only once, where a new process is to begin with it done.
    hash_seed : see `fork`.
    """

    function: Callable[..., Iterator[Any]]
    arguments: tuple[Any, ...]
    seconds: float
    owner: str = ""
    preparation: Call | None = None
    hash_seed: str | None = None


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of a job, and whether its process must not be given another."""

    value: Any
    last: bool = False


class Process:
    """A child process for an owner's jobs, prepared for the first of them.

    `pipe` can be waited for; at `deadline`, on the monotonic clock, it is too late.
    """

    def __init__(self, first: Job) -> None:
        self.owner = first.owner
        self._up, self._job = False, first
        self.pipe, theirs = multiprocessing.Pipe()
        self.deadline, self._limit, self._ready = 0.0, 0.0, False
        self._folder = tempfile.TemporaryDirectory(prefix="explore-bench-", ignore_cleanup_errors=True)
        preparation = _prepare, (first.function, first.preparation)
        with theirs:
            self._child = fork(
                serve,
                self._folder.name,
                descriptors=[theirs.fileno()],
                preparation=preparation,
                hash_seed=first.hash_seed,
            )

    def begin(self, job: Job) -> None:
        """Let it begin a job as soon as it is up; whether it could shows when the answer is taken."""
        self.deadline, self._limit, self._ready = time.monotonic() + START, job.seconds, False
        self._job = job
        if self._up:
            self._send()

    def _send(self) -> None:
        with contextlib.suppress(OSError):
            self.pipe.send((self._job.function, self._job.arguments))

    @property
    def patience(self) -> float:
        """Seconds for which its pipe can be waited for before an answer is taken, or looked for."""
        left = max(self.deadline - time.monotonic(), 0.0)
        return left if self._up else min(left, LOOK)

    def take(self) -> Answer | None:
        """Answer to the job, as soon as there is one.

        Raises
        ------
        LostError : where none will come any more; ProcessDiedError where the process has ended.
        RequestError : that of the job.
        """
        if not self.pipe.poll():
            if time.monotonic() < self.deadline:
                if not self._up:
                    self._child.look()
                return None
            late = f"took longer than the {self._limit:g} s allowed and could not be interrupted"
            raise LostError(late if self._ready else f"was not begun within {START:g} s")
        try:
            found = self.pipe.recv()
        except (EOFError, OSError):
            self._child.begun()
            why = self._child.error
            raise ProcessDiedError(
                f"its worker process could not be started ({why})"
                if why
                else "its worker process died (killed, or out of memory)"
            ) from None
        except Exception as error:
            raise LostError(f"its worker process answered what cannot be read ({describe(error)})") from None
        if isinstance(found, RequestError | LostError):
            raise found
        if isinstance(found, Answer):
            return found
        if found == UP:  # before nobody would have read
            self._up = True
            self._send()
            return None
        self.deadline, self._ready = time.monotonic() + self._limit + GRACE, True
        return None

    def end(self) -> None:
        """Kill the process and all that it started."""
        self._child.kill()
        self.pipe.close()
        self._folder.cleanup()


def _prepare(function: Callable[..., Any], preparation: Call | None) -> None:
    """Do a job's preparation; the module of its function is imported by now."""
    if preparation:
        prepare, arguments = preparation
        prepare(*arguments)


def serve(folder: str, descriptor: int) -> None:
    """Do the jobs that come through a pipe until it is closed: the main function of a Process."""
    place = Path(folder)
    threading.Thread(target=_end_with, args=(descriptor, place), daemon=True).start()
    multiprocessing.current_process().name = "Process"
    pipe = Connection(descriptor)
    with contextlib.suppress(EOFError, OSError):
        pipe.send(UP)
        while True:
            function, arguments = pipe.recv()
            try:
                for found in function(*arguments, place):
                    pipe.send(found)
            except RequestError as error:
                pipe.send(error)
            except OSError:
                raise
            except BaseException as error:
                pipe.send(LostError(f"its worker process broke off ({describe(error)})"))
    shutil.rmtree(place, ignore_errors=True)


def _end_with(descriptor: int, folder: Path) -> None:
    """End this process, whatever it does, when nobody is left at the other end of its pipe, however that came about."""
    end = select.poll()
    end.register(descriptor, 0)  # that it was hung up is told without being asked for
    end.poll()
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)
