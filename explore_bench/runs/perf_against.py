"""A measurement of `perf` beside a stored one: ratios only, for microseconds of two machines say nothing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from explore_bench.errors import RequestError
from explore_bench.runs.perf import ISAM2, LENGTHS, SIZES, Perf, read_json


def read_stored(path: Path) -> Perf:
    """Read a measurement that `explore-bench perf --json` stored.

    Raises
    ------
    RequestError : where the file is none.
    """
    try:
        stored = read_json(path)
        dict(_ratios(stored))
    except OSError as error:
        raise RequestError(f"'{path}' cannot be read: {error.strerror}; name a file of perf --json.") from None
    except (ValueError, TypeError, KeyError, AttributeError):
        raise RequestError(f"'{path}' holds no measurement of perf; name a file of perf --json.") from None
    return stored


def comparison(then: Perf, now: Perf) -> str:
    """Return both as a table: each number, and now to then.

    All times are in iSAM2's updates of the same run and size, so that a slower machine shows in none of them. What only
    one of the two has is left out.
    """
    before, after = dict(_ratios(then)), dict(_ratios(now))
    lines = ["in iSAM2's updates of the same run              then       now  now/then"]
    lines += [
        f"{name:<40}{before[name]:>12.2f}{after[name]:>10.2f}{after[name] / before[name]:>10.2f}"
        for name in before
        if name in after and before[name] > 0.0
    ]
    return "\n".join(lines)


def _ratios(perf: Perf) -> Iterator[tuple[str, float]]:
    """Name and value of all that a measurement says apart from its machine's speed."""
    for size in SIZES:
        key = f"{size:g}"
        own = [part for part in perf.parts if part.size == size]
        for length in (None, *LENGTHS):
            where = f"{key} m" if length is None else f"{key} m, {length} poses"
            yield from (
                (f"{where}: {part.name}", part.to_isam2) for part in own if part.length == length and part.name != ISAM2
            )
        yield f"{key} m: all steps to all updates", perf.step_to_isam2_ratio[key]
        yield f"{key} m: step at 1000 poses to 100", perf.step_growth_1000_over_100[key]
        unit = next((part.median_us for part in own if part.name == ISAM2 and part.length is None), None)
        if unit is None:
            continue
        for what, seconds, times in (("decision", 1e-3, perf.decision_ms), ("trial", 1.0, perf.trial_cpu_s)):
            for name, by_size in times.items():
                if by_size.get(key):  # null where it made no decision
                    yield f"{key} m: {what} of {name}", by_size[key] * seconds / (1e-6 * unit)
