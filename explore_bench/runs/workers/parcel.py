"""A task for another machine: with the files that it names, and proof that the same code runs there."""

from __future__ import annotations

import dataclasses
import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from explore_bench.errors import RequestError
from explore_bench.records.provenance import code_digest, library_versions, trial_key, weights_digest
from explore_bench.runs.workers.task import Task
from explore_bench.strategies.entry import parse_factory, weights_file
from explore_bench.trial.spec import TrialSpec


@dataclass(frozen=True, slots=True)
class Parcel:
    """A task to be run elsewhere.

    Attributes
    ----------
    files : content of the plugin's file, and of weights that lie in no package with their card, by path.
    versions : what the key is made of, to say what differs where a worker finds another key.
    """

    task: Task
    files: Mapping[str, bytes]
    versions: Mapping[str, str]


class OtherCodeError(RequestError):
    """A worker would store other numbers under the key than this machine."""


def pack(task: Task) -> Parcel:
    """Put the files of this machine beside a task."""
    files = {name: Path(name).read_bytes() for name in _own_files(task.spec) if Path(name).is_file()}
    return Parcel(task, files, _versions(task.spec))


def unpack(parcel: Parcel, folder: Path) -> TrialSpec:
    """Return the specification of the same trial here, its files written below `folder`.

    Raises
    ------
    OtherCodeError : where code, weights or libraries are others than on the machine that packed it.
    """
    spec = _with_files(parcel, folder)
    if trial_key(spec) != parcel.task.key:
        here = _versions(spec)
        differ = [
            f"{name} {here.get(name)} for {text}" for name, text in parcel.versions.items() if here.get(name) != text
        ]
        raise OtherCodeError(
            f"worker on '{platform.node()}' would mix records: it has {', '.join(differ) or 'another environment'}; "
            "install there what this machine has, and run again."
        )
    return spec


def _own_files(spec: TrialSpec) -> list[str]:
    """Files of a trial that no installed package holds, as its specification names them."""
    place, _ = parse_factory(spec.factory)
    files = [place] if place.endswith(".py") else []
    if spec.weights and weights_file(spec.weights) == Path(spec.weights):
        files += [spec.weights, str(Path(spec.weights).with_suffix(".json"))]
    return files


def _with_files(parcel: Parcel, folder: Path) -> TrialSpec:
    """Specification that names copies of the parcel's files; the same files have the same copies."""
    spec = parcel.task.spec
    if not parcel.files:
        return spec
    digest = hashlib.sha256()
    for path, content in parcel.files.items():
        digest.update(f"{path}\0{len(content)}\0".encode() + content)
    copies = folder / digest.hexdigest()[:16]
    copies.mkdir(exist_ok=True)
    for path, content in parcel.files.items():
        (copies / Path(path).name).write_bytes(content)
    place, name = parse_factory(spec.factory)
    here = {path: str(copies / Path(path).name) for path in parcel.files}
    return dataclasses.replace(
        spec,
        factory=f"{here.get(place, place)}:{name}",
        weights=spec.weights and here.get(spec.weights, spec.weights),
    )


def _versions(spec: TrialSpec) -> dict[str, str]:
    place, _ = parse_factory(spec.factory)
    weights = {"weights": weights_digest(spec.weights)[:8]} if spec.weights else {}
    return {
        "code": code_digest(place, spec.scenario.kind)[:8],
        **weights,
        **library_versions(place, spec.scenario.kind),
    }
