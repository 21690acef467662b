"""The file of one trial: its bytes from a result, and a record or a replay from its bytes.

A shard holds the step rows, the trajectory as estimated at the end, and the replay of every decision on the row of
the step at which it was made; its metadata hold the specification, the world and the ending.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from explore_bench.errors import RequestError, one_line
from explore_bench.records.provenance import spec_values
from explore_bench.trial.run import TrialResult
from explore_bench.trial.snapshot import FINE_COLUMNS, REPLAY_COLUMNS, unpack_fine_map
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import FINAL_COLUMNS, SCHEMA_VERSION, Column, step_columns
from explore_bench.world.kinds import World, kind_of
from explore_bench.world.scenario import Scenario

METADATA_KEY = b"explore_bench"
DIGEST_KEY = b"explore_bench_digest"
UNSEALED = b"the SHA-256 of the file with these words where it stands in hex."
"""What a shard holds under DIGEST_KEY while its own digest is computed."""

_SEAL = re.compile(re.escape(DIGEST_KEY) + rb".{1,8}?([0-9a-f]{64})", re.DOTALL)


BRIEF_COLUMNS = ("step", "uncertainty", "peak_trace", "explored")
"""Columns of the rows that a trial's score and its curves follow from."""


class DamagedError(RequestError):
    """A shard is not, byte for byte, what was written."""


class Columns(Mapping[str, np.ndarray]):
    """Columns of a shard by name, read when one of them is first asked for: most of what a shard costs is decoding.

    All are read then, which takes less than half as long as one by one.

    Parameters
    ----------
    shard : open, and kept until the columns are forgotten.
    names : which there are.
    """

    def __init__(self, shard: pq.ParquetFile, names: Iterable[str]) -> None:
        self._shard = shard
        self._names = tuple(names)

    @cached_property
    def _read(self) -> dict[str, np.ndarray]:
        table = self._shard.read(list(self._names), use_threads=False)
        return {name: table[name].to_numpy() for name in self._names}

    def __getitem__(self, name: str) -> np.ndarray:
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


@dataclass(frozen=True, eq=False)
class TrialRecord:
    """What the store says of one trial.

    Attributes
    ----------
    status, reason : how it ended, and why where that says not all.
    spec : what defined it.
    steps : columns of the rows by name, each of shape (T + 1,), empty where the trial failed at once; see `Columns`.
    final : columns of FINAL_COLUMNS likewise.
    world : the true map.
    transient : whether it failed for want of time, memory or disk: such a trial runs again.
    fine_map : class of each cell of the robot's finer map when the trial ended (of a failed one: at its last decision
        that was answered): `snapshot.UNKNOWN`, `FREE` or `OCCUPIED`, shape that of `scenario.map_grid`; None in a kind
        of world without one, and for a trial of which no map was kept.
    notes : what a reference said of the world, numbers by name.
    """

    spec: TrialSpec
    status: str
    reason: str
    steps: Mapping[str, np.ndarray]
    final: Mapping[str, np.ndarray]
    world: World
    transient: bool
    fine_map: NDArray[np.uint8] | None = None
    notes: dict[str, float] = field(default_factory=dict)

    def brief(self) -> TrialRecord:
        """The record with BRIEF_COLUMNS alone of its rows: what many of are in memory at a time."""
        return replace(self, steps={name: self.steps[name] for name in BRIEF_COLUMNS}, final={})


@dataclass(frozen=True)
class Replay:
    """Decisions of a trial: for each the step at which it was made; the last entry is the end of the trial.

    Attributes
    ----------
    steps : row of each, shape (D + 1,).
    candidates, choices : cells to choose from and the index chosen; None at the end.
    targets : place [m] that was answered instead of an index; None elsewhere.
    maps, ellipses : packed; see `snapshot.unpack_map` and `snapshot.unpack_ellipses`.
    landmarks : x, y, xx, xy, yy of each landmark seen, shape (M, 5).
    fine_maps : packed; see `snapshot.unpack_fine_map`. With the next three it is empty in a kind of world without a
        finer map.
    positions : places of the candidates [m], shape (C, 2); none at the end.
    trajectories : place of every pose so far as estimated then [m], shape (N, 2).
    loops : numbers of the poses (earlier, later) that each loop closure so far joined, shape (L, 2).
    """

    steps: list[int]
    candidates: list[list[int] | None]
    choices: list[int | None]
    targets: list[tuple[float, float] | None]
    maps: list[bytes]
    ellipses: list[bytes]
    landmarks: list[np.ndarray]
    fine_maps: list[bytes] = field(default_factory=list)
    positions: list[np.ndarray] = field(default_factory=list)
    trajectories: list[np.ndarray] = field(default_factory=list)
    loops: list[np.ndarray] = field(default_factory=list)


