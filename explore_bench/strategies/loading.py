"""From the string that names a factory to a living strategy, and a sentence where that fails."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import sys
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from explore_bench.errors import RequestError, describe
from explore_bench.strategies.entry import parse_factory


class StrategyError(RequestError):
    """A strategy was asked for rightly and cannot be made or begun: its trials fail with this sentence."""


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
    except (Exception, SystemExit, KeyboardInterrupt) as error:
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
    except (Exception, SystemExit, KeyboardInterrupt) as error:
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
