"""From the name of a strategy to its Entry. Nothing is imported but what names the entries."""

from __future__ import annotations

import dataclasses
import hashlib
import re
import sys
from collections.abc import Collection, Iterable, Mapping
from contextlib import redirect_stdout
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from explore_bench.errors import RequestError, describe, unknown
from explore_bench.files import parse_json, read_text
from explore_bench.strategies.entry import GROUP, Entry, parse_factory, weights_file
from explore_bench.strategies.notation import split_parameters, written_parameters
from explore_bench.strategies.tracing import place_of, with_place

PLUGIN_COLORS = (
    *("#0000ff", "#ff1eff", "#00d200", "#4b5a00", "#690fb4", "#ff0078", "#d2b478", "#0f8700"),
    *("#0078ff", "#960f4b", "#964b00", "#c300a5", "#0f5a4b", "#d269ff", "#96c3a5", "#004bff"),
    *("#00d269", "#87d23c", "#a51eff", "#967800", "#f0965a", "#ff0000", "#87a5ff"),
)
"""Colours far from one another and from usual palettes; their number is prime."""

WEIGHTS = "weights"
"""Parameter that names a file of weights, or a list of them, one for each training seed: they become the Entry's."""


@cache
def strategies() -> dict[str, Entry]:
    """All registered strategies by name, in the order in which they are shown.

    They come from the entry points of the group `explore_bench.strategies`: mappings from a name to an Entry or to
    a string "module:factory". The ones of this project come first. What cannot be used is an Entry that is `broken`,
    under the name of the entry point where that cannot be loaded.
    """
    found: dict[str, Entry] = {}
    points = sorted(entry_points(group=GROUP), key=lambda point: (point.name != "baselines", point.name))
    for point in points:
        for name, entry in _entries(point).items():
            found.setdefault(name, entry)
    return found


def _entries(point: EntryPoint) -> dict[str, Entry]:
    """Entries that an entry point names."""
    try:
        with redirect_stdout(sys.stderr):
            mapping = dict(point.load())
    except (Exception, SystemExit) as error:
        return {point.name: _broken(point, point.name, error)}
    found = {}
    for name, entry in mapping.items():
        try:
            if not isinstance(name, str) or not re.fullmatch(r"[^\[\]:]+", name):
                raise ValueError(f"{name!r} is no name of a strategy")
            if not isinstance(entry, Entry | str):
                raise TypeError(f"'{name}' is {entry!r}, neither an Entry nor 'module:factory'")
            found[name] = entry if isinstance(entry, Entry) else plugin_entry(entry, name)
        except Exception as error:
            shown = str(name)
            found[shown] = _broken(point, shown, error)
    return found


def _broken(point: EntryPoint, name: str, error: BaseException) -> Entry:
    """Entry whose trials fail: what the entry point names cannot be used. Its source is theirs."""
    named = re.match(r"[\w.]+:[^\W\d]\w*", point.value)
    factory = named[0] if named else "broken:broken"
    reason = with_place(describe(error), place_of(error, factory))
    sentence = f"entry point '{point.name}' of {GROUP} ({point.value}) cannot be used: {reason}; mend or uninstall it."
    return dataclasses.replace(plugin_entry(factory, name), broken=sentence)


def parameter_count(entry: Entry) -> int:
    """Number of a learned strategy's parameters, from the card beside its weights.

    Raises
    ------
    RequestError : where the card is missing or says none.
    """
    card = weights_file(next(iter(entry.weights.values()))).with_suffix(".json")
    try:
        return int(parse_json(read_text(card))["parameter_count"])
    except (OSError, ValueError, KeyError, TypeError, OverflowError):
        raise RequestError(f"card '{card}' of '{entry.label}' cannot be read; restore it or train anew.") from None


def _present_name(name: str) -> str:
    """Name of the registered strategy that had this one before; the name itself where none had."""
    known = strategies()
    if name in known:
        return name
    return next((present for present, entry in known.items() if name in entry.formerly), name)


