"""How a rule refuses a constant that makes no sense, in one sentence that names rule, value and remedy."""

from __future__ import annotations

import math

from explore_bench import RequestError


def at_least(least: float, value: float, what: str, unit: str = "") -> float:
    """Return a constant that is a finite number of at least `least`.

    Raises
    ------
    RequestError : for anything else; `what` says which constant of which rule it is.
    """
    if not _is_number(value) or value < least:
        raise RequestError(f"{what} is {value!r}; give {unit or 'a number'}, {least:g} or more.")
    return value


def above(least: float, value: float, what: str, unit: str = "") -> float:
    """Return a constant that is a finite number above `least`; raises likewise."""
    if not _is_number(value) or not value > least:
        raise RequestError(f"{what} is {value!r}; give {unit or 'a number'} above {least:g}.")
    return value


def finite(value: float, what: str, unit: str = "") -> float:
    """Return a constant that is a finite number; raises likewise."""
    if not _is_number(value):
        raise RequestError(f"{what} is {value!r}; give {unit or 'a number'} that is finite.")
    return value


def between(low: float, high: float, value: float, what: str) -> float:
    """Return a constant that lies between two numbers, neither included; raises likewise."""
    if not _is_number(value) or not low < value < high:
        raise RequestError(f"{what} is {value!r}; give a number between {low:g} and {high:g}.")
    return value


def count(least: int, value: int, what: str) -> int:
    """Return a constant that is a whole number of at least `least`; raises likewise."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise RequestError(f"{what} is {value!r}; give a whole number, {least} or more.")
    return value


def flag(value: bool, what: str) -> bool:
    """Return a constant that is true or false; raises likewise."""
    if not isinstance(value, bool):
        raise RequestError(f"{what} is {value!r}; give true or false.")
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
