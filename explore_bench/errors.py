"""The one exception a user is meant to read, and how errors become one line."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

MOST = 1000
"""Characters of a sentence; of a longer one the middle is left out."""


class RequestError(ValueError):
    """The request, or a file it names, is wrong: one sentence with the value and the fix (exit code 2)."""


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn whatever keeps a file from being written in the block (a full disk, a missing right) into a RequestError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RequestError(f"'{path}' cannot be written ({reason}); make room or give another place.") from None


def unknown(kind: str, name: str, known: Iterable[str]) -> RequestError:
    """Error for a `name` that is not among the `known` ones of its `kind`, with the nearest spelling."""
    names, name = sorted(known), one_line(name, 200)
    near = difflib.get_close_matches(name, names, n=1)
    fix = f"did you mean '{near[0]}'?" if near else f"choose one of {', '.join(names)}."
    return RequestError(f"{kind} '{name}' is unknown; {fix}")


def describe(error: BaseException) -> str:
    """Return an exception as one line: its type and its first line that is not empty."""
    try:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    except BaseException:  # it may be a foreign one
        lines = []
    return f"{type(error).__name__}: {lines[0]}" if lines else type(error).__name__


def one_line(text: str, most: int = MOST) -> str:
    """Text without line breaks and other control characters, shortened to `most` characters."""
    if len(text) > 4 * most:  # before anything is done with all of it
        text = f"{text[: 2 * most]} … {text[-2 * most :]}"
    line = " ".join("".join(character if character.isprintable() else " " for character in text).split())
    half = (most - 3) // 2
    return line if len(line) <= most else f"{line[:half]} … {line[-half:]}"
