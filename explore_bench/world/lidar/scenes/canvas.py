"""A raster that is drawn on in metres."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

OUTER_WALL = 0.2
"""Thickness [m] of the wall around every scene."""


class Box(NamedTuple):
    """An axis-aligned rectangle [m]; the origin is the lower left corner of the scene."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width(self) -> float:
        """Extent along x [m]."""
        return self.x1 - self.x0

    @property
    def height(self) -> float:
        """Extent along y [m]."""
        return self.y1 - self.y0

    @property
    def centre(self) -> tuple[float, float]:
        """Middle (x, y) [m]."""
        return (self.x0 + self.x1) / 2, (self.y0 + self.y1) / 2

    @property
    def turned(self) -> Box:
        """The box with x and y exchanged."""
        return Box(self.y0, self.x0, self.y1, self.x1)

    def grown(self, margin: float) -> Box:
        """Box with this much more [m] on every side; less where it is negative."""
        return Box(self.x0 - margin, self.y0 - margin, self.x1 + margin, self.y1 + margin)

    def within(self, other: Box) -> Box:
        """Part that lies in another box."""
        return Box(max(self.x0, other.x0), max(self.y0, other.y0), min(self.x1, other.x1), min(self.y1, other.y1))


class Canvas:
    """Obstacles of a square scene, drawn shape by shape; what lies beyond its edge is cut off.

    Parameters
    ----------
    size, resolution : edge of the scene and of a cell [m].

    Attributes
    ----------
    inside : what the outer wall encloses.
    obstacles : shape (n, n), n = size / resolution, rows along y.
    kept_free : cells in front of doors, where no furniture stands; the same shape.
    """

    def __init__(self, size: float, resolution: float) -> None:
        n = round(size / resolution)
        self.resolution = resolution
        self.inside = Box(0.0, 0.0, size, size).grown(-OUTER_WALL)
        self.obstacles: NDArray[np.bool_] = np.zeros((n, n), dtype=bool)
        self.kept_free: NDArray[np.bool_] = np.zeros((n, n), dtype=bool)

    def fill(self, box: Box) -> None:
        """Make a box an obstacle, at least one cell wide."""
        self.obstacles[self._cells(box)] = True

    def clear(self, box: Box) -> None:
        """Make a box free."""
        self.obstacles[self._cells(box)] = False

    def keep_free(self, box: Box) -> None:
        """Let no furniture stand in a box."""
        self.kept_free[self._cells(box)] = True

    def fill_disc(self, x: float, y: float, radius: float) -> None:
        """Make an obstacle of the cells whose centre lies in a disc [m]."""
        rows, columns = self._cells(Box(x, y, x, y).grown(radius + self.resolution))
        ys = (np.arange(rows.start, rows.stop) + 0.5) * self.resolution - y
        xs = (np.arange(columns.start, columns.stop) + 0.5) * self.resolution - x
        self.obstacles[rows, columns] |= ys[:, None] ** 2 + xs**2 <= radius**2

    def is_clear(self, box: Box) -> bool:
        """Whether a box holds no obstacle."""
        return not self.obstacles[self._cells(box)].any()

    def may_stand(self, box: Box) -> bool:
        """Whether a box leaves the places in front of doors free."""
        return not self.kept_free[self._cells(box)].any()

    def enclosed(self) -> NDArray[np.bool_]:
        """Obstacles with the outer wall around them, at least two cells thick."""
        thick = max(self._edge(OUTER_WALL), 2)
        for side in (np.s_[:thick], np.s_[-thick:], np.s_[:, :thick], np.s_[:, -thick:]):
            self.obstacles[side] = True
        return self.obstacles

    def _cells(self, box: Box) -> tuple[slice, slice]:
        """Rows and columns of a box, each edge at the nearest border between cells."""
        return self._span(box.y0, box.y1), self._span(box.x0, box.x1)

    def _span(self, low: float, high: float) -> slice:
        first, n = self._edge(low), len(self.obstacles)
        last = max(self._edge(high), first + 1)
        return slice(min(max(first, 0), n), min(max(last, 0), n))

    def _edge(self, position: float) -> int:
        return math.floor(position / self.resolution + 0.5)


def divided(low: float, high: float, least: float, most: float, rng: np.random.Generator) -> list[float]:
    """Cut a length at random into parts of about `least` to `most` metres; its ends and cuts, ascending.

    One part where it is too short for two.
    """
    fewest = max(math.ceil((high - low) / most), 1)
    parts = int(rng.integers(fewest, max(math.floor((high - low) / least), fewest) + 1))
    shares = rng.uniform(0.75, 1.25, parts)
    cuts = low + (high - low) * np.cumsum(shares) / shares.sum()
    return [low, *cuts[:-1].tolist(), high]
