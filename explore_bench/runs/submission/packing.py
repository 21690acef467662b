"""Packs the stored trials of one strategy in one suite, with its file of source and its weights."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path

from explore_bench.errors import RequestError
from explore_bench.records.encoding import renamed
from explore_bench.records.provenance import code_digest, installed_version, library_versions, trial_key, weights_digest
from explore_bench.records.store import Store
from explore_bench.runs.submission.archive import MANIFEST, write_archive
from explore_bench.runs.submission.manifest import Manifest, Weights
from explore_bench.runs.suites import plan
from explore_bench.strategies.entry import parse_factory, weights_file
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import SCHEMA_VERSION

SHOWN = 5
"""Missing trials that are named."""


def pack_submission(suite: str, strategy: str, results: Path) -> tuple[Manifest, bytes]:
    """Pack the trials of a strategy in a suite that a results folder holds.

    Returns
    -------
    What the submission says of itself, and its bytes: the same for the same trials, wherever the files lie.

    Raises
    ------
    RequestError : where there is no such suite, strategy or folder, trials are missing, or it would be too large.
    """
    store = Store(results)
    root = int(store.protocol()["root"])
    asked = plan(suite, [strategy], root=root)
    if not asked.specs:
        raise RequestError(f"strategy '{strategy}' is not trained; submit one with weights.")
    _require_all(store, asked.specs, suite)
    first = asked.specs[0]
    place, _ = parse_factory(first.factory)
    kind = first.scenario.kind
    files = {name: path.read_bytes() for spec in asked.specs for name, path in _files(spec).items()}
    for spec in asked.specs:
        key = trial_key(spec)
        files[f"trials/{key}.parquet"] = renamed(store.path(key), inside(spec))
    manifest = Manifest(
        suite=suite,
        root=root,
        strategy=first.strategy,
        factory=inside(first).factory,
        version=installed_version("explore-bench"),
        record_version=SCHEMA_VERSION,
        code=code_digest(place, kind),
        libraries=library_versions(place, kind),
        source={
            name: hashlib.sha256(text).hexdigest() for name, text in sorted(files.items()) if name.startswith("source/")
        },
        weights=_weights(asked.specs),
        trials=len(asked.specs),
    )
    files[MANIFEST] = (json.dumps(manifest.model_dump(mode="json"), indent=1, ensure_ascii=False) + "\n").encode()
    return manifest, write_archive(files)


def inside(spec: TrialSpec) -> TrialSpec:
    """Specification that names its files as they lie in a submission; those of installed packages stay as they are."""
    place, name = parse_factory(spec.factory)
    factory = f"source/{Path(place).name}:{name}" if place.endswith(".py") else spec.factory
    return dataclasses.replace(spec, factory=factory, weights=_weights_inside(spec))


def _weights_inside(spec: TrialSpec) -> str | None:
    if spec.weights is None or weights_file(spec.weights) != Path(spec.weights):
        return spec.weights
    return f"weights/{spec.training_seed}/{Path(spec.weights).name}"


def _files(spec: TrialSpec) -> dict[str, Path]:
    """Files of a trial that no installed package holds, by their names in a submission."""
    place, _ = parse_factory(spec.factory)
    own = inside(spec)
    files = {own.factory.rpartition(":")[0]: Path(place)} if place.endswith(".py") else {}
    if own.weights is not None and own.weights != spec.weights:
        weights = Path(str(spec.weights))
        files[own.weights] = weights
        card = weights.with_suffix(".json")
        if card.is_file():
            files[str(Path(own.weights).with_suffix(".json"))] = card
    return files


def _weights(specs: tuple[TrialSpec, ...]) -> tuple[Weights, ...]:
    found = {spec.training_seed: spec for spec in specs if spec.weights is not None}
    return tuple(
        Weights(seed=seed or 0, file=str(inside(spec).weights), digest=weights_digest(str(spec.weights)))
        for seed, spec in found.items()
    )


def _require_all(store: Store, specs: tuple[TrialSpec, ...], suite: str) -> None:
    missing = [spec for spec in specs if not store.has(spec)]
    if not missing:
        return
    names = [
        f"{spec.scenario.size:g} m, {spec.scenario_name}, world {spec.trial}"
        + ("" if spec.training_seed is None else f", training seed {spec.training_seed}")
        for spec in missing[:SHOWN]
    ]
    more = f"; and {len(missing) - SHOWN} more" if len(missing) > SHOWN else ""
    raise RequestError(
        f"results folder '{store.folder}' lacks {len(missing)} of the {len(specs)} trials of '{specs[0].strategy}' in "
        f"suite '{suite}' by the present code: {'; '.join(names)}{more}; run them with 'explore-bench run {suite}'."
    )
