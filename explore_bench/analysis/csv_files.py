"""The CSV files of a results folder: the columns that name a trial, how one is read and written; values as in JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.api.types import is_numeric_dtype

from explore_bench.analysis.rounding import significant
from explore_bench.errors import RequestError, one_line
from explore_bench.files import require_file, write_whole

KEYS = ["strategy", "training_seed", "size", "trial", "scenario"]
"""Columns that name a trial."""

MOST_BYTES = 1_000_000_000
"""A million trials or two."""

TEXTS = ("strategy", "world", "status", "scenario", "table", "metric")
"""Columns of words among those that are read back; all others hold numbers."""


def read_csv(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    """Read one of the tables of a results folder.

    Raises
    ------
    RequestError : where the file is missing or is no such table.
    """
    try:
        require_file(path, MOST_BYTES)
        table = pd.read_csv(path, dtype={"training_seed": "Int64"}, keep_default_na=True)
    except (OSError, ValueError, TypeError, OverflowError) as error:
        reason = one_line(getattr(error, "strerror", None) or str(error), 200)
        raise RequestError(f"'{path}' cannot be read ({reason}); run 'explore-bench run SUITE' to make it.") from None
    lacking = [name for name in columns if name not in table.columns]
    if lacking:
        raise RequestError(f"'{path}' lacks the column '{lacking[0]}'; delete it and run again.")
    worded = [name for name in columns if name not in TEXTS and len(table) and not is_numeric_dtype(table[name])]
    if worded:
        raise RequestError(f"'{path}' has something else than numbers in '{worded[0]}'; delete it and run again.")
    return table


def write_table(table: pd.DataFrame, path: Path) -> Path:
    """Write one of these tables, whole or not at all, and return its path.

    Raises
    ------
    RequestError : where it cannot be written.
    """
    return write_whole(path, table.to_csv(index=False, lineterminator="\n"))


def plain(value: Any) -> Any:
    """Nested values as JSON knows them: tuples as lists, numbers rounded, those that are not finite as None."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return float(significant(np.array(value))) if math.isfinite(value) else None
    return value
