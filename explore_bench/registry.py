"""From the name of a strategy to its Entry. Nothing is imported but what names the entries."""

from __future__ import annotations

import json
import re
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path

from explore_bench.errors import RequestError, unknown
from explore_bench.strategy import Entry, parse_factory
from explore_bench.weights import weights_file

GROUP = "explore_bench.strategies"

PLUGIN_COLORS = ("#56b4e9", "#cc79a7", "#d55e00", "#0072b2", "#f0e442", "#4d4d4d")


@cache
def strategies() -> dict[str, Entry]:
    """All registered strategies by name, in the order in which they are shown.

    They come from the entry points of the group `explore_bench.strategies`: mappings from a name to an Entry or to
    a string "module:factory". The ones of this project come first.
    """
    found: dict[str, Entry] = {}
    points = sorted(entry_points(group=GROUP), key=lambda point: (point.name != "baselines", point.name))
    for point in points:
        try:
            mapping = point.load()
            for name, entry in mapping.items():
                found.setdefault(name, entry if isinstance(entry, Entry) else plugin_entry(entry, name))
        except Exception as error:
            raise RequestError(
                f"entry point '{point.name}' of {GROUP} ({point.value}) cannot be used "
                f"({type(error).__name__}: {error}); mend or uninstall it."
            ) from error
    return found


def parameter_count(entry: Entry) -> int:
    """Number of a learned strategy's parameters, from the card beside its weights.

    Raises
    ------
    RequestError : where the card is missing or says none.
    """
    card = weights_file(next(iter(entry.weights.values()))).with_suffix(".json")
    try:
        return int(json.loads(card.read_text(encoding="utf-8"))["parameter_count"])
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        raise RequestError(f"card '{card}' of '{entry.label}' cannot be read; restore it or train anew.") from None


def lookup(name: str) -> tuple[str, Entry]:
    """Name and Entry of a strategy given as a registered name, "module:factory" or "path/to/file.py:factory".

    Raises
    ------
    RequestError : where there is no such strategy.
    """
    known = strategies()
    if name in known:
        return name, known[name]
    if ":" not in name:
        raise unknown("strategy", name, known)
    place, factory = parse_factory(name)
    if place.endswith(".py"):
        path = Path(place)
        if not path.is_file():
            raise RequestError(f"strategy '{name}': there is no file {path}; check the path.")
        return factory, plugin_entry(f"{path.resolve()}:{factory}", factory)
    return factory, plugin_entry(name, factory)


def plugin_entry(factory: str, name: str) -> Entry:
    """Entry of a strategy known by its factory only; its colour follows from its name."""
    label = re.sub(r"[_-]+", " ", name)
    color = PLUGIN_COLORS[sum(name.encode()) % len(PLUGIN_COLORS)]
    return Entry(factory, label, color)
