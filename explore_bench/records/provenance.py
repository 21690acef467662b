"""What defines a trial's numbers: a digest of its specification, of the code that it runs and of the libraries.

Code counts by its syntax trees without docstrings: a comment changes nothing, an edited path search makes every stored
trial stale. It is that of the simulation loop, of the kind of world and of the factory's module, followed through
imports into its own package, into packages that register strategies, and into whatever lies outside of the installed
libraries. What is imported lazily is followed by name: the parts of a kind, and the public names of `explore_bench`.
So an edit of one kind of world leaves the trials in others as they are. A library counts by its version, one that
cannot be found as absent.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import importlib.util
import json
import re
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.machinery import ModuleSpec
from importlib.metadata import PackageNotFoundError, entry_points, packages_distributions, version
from pathlib import Path
from typing import Any

from explore_bench.strategies.entry import GROUP, parse_factory, weights_file
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import SCHEMA_VERSION
from explore_bench.world.kinds import kind_of
from explore_bench.world.scenario import Scenario

PACKAGE = "explore_bench"
LOOP = "explore_bench.trial.run"
"""Module from which every trial runs."""

LIBRARIES = ("gtsam", "numba", "numpy", "scipy", "torch")
"""Libraries whose version enters the digest where the core imports them; of a strategy's own code all do."""


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
        "broken": spec.broken,
    }


def trial_key(spec: TrialSpec) -> str:
    """Twenty hexadecimal digits of everything that defines a trial's rows; the name of the scenario does not count."""
    values = spec_values(spec)
    del values["scenario_name"]
    place, _ = parse_factory(spec.factory)
    values["factory"] = Path(spec.factory).name
    values["weights"] = weights_digest(spec.weights) if spec.weights else None
    values["code"] = code_digest(place, spec.scenario.kind)
    values["libraries"] = library_versions(place, spec.scenario.kind)
    values["schema"] = SCHEMA_VERSION
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:20]


def scenario_digest(scenario: Scenario) -> str:
    """Twelve hexadecimal digits of all constants of a scenario.

    Those that came later count only where they are not as usual, so that cards of older weights go on naming it.
    """
    values = scenario.model_dump()
    for name in scenario.later:
        if values[name] == type(scenario).model_fields[name].default:
            del values[name]
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


def forget_code() -> None:
    """Read all code anew: it may have been edited since (in a notebook, say)."""
    of_packages = (_modules, _file, _counts_by_source, _registering, _distributions)
    for function in (code_digest, library_versions, weights_digest, *of_packages):
        function.cache_clear()  # what follows from the bytes of a file alone stays
    importlib.invalidate_caches()


@cache
def code_digest(place: str, kind: str) -> str:
    """Digest of the syntax trees of a factory's module, of the loop and the kind of world, and of what these import."""
    digest = hashlib.sha256()
    for name, path in sorted(_modules(place, kind).items()):
        digest.update(name.encode() + _syntax(path.read_bytes()))
    return digest.hexdigest()


@cache
def library_versions(place: str, kind: str) -> dict[str, str]:
    """Versions of the libraries that the code of a factory imports, read without importing them."""
    core: set[str] = set()
    own: set[str] = set()
    for module, path in _modules(place, kind).items():
        (core if module.startswith(f"{PACKAGE}.") else own).update(_packages(path, module))
    known = sys.stdlib_module_names | {PACKAGE}
    libraries = core & set(LIBRARIES) | {name for name in own - known if not _counts_by_source(name)}
    return {name: _library_version(name) for name in sorted(libraries)}


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


def _library_version(package: str) -> str:
    """Version of the distribution that a package is imported from, or "absent"."""
    found = installed_version(package)
    if found != "absent" or _location(package) is None:
        return found
    return ", ".join(map(installed_version, _distributions().get(package, ())))


@cache
def _distributions() -> Mapping[str, Sequence[str]]:
    return packages_distributions()  # takes a second


@cache
def _modules(place: str, kind: str) -> dict[str, Path]:
    """Modules that a trial runs: name → file, from the loop, the parts of the kind and the factory's module on."""
    found: dict[str, Path] = {}
    for part in (LOOP, *kind_of(kind).simulated):
        _follow(part.partition(":")[0], found)
    if place.endswith(".py"):
        path = Path(place)
        found[path.name] = path
        for name in sorted(_imports(path, "")):
            _follow(name, found)
    else:
        _follow(place, found, place.split(".")[0])
    return found


