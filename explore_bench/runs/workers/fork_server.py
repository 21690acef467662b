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
import select
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

PATIENCE = 1.0
"""Seconds for which the end of what was killed is waited for: its server may be busy."""

LOOK = 0.1
"""How often it is looked whether a server that is waited for runs [s]."""

LEFT_ALONE = 2.0
"""Seconds that children have to end when the one who asked for them is gone."""

FORK, FINISH = b"+", b"."

Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function of a module, and its arguments."""


def shipped_code() -> dict[Path, int]:
    """Every file of the shipped code, and when it was changed [ns]."""
    root = Path(__file__).parents[3]
    code = (file for package in SHIPPED for file in (root / package).rglob("*.py"))
    return {file: file.stat().st_mtime_ns for file in code if file.is_file()}  # editors leave links to nothing


def another_hash_seed() -> str:
    """A PYTHONHASHSEED under which sets and dictionaries of text have another order than here."""
    return "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"


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
    status, theirs = multiprocessing.Pipe(duplex=False)
    with theirs:
        for last in (False, True):
            server = _server(hash_seed)
            try:
                server.ask(request, (theirs.fileno(), output, 2, *descriptors))
                return Child(server, status)
            except OSError:  # somebody killed it
                server.end()
                if last:
                    raise
    raise AssertionError


class Child:
    """A forked process, of which its server tells what becomes of it.

    Attributes
    ----------
    pid : its number; None as long as it was not forked.
    code : its exit code, like Popen's; None as long as it goes on, and where nobody is left to tell.
    error : why it could not be forked, in words; None where it could.
    """

    def __init__(self, server: ForkServer, status: Connection) -> None:
        self._server, self._status, self._told = server, status, True
        self.pid: int | None = None
        self.code: int | None = None
        self.error: str | None = None

    def begun(self, seconds: float = 0.0) -> bool:
        """Whether it was forked; waits for that so long."""
        self._hear("pid", seconds)
        return self.pid is not None

    def ended(self, seconds: float = 0.0) -> bool:
        """Whether it has ended and its exit code is known; waits for that so long."""
        self._hear("code", seconds)
        return self.code is not None

    def look(self) -> None:
        """End its server if that does not run any more, so that whoever waits for this child hears of it."""
        if not self._server.runs():
            self._server.end()

    def kill(self) -> int | None:
        """Kill it and all of its group, and return its exit code where that can be known.

        If it was not forked yet, it never will be. To kill it again does nothing.
        """
        if not self._status.closed:
            if self.begun():
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self.pid or 0, signal.SIGKILL)
                self.ended(PATIENCE)
            self._status.close()
        return self.code

    def _hear(self, name: str, seconds: float) -> None:
        """Take in what the server tells, until it has told that or nothing more will come."""
        end = time.monotonic() + seconds
        while self._told and getattr(self, name) is None:
            left = max(end - time.monotonic(), 0.0)
            if self._status.poll(min(left, LOOK)):
                try:
                    what, value = self._status.recv()
                    setattr(self, what, value)
                except (EOFError, OSError):
                    self._told = False
            elif left == 0.0 or not self._server.runs():
                return


class ForkServer:
    """The process that is forked, of the process that started it; threads may ask at the same time."""

    def __init__(self, hash_seed: str | None) -> None:
        self._environment, self._code = dict(os.environ), shipped_code()
        self._lock, self._able = threading.Lock(), True
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
        theirs.close()

    def ask(self, request: object, descriptors: Sequence[int]) -> None:
        """Ask for a child.

        Raises
        ------
        OSError : where the server does not run.
        """
        with self._lock:
            try:
                room = select.poll()
                room.register(self._socket, select.POLLOUT)
                while not room.poll(1000 * LOOK):
                    if not self.runs():
                        raise BrokenPipeError
                socket.send_fds(self._socket, [FORK], descriptors)
                self._pipe.send(request)
            except BaseException:  # it may have half a request
                self._able = False
                raise

    def runs(self) -> bool:
        """Whether it has not ended and nobody has stopped it."""
        if self._able:
            try:
                changed, _ = os.waitpid(self._process.pid, os.WUNTRACED | os.WNOHANG)
            except ChildProcessError:  # somebody else has waited for it
                changed = self._process.pid
            self._able = not changed
        return self._able

    def fits(self) -> bool:
        """Whether what it forks is what would be started now."""
        return self._environment == os.environ and self._code == shipped_code()

    def finish(self) -> None:
        """Let it do what it was asked for and end with the last of its children; nothing more is asked."""
        with self._lock, contextlib.suppress(OSError):
            self._socket.send(FINISH)
        self.close()

    def end(self) -> None:
        """Kill it; its children go on, and end with this process."""
        self._able = False
        self._process.kill()
        self._process.wait()
        self.close()

    def close(self) -> None:
        """Leave it to itself."""
        self._socket.close()
        self._pipe.close()


_servers: dict[str | None, ForkServer] = {}
_finishing: list[ForkServer] = []
_lock = threading.Lock()


def _server(hash_seed: str | None) -> ForkServer:
    """The server of this process, if it was started where things are as they are now; else a new one."""
    with _lock:
        _finishing[:] = [server for server in _finishing if server.runs()]
        known = _servers.get(hash_seed)
        if known and not known.runs():
            known.end()
        elif known and not known.fits():
            known.finish()
            _finishing.append(known)
        elif known:
            return known
        server = _servers[hash_seed] = ForkServer(hash_seed)
        return server


@atexit.register
def end_servers() -> None:
    """End the servers of this process."""
    while _servers:
        _servers.popitem()[1].end()


def _forget_servers() -> None:
    """In a fork of this process: they are not its own, and some thread that is not there may have held the lock."""
    global _lock
    _lock = threading.Lock()
    _finishing.clear()
    while _servers:
        _servers.popitem()[1].close()


os.register_at_fork(after_in_child=_forget_servers)


# In the server, and in what it forks


def serve() -> None:
    """Fork as often as is asked, until nobody is left who could: the main function of a ForkServer, and of a child."""
    pipe = Connection(int(sys.argv[1]))
    child = _fork_as_asked(pipe)
    if child:
        pipe.close()
        (call, _, folder, imports), (output, errors, *descriptors) = child
        _settle(folder, imports, output, errors, descriptors)
        function, arguments = pickle.loads(call)
        function(*arguments, *descriptors)


Request = tuple[bytes, bytes, str, list[str]]


def _fork_as_asked(pipe: Connection) -> tuple[Request, list[int]] | None:
    """Fork again and again; returns in each child what it shall do, and in the server None, when all is done."""
    prepared, children = set[bytes](), dict[int, Connection]()
    signal.signal(signal.SIGCHLD, lambda *_: _reap(children))
    with _socket_of(pipe) as asking:
        while True:
            mark, descriptors, request = _next_request(pipe, asking)
            if request is None:
                _see_off(children, patient=mark == FINISH)
                return None
            preparation = request[1]
            if preparation not in prepared:
                prepared.add(preparation)
                _prepare(preparation)
            status = Connection(descriptors.pop(0), readable=False)
            if _is_awaited(status) and not _fork(status, children):
                return request, descriptors
            for descriptor in descriptors:
                os.close(descriptor)


def _next_request(pipe: Connection, asking: socket.socket) -> tuple[bytes, list[int], Request | None]:
    """Mark, open files and request; None where nothing more is asked for."""
    try:
        mark, descriptors, *_ = socket.recv_fds(asking, 1, 16)
        return mark, descriptors, pipe.recv() if mark == FORK else None
    except (EOFError, OSError):
        return b"", [], None


def _is_awaited(status: Connection) -> bool:
    """Whether somebody would hear what becomes of a child."""
    awaited = select.poll()
    awaited.register(status.fileno(), 0)
    return not awaited.poll(0)


def _fork(status: Connection, children: dict[int, Connection]) -> int:
    """Fork, note the child and tell its number; 0 in the child, −1 where there is none."""
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])  # it may end before it is noted
    try:
        with warnings.catch_warnings():  # of other threads: there is but that of a library's memory allocator
            warnings.simplefilter("ignore", DeprecationWarning)
            pid = os.fork()
        if not pid:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for other in children.values():
                other.close()
            status.close()
            return 0
        children[pid] = status
        with contextlib.suppress(OSError):  # as it does itself: whoever of the two is first
            os.setpgid(pid, pid)
        _tell(status, "pid", pid, or_kill=pid)
        return pid
    except OSError as error:  # there may be no more processes
        _tell(status, "error", str(error))
        status.close()
        return -1
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])


def _tell(status: Connection, what: str, value: object, or_kill: int = 0) -> None:
    """Tell what became of a child; one of which nobody wants to hear is killed."""
    try:
        status.send((what, value))
    except OSError:
        if or_kill:
            os.kill(or_kill, signal.SIGKILL)


def _reap(children: dict[int, Connection]) -> None:
    """Tell the exit codes of those that have ended; when another one ends, it may begin anew on the way."""
    for pid in list(children):
        try:
            ended, code = os.waitpid(pid, os.WNOHANG)
        except ChildProcessError:  # that did it
            continue
        if ended:
            status = children.pop(pid)
            _tell(status, "code", os.waitstatus_to_exitcode(code))
            status.close()


def _see_off(children: dict[int, Connection], *, patient: bool) -> None:
    """Wait for the children's ends; those of which nobody will hear any more are killed after a while."""
    end = time.monotonic() + LEFT_ALONE
    while children and (patient or time.monotonic() < end):
        time.sleep(0.05)
    for pid in list(children):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(pid, signal.SIGKILL)


def _prepare(preparation: bytes) -> None:
    """Do what children are to find done; what goes wrong goes wrong in them, too, and is told there."""
    with contextlib.suppress(Exception):
        call: Call | None = pickle.loads(preparation)
        if call:
            function, arguments = call
            function(*arguments)


def _settle(folder: str, imports: list[str], output: int, errors: int, descriptors: Sequence[int]) -> None:
    """Make a forked process one of its own."""
    with contextlib.suppress(OSError):  # as its server does
        os.setpgid(0, 0)
    for here, standard in ((output, 1), (errors, 2)):
        os.dup2(here, standard)
        os.close(here)
    for descriptor in descriptors:
        os.set_inheritable(descriptor, False)
    os.chdir(folder)
    sys.path[:] = imports
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, imports))
    importlib.invalidate_caches()
    np.random.seed()  # noqa: NPY002  (the global one; the standard library's does so by itself)


def _socket_of(pipe: Connection) -> socket.socket:
    """The same socket, for open files."""
    return socket.socket(fileno=os.dup(pipe.fileno()))
