"""The global random generators, from which no strategy may draw: put into a known state, and watched."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

GLOBAL = """
random        getstate       setstate       seed
numpy.random  get_state      set_state      seed
torch         get_rng_state  set_rng_state  manual_seed
"""
"""Modules with a generator of their own: the functions that get its state, set it, and set it from a number."""


@contextmanager
def watched(number: int, used: list[str]) -> Iterator[None]:
    """Give the global generators a state of this number in the block, and their own back afterwards.

    Names of modules whose generator the block used are added to `used`. A module that is not imported is not watched.
    """
    loaded = _loaded()
    own = {name: get() for name, (get, _, _) in loaded.items()}
    for _, _, seed in loaded.values():
        seed(number)
    before = {name: _plain(get()) for name, (get, _, _) in loaded.items()}
    try:
        yield
    finally:
        used += [name for name, (get, _, _) in loaded.items() if _plain(get()) != before[name]]
        for name, (_, put, _) in loaded.items():
            put(own[name])


def _loaded() -> dict[str, tuple[Callable[..., Any], ...]]:
    rows = [line.split() for line in GLOBAL.strip().splitlines()]
    return {
        name: tuple(getattr(sys.modules[name], function) for function in functions)
        for name, *functions in rows
        if name in sys.modules
    }


def _plain(state: Any) -> object:
    """Return a state, which may hold arrays, as something that compares by value."""
    if isinstance(state, tuple):
        return tuple(_plain(part) for part in state)
    return state.tolist() if hasattr(state, "tolist") else state
