"""What the shell completes: names of suites, strategies, scenarios and maps.

A completion must not be felt, and to import what a suite or a scenario is made of takes half a second: their names are
read from the tables in the source that define them.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from importlib.util import find_spec
from pathlib import Path

import click
from click.shell_completion import CompletionItem

Complete = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def suites() -> list[str]:
    """Names of all suites."""
    return _keys("runs/suites.py", "SUITES")


def scenarios() -> list[str]:
    """Names of all scenarios."""
    return _keys("world/scenarios.py", "SCENARIOS")


def maps() -> list[str]:
    """Names of the maps of the gallery."""
    return sorted(path.stem for path in _package().glob("world/maps/gallery/*.txt"))


def strategies() -> list[str]:
    """Names of the strategies that can run."""
    from explore_bench.strategies.registry import strategies

    return [name for name, entry in strategies().items() if entry.ready and not entry.broken]


def learned() -> list[str]:
    """Names of the strategies that can be trained."""
    from explore_bench.strategies.registry import strategies

    return [name for name, entry in strategies().items() if entry.trainer]


def one_of(names: Callable[[], Iterable[str]], files: bool = False) -> Complete:
    """Completion by names, and by files where a file may stand instead: what holds a slash or a dot is one."""

    def complete(context: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
        found = [CompletionItem(name) for name in names() if name.startswith(begun)]
        return found or ([CompletionItem(begun, type="file")] if files else [])

    return complete


def _package() -> Path:
    spec = find_spec("explore_bench")
    assert spec is not None and spec.origin is not None
    return Path(spec.origin).parent


def _keys(module: str, table: str) -> list[str]:
    """Keys of a table that a module defines, in their order, read without importing it."""
    for node in ast.parse((_package() / module).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == table:
            assert isinstance(node.value, ast.Dict)
            return [
                key.value for key in node.value.keys if isinstance(key, ast.Constant) and isinstance(key.value, str)
            ]
    raise LookupError(f"{module} defines no {table}")
