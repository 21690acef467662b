"""What a gate tolerates: the declared family of strategies and metrics, read from `thresholds.toml`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from explore_bench.analysis.csv_files import KEYS
from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.times import EVERY_DECISION, TIME_COLUMNS
from explore_bench.errors import RequestError, unknown
from explore_bench.files import parse_toml, read_text
from explore_bench.strategies.registry import entry_named

MAX_PAIRS = 6
"""Largest family unless the file allows more: each member costs the others power."""

TIMES = {"time", *TIME_COLUMNS, EVERY_DECISION} - {*KEYS, "steps", "decisions"}
"""What nobody may gate: another machine, or a busy one, would be a regression."""


class Threshold(BaseModel):
    """How much worse a metric of a strategy may become.

    Attributes
    ----------
    size : edge of the map [m].
    tolerance : loss that is tolerated, as a share of the reference's mean.
    reason : why so much, for whoever meets it in a failed check.
    direction : which is better; from the metric's definition, and checked against it where it is written.
    scenario : name of the physical constants, as in the column of `trials.csv`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    metric: str
    strategy: str
    size: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    tolerance: Annotated[float, Field(gt=0, lt=1)]
    reason: Annotated[str, Field(min_length=1)]
    direction: Literal["lower", "higher"] | None = None
    scenario: str = "paper"

    @property
    def sign(self) -> float:
        """1 where a larger value is worse, else −1."""
        return 1.0 if METRICS[self.metric].better == "lower" else -1.0

    @property
    def place(self) -> str:
        """Strategy, size and scenario in words."""
        return f"{self.strategy}, {self.size:g} m, {self.scenario}"


class _File(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    threshold: list[Threshold] = Field(min_length=1)
    max_pairs: Annotated[int, Field(ge=1)] = MAX_PAIRS


def load_thresholds(path: Path) -> tuple[Threshold, ...]:
    """Read a declared family.

    Raises
    ------
    RequestError : for a file that cannot be read or is no TOML, an unknown key or metric, a metric of time or without
        a direction, a value out of range, one pair declared twice, or too many of them.
    """
    try:
        values = parse_toml(read_text(path))
    except OSError as error:
        raise RequestError(
            f"'{path}' cannot be read ({error.strerror}); write [[threshold]] entries into it, see docs/gate.md."
        ) from None
    except ValueError as error:
        raise RequestError(f"'{path}': {error}.") from None
    try:
        file = _File(**values)
        return _checked(tuple(file.threshold), file.max_pairs)
    except ValidationError as error:
        raise RequestError(f"'{path}': {_sentence(error)}") from None
    except RequestError as error:
        raise RequestError(f"'{path}': {error}") from None


def _checked(family: tuple[Threshold, ...], most: int) -> tuple[Threshold, ...]:
    for one in family:
        _check_metric(one)
    pairs = [(one.metric, one.strategy, one.size, one.scenario) for one in family]
    twice = next((one for one, pair in zip(family, pairs, strict=True) if pairs.count(pair) > 1), None)
    if twice is not None:
        raise RequestError(f"{twice.metric} of '{twice.strategy}' at {twice.size:g} m is declared twice; keep one.")
    if len(family) > most:
        raise RequestError(
            f"{len(family)} pairs are more than max_pairs {most}, and each costs the others power; drop some, or "
            f"write max_pairs = {len(family)} above them."
        )
    return family


def _check_metric(one: Threshold) -> None:
    if one.metric in TIMES:
        raise RequestError(
            f"metric '{one.metric}' is a time, which differs from run to run and is never gated; drop it, "
            "'explore-bench perf' measures times."
        )
    gated = {name: metric.better for name, metric in METRICS.items() if metric.better}
    if one.metric not in METRICS:
        raise unknown("metric", one.metric, gated)
    if one.metric not in gated:
        raise RequestError(f"metric '{one.metric}' is better in no direction; gate one of {', '.join(gated)}.")
    if not entry_named(one.strategy).fills(one.metric):
        raise RequestError(
            f"metric '{one.metric}' is none that the reference '{one.strategy}' plans for; gate another."
        )
    if one.direction not in (None, gated[one.metric]):
        raise RequestError(
            f"direction of {one.metric} is '{one.direction}', but by its definition {gated[one.metric]} is better; "
            "write that or leave it out."
        )


def _sentence(error: ValidationError) -> str:
    first: Any = error.errors()[0]
    where = first["loc"]
    key = str(where[-1]) if where else ""
    entry = f"threshold {where[1] + 1}: " if len(where) > 1 and isinstance(where[1], int) else ""
    if first["type"] == "extra_forbidden":
        return entry + str(unknown("key", key, (Threshold if entry else _File).model_fields))
    if first["type"] == "missing":
        return f"{entry}{key} is missing; write it."
    if first["type"] == "too_short" and key == "threshold":
        return "it declares no threshold; write [[threshold]] entries into it."
    reason = first["msg"][0].lower() + first["msg"][1:]
    fix = f"{reason}, a share such as 0.05" if key == "tolerance" else reason
    return f"{entry}{key} is {first['input']!r}; {fix}."
