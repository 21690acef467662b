"""The store: one Parquet shard a trial, written atomically under the key of everything that defines it."""

from __future__ import annotations

import json
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from explore_bench.errors import RequestError, writing
from explore_bench.files import parse_json, read_text, write_whole
from explore_bench.records.encoding import (
    DamagedError,
    Replay,
    TrialRecord,
    encode,
    facts_of,
    opened,
    read_record,
    read_replay,
    record_of,
    renamed,
    spec_from,
    version_words,
)
from explore_bench.records.provenance import forget_code, scenario_digest, spec_values, trial_key
from explore_bench.trial.run import TrialResult
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import SCHEMA_VERSION
from explore_bench.world.kinds import DEFAULT_KIND
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

PROTOCOL_FILE = "protocol.json"
DAMAGED_FOLDER = "damaged"
"""Where shards are moved that are not what was written."""

HALF = re.compile(r"\.[0-9a-f]{32}$")
"""How the name ends of a file that `write_whole` has not put in its place yet."""

ABANDONED_SECONDS = 3600.0
"""A file half written for so long is that of a process that was killed."""

Order = tuple[str, int, float, int]
"""Strategy, training seed (−1: none), size and trial."""

_PROTOCOL = {"root": "root seed", "purpose": "purpose", "scenario": "scenario"}


class Store:
    """The shards of one results folder.

    Attributes
    ----------
    damaged : where the shards lie now that were found damaged and moved aside.

    Raises
    ------
    RequestError : where the folder cannot be written, or holds records of another version or protocol.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.runs = folder.resolve() / "runs"  # whatever a strategy does to the working folder
        self.damaged: list[Path] = []

    def exists(self) -> bool:
        """Whether the folder has been made ready before."""
        return (self.runs / PROTOCOL_FILE).exists()

    def open(self, root: int, purpose: str, scenario: Scenario | None = PAPER) -> None:
        """Make the folder ready for trials of one root seed, purpose and scenario (None: of any), sizes aside."""
        self.adopt({"schema": SCHEMA_VERSION, "root": root, "purpose": purpose, "scenario": _name(scenario)})

    def adopt(self, protocol: Mapping[str, Any]) -> None:
        """Make the folder ready for trials of a protocol, as `protocol()` gives it of another folder."""
        forget_code()
        try:
            self.runs.mkdir(parents=True, exist_ok=True)
            file = self.runs / PROTOCOL_FILE
            if not file.exists():
                write_whole(file, json.dumps(protocol))
            _remove_abandoned(self.folder)
        except OSError as error:
            raise RequestError(
                f"results folder '{self.folder}' cannot be written ({error.strerror}); give another with --results."
            ) from None
        if not os.access(self.runs, os.W_OK):
            raise RequestError(f"results folder '{self.folder}' is not writable; give another with --results.")
        self.require(protocol)

    def require(self, protocol: Mapping[str, Any]) -> None:
        """Refuse a folder whose trials are not of this protocol."""
        stored = self.protocol()
        for name, words in _PROTOCOL.items():
            if stored[name] != protocol[name]:
                raise RequestError(
                    f"results folder '{self.folder}' holds trials of {words} '{stored[name]}', not '{protocol[name]}'; "
                    "give another with --results."
                )

    def protocol(self) -> dict[str, Any]:
        """Return record version, root seed, purpose and scenario of the folder's trials."""
        file = self.runs / PROTOCOL_FILE
        if not file.is_file():
            raise RequestError(
                f"results folder '{self.folder}' holds no trials; run some with 'explore-bench run SUITE'."
            )
        damaged = RequestError(f"'{file}' is damaged; delete it and the folder it lies in.")
        try:
            protocol = parse_json(read_text(file))
            version = protocol["schema"]
        except (ValueError, KeyError, TypeError):
            raise damaged from None
        if version != SCHEMA_VERSION:
            raise RequestError(
                f"results folder '{self.folder}' holds trials of {version_words(version)}; give another with --results."
            )
        if not _PROTOCOL.keys() <= protocol.keys():
            raise damaged
        return dict(protocol)

    def path(self, key: str) -> Path:
        """File of the shard with this key."""
        return self.runs / f"{key}.parquet"

    def write(self, result: TrialResult, key: str | None = None) -> None:
        """Write a trial's shard, under the key that its code has now if none is given."""
        self.keep(key or trial_key(result.spec), encode(result))

    def keep(self, key: str, shard: bytes) -> None:
        """Write the bytes of a shard: whole or not at all. A damaged one that was there is moved aside.

        Raises
        ------
        RequestError : where it cannot be written.
        """
        path = self.path(key)
        if path.exists() and self._facts(path) is None:
            self._set_aside(path)
        write_whole(path, shard)

    def has(self, spec: TrialSpec) -> bool:
        """Whether a trial is stored, and neither damaged nor one that failed for want of time, memory or disk."""
        path = self.path(trial_key(spec))
        facts = self._facts(path) if path.is_file() else None
        return facts is not None and not facts["transient"]

    def take(self, specs: Sequence[TrialSpec]) -> None:
        """Make the stored ones of some trials name themselves as these do: a file that they ran may have been moved.

        Its content is part of the key, its place is not; without this they would be stored, and yet no current ones.
        """
        for spec in specs:
            path = self.path(trial_key(spec))
            facts = self._facts(path) if path.is_file() else None
            if facts is not None and facts["spec"] != json.loads(json.dumps(spec_values(spec))):
                write_whole(path, renamed(path, spec))

    def _facts(self, path: Path) -> dict[str, Any] | None:
        """Metadata of a shard; None where it is damaged."""
        try:
            return facts_of(opened(path), path)
        except DamagedError:
            return None

    def _set_aside(self, path: Path) -> None:
        place = self.runs / DAMAGED_FOLDER / path.name
        with writing(place):
            place.parent.mkdir(exist_ok=True)
            path.replace(place)
        self.damaged.append(place)

    def find(self, spec: TrialSpec) -> TrialRecord:
        """Read a stored trial."""
        return read_record(self.path(trial_key(spec)))

    def replay(self, spec: TrialSpec) -> Replay:
        """Read the replay of a stored trial."""
        return read_replay(self.path(trial_key(spec)))

    def records(self, keep: Callable[[TrialRecord], Any] = lambda record: record) -> tuple[list[Any], int]:
        """All trials of the folder whose key is still that of their specification, and how many are stale.

        A trial is stale where the code or the libraries that it ran have changed since. The order is that of
        `trials.csv`: strategy, training seed, size, trial. Damaged shards are moved aside.

        Thousands of whole records fill a memory: `keep` says what to keep of each, the rest is forgotten at once.
        """
        found, stale = self.part(self.shards(), keep)
        return in_order_of_table(found), stale

    def shards(self) -> list[Path]:
        """Files of all shards, in the order of their keys."""
        self.protocol()
        return sorted(self.runs.glob("*.parquet"))

    def part(self, shards: Iterable[Path], keep: Callable[[TrialRecord], Any]) -> tuple[list[tuple[Order, Any]], int]:
        """Of some shards what `records` gives of all, in any order, each with its place in the order of the table."""
        found, stale = [], 0
        for _, record in self.survey(shards, mend=True):
            if record is None:
                stale += 1
            else:
                found.append((_order(record), keep(record)))
        return found, stale

    def survey(
        self, shards: Iterable[Path] | None = None, mend: bool = False
    ) -> Iterator[tuple[Path, TrialRecord | None]]:
        """Every shard (None: of the folder) with its record, or None where it is stale.

        Damaged ones are moved aside if it is to `mend` the folder.

        Raises
        ------
        DamagedError : at the first damaged one otherwise.
        """
        for path in self.shards() if shards is None else shards:
            try:
                shard = opened(path)
                facts = facts_of(shard, path)
                record = record_of(shard, facts) if _is_current(facts["spec"], path.stem) else None
            except DamagedError:
                if not mend:
                    raise
                self._set_aside(path)
                continue
            yield path, record