def lookup(name: str) -> tuple[str, Entry]:
    """Name and Entry of a strategy given as a registered name, "module:factory" or "path/to/file.py:factory".

    Parameters may follow in brackets: "entropy[alpha=0.5]", see `notation`. The name under which its records are kept
    holds them in canonical form.

    Raises
    ------
    RequestError : where there is no such strategy or file, or the name is taken by a registered one.
    """
    asked, parameters = split_parameters(name)
    asked, known = _present_name(asked), strategies()
    if asked in known:
        return _with_parameters(asked, known[asked], parameters)
    if ":" not in asked:
        raise unknown("strategy", asked, known)
    place, factory = parse_factory(asked)
    if place.endswith(".py"):
        path = Path(place)
        if not path.is_file():
            raise RequestError(f"strategy '{asked}': there is no file {path}; check the path.")
        asked = f"{path.resolve()}:{factory}"
    if factory in known:
        raise RequestError(f"strategy '{name}' has the name of a registered one, '{factory}'; rename its factory.")
    return _with_parameters(factory, plugin_entry(asked, factory), parameters)


def lookup_ready(name: str) -> tuple[str, Entry]:
    """`lookup` of a strategy that can run.

    Raises
    ------
    RequestError : also where it is not trained.
    """
    name, entry = lookup(name)
    if not entry.ready:
        raise RequestError(f"strategy '{name}' is not trained; choose one that 'explore-bench list' calls ready.")
    return name, entry


def entry_named(name: str, references: Collection[str] = ()) -> Entry:
    """Entry of a strategy by the name of its records, also of one that is not registered: its label and its colour.

    One of `references`, which were told the truth when their trials ran, is a reference whatever is registered.
    """
    if name in references:
        return dataclasses.replace(entry_named(name), reference=True)
    name, known = _present_name(name), strategies()
    if name in known:
        return known[name]
    try:
        base, parameters = split_parameters(name)
    except RequestError:
        base, parameters = name, {}
    base = _present_name(base)
    entry = known.get(base) or plugin_entry("unknown:unknown", base)
    return _variant(base, entry, parameters) if parameters else entry


def in_order(names: Iterable[str]) -> list[str]:
    """Names of strategies as they are shown: the registered ones in their order, then others by name.

    One with parameters follows the one without.
    """
    order = {name: place for place, name in enumerate(strategies())}

    def place(name: str) -> tuple[int, str]:
        return order.get(name, order.get(name.partition("[")[0], len(order))), name

    return sorted(set(names), key=place)


def plugin_entry(factory: str, name: str) -> Entry:
    """Entry of a strategy known by its factory only; its colour follows from its name."""
    return Entry(factory, re.sub(r"[_-]+", " ", name), PLUGIN_COLORS[_number(name) % len(PLUGIN_COLORS)])


def _with_parameters(name: str, entry: Entry, parameters: Mapping[str, Any]) -> tuple[str, Entry]:
    """Name and Entry of a strategy given other parameters or weights."""
    if not parameters:
        return name, entry
    own = dict(parameters)
    if WEIGHTS in own:
        files = own[WEIGHTS] if isinstance(own[WEIGHTS], list) else [own[WEIGHTS]]
        if not files:
            raise RequestError(f"strategy '{name}': weights is []; name a file.")
        entry = dataclasses.replace(entry, weights={seed: _weights(name, file) for seed, file in enumerate(files)})
        names = [Path(file).name for file in files]
        own[WEIGHTS] = names if len(names) > 1 else names[0]
    return f"{name}[{written_parameters(own)}]", _variant(name, entry, own)


def _weights(name: str, file: Any) -> str:
    """File of weights as an Entry names it."""
    path = weights_file(file) if isinstance(file, str) else Path()
    if not path.is_file():
        raise RequestError(f"strategy '{name}': there is no file of weights '{file}'; check the path.")
    return file if path != Path(file) else str(path.resolve())


def _variant(name: str, entry: Entry, parameters: Mapping[str, Any]) -> Entry:
    """Entry with other parameters: they are in its label, its colour is another, and no paper prints its values."""
    written = written_parameters(parameters)
    count = len(PLUGIN_COLORS)
    steps = 1 + _number(written) % (count - 1)
    return dataclasses.replace(
        entry,
        label=f"{entry.label} [{written}]",
        color=PLUGIN_COLORS[(_number(name) + steps) % count],
        parameters={**entry.parameters, **{key: value for key, value in parameters.items() if key != WEIGHTS}},
        published={},
    )


def _number(text: str) -> int:
    """Return a number that follows from a text, the same in every process."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")
