"""Looks at a submission of somebody else: whether it is whole, of which code and weights, and whether a sample agrees.

Nothing of it is run unless a sample is asked for. Its code then runs as any strategy does, in processes of its own,
which keep it from the trials of others and from nothing else.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from explore_bench.errors import RequestError, describe, one_line
from explore_bench.records.encoding import facts_of, opened, renamed
from explore_bench.records.provenance import code_digest, library_versions, spec_values, trial_key, weights_digest
from explore_bench.records.store import Store
from explore_bench.runs.submission.archive import MANIFEST, read_archive
from explore_bench.runs.submission.manifest import Manifest, parse_manifest
from explore_bench.runs.submission.packing import inside
from explore_bench.runs.suites import plan
from explore_bench.runs.verifying import Verified, verify
from explore_bench.strategies.entry import parse_factory
from explore_bench.strategies.notation import split_parameters, written_parameters
from explore_bench.strategies.registry import WEIGHTS
from explore_bench.trial.spec import TrialSpec

MOST_ROWS, MOST_UNPACKED = 1_000_000, 2**30
"""Rows of a shard, and bytes that it takes when it is read."""


@dataclass(frozen=True)
class Checked:
    """What is found of a submission.

    Attributes
    ----------
    manifest : what it says of itself.
    lines : number of lines of each file of source.
    differs : in what the code, the libraries and the installed weights here are others, in words; where it is not
        empty, nothing can be said of the trials.
    statuses : how its trials ended, and how many.
    verified : what came of the sample; None where none was run.
    """

    manifest: Manifest
    lines: Mapping[str, int]
    differs: tuple[str, ...]
    statuses: Mapping[str, int]
    verified: Verified | None


def check_submission(path: Path, sample: int = 0, workers: int = 1, salt: str = "") -> Checked:
    """Check a submission; with a sample, run so many of its trials again, another sample for another salt.

    Raises
    ------
    RequestError : where the file is no submission, or is not what it says of itself.
    """
    files = read_archive(path)
    try:
        manifest = parse_manifest(files.pop(MANIFEST).decode())
        _require_digests(manifest, files)
    except (RequestError, UnicodeDecodeError) as error:
        raise RequestError(f"submission '{path}': {error}") from None
    lines = {name: files[name].count(b"\n") for name in manifest.source}
    with tempfile.TemporaryDirectory(prefix="explore-bench-") as place:
        folder = Path(place).resolve()
        for name, content in files.items():
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
        try:
            specs = plan(manifest.suite, [_asked(manifest, folder)], root=manifest.root).specs
            differs = _differences(manifest, specs)
            if differs:
                return Checked(manifest, lines, differs, {}, None)
            statuses = _unpack(manifest, specs, folder)
        except RequestError as error:
            raise RequestError(f"submission '{path}': {_without(folder, str(error))}") from None
        found = verify(folder, sample, workers, salt=salt) if sample else None
    return Checked(manifest, lines, (), statuses, found)


def _require_digests(manifest: Manifest, files: Mapping[str, bytes]) -> None:
    """Refuse files that are not those which the manifest names, or are more or fewer."""
    claimed = dict(manifest.source)
    for weights in manifest.weights:
        if weights.file.startswith("weights/"):
            claimed[weights.file] = weights.digest
    for name, digest in claimed.items():
        if name not in files:
            raise RequestError(f"it lacks {one_line(name, 100)}; ask for a whole one.")
        if hashlib.sha256(files[name]).hexdigest() != digest:
            raise RequestError(f"{name} is not the file whose digest submission.json has; ask for one packed anew.")
    cards = {str(Path(name).with_suffix(".json")) for name in claimed if name.startswith("weights/")}
    for name in files:
        if not name.startswith("trials/") and name not in claimed and name not in cards:
            raise RequestError(f"{name} is not named in submission.json; ask for one packed anew.")
    place = manifest.factory.rpartition(":")[0]
    if place.endswith(".py") and place not in manifest.source:
        raise RequestError(
            f"its factory '{one_line(manifest.factory, 100)}' is no file of it; ask for one packed anew."
        )


def _asked(manifest: Manifest, folder: Path) -> str:
    """Name by which its strategy is asked for here, its files being in a folder."""
    base, parameters = split_parameters(manifest.strategy)
    own = [str(folder / weights.file) for weights in manifest.weights if weights.file.startswith("weights/")]
    if WEIGHTS in parameters:
        parameters[WEIGHTS] = own
    place, name = parse_factory(manifest.factory)
    if place.endswith(".py"):
        base = f"{folder / place}:{name}"
    elif name == base:  # of a module, and not registered
        base = manifest.factory
    return f"{base}[{written_parameters(parameters)}]" if parameters else base


def _differences(manifest: Manifest, specs: tuple[TrialSpec, ...]) -> tuple[str, ...]:
    """Say in what the code, the libraries and the weights here are others than those of the submission."""
    if not specs or specs[0].strategy != manifest.strategy or inside(specs[0]).factory != manifest.factory:
        return (f"the strategy '{one_line(manifest.strategy, 100)}' is another here, or not trained",)
    place, _ = parse_factory(specs[0].factory)
    kind = specs[0].scenario.kind
    found = []
    code = code_digest(place, kind)
    if code != manifest.code:
        found.append(f"the code here is {code[:12]}, not {manifest.code[:12]}")
    here = library_versions(place, kind)
    for name in sorted({*here, *manifest.libraries}):
        one, other = here.get(name, "none"), manifest.libraries.get(name, "none")
        if one != other:
            found.append(f"{one_line(name, 60)} here is {one}, not {one_line(other, 60)}")
    digests = {spec.training_seed: weights_digest(spec.weights) for spec in specs if spec.weights}
    if digests != {weights.seed: weights.digest for weights in manifest.weights}:
        found.append("the weights here are others")
    return tuple(found)


def _unpack(manifest: Manifest, specs: tuple[TrialSpec, ...], folder: Path) -> Counter[str]:
    """Make the folder a results folder of the submission's trials, and count how they ended."""
    expected = {trial_key(spec): spec for spec in specs}
    shards = {path.stem: path for path in (folder / "trials").glob("*.parquet")}
    lacking, more = expected.keys() - shards.keys(), shards.keys() - expected.keys()
    if lacking or more or len(expected) != manifest.trials:
        raise RequestError(
            f"it has {len(shards) - len(more)} of the {len(expected)} trials of '{manifest.strategy}' in suite "
            f"'{manifest.suite}', and {len(more)} others; ask for one packed anew."
        )
    store = Store(folder)
    store.open(manifest.root, "evaluate", None)
    return Counter(_take(store, key, shards[key], spec) for key, spec in expected.items())


