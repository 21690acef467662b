"""How much memory a process may take: beyond it an allocation fails there, before the machine has none left."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LEAST = 2.0
"""A trial has at least so much [GiB], however many run at a time: libraries alone take a quarter of it."""

GROUP = Path("/sys/fs/cgroup/memory.max")
"""Where Linux says what a container may take."""


def share_of_memory(processes: int) -> float:
    """Memory [GiB] for each of so many processes: what this machine, or the container, has."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    with contextlib.suppress(OSError, ValueError):  # there is no such file, or it says "max"
        total = min(total, int(GROUP.read_text()))
    return max(total / 2**30 / processes, LEAST)


@contextmanager
def memory_limit(gibibytes: float) -> Iterator[None]:
    """Let this process take no more memory of its own than that in the block, where the system can be told so.

    Linux counts what a process allocates, not the files and libraries that it maps.
    """
    try:
        import resource
    except ImportError:  # Windows
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    wanted = int(gibibytes * 2**30)
    resource.setrlimit(resource.RLIMIT_DATA, (wanted if hard == resource.RLIM_INFINITY else min(wanted, hard), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