def encode(result: TrialResult) -> bytes:
    """Bytes of a trial's shard, the same for the same trial."""
    return _encoded(_table(result))


def renamed(path: Path, spec: TrialSpec) -> bytes:
    """Bytes of a shard that names its trial as `spec` does: a file that it ran may lie elsewhere now."""
    shard = opened(path)
    facts = facts_of(shard, path) | {"spec": spec_values(spec)}
    table = shard.read(use_threads=False)
    schema = _schema(spec.scenario.kind, "fine" in table.column_names)
    table = table.select(schema.names).cast(schema)  # pyarrow names the items of a list anew
    return _encoded(table.replace_schema_metadata({METADATA_KEY: json.dumps(facts, sort_keys=True)}))


def comparable(path: Path) -> tuple[bytes, bool]:
    """All that a shard says but its specification, whose paths are those of one machine; and whether it is transient.

    Raises
    ------
    RequestError : for a file that is no shard or of another record version.
    """
    shard = opened(path)
    facts = facts_of(shard, path)
    table = shard.read(use_threads=False)
    rest = {name: value for name, value in facts.items() if name != "spec"}
    return _encoded(table.replace_schema_metadata({METADATA_KEY: json.dumps(rest, sort_keys=True)})), facts["transient"]


def _encoded(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    table = table.replace_schema_metadata({**table.schema.metadata, DIGEST_KEY: UNSEALED})
    # zstd would make it a twentieth smaller, and reading it three times as long.
    pq.write_table(table, sink, compression="lz4", write_statistics=False)
    shard: bytes = sink.getvalue().to_pybytes()
    return shard.replace(UNSEALED, hashlib.sha256(shard).hexdigest().encode())


def _is_whole(shard: bytes) -> bool:
    """Whether a shard is byte for byte what was written."""
    found = _SEAL.findall(shard)
    return len(found) == 1 and hashlib.sha256(shard.replace(found[0], UNSEALED)).hexdigest().encode() == found[0]


def _table(result: TrialResult) -> pa.Table:
    rows = len(result.steps)
    kind = result.spec.scenario.kind
    columns: dict[str, Any] = {name: [getattr(step, name) for step in result.steps] for name in step_columns(kind)}
    final = np.full((rows, 6), np.nan)
    final[: len(result.final_poses)] = np.hstack((result.final_poses, result.final_covariances))
    columns |= {name: final[:, i] for i, name in enumerate(FINAL_COLUMNS)}
    fine = any(snapshot.fine is not None for snapshot in result.snapshots.values())
    for name in REPLAY_COLUMNS | (FINE_COLUMNS if fine else {}):
        snapshots = (result.snapshots.get(row) for row in range(rows))
        columns[name] = [None if snapshot is None else getattr(snapshot, name) for snapshot in snapshots]
    values = {
        "schema": SCHEMA_VERSION,
        "spec": spec_values(result.spec),
        "status": result.status.value,
        "reason": one_line(result.reason),
        "transient": result.transient,
        "world": result.world.facts(),
    }
    if result.notes:
        values["notes"] = result.notes
    schema = _schema(kind, fine).with_metadata({METADATA_KEY: json.dumps(values, sort_keys=True).encode()})
    return pa.table({name: pa.array(columns[name], schema.field(name).type) for name in schema.names}, schema)


@cache
def _schema(kind: str, fine: bool) -> pa.Schema:
    def arrow(column: Column) -> pa.DataType:
        if column.dtype.startswith("list<"):
            return pa.list_(pa.type_for_alias(column.dtype[5:-1]))
        return pa.type_for_alias(column.dtype)

    columns = step_columns(kind) | FINAL_COLUMNS | REPLAY_COLUMNS | (FINE_COLUMNS if fine else {})
    return pa.schema([pa.field(name, arrow(column)) for name, column in columns.items()])


def opened(path: Path) -> pq.ParquetFile:
    """Open a shard, all of which is in memory then: its file is not read again.

    Raises
    ------
    DamagedError : where it is not what was written.
    RequestError : where it cannot be read now, which says nothing of what it holds.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RequestError(f"'{path}' cannot be read ({reason}); give the right to, or another folder.") from None
    if not _is_whole(content):
        raise DamagedError(f"'{path}' is no readable record; delete it and run again.")
    return pq.ParquetFile(pa.BufferReader(content))


def version_words(version: object) -> str:
    """Words for records of another version than those that are written now."""
    older = "an older " if isinstance(version, int) and version < SCHEMA_VERSION else "another "
    return f"{older}record version, {version}, not {SCHEMA_VERSION}"


def facts_of(shard: pq.ParquetFile, path: Path) -> dict[str, Any]:
    """Metadata of a shard: the specification of its trial, its ending and its world."""
    facts: dict[str, Any] = json.loads(shard.metadata.metadata[METADATA_KEY])
    if facts.get("schema") != SCHEMA_VERSION:
        raise RequestError(f"'{path}' is of {version_words(facts.get('schema'))}; give another folder with --results.")
    return facts


def record_of(shard: pq.ParquetFile, facts: dict[str, Any]) -> TrialRecord:
    """Record of an open shard, whose metadata are `facts`."""
    spec = spec_from(facts["spec"])
    return TrialRecord(
        spec=spec,
        status=facts["status"],
        reason=facts["reason"],
        steps=Columns(shard, step_columns(spec.scenario.kind)),
        final=Columns(shard, FINAL_COLUMNS),
        world=kind_of(spec.scenario.kind).load("world").from_facts(facts["world"], spec.scenario),
        transient=facts["transient"],
        fine_map=_last_fine_map(shard, spec.scenario),
        notes=facts.get("notes", {}),
    )


def _last_fine_map(shard: pq.ParquetFile, scenario: Any) -> NDArray[np.uint8] | None:
    """Newest finer map that a shard holds; None where it holds none."""
    if "fine" not in shard.schema.names:
        return None
    maps = shard.read(["fine"], use_threads=False)["fine"].drop_null()
    return unpack_fine_map(maps[-1].as_py(), scenario.map_grid.shape) if len(maps) else None


def spec_from(values: dict[str, Any]) -> TrialSpec:
    """Specification from the plain values of `spec_values`."""
    return TrialSpec(**{**values, "scenario": _scenario_from(json.dumps(values["scenario"]))})


@lru_cache(maxsize=256)
def _scenario_from(values: str) -> Scenario:
    """Scenario from its values in JSON: one for all of its trials."""
    return Scenario(**json.loads(values))


def read_record(path: Path) -> TrialRecord:
    """Read a shard.

    Raises
    ------
    RequestError : for a file that is no shard or of another record version.
    """
    shard = opened(path)
    return record_of(shard, facts_of(shard, path))


def read_replay(path: Path) -> Replay:
    """Read the replay that a shard holds; errors as of `read_record`."""
    shard = opened(path)
    facts_of(shard, path)
    table = shard.read(["step", *REPLAY_COLUMNS, *FINE_COLUMNS], use_threads=False).to_pylist()
    rows = [row for row in table if row["map"] is not None]
    fine = [row for row in rows if row.get("fine") is not None]  # all of them, or none
    return Replay(
        steps=[row["step"] for row in rows],
        candidates=[row["candidates"] for row in rows],
        choices=[row["choice"] for row in rows],
        targets=[row["target"] and (row["target"][0], row["target"][1]) for row in rows],
        maps=[row["map"] for row in rows],
        ellipses=[row["ellipses"] for row in rows],
        landmarks=[np.array(row["landmark_estimates"], dtype=float).reshape(-1, 5) for row in rows],
        fine_maps=[row["fine"] for row in fine],
        positions=[np.array(row["positions"] or (), dtype=float).reshape(-1, 2) for row in fine],
        trajectories=[np.array(row["trajectory"], dtype=float).reshape(-1, 2) for row in fine],
        loops=[np.array(row["loops"], dtype=np.int64).reshape(-1, 2) for row in fine],
    )
