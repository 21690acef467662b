"""The one exception a user is meant to read."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RequestError(ValueError):
    """The request, or a file it names, is wrong: one sentence with the value and the fix (exit code 2)."""


def unknown(kind: str, name: str, known: Iterable[str]) -> RequestError:
    """Error for a `name` that is not among the `known` ones of its `kind`, with the nearest spelling."""
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=1)
    fix = f"did you mean '{near[0]}'?" if near else f"choose one of {', '.join(names)}."
    return RequestError(f"{kind} '{name}' is unknown; {fix}")
