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

from explore_bench.spec import TrialSpec
from explore_bench.steps import SCHEMA_VERSION
from explore_bench.strategy import parse_factory

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
    }


def trial_key(spec: TrialSpec) -> str:
    """Twenty hexadecimal digits of everything that defines a trial's rows; names of strategies do not count."""
    values = spec_values(spec)
    del values["strategy"], values["scenario_name"]
    place, _ = parse_factory(spec.factory)
    values["factory"] = Path(spec.factory).name
    values["code"] = code_digest(place)
    values["libraries"] = library_versions(place)
    values["schema"] = SCHEMA_VERSION
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:20]


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
    """Source file of a module; None for a name within a module, or where there is no source."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, AttributeError, ValueError):
        return None
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


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
    """Syntax tree of a file without docstrings and positions."""
    tree = ast.parse(path.read_bytes())
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                node.body = node.body[1:]
    return ast.dump(tree).encode()
