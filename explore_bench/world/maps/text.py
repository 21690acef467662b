"""Maps drawn with characters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from explore_bench.files import read_text as text_of
from explore_bench.world.floor_plan import BLANK, FREE, OBSTACLE, START, UNKNOWN
from explore_bench.world.maps.raster import FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL, Raster, check_pixels

_PIXELS = {OBSTACLE: OCCUPIED_PIXEL, FREE: FREE_PIXEL, START: FREE_PIXEL, UNKNOWN: UNKNOWN_PIXEL, BLANK: UNKNOWN_PIXEL}


def read_text(path: Path, resolution: float) -> Raster:
    """Map of rows of text, a character a pixel of an edge [m]: `#` obstacle, `.` free, `?` or blank unknown, `S` start.

    Raises
    ------
    OSError, ValueError : for a file that cannot be read, or holds something else.
    """
    return raster_of(text_of(path).splitlines(), resolution)


def raster_of(rows: Sequence[str], resolution: float) -> Raster:
    """Map of rows of text, the first the northernmost; see `read_text`.

    Raises
    ------
    ValueError : for no characters, too many, another one, or a second start.
    """
    width = max(map(len, rows), default=0)
    check_pixels(width, len(rows))
    strange = sorted(set("".join(rows)) - _PIXELS.keys())
    if strange:
        row = next(number for number, row in enumerate(rows, start=1) if strange[0] in row)
        raise ValueError(f"row {row} holds {strange[0]!r}; draw with # (obstacle), . (free), ? (unknown) and S (start)")
    text = np.array([list(row.ljust(width)) for row in rows])
    pixels = np.full(text.shape, UNKNOWN_PIXEL, dtype=np.uint8)
    for character, pixel in _PIXELS.items():
        pixels[text == character] = pixel
    starts = np.argwhere(text == START)
    if len(starts) > 1:
        raise ValueError(f"it has {len(starts)} starts; leave one S")
    start = None
    if len(starts):
        row, column = starts[0].tolist()
        start = (column + 0.5) * resolution, (len(rows) - row - 0.5) * resolution
    return Raster(pixels, resolution, start=start)
