"""Files: those of others are read with limits, lest one cost more than it may; ours are written whole or not at all.

What is wrong with a file is a ValueError that follows its name: "it is not UTF-8 text; …". A file that cannot be read
at all is the OSError that it is.
"""

from __future__ import annotations

import json
import os
import re
import stat
import tomllib
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from explore_bench.errors import one_line, writing

MOST_TEXT = 1_000_000
"""Bytes of a file that a person writes."""

MOST_DEPTH, MOST_VALUES = 20, 100_000
"""How deep values may lie in one another, and how many there may be."""

MOST_INTEGER = 2**63
_PART = r"""(?:[^\s.=\[\]{},"'#]+|"[^"\n]*"|'[^'\n]*')"""
_LONG_KEY = re.compile(rf"{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{MOST_DEPTH}}}")


def require_file(path: Path, most: int) -> None:
    """Refuse what is no regular file, or has too many bytes.

    Raises
    ------
    OSError, ValueError : where there is none, or it is refused.
    """
    found = path.stat()
    if not stat.S_ISREG(found.st_mode):
        raise ValueError("it is no regular file; name one that holds what is asked for")
    if found.st_size > most:
        raise ValueError(f"it has {found.st_size:,} bytes, and at most {most:,} are read; make it smaller")


def read_text(path: Path, most: int = MOST_TEXT) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises
    ------
    OSError, ValueError : where it cannot be read, is too large, or no such text.
    """
    require_file(path, most)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("it is not UTF-8 text; look at what it holds") from None


def parse_toml(text: str) -> dict[str, Any]:
    """Values of a TOML text.

    Raises
    ------
    ValueError : where it is none, or holds what `bounded` refuses.
    """
    if _LONG_KEY.search(text):
        raise ValueError(f"a key has more than {MOST_DEPTH} parts; write plain keys")
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"it is not TOML, {one_line(str(error), 200)}; write lines like size = 20.0") from None
    except RecursionError:
        raise ValueError(f"its values lie more than {MOST_DEPTH} deep; flatten them") from None
    except ValueError:  # Python's own limit
        raise ValueError("an integer has thousands of digits; write a number that fits") from None
    return bounded(values)


def parse_json(text: str) -> Any:
    """Values of a JSON text.

    Raises
    ------
    ValueError : where it is none, or holds what `bounded` refuses.
    """
    try:
        values = json.loads(text)
    except RecursionError:
        raise ValueError(f"its values lie more than {MOST_DEPTH} deep; flatten them") from None
    except ValueError as error:
        raise ValueError(f"it is not JSON: {one_line(str(error), 200)}") from None
    return bounded(values)


def parse_yaml(text: str) -> Any:
    """Values of a YAML text of plain values: it has neither aliases nor tags, and no key twice.

    Raises
    ------
    ValueError : where it is none, or holds what `bounded` refuses.
    """
    import yaml

    depth = 0
    try:
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            if isinstance(event, yaml.AliasEvent):
                raise ValueError(f"it has an alias, *{one_line(event.anchor, 40)}; write the value itself")
            if getattr(event, "tag", None) is not None:
                raise ValueError(f"it has a tag, {one_line(event.tag, 80)}; write plain values")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > MOST_DEPTH:
                raise ValueError(f"its values lie more than {MOST_DEPTH} deep; flatten them")
        _require_single_keys(yaml.compose(text, Loader=yaml.SafeLoader))
        try:
            values = yaml.safe_load(text)
        except ValueError as error:  # a date that is none, an integer of thousands of digits
            raise ValueError(f"it is not YAML: {one_line(str(error), 200)}; write plain values") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark else ""
        raise ValueError(f"it is not YAML{where}; write lines like resolution: 0.05") from None
    return bounded(values)


def _require_single_keys(node: Any) -> None:
    """Refuse a YAML node in which a key stands twice: the parser would take the last one in silence."""
    kind = getattr(node, "id", "")
    lines: dict[Any, int] = {}
    for key, value in node.value if kind == "mapping" else ():
        line = key.start_mark.line + 1
        if key.id == "scalar" and key.value in lines:
            name = one_line(key.value, 40)
            raise ValueError(f"it has the key {name} twice, in lines {lines[key.value]} and {line}; leave one")
        lines |= {key.value: line} if key.id == "scalar" else {}
        _require_single_keys(value)
    for item in node.value if kind == "sequence" else ():
        _require_single_keys(item)


def bounded(values: Any) -> Any:
    """Return nested values as they are.

    Raises
    ------
    ValueError : where they lie too deep in one another, are too many, or hold an integer of more than 64 bits.
    """
    waiting, count = [(values, 1)], 0
    while waiting:
        value, depth = waiting.pop()
        count += 1
        if depth > MOST_DEPTH:
            raise ValueError(f"its values lie more than {MOST_DEPTH} deep; flatten them")
        if count > MOST_VALUES:
            raise ValueError(f"it holds more than {MOST_VALUES:,} values; leave some out")
        if isinstance(value, int) and not -MOST_INTEGER <= value < MOST_INTEGER:
            raise ValueError(f"it holds an integer of {value.bit_length()} bits; write a number that fits in 64")
        if isinstance(value, Mapping):
            waiting += [(item, depth + 1) for item in value.values()]
        elif isinstance(value, list):
            waiting += [(item, depth + 1) for item in value]
    return values


def write_whole(path: Path, content: str | bytes) -> Path:
    """Write a file in the place of what was there, in one step, and return its path; text is UTF-8.

    Raises
    ------
    RequestError : where it cannot be written; what was there stays.
    """
    half = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    with writing(path):
        try:
            with half.open("wb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
                file.flush()
                os.fsync(file.fileno())
            half.replace(path)
        finally:
            half.unlink(missing_ok=True)
    return path
