"""A process that does jobs for whoever asks, one after the other: trials, and a look at a strategy before them.

It has a main thread of its own, which time limits need, numerical settings, which libraries read when they are
imported, and a limit of memory. Whoever asks can kill it: a job that dies or cannot be interrupted takes nothing along.
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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from explore_bench.errors import RequestError, describe
from explore_bench.runs.workers import GRACE, SHIPPED, THREAD_SETTINGS

START = 300.0
"""Seconds that a process may take to import and compile before its job begins."""

PARENT_SECONDS = 1.0
"""How often a process looks whether its parent is still there."""

READY = "ready"


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
    """

    function: Callable[..., Iterator[Any]]
    arguments: tuple[Any, ...]
    seconds: float
    owner: str = ""


@dataclass(frozen=True, slots=True)
class Answer:
    """What came of a job, and whether its process must not be given another."""

    value: Any
    last: bool = False


def surroundings() -> tuple[object, ...]:
    """What a process that is started now begins with: its folder, where it imports from, settings, and shipped code."""
    root = Path(__file__).parents[3]
    code = (file for package in SHIPPED for file in (root / package).rglob("*.py"))
    files = {file: file.stat().st_mtime_ns for file in code if file.is_file()}  # editors leave links to nothing
    return Path.cwd(), tuple(sys.path), dict(os.environ), files


class Process:
    """A child process of an owner. `pipe` can be waited for; at `deadline`, on the monotonic clock, it is too late."""

    def __init__(self, owner: str = "") -> None:
        self.owner, self.surroundings = owner, surroundings()
        self.pipe, theirs = multiprocessing.Pipe()
        self.deadline, self._limit, self._ready = 0.0, 0.0, False
        self._folder = tempfile.TemporaryDirectory(prefix="explore-bench-", ignore_cleanup_errors=True)
        code = f"from {__name__} import serve; serve()"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", code, str(theirs.fileno()), self._folder.name],
            pass_fds=[theirs.fileno()],
            env=os.environ | THREAD_SETTINGS | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=subprocess.DEVNULL,
            stdout=2,  # what is printed there is not for those who read ours
            start_new_session=True,  # Ctrl-C is for the one who asks
        )
        theirs.close()

    def begin(self, job: Job) -> None:
        """Let it begin a job; whether it could shows when the answer is taken."""
        self.deadline, self._limit, self._ready = time.monotonic() + START, job.seconds, False
        with contextlib.suppress(OSError):
            self.pipe.send((job.function, job.arguments))

    def take(self) -> Answer | None:
        """Answer to the job, as soon as there is one.

        Raises
        ------
        LostError : where none will come any more; ProcessDiedError where the process has ended.
        RequestError : that of the job.
        """
        if not self.pipe.poll():
            if time.monotonic() < self.deadline:
                return None
            late = f"took longer than the {self._limit:g} s allowed and could not be interrupted"
            raise LostError(late if self._ready else f"was not begun within {START:g} s")
        try:
            found = self.pipe.recv()
        except (EOFError, OSError):
            raise ProcessDiedError("its worker process died (killed, or out of memory)") from None
        except Exception as error:
            raise LostError(f"its worker process answered what cannot be read ({describe(error)})") from None
        if isinstance(found, RequestError | LostError):
            raise found
        if isinstance(found, Answer):
            return found
        self.deadline, self._ready = time.monotonic() + self._limit + GRACE, True
        return None

    def end(self) -> None:
        """Kill the process and all that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self.pipe.close()
        self._folder.cleanup()


def serve() -> None:
    """Do the jobs that come through a pipe until it is closed: the main function of a Process."""
    descriptor, folder = int(sys.argv[1]), Path(sys.argv[2])
    threading.Thread(target=_end_with, args=(os.getppid(), folder), daemon=True).start()
    multiprocessing.current_process().name = "Process"
    pipe = Connection(descriptor)
    with contextlib.suppress(EOFError, OSError):
        while True:
            function, arguments = pipe.recv()
            try:
                for found in function(*arguments, folder):
                    pipe.send(found)
            except RequestError as error:
                pipe.send(error)
            except OSError:
                raise
            except BaseException as error:
                pipe.send(LostError(f"its worker process broke off ({describe(error)})"))
    shutil.rmtree(folder, ignore_errors=True)


def _end_with(parent: int, folder: Path) -> None:
    """End this process, whatever it does, when its parent has ended, however that came about."""
    while os.getppid() == parent:
        time.sleep(PARENT_SECONDS)
    shutil.rmtree(folder, ignore_errors=True)
    os.killpg(0, signal.SIGKILL)
