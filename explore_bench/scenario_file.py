"""Scenarios by name and from TOML files."""

from __future__ import annotations

import tomllib
from pathlib import Path

from explore_bench.errors import RequestError, unknown
from explore_bench.scenario import SCENARIOS, Scenario


def load_scenario(name_or_file: str) -> Scenario:
    """Scenario of a registered name or of a TOML file.

    A file holds constants by name, and may start from a named scenario: `extends = "chen2020"` (default: paper).

    Raises
    ------
    RequestError : for an unknown name, an unreadable or foreign file, an unknown key or a value out of range.
    """
    if name_or_file in SCENARIOS:
        return SCENARIOS[name_or_file][0]
    path = Path(name_or_file)
    if path.suffix != ".toml":
        raise unknown("scenario", name_or_file, SCENARIOS)
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise RequestError(f"scenario file '{path}' cannot be read ({reason}); give a TOML file.") from None
    except tomllib.TOMLDecodeError as error:
        raise RequestError(f"scenario file '{path}' is not TOML ({error}); write lines like size = 20.0.") from None
    base = values.pop("extends", "paper")
    if not isinstance(base, str) or base not in SCENARIOS:
        raise unknown(f"scenario file '{path}': extends", str(base), SCENARIOS)
    for kind in ("landmark", "obstacle"):
        if {f"{kind}_density", f"{kind}_count"} <= values.keys():
            raise RequestError(f"scenario file '{path}' gives {kind}_density and {kind}_count; give one of them.")
    try:
        return SCENARIOS[base][0].replace(**values)
    except RequestError as error:
        raise RequestError(f"scenario file '{path}': {error}") from None
