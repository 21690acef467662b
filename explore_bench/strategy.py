"""What a strategy sees, what it must answer, and how one is registered."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import json
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from explore_bench.errors import RequestError

if TYPE_CHECKING:
    from explore_bench.geometry import Array, Pose
    from explore_bench.scenario import Scenario
    from explore_bench.simulator.world import World
    from explore_bench.slam.belief import Belief


GROUP = "explore_bench.strategies"
"""Entry point group in which a package names its strategies: a mapping from a name to an Entry or "module:factory"."""


class StrategyError(RequestError):
    """A strategy was asked for rightly and cannot be made or begun: its trials fail with this sentence."""


@dataclass(frozen=True, slots=True)
class Observation:
    """All that a strategy may use for one decision. Every array is read-only; nothing in it leads to the truth.

    Attributes
    ----------
    belief : estimates, covariances, occupancy and virtual map; `explore_bench.slam.predict` propagates it.
    step, decision : how many steps were taken and decisions made before this one.
    candidates : target cells to choose from, shape (C,), ascending, at least one.
    positions : centres of the candidates [m], shape (C, 2).
    paths : for each candidate the cells of its path, from the robot's own cell to the candidate.
    path_lengths : length of each path [m], shape (C,).
    """

    belief: Belief
    step: int
    decision: int
    candidates: NDArray[np.int64]
    positions: Array
    paths: tuple[NDArray[np.int64], ...]
    path_lengths: Array

    @property
    def scenario(self) -> Scenario:
        """The physical constants."""
        return self.belief.scenario

    @property
    def pose(self) -> Pose:
        """Estimated pose (x, y, heading) [m, m, rad]."""
        return self.belief.pose


@runtime_checkable
class Strategy(Protocol):
    """What the benchmark asks of a strategy; any object with these two methods is one."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial. All randomness of the trial must come from `rng`, nothing may be kept from the last one."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the chosen candidate, 0 ≤ index < C."""


@runtime_checkable
class Reference(Protocol):
    """A strategy that is told the truth: a bound to compare with, never a competitor."""

    def reset_with_world(self, rng: np.random.Generator, world: World) -> None:
        """Begin a trial in a world that is known."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the chosen candidate, 0 ≤ index < C."""


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
    published : what those tables print of it.
    reference : whether it is told the truth; it is marked so in every table and compared with nobody.
    trainer : "module:name" of what trains it; None for one that is not learned.
    training : what the trainer should do otherwise than usual, as the trainer defines it.
    weights : safetensors file of each training seed, a path or "package:path" (see `weights.weights_file`); a learned
        strategy without any is shown as `not trained`.
    broken : what is wrong with its registration, in a sentence; its trials fail. Empty where nothing is.
    """

    factory: str
    label: str
    color: str = "#7f7f7f"
    parameters: Mapping[str, Any] = field(default_factory=dict)
    tables: tuple[str, ...] = ("table2", "table3")
    published: Published = field(default_factory=dict)
    reference: bool = False
    trainer: str | None = None
    training: Mapping[str, Any] = field(default_factory=dict)
    weights: Mapping[int, str] = field(default_factory=dict)
    broken: str = ""

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


def make_strategy(factory: str, parameters: Mapping[str, Any]) -> Any:
    """Import what a factory string names, in this process, and call it with the parameters.

    Raises
    ------
    RequestError : where there is no such file, module or name, or it takes no such parameters.
    StrategyError : where it cannot be imported, or raises when it is called.
    """
    make = load_factory(factory)
    try:
        return make(**parameters)
    except RequestError:
        raise
    except (Exception, SystemExit) as error:
        given = ", ".join(f"{key}={value!r}" for key, value in parameters.items())
        if takes := _mismatch(make, parameters):
            raise RequestError(f"strategy '{factory}' takes the parameters {takes}, not ({given}).") from error
        raise StrategyError(f"strategy '{factory}' cannot be made with ({given}): {describe(error)}.") from error


def load_factory(factory: str) -> Any:
    """Import what a factory string names, in this process.

    Raises
    ------
    RequestError : where there is no such file, module or name.
    StrategyError : where the file or module cannot be imported.
    """
    place, name = parse_factory(factory)
    is_file = place.endswith(".py")
    if is_file and not Path(place).is_file():
        raise RequestError(f"strategy '{factory}': there is no file {place}; check the path.")
    try:
        module = _load_file(Path(place)) if is_file else importlib.import_module(place)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and f"{place}.".startswith(f"{error.name}."):
            raise RequestError(f"strategy '{factory}': there is no module '{error.name}'; check its name.") from None
        raise StrategyError(f"strategy '{factory}' cannot be imported ({describe(error)}); mend that.") from error
    if not hasattr(module, name):
        raise RequestError(f"strategy '{factory}': '{place}' has no '{name}'; name something that it defines.")
    return getattr(module, name)


def check_methods(strategy: object, reference: bool = False) -> None:
    """Refuse what is no strategy.

    Raises
    ------
    StrategyError : where it lacks `choose`, or `reset` (`reset_with_world` for a reference).
    """
    for method in ("reset_with_world" if reference else "reset", "choose"):
        if not callable(getattr(strategy, method, None)):
            raise StrategyError(f"strategy '{type(strategy).__name__}' has no method {method}; add it.")


def _mismatch(make: Any, parameters: Mapping[str, Any]) -> str:
    """Signature of a factory that does not take these parameters; empty where it does or has none to read."""
    try:
        signature = inspect.signature(make)
    except (TypeError, ValueError):
        return ""
    try:
        signature.bind(**parameters)
    except TypeError:
        return str(signature.replace(return_annotation=inspect.Signature.empty))
    return ""


def describe(error: BaseException) -> str:
    """Return an exception as one line: its type and its first line that is not empty."""
    try:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    except Exception:
        lines = []
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def _load_file(path: Path) -> ModuleType:
    digest = hashlib.sha256(str(path.resolve()).encode() + path.read_bytes())  # an edited file is another module
    name = f"explore_bench_plugin_{digest.hexdigest()[:12]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None  # it ends in .py
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
