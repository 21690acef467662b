"""Merges the results folders of several machines, and refuses records that disagree."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from explore_bench.analysis.tables import refuse_shared_names, write_trials
from explore_bench.analysis.times import read_times, write_time_rows
from explore_bench.errors import RequestError
from explore_bench.records.encoding import comparable
from explore_bench.records.store import Store
from explore_bench.trial.spec import TrialSpec


@dataclass(frozen=True)
class Merged:
    """How many trials were added, how many the folder had, and how many it now has of code that is not that here."""

    added: int
    known: int
    stale: int


def merge(sources: Sequence[Path], into: Path) -> Merged:
    """Add the records of results folders to those of another, and write its `trials.csv` and `times.csv`.

    Everything is read and compared before anything is written. Of a trial that failed for want of time, memory or
    disk in one folder, the record of another counts; otherwise the first of equal ones is kept, that of `into` before
    all others.

    Raises
    ------
    RequestError : where a folder is given twice, holds no records, damaged ones or ones of another protocol, or two
        folders disagree about a trial.
    """
    _refuse_repeated([*sources, into])
    target, stores = Store(into), [Store(folder) for folder in sources]
    protocol = (target if target.exists() else stores[0]).protocol()
    for store in stores:
        store.require(protocol)
    gathered = Gathered()
    if target.exists():
        gathered.add(target)
    before = set(gathered.shards)
    for store in stores:
        if not gathered.add(store):
            raise RequestError(f"results folder '{store.folder}' holds no trials; leave it out.")
    refuse_shared_names(gathered.specs.values())
    times = [read_times(store.folder) for store in (*stores, target)]
    target.adopt(protocol)
    for key, path in gathered.shards.items():
        if path.parent != target.runs:
            target.keep(key, path.read_bytes())
    write_time_rows(target.folder, times)
    write_trials(target)
    shards = gathered.shards.keys()
    return Merged(len(shards - before), len(before), len(shards - gathered.specs.keys()))


@dataclass
class Gathered:
    """One shard a trial, out of several folders.

    Attributes
    ----------
    shards : file by key.
    specs : specification by key, of those that are current.
    """

    shards: dict[str, Path] = field(default_factory=dict)
    specs: dict[str, TrialSpec] = field(default_factory=dict)

    def add(self, store: Store) -> int:
        """Add the shards of a folder and return how many it has.

        Raises
        ------
        RequestError : where one is damaged, or another record of its trial disagrees.
        """
        count = 0
        for path, record in store.survey():
            count += 1
            key = path.stem
            self.shards[key] = _agreed(self.shards[key], path) if key in self.shards else path
            if record is not None:
                self.specs.setdefault(key, record.spec)
        return count


def _agreed(kept: Path, other: Path) -> Path:
    """Return the file to be kept of two of one key."""
    (content, transient), (second, second_transient) = comparable(kept), comparable(other)
    if transient or second_transient:
        return kept if second_transient else other
    if content != second:
        raise RequestError(f"'{kept}' and '{other}' disagree about the same trial; delete one of them and merge again.")
    return kept


def _refuse_repeated(folders: Iterable[Path]) -> None:
    seen: set[Path] = set()
    for folder in folders:
        if folder.resolve() in seen:
            raise RequestError(f"results folder '{folder}' is given twice; name each folder, and --results, once.")
        seen.add(folder.resolve())
