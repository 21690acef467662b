"""A registered strategy: what makes it, how it is shown, what was published of it, and its weights."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from explore_bench.errors import RequestError

GROUP = "explore_bench.strategies"
"""Entry point group in which a package names its strategies: a mapping from a name to an Entry or "module:factory"."""

Published = dict[tuple[str, float, str], float]
"""Values that the paper prints, keyed by table, size [m] and metric."""


@dataclass(frozen=True)
class Entry:
    """A registered strategy.

    Attributes
    ----------
    factory : "module:name" of what makes the strategy, called with the parameters (and `weights`, a path, where
        the strategy is learned).
    label : its name in tables and figures.
    color : its fixed colour, "#rrggbb".
    parameters : keyword arguments of the factory.
    tables : the paper's tables that it belongs to.
    suites : what it takes part in beside its tables, as suites name it.
    kinds : of world in which it can run; empty for all.
    published : what those tables print of it.
    reference : whether it is told the truth; it is marked so in every table and compared with nobody.
    plans : metrics for which a reference plans: it fills no other column.
    baseline : whether it is what others are measured by, in tables of the differences to one.
    trainer : "module:name" of what trains it; None for one that is not learned.
    training : what the trainer should do otherwise than usual, as the trainer defines it.
    weights : safetensors file of each training seed, a path or "package:path" (see `weights_file`); a learned
        strategy without any is shown as `not trained`.
    broken : what is wrong with its registration, in a sentence; its trials fail. Empty where nothing is.
    formerly : names that it had before and by which it can still be asked for.
    """

    factory: str
    label: str
    color: str = "#7f7f7f"
    parameters: Mapping[str, Any] = field(default_factory=dict)
    tables: tuple[str, ...] = ("table2", "table3")
    suites: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ()
    published: Published = field(default_factory=dict)
    reference: bool = False
    plans: tuple[str, ...] = ()
    baseline: bool = False
    trainer: str | None = None
    training: Mapping[str, Any] = field(default_factory=dict)
    weights: Mapping[int, str] = field(default_factory=dict)
    broken: str = ""
    formerly: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        parse_factory(self.factory)
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", self.color):
            raise ValueError(f"color '{self.color}' of '{self.label}' must read '#rrggbb'")
        try:
            json.dumps(dict(self.parameters))
        except TypeError as error:
            raise ValueError(f"parameters of '{self.label}' must be plain numbers, texts and lists ({error})") from None

    @property
    def ready(self) -> bool:
        """Whether it can run: a learned strategy needs weights."""
        return self.trainer is None or bool(self.weights)

    def fills(self, metric: str) -> bool:
        """Whether its values of a metric are shown: those of a reference where it plans for that one."""
        return not self.reference or metric in self.plans

    def runs_in(self, kind: str) -> bool:
        """Whether it can run in worlds of a kind."""
        return not self.kinds or kind in self.kinds


def parse_factory(factory: str) -> tuple[str, str]:
    """Split "module:name" or "path/to/file.py:name" at its last colon.

    Raises
    ------
    RequestError : where it reads otherwise.
    """
    place, colon, name = factory.rpartition(":")
    if not colon or not name.isidentifier() or not (place.endswith(".py") or re.fullmatch(r"[\w.]+", place)):
        raise RequestError(f"factory '{factory}' must read 'module:name' or 'path/to/file.py:name'.")
    return place, name


def weights_file(weights: str) -> Path:
    """File that `Entry.weights` names: a path, or "package:path" below an importable top-level package.

    The second form stays true in a checkout that is moved, and on another machine.
    """
    package, colon, below = weights.partition(":")
    if colon and re.fullmatch(r"\w{2,}", package) and (spec := find_spec(package)) and spec.submodule_search_locations:
        return Path(spec.submodule_search_locations[0]) / below
    return Path(weights)
