"""Child processes that begin with all imported and compiled: forks of a process that runs nothing but this project.

To import takes half a second of a processor, to load what is compiled another, a fork some milliseconds. Nobody's code
was run in what is forked, so that a child is as good as a new interpreter; it gets another state of chance.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import multiprocessing
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from explore_bench.runs.workers import SHIPPED, THREAD_SETTINGS

PATIENCE = 5.0
"""Seconds within which a server that is not busy answers; one that does not, or is stopped, is killed."""

Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function of a module, and its arguments."""


def shipped_code() -> dict[Path, int]:
    """Every file of the shipped code, and when it was changed [ns]."""
    root = Path(__file__).parents[3]
    code = (file for package in SHIPPED for file in (root / package).rglob("*.py"))
    return {file: file.stat().st_mtime_ns for file in code if file.is_file()}  # editors leave links to nothing


def fork(
    function: Callable[..., Any],
    *arguments: Any,
    descriptors: Sequence[int] = (),
    output: int = 2,
    preparation: Call | None = None,
    hash_seed: str | None = None,
) -> Child:
    """Have a child process call a function of a module, in this process's folder and with its import path.

    It leads a process group of its own, and reads nothing.

    Parameters
    ----------
    arguments, descriptors : with which it is called: what can be pickled, then the numbers that files open here have
        there.
    output : file open here that is its standard output.
    preparation : of this project alone; done once before children are forked, which find it done.
    hash_seed : PYTHONHASHSEED, where it is to be another one than that of this process.
    """
    request = (pickle.dumps((function, arguments)), pickle.dumps(preparation), str(Path.cwd()), list(sys.path))
    for last in (False, True):
        server = _server(hash_seed)
        try:
            return Child(server, server.ask(request, (output, 2, *descriptors)))
        except OSError:  # somebody killed it
            server.end()
            if last:
                raise
    raise AssertionError


class Child:
    """A forked process. Like a server, it is of the process that asked for it."""

    def __init__(self, server: ForkServer, ticket: int) -> None:
        self._server, self._ticket, self._pid = server, ticket, 0
        self._killed = False
        self._code: int | None = None

    @property
    def pid(self) -> int:
        """Its number.

        Raises
        ------
        OSError, EOFError : where its server has not forked it in time, or is gone before it did.
        """
        self._pid = self._pid or self._server.answer(self._ticket)
        return self._pid

    def kill(self) -> int | None:
        """Kill it and all of its group, and return its exit code, like Popen's, where that can be known.

        If it was not forked yet, it never will be. To kill it again does nothing.
        """
        if self._killed:
            return self._code
        self._killed = True
        try:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self.pid, signal.SIGKILL)
            self._code = self._server.answer(self._server.ask(self.pid))
        except (OSError, EOFError):  # the server hangs, or was killed
            self._server.end()
        return self._code


class ForkServer:
    """The process that is forked, and how to talk to it; threads may do so at the same time."""

    def __init__(self, hash_seed: str | None) -> None:
        self._owner, self._environment, self._code = os.getpid(), dict(os.environ), shipped_code()
        self._lock = threading.Lock()
        self._tickets, self._answers = 0, dict[int, int]()
        self._pipe, theirs = multiprocessing.Pipe()
        self._socket = _socket_of(self._pipe)
        chosen = {} if hash_seed is None else {"PYTHONHASHSEED": hash_seed}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()", str(theirs.fileno())],
            pass_fds=[theirs.fileno()],
            env=os.environ | THREAD_SETTINGS | chosen | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            stdin=subprocess.DEVNULL,
            stdout=2,
            start_new_session=True,  # Ctrl-C is for the one who asks
        )
        self._able = True
        theirs.close()

    def ask(self, request: object, descriptors: Sequence[int] = ()) -> int:
        """Ask for a fork, or for the end of a child; returns the ticket of the answer.

        Raises
        ------
        OSError : where it is gone.
        """
        with self._lock:
            self._tickets += 1
            socket.send_fds(self._socket, [b" "], descriptors)
            self._pipe.send((self._tickets, request))
            return self._tickets

    def answer(self, ticket: int) -> int:
        """Answer to what was asked.

        Raises
        ------
        TimeoutError : where it does not come in time.
        OSError, EOFError : where it will not come any more.
        """
        end = time.monotonic() + PATIENCE
        with self._lock:
            while ticket not in self._answers:
                while not self._pipe.poll(0.1):
                    if time.monotonic() > end or not self._runs():
                        raise TimeoutError
                self._receive()
            return self._answers.pop(ticket)

    def _receive(self) -> None:
        ticket, answer = self._pipe.recv()
        self._answers[ticket] = answer

    def fits(self) -> bool:
        """Whether it can fork, and what it forks is what would be started now."""
        with self._lock:
            able = self._owner == os.getpid() and self._runs()
        return able and self._environment == os.environ and self._code == shipped_code()

    def _runs(self) -> bool:
        """Whether it has not ended and nobody has stopped it."""
        if self._able:
            changed, _ = os.waitpid(self._process.pid, os.WUNTRACED | os.WNOHANG)
            self._able = not changed
        return self._able

    def end(self) -> None:
        """Kill it; its children go on, and end with this process."""
        with self._lock:
            self._able = False
            if self._owner == os.getpid():
                self._process.kill()
                self._process.wait()
                with contextlib.suppress(OSError, EOFError):  # what it forked can still be killed
                    while self._pipe.poll():
                        self._receive()
            self._socket.close()
            self._pipe.close()


