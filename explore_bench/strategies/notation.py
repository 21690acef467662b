"""How a strategy with parameters is written: NAME[key=value,…], the values as in TOML."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

from explore_bench.errors import RequestError
from explore_bench.files import parse_toml

_WRITTEN = re.compile(r"(?P<name>.+?\.py:\w+|[\w.]+:\w+|[^\[:]+)\[(?P<values>.*)\]", re.DOTALL)
_UNQUOTED = re.compile(r"""(?P<key>[\w-]+\s*=\s*)(?P<text>[^\s,="'{}\[\]]+)""")
_TOML_WORD = re.compile(r"true|false|[+-]?(inf|nan|\d\S*)")


def split_parameters(written: str) -> tuple[str, dict[str, Any]]:
    """Split NAME[key=value,…] into its name and its parameters; without brackets there are none.

    The values are those of a TOML inline table: 0.5, true, "text", [1, 2]. A text without quotes is taken for one
    where the whole would not be TOML otherwise: [weights=mine.safetensors].

    Raises
    ------
    RequestError : where the brackets hold something else.
    """
    parts = _WRITTEN.fullmatch(written)
    if parts is None:
        return written, {}
    return parts["name"], _parameters(written, parts["values"])


def _parameters(written: str, values: str) -> dict[str, Any]:
    try:
        found = _inline_table(values)
    except ValueError:
        try:
            found = _inline_table(_UNQUOTED.sub(_quoted, values))
        except ValueError as error:
            reason = str(error).removeprefix("it is not TOML, ").partition("; ")[0].partition(" (")[0]
            raise RequestError(
                f"strategy '{written}': '{values}' does not read key=value,… ({reason}); write "
                """values like 0.5, true, "text" or [1, 2]."""
            ) from None
    try:
        json.dumps(found)
    except TypeError:
        raise RequestError(f"strategy '{written}': a value is a date; give numbers, texts and lists.") from None
    if any(isinstance(value, float) and math.isnan(value) for value in found.values()):
        raise RequestError(f"strategy '{written}': a value is nan; give a number.")
    return found


def _inline_table(values: str) -> dict[str, Any]:
    whole = parse_toml(f"parameters = {{{values}}}")
    if whole.keys() != {"parameters"}:
        raise ValueError("it has more than one line")
    return dict(whole["parameters"])


def _quoted(match: re.Match[str]) -> str:
    key, text = match["key"], match["text"]
    return match[0] if _TOML_WORD.fullmatch(text) else f"{key}{json.dumps(text)}"


def written_parameters(parameters: Mapping[str, Any]) -> str:
    """Canonical form of parameters: `alpha=0.5, name="x"`, sorted by key; split_parameters reads it."""
    return ", ".join(f"{_key(key)}={_value(parameters[key])}" for key in sorted(parameters))


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{{written_parameters(value)}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return json.dumps(value, ensure_ascii=False)
