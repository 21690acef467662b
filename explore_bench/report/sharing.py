"""What of a large report takes longest, shared out among the processors: reading shards, and drawing.

What a process could not do, for want of memory, say, is done here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from explore_bench.records.encoding import TrialRecord
from explore_bench.records.store import Store, in_order_of_table
from explore_bench.report.drawing import draw, postponing
from explore_bench.runs.workers.local import default_workers, results_of
from explore_bench.runs.workers.process import READY, Answer, Job, LostError

LARGE = 2000
"""Trials from which on a report is large: to start the processes takes as long as reading so many."""

SHARDS = 200
"""How many are read before what was kept of them is sent."""

SECONDS = 600.0
"""Limit of a job."""


def shared_records(store: Store, keep: Callable[[TrialRecord], Any]) -> tuple[list[Any], int]:
    """What `Store.records` gives; `keep` is a function of a module."""
    shards = store.shards()
    if len(shards) < LARGE:
        return store.records(keep)
    parts = [shards[first : first + SHARDS] for first in range(0, len(shards), SHARDS)]
    found, stale = [], 0
    for own, more, damaged in _done(_read, [(store.folder, part, keep) for part in parts]):
        found += own
        stale += more
        store.damaged += damaged
    return in_order_of_table(found), stale


@contextmanager
def figures_aside(trials: int, make: Callable[[], list[Path]]) -> Iterator[list[Path]]:
    """Make figures and give their files, which are there after the block: those of many trials are drawn beside it."""
    if trials < LARGE:
        yield make()
        return
    with postponing() as postponed:
        files = make()
    with ThreadPoolExecutor(1) as waiting:
        drawn = waiting.submit(_done, _draw, postponed)
        yield files
        drawn.result()


def _done(function: Callable[..., Iterator[Any]], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
    """What a function gives for each of some arguments, in their order."""
    found = dict(results_of([Job(function, own, SECONDS) for own in arguments], default_workers()))
    return [_here(function, own) if isinstance(found[i], LostError) else found[i] for i, own in enumerate(arguments)]


def _here(function: Callable[..., Iterator[Any]], arguments: tuple[Any, ...]) -> Any:
    """Last thing that a function of a job gives, in this process."""
    *_, answer = function(*arguments, Path())
    return answer.value


def _read(folder: Path, shards: Sequence[Path], keep: Callable[[TrialRecord], Any], _: Path) -> Iterator[Any]:
    yield READY
    store = Store(folder)
    found, stale = store.part(shards, keep)
    yield Answer((found, stale, store.damaged))


def _draw(pickled: bytes, stem: Path, _: Path) -> Iterator[Any]:
    yield READY
    draw(pickled, stem)
    yield Answer(None)