_servers: dict[str | None, ForkServer] = {}
_lock = threading.Lock()


def _server(hash_seed: str | None) -> ForkServer:
    """The server of this process, if it was started where things are as they are now; else a new one."""
    with _lock:
        known = _servers.get(hash_seed)
        if known and not known.fits():
            known.end()
            known = None
        server = _servers[hash_seed] = known or ForkServer(hash_seed)
        return server


@atexit.register
def end_servers() -> None:
    """End the servers of this process."""
    while _servers:
        _servers.popitem()[1].end()


def serve() -> None:
    """Fork as often as is asked, until nobody is left who could: the main function of a ForkServer, and of a child."""
    pipe = Connection(int(sys.argv[1]))
    child = None
    with contextlib.suppress(OSError, EOFError), _socket_of(pipe) as asking:
        child = _fork_as_asked(pipe, asking)
    if child:
        pipe.close()
        (call, folder, imports), (output, errors, *descriptors) = child
        _settle(folder, imports, output, errors)
        function, arguments = pickle.loads(call)
        function(*arguments, *descriptors)


def _fork_as_asked(pipe: Connection, asking: socket.socket) -> tuple[tuple[bytes, str, list[str]], list[int]]:
    """Fork again and again; returns in each child alone what it shall do, where, and with which files.

    Raises
    ------
    OSError, EOFError : where nobody asks any more.
    """
    prepared = set[bytes]()
    while True:
        mark, descriptors, *_ = socket.recv_fds(asking, 1, 16)
        if not mark:
            raise EOFError
        ticket, request = pipe.recv()
        if isinstance(request, int):
            _, status = os.waitpid(request, 0)
            pipe.send((ticket, os.waitstatus_to_exitcode(status)))
            continue
        call, preparation, folder, imports = request
        if preparation not in prepared:
            prepared.add(preparation)
            _prepare(preparation)
        with warnings.catch_warnings():  # of other threads: there is but that of a library's memory allocator
            warnings.simplefilter("ignore", DeprecationWarning)
            pid = os.fork()
        if not pid:
            return (call, folder, imports), descriptors
        with contextlib.suppress(OSError):  # as it does itself: whoever of the two is first
            os.setpgid(pid, pid)
        pipe.send((ticket, pid))
        for descriptor in descriptors:
            os.close(descriptor)


def _prepare(preparation: bytes) -> None:
    """Do what children are to find done; what goes wrong goes wrong in them, too, and is told there."""
    with contextlib.suppress(Exception):
        call: Call | None = pickle.loads(preparation)
        if call:
            function, arguments = call
            function(*arguments)


def _settle(folder: str, imports: list[str], output: int, errors: int) -> None:
    """Make a forked process one of its own."""
    os.setpgid(0, 0)
    for here, standard in ((output, 1), (errors, 2)):
        os.dup2(here, standard)
        os.close(here)
    os.chdir(folder)
    sys.path[:] = imports
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, imports))
    importlib.invalidate_caches()
    np.random.seed()  # noqa: NPY002  (the global one; the standard library's does so by itself)


def _socket_of(pipe: Connection) -> socket.socket:
    """The same socket, for open files."""
    return socket.socket(fileno=os.dup(pipe.fileno()))
