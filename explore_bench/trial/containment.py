"""What keeps a strategy from stopping the others: a time limit, an end of forked processes, and whose error it was."""

from __future__ import annotations

import math
import os
import signal
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

import numpy as np

REMINDER = 5.0
"""Seconds after which a strategy that swallowed the first OutOfTime is sent another."""

LIBRARIES = ("numpy", "scipy", "numba", "gtsam")
"""Packages that do what they are asked for: an error in them is that of whoever called."""


class OutOfTime(BaseException):
    """A trial took longer than it may; no `except Exception` of a strategy holds it."""


@dataclass
class Signals:
    """What this process was told meanwhile, whatever became of the exception that said it.

    A strategy may swallow that one, compiled code turns it into another, and a strategy may raise one of its own.

    Attributes
    ----------
    expired : the time is over.
    interrupted : somebody wants this process to end, by Ctrl-C or SIGTERM.
    """

    expired: bool = False
    interrupted: bool = False


@contextmanager
def one_process() -> Iterator[None]:
    """End a process that was forked off in the block, lest it run the rest of the benchmark a second time."""
    own = os.getpid()
    try:
        yield
    finally:
        if os.getpid() != own:
            os._exit(0)


@contextmanager
def time_limit(seconds: float | None) -> Iterator[Signals]:
    """Raise OutOfTime in the block after some seconds, where the platform has timers and this is the main thread.

    Yields the signals that came so far.
    """
    told = Signals()
    if threading.current_thread() is not threading.main_thread():
        yield told
        return

    def expire(number: int, frame: FrameType | None) -> None:
        told.expired = True
        raise OutOfTime

    def interrupt(number: int, frame: FrameType | None) -> None:
        told.interrupted = True
        handler = before[number]
        assert callable(handler)
        handler(number, frame)

    before = {int(number): signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    watched = [number for number, handler in before.items() if callable(handler)]
    limited = bool(seconds and math.isfinite(seconds))
    alarm = signal.signal(signal.SIGALRM, expire) if limited else None
    for number in watched:
        signal.signal(number, interrupt)
    if limited:
        signal.setitimer(signal.ITIMER_REAL, seconds or 0.0, REMINDER)
    try:
        yield told
    finally:
        if limited:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, alarm)
        for number in watched:
            signal.signal(number, before[number])


def is_breakdown(error: BaseException) -> bool:
    """Whether an error is one of the arithmetic of the robot's SLAM, whoever asked for what it computed."""
    if not isinstance(error, ArithmeticError | np.linalg.LinAlgError | RuntimeError):
        return False
    modules = [frame.f_globals.get("__name__", "") for frame, _ in traceback.walk_tb(error.__traceback__)]
    own = [name for name in modules if name.partition(".")[0] not in LIBRARIES]
    return bool(own) and own[-1].startswith("explore_bench.robot.")
