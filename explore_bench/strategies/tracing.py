"""Where in its own source a strategy raised an error: file, line and code, in a few words."""

from __future__ import annotations

import linecache
import traceback
from importlib.util import find_spec
from pathlib import Path

from explore_bench.errors import one_line
from explore_bench.strategies.entry import parse_factory

MOST_CODE = 100
"""Characters of a line of code that are shown."""


def place_of(error: BaseException, factory: str) -> str:
    """Innermost place in a factory's own source that an error came through, as "mine.py:6: the line of code".

    Its own source is its file, or the package of its module. Of a file that does not parse it is the line that does
    not. The file is told from the working folder on where it lies below, and the text has a bounded length.

    Returns
    -------
    The place; empty where the error came through none, as of a class that lacks a method.
    """
    own, met = _source(factory), set[int]()
    raised: BaseException | None = error
    while own and raised is not None and id(raised) not in met:
        met.add(id(raised))
        places = [(frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(raised.__traceback__)]
        if isinstance(raised, SyntaxError):
            places.append((raised.filename or "", raised.lineno or 0))
        for name, line in reversed(places):
            file = Path(name).resolve()
            if line and (file == own or own in file.parents):
                return _written(file, line)
        raised = raised.__cause__
    return ""


def with_place(reason: str, place: str) -> str:
    """Reason with the place that `place_of` gives, where there is one."""
    return f"{reason}, in {place}" if place else reason


def _source(factory: str) -> Path | None:
    """File of a factory, or the folder of its package; None where there is none."""
    place, _ = parse_factory(factory)
    if place.endswith(".py"):
        return Path(place).resolve()
    try:
        spec = find_spec(place.partition(".")[0])
    except (ImportError, ValueError):
        return None
    if spec is None or not spec.origin:
        return None
    return Path(spec.origin).parent if spec.submodule_search_locations else Path(spec.origin)


def _written(file: Path, line: int) -> str:
    linecache.checkcache(str(file))  # it may have been edited since
    code = one_line(linecache.getline(str(file), line), MOST_CODE)
    here = Path.cwd()
    shown = one_line(str(file.relative_to(here) if file.is_relative_to(here) else file), 2 * MOST_CODE)
    return f"{shown}:{line}: {code}" if code else f"{shown}:{line}"