def _take(store: Store, key: str, shard: Path, spec: TrialSpec) -> str:
    """Put a shard of the submission into a store, and return how its trial ended.

    Raises
    ------
    RequestError : where it is no record of this trial, or too large to be read.
    """
    refusal = RequestError(f"trials/{shard.name} is no record of its trial; ask for one packed anew.")
    try:
        content = opened(shard)
        size = sum(content.metadata.row_group(i).total_byte_size for i in range(content.metadata.num_row_groups))
        if content.metadata.num_rows > MOST_ROWS or size > MOST_UNPACKED:
            raise refusal
        facts = facts_of(content, shard)
        if facts["spec"] != json.loads(json.dumps(spec_values(inside(spec)))) or facts["transient"]:
            raise refusal
        store.keep(key, renamed(shard, spec))
        store.replay(spec)
        record = store.find(spec)
        for columns in (record.steps, record.final):
            list(columns.values())  # each of them can be read
        return record.status
    except RequestError:
        raise refusal from None
    except Exception as error:  # whatever comes of bytes that somebody else wrote
        what = one_line(describe(error), 200)
        raise RequestError(f"trials/{shard.name} cannot be read ({what}); ask for one packed anew.") from None


def _without(folder: Path, sentence: str) -> str:
    """Sentence in which files are named as in the submission."""
    return sentence.replace(f"{folder}/", "")
