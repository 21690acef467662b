"""What another machine computes otherwise lies in the last digits; tables keep those before them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

DIGITS = 7
"""Significant digits of a measured number, in every table and figure."""

ROUNDING = 10.0 ** (1 - DIGITS)
"""Values that differ by no more than this share of them are tied: another machine may round them the other way."""


def significant(values: np.ndarray) -> np.ndarray:
    """Values with DIGITS significant digits, of the same shape."""
    values = np.asarray(values, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        places = DIGITS - 1 - np.floor(np.log10(np.abs(values)))
        scale = 10.0 ** np.abs(places)
        shortened = np.where(places >= 0.0, np.rint(values * scale) / scale, np.rint(values / scale) * scale)
    return np.where(np.isfinite(places) & np.isfinite(shortened), shortened, values)


def rounded(table: pd.DataFrame) -> pd.DataFrame:
    """Copy of a table in which every number that is no whole one has DIGITS significant digits."""
    numbers = [name for name in table.columns if table[name].dtype.kind == "f"]
    return table.assign(**{name: significant(table[name].to_numpy()) for name in numbers})