def in_order_of_table(found: Iterable[tuple[Order, Any]]) -> list[Any]:
    """What was kept of records, in the order of `trials.csv`."""
    return [kept for _, kept in sorted(found, key=itemgetter(0))]


def _order(record: TrialRecord) -> Order:
    spec = record.spec
    return spec.strategy, -1 if spec.training_seed is None else spec.training_seed, spec.scenario.size, spec.trial


def _is_current(values: dict[str, Any], key: str) -> bool:
    try:
        return trial_key(spec_from(values)) == key
    except (OSError, RequestError):
        return False  # a plugin's file that is gone or broken, a constant that is no more


def _name(scenario: Scenario | None) -> str:
    """Constants that differ from those of their kind of world, the size aside; "any" for None."""
    if scenario is None:
        return "any"
    fields = type(scenario).model_fields
    differs = {
        name: value for name, value in scenario.model_dump(exclude={"size"}).items() if value != fields[name].default
    }
    if scenario.kind != DEFAULT_KIND:
        differs = {"kind": scenario.kind} | differs
    if scenario.map is not None:
        differs["map"] = scenario_digest(Scenario(kind=scenario.kind, map=scenario.map))
    return ", ".join(f"{key}={value}" for key, value in differs.items()) or "paper"


def _remove_abandoned(folder: Path) -> None:
    """Remove what killed processes had half written, here and in what lies within; what others write now is younger."""
    for half in folder.rglob(".*"):
        if HALF.search(half.name) and time.time() - half.stat().st_mtime > ABANDONED_SECONDS:
            half.unlink(missing_ok=True)


def missing(store: Store, specs: Sequence[TrialSpec]) -> Iterator[TrialSpec]:
    """Trials of a plan that the store does not hold."""
    return (spec for spec in specs if not store.has(spec))