def _homes(name: str) -> list[str]:
    """Modules behind a public name of the package's root, "explore_bench.*" being all of them."""
    public: dict[str, str] = importlib.import_module(PACKAGE).PUBLIC
    wanted = name.removeprefix(f"{PACKAGE}.")
    return [f"{PACKAGE}.{home}" for own, home in public.items() if wanted in (own, "*")]


def _follow(name: str, found: dict[str, Path], own: str = PACKAGE) -> None:
    """Add a module, and what it imports, to `found` as far as the source counts: always within the package `own`."""
    package = name.split(".")[0]
    if package == PACKAGE and (homes := _homes(name)):
        for home in homes:
            _follow(home, found)
        return
    if name in found or name == PACKAGE or not (package == own or _counts_by_source(package)):
        return
    path = _file(name)
    if path is None:
        return
    found[name] = path
    for imported in sorted(_imports(path, name)):
        _follow(imported, found, own)


@cache
def _counts_by_source(package: str) -> bool:
    """Whether a package registers strategies, or lies elsewhere than the libraries do: in a checkout, say."""
    if package in sys.stdlib_module_names or package in LIBRARIES:
        return False
    if package == PACKAGE or package in _registering():
        return True
    path = _location(package)
    return path is not None and not {"site-packages", "dist-packages"} & set(path.parts)


@cache
def _registering() -> frozenset[str]:
    """Top-level packages that register strategies."""
    return frozenset(re.split(r"[:.]", point.value)[0].strip() for point in entry_points(group=GROUP))


def _packages(path: Path, module: str) -> set[str]:
    """Top-level packages that the file of a module imports."""
    return {name.split(".")[0] for name in _imports(path, "" if module.endswith(".py") else module)} - {""}


@cache
def _file(name: str) -> Path | None:
    """Source file of a module, found without importing it or its package; None where the name is no module."""
    package, *rest = name.split(".")
    spec = _spec(package)
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


def _location(package: str) -> Path | None:
    """File or folder of a top-level package; None where there is none."""
    spec = _spec(package)
    places = spec and [*(spec.submodule_search_locations or ()), spec.origin]
    return Path(places[0]) if places and places[0] else None


def _spec(package: str) -> ModuleSpec | None:
    try:
        return importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return None


def _parsed(source: bytes) -> ast.Module | None:
    """Syntax tree of a file; None for one that does not parse, which imports nothing and counts by its bytes."""
    try:
        return ast.parse(source)
    except (SyntaxError, ValueError, RecursionError):
        return None


def _imports(path: Path, module: str) -> frozenset[str]:
    """Names that a file imports: of `from a import b` both a and a.b, which may be a module or not."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    return _imported(path.read_bytes(), package)


@cache
def _imported(source: bytes, package: str) -> frozenset[str]:
    """Names that a source in a package imports."""
    names: set[str] = set()
    nodes = list(ast.walk(_parsed(source) or ast.Pass()))
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = package.split(".")
                parents = parts[: len(parts) - node.level + 1]
                base = ".".join(filter(None, (*parents, base)))
            names |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    return frozenset(names | _taken_from_root(nodes))


def _taken_from_root(nodes: Sequence[ast.AST]) -> set[str]:
    """Names that a file takes from the imported package `explore_bench` itself, `bench.score` say; all if unclear."""
    bound = {
        alias.asname or PACKAGE
        for node in nodes
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name == PACKAGE or (alias.name.startswith(f"{PACKAGE}.") and not alias.asname)
    }
    taken, of_attributes = set(), set()
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in bound:
            taken.add(f"{PACKAGE}.{node.attr}")
            of_attributes.add(node.value)
    bare = [node for node in nodes if isinstance(node, ast.Name) and node.id in bound]
    return taken | ({f"{PACKAGE}.*"} if any(node not in of_attributes for node in bare) else set())


@cache
def _syntax(source: bytes) -> bytes:
    """Syntax tree of a file without positions and without strings that stand alone: docstrings of all kinds."""
    tree = _parsed(source)
    if tree is None:
        return source
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [line for line in body if not _is_text(line)]  # type: ignore[attr-defined]
    return ast.dump(tree).encode()


def _is_text(line: ast.stmt) -> bool:
    return isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant) and isinstance(line.value.value, str)
