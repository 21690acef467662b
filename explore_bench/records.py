"""The store: one Parquet shard a trial, written atomically under the key of everything that defines it.

A shard holds the step rows, the trajectory as estimated at the end, and the replay of every decision on the row of
the step at which it was made; its metadata hold the specification, the world and the ending.
"""

from __future__ import annotations

import json
import os
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from explore_bench.errors import RequestError, writing
from explore_bench.provenance import forget_code, scenario_digest, spec_values, trial_key
from explore_bench.scenario import PAPER, Scenario
from explore_bench.simulator.world import World
from explore_bench.spec import TrialSpec
from explore_bench.steps import FINAL_COLUMNS, REPLAY_COLUMNS, SCHEMA_VERSION, STEP_COLUMNS, Column
from explore_bench.trial import TrialResult

METADATA_KEY = b"explore_bench"
PROTOCOL_FILE = "protocol.json"
ABANDONED_SECONDS = 3600.0
"""A file half written for so long is that of a process that was killed."""

_PROTOCOL = {"root": "root seed", "purpose": "purpose", "scenario": "scenario"}


@dataclass(frozen=True)
class TrialRecord:
    """What the store says of one trial.

    Attributes
    ----------
    status, reason : how it ended, and why where that says not all.
    spec : what defined it.
    steps : columns of STEP_COLUMNS by name, each of shape (T + 1,); empty where the trial failed at once.
    final : columns of FINAL_COLUMNS likewise.
    world : the true map.
    transient : whether it failed for want of time, memory or disk: such a trial runs again.
    """

    spec: TrialSpec
    status: str
    reason: str
    steps: dict[str, np.ndarray]
    final: dict[str, np.ndarray]
    world: World
    transient: bool


@dataclass(frozen=True)
class Replay:
    """Decisions of a trial: for each the step at which it was made; the last entry is the end of the trial.

    Attributes
    ----------
    steps : row of each, shape (D + 1,).
    candidates, choices : cells to choose from and the index chosen; None at the end.
    maps, ellipses : packed; see `steps.unpack_map` and `steps.unpack_ellipses`.
    landmarks : x, y, xx, xy, yy of each landmark seen, shape (M, 5).
    """

    steps: list[int]
    candidates: list[list[int] | None]
    choices: list[int | None]
    maps: list[bytes]
    ellipses: list[bytes]
    landmarks: list[np.ndarray]


