"""An array that grows by rows, doubling its room: appending is cheap and memory stays linear."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray


class Rows:
    """Rows of one shape and type; `view` is the part in use, sharing memory."""

    def __init__(self, shape: tuple[int, ...] = (), dtype: DTypeLike = np.float64) -> None:
        self._array: NDArray[Any] = np.empty((64, *shape), dtype=dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def view(self) -> NDArray[Any]:
        """The rows in use, shape (len, …)."""
        return self._array[: self._count]

    def resize(self, count: int) -> None:
        """Use `count` rows; those that are new hold nothing in particular."""
        if count > len(self._array):
            larger = np.empty((max(count, 2 * len(self._array)), *self._array.shape[1:]), self._array.dtype)
            larger[: self._count] = self.view
            self._array = larger
        self._count = count

    def append(self, row: ArrayLike) -> None:
        """Add one row."""
        self.resize(self._count + 1)
        self._array[self._count - 1] = row
