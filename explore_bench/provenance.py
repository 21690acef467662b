"""What defines a trial's numbers: a digest of its specification, of the code that it runs and of the libraries.

Code counts by its syntax trees without docstrings: a comment changes nothing, an edited A* makes every stored
trial stale.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from explore_bench.scenario import Scenario
from explore_bench.spec import TrialSpec
from explore_bench.steps import SCHEMA_VERSION
from explore_bench.strategy import parse_factory
from explore_bench.weights import weights_file

LIBRARIES = ("gtsam", "numba", "numpy", "scipy", "torch")
"""Libraries whose version enters the digest where the code that a trial runs imports them."""


def spec_values(spec: TrialSpec) -> dict[str, Any]:
    """Return a specification as plain values that JSON keeps exactly; `TrialSpec` is made anew from them."""
    return {
        "strategy": spec.strategy,
        "factory": spec.factory,
        "parameters": dict(spec.parameters),
        "reference": spec.reference,
        "scenario": spec.scenario.model_dump(),
        "scenario_name": spec.scenario_name,
        "purpose": spec.purpose,
        "root": spec.root,
        "trial": spec.trial,
        "training_seed": spec.training_seed,
        "weights": spec.weights,
    }


def trial_key(spec: TrialSpec) -> str:
    """Twenty hexadecimal digits of everything that defines a trial's rows; the name of the scenario does not count."""
    values = spec_values(spec)
    del values["scenario_name"]
    place, _ = parse_factory(spec.factory)
    values["factory"] = Path(spec.factory).name
    values["weights"] = weights_digest(spec.weights) if spec.weights else None
    values["code"] = code_digest(place)
    values["libraries"] = library_versions(place)
    values["schema"] = SCHEMA_VERSION
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:20]


def scenario_digest(scenario: Scenario) -> str:
    """Twelve hexadecimal digits of all constants of a scenario."""
    return hashlib.sha256(json.dumps(scenario.model_dump(), sort_keys=True).encode()).hexdigest()[:12]


def forget_code() -> None:
    """Read all code anew: it may have been edited since (in a notebook, say)."""
    for function in (code_digest, library_versions, weights_digest, _modules, _file, _tree, _syntax):
        function.cache_clear()


@cache
def code_digest(place: str) -> str:
    """Digest of the syntax trees of a factory's module, its imports within its own package, and of the core."""
    digest = hashlib.sha256()
    for name, path in sorted(_modules(place).items()):
        digest.update(name.encode() + _syntax(path))
    return digest.hexdigest()


@cache
def library_versions(place: str) -> dict[str, str]:
    """Versions of the LIBRARIES that the code of a factory imports, read without importing them."""
    imported = {name.split(".")[0] for path in _modules(place).values() for name in _imports(path, "")}
    return {name: installed_version(name) for name in LIBRARIES if name in imported}


@cache
def weights_digest(weights: str) -> str:
    """Digest of the file of weights that an Entry names; "absent" where there is none."""
    try:
        return hashlib.sha256(weights_file(weights).read_bytes()).hexdigest()
    except OSError:
        return "absent"


def installed_version(distribution: str) -> str:
    """Version of an installed distribution, or "absent"."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return "absent"


@cache
def _modules(place: str) -> dict[str, Path]:
    """Modules that a trial runs: name → file, from the core's `trial` and the factory's module on."""
    found: dict[str, Path] = {}
    _follow("explore_bench.trial", "explore_bench", found)
    if place.endswith(".py"):
        path = Path(place)
        found[path.name] = path
        names = _imports(path, "")
    else:
        _follow(place, place.split(".")[0], found)
        names = {name for path in list(found.values()) for name in _imports(path, "")}
    for name in sorted(names):
        if name.startswith("explore_bench."):
            _follow(name, "explore_bench", found)
    return found


def _follow(name: str, package: str, found: dict[str, Path]) -> None:
    """Add a module of the package, and what it imports from that package, to `found`."""
    if name in found or name.split(".")[0] != package or name == "explore_bench":
        return
    path = _file(name)
    if path is None:
        return
    found[name] = path
    for imported in sorted(_imports(path, name)):
        _follow(imported, package, found)


@cache
def _file(name: str) -> Path | None:
    """Source file of a module, found without importing it or its package; None where the name is no module."""
    package, *rest = name.split(".")
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return None
    if spec is None:
        return None
    if not spec.submodule_search_locations:
        return Path(spec.origin) if not rest and spec.origin and spec.origin.endswith(".py") else None
    for folder in map(Path, spec.submodule_search_locations):
        place = folder.joinpath(*rest)
        for file in (place / "__init__.py", place.with_suffix(".py")):
            if file.is_file():
                return file
    return None


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_bytes())


def _imports(path: Path, module: str) -> set[str]:
    """Names that a file imports: of `from a import b` both a and a.b, which may be a module or not."""
    names: set[str] = set()
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                is_package = path.name == "__init__.py"
                parts = module.split(".")
                parents = parts[: len(parts) - node.level + is_package]
                base = ".".join(filter(None, (*parents, base)))
            names |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return names


@cache
def _syntax(path: Path) -> bytes:
    """Syntax tree of a file without positions and without strings that stand alone: docstrings of all kinds."""
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [line for line in body if not _is_text(line)]  # type: ignore[attr-defined]
    return ast.dump(tree).encode()


def _is_text(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)