class Store:
    """The shards of one results folder.

    Raises
    ------
    RequestError : where the folder cannot be written, or holds records of another version or protocol.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.runs = folder.resolve() / "runs"  # whatever a strategy does to the working folder

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
                _write_atomically(file, json.dumps(protocol).encode())
            _remove_abandoned(self.runs)
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
            protocol = json.loads(file.read_text())
            version = protocol["schema"]
        except (ValueError, KeyError, TypeError):
            raise damaged from None
        if version != SCHEMA_VERSION:
            raise RequestError(
                f"results folder '{self.folder}' holds trials of record version {version}, not {SCHEMA_VERSION}; "
                "give another with --results."
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
        """Write the bytes of a shard: whole or not at all.

        Raises
        ------
        RequestError : where it cannot be written.
        """
        path = self.path(key)
        with writing(path):
            _write_atomically(path, shard)

    def has(self, spec: TrialSpec) -> bool:
        """Whether a trial is stored; one that failed for want of time, memory or disk does not count."""
        path = self.path(trial_key(spec))
        if not path.is_file():
            return False
        with _opened(path) as shard:
            return not _facts(shard, path)["transient"]

    def read(self, path: Path) -> TrialRecord:
        """Read a shard.

        Raises
        ------
        RequestError : for a file that is no shard or of another record version.
        """
        with _opened(path) as shard:
            return _record(shard, _facts(shard, path))

    def find(self, spec: TrialSpec) -> TrialRecord:
        """Read a stored trial."""
        return self.read(self.path(trial_key(spec)))

    def replay(self, spec: TrialSpec) -> Replay:
        """Read the replay of a stored trial."""
        path = self.path(trial_key(spec))
        with _opened(path) as shard:
            _facts(shard, path)
            table = shard.read(["step", *REPLAY_COLUMNS], use_threads=False).to_pylist()
        rows = [row for row in table if row["map"] is not None]
        return Replay(
            steps=[row["step"] for row in rows],
            candidates=[row["candidates"] for row in rows],
            choices=[row["choice"] for row in rows],
            maps=[row["map"] for row in rows],
            ellipses=[row["ellipses"] for row in rows],
            landmarks=[np.array(row["landmark_estimates"], dtype=float).reshape(-1, 5) for row in rows],
        )

    def records(self) -> tuple[list[TrialRecord], int]:
        """All trials of the folder whose key is still that of their specification, and how many are stale.

        A trial is stale where the code or the libraries that it ran have changed since. The order is that of
        `trials.csv`: strategy, training seed, size, trial.
        """
        found = [record for _, record in self.survey()]
        current = [record for record in found if record is not None]
        return sorted(current, key=_order), len(found) - len(current)

    def survey(self) -> Iterator[tuple[Path, TrialRecord | None]]:
        """Every shard in the order of the keys, with its record, or None where it is stale."""
        self.protocol()
        for path in sorted(self.runs.glob("*.parquet")):
            with _opened(path) as shard:
                facts = _facts(shard, path)
                record = _record(shard, facts) if _is_current(facts["spec"], path.stem) else None
            yield path, record


def encode(result: TrialResult) -> bytes:
    """Bytes of a trial's shard, the same for the same trial."""
    return _encoded(_table(result))


def comparable(path: Path) -> tuple[bytes, bool]:
    """All that a shard says but its specification, whose paths are those of one machine; and whether it is transient.

    Raises
    ------
    RequestError : for a file that is no shard or of another record version.
    """
    with _opened(path) as shard:
        facts = _facts(shard, path)
        table = shard.read(use_threads=False)
    rest = {name: value for name, value in facts.items() if name != "spec"}
    return _encoded(table.replace_schema_metadata({METADATA_KEY: json.dumps(rest, sort_keys=True)})), facts["transient"]


