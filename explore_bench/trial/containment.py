"""What keeps a strategy from stopping the others: a time limit, and an end of processes that it forks."""

from __future__ import annotations

import math
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

REMINDER = 5.0
"""Seconds after which a strategy that swallowed the first OutOfTime is sent another."""


class OutOfTime(BaseException):
    """A trial took longer than it may; no `except Exception` of a strategy holds it."""


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
def time_limit(seconds: float | None) -> Iterator[None]:
    """Raise OutOfTime in the block after some seconds, where the platform has timers and this is the main thread."""
    if not seconds or not math.isfinite(seconds) or threading.current_thread() is not threading.main_thread():
        yield
        return

    def expire(signum: int, frame: object) -> None:
        raise OutOfTime

    previous = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, seconds, REMINDER)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
