"""How the parts of a step are timed: each calls `lap` with its name when it is done."""

from __future__ import annotations

from collections.abc import Callable

Lap = Callable[[str], None]
"""`perf` passes a stopwatch."""


def no_lap(part: str) -> None:
    """Time nothing."""