def _encoded(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd", write_statistics=False)
    shard: bytes = sink.getvalue().to_pybytes()
    return shard


def _table(result: TrialResult) -> pa.Table:
    rows = len(result.steps)
    columns: dict[str, Any] = {name: [getattr(step, name) for step in result.steps] for name in STEP_COLUMNS}
    final = np.full((rows, 6), np.nan)
    final[: len(result.final_poses)] = np.hstack((result.final_poses, result.final_covariances))
    columns |= {name: final[:, i] for i, name in enumerate(FINAL_COLUMNS)}
    for name in REPLAY_COLUMNS:
        snapshots = (result.snapshots.get(row) for row in range(rows))
        columns[name] = [None if snapshot is None else getattr(snapshot, name) for snapshot in snapshots]
    values = {
        "schema": SCHEMA_VERSION,
        "spec": spec_values(result.spec),
        "status": result.status.value,
        "reason": result.reason,
        "transient": result.transient,
        "world": {
            "obstacles": np.flatnonzero(result.world.obstacles).tolist(),
            "landmarks": result.world.landmarks.tolist(),
            "start": list(result.world.start),
            "uncounted": result.world.uncounted.tolist(),
        },
    }
    schema = _schema().with_metadata({METADATA_KEY: json.dumps(values, sort_keys=True).encode()})
    return pa.table({name: pa.array(columns[name], schema.field(name).type) for name in schema.names}, schema)


@cache
def _schema() -> pa.Schema:
    def arrow(column: Column) -> pa.DataType:
        if column.dtype.startswith("list<"):
            return pa.list_(pa.type_for_alias(column.dtype[5:-1]))
        return pa.type_for_alias(column.dtype)

    columns = STEP_COLUMNS | FINAL_COLUMNS | REPLAY_COLUMNS
    return pa.schema([pa.field(name, arrow(column)) for name, column in columns.items()])


def _order(record: TrialRecord) -> tuple[str, int, float, int]:
    spec = record.spec
    return spec.strategy, -1 if spec.training_seed is None else spec.training_seed, spec.scenario.size, spec.trial


@contextmanager
def _opened(path: Path) -> Iterator[pq.ParquetFile]:
    """Open a shard; whatever is wrong with it while it is read is said of its file."""
    try:
        with pq.ParquetFile(path) as shard:
            yield shard
    except (pa.ArrowException, OSError):
        raise RequestError(f"'{path}' is no readable record; delete it and run again.") from None


def _facts(shard: pq.ParquetFile, path: Path) -> dict[str, Any]:
    """Metadata of a shard: the specification of its trial, its ending and its world."""
    metadata = shard.schema_arrow.metadata or {}
    if METADATA_KEY not in metadata:
        raise RequestError(f"'{path}' is no record of explore-bench; delete it.")
    facts: dict[str, Any] = json.loads(metadata[METADATA_KEY])
    if facts.get("schema") != SCHEMA_VERSION:
        raise RequestError(
            f"'{path}' is of record version {facts.get('schema')}, not {SCHEMA_VERSION}; give another folder with "
            "--results."
        )
    return facts


def _is_current(values: dict[str, Any], key: str) -> bool:
    try:
        return trial_key(_spec_from(values)) == key
    except (OSError, RequestError):
        return False  # a plugin's file that is gone or broken, a constant that is no more


def _record(shard: pq.ParquetFile, facts: dict[str, Any]) -> TrialRecord:
    columns = shard.read([*STEP_COLUMNS, *FINAL_COLUMNS], use_threads=False)
    arrays = {name: columns[name].to_numpy() for name in columns.column_names}
    world, scenario = facts["world"], facts["spec"]["scenario"]
    cells = int(scenario["size"] / scenario["cell_size"] + 0.5)
    obstacles = np.zeros(cells * cells, dtype=bool)
    obstacles[world["obstacles"]] = True
    return TrialRecord(
        spec=_spec_from(facts["spec"]),
        status=facts["status"],
        reason=facts["reason"],
        steps={name: arrays[name] for name in STEP_COLUMNS},
        final={name: arrays[name] for name in FINAL_COLUMNS},
        world=World(
            obstacles.reshape(cells, cells),
            np.array(world["landmarks"], dtype=float).reshape(-1, 2),
            (world["start"][0], world["start"][1], world["start"][2]),
            scenario["cell_size"],
            np.array(world["uncounted"], dtype=np.int64),
        ),
        transient=facts["transient"],
    )


def _name(scenario: Scenario | None) -> str:
    """Constants that differ from the paper's, the size aside; "any" for None."""
    if scenario is None:
        return "any"
    differs = {
        key: value for key, value in scenario.model_dump(exclude={"size"}).items() if value != getattr(PAPER, key)
    }
    if scenario.map is not None:
        differs["map"] = scenario_digest(Scenario(map=scenario.map))
    return ", ".join(f"{key}={value}" for key, value in differs.items()) or "paper"


def _spec_from(values: dict[str, Any]) -> TrialSpec:
    return TrialSpec(**{**values, "scenario": Scenario(**values["scenario"])})


def _write_atomically(path: Path, content: bytes) -> None:
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    try:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _remove_abandoned(folder: Path) -> None:
    """Remove what killed processes had half written; files of others that write now are younger."""
    for half in folder.glob(".*"):
        if time.time() - half.stat().st_mtime > ABANDONED_SECONDS:
            half.unlink(missing_ok=True)


def missing(store: Store, specs: Sequence[TrialSpec]) -> Iterator[TrialSpec]:
    """Trials of a plan that the store does not hold."""
    return (spec for spec in specs if not store.has(spec))
