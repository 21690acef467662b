"""Maps saved by numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from explore_bench.files import require_file
from explore_bench.world.maps.raster import (
    FREE_BELOW,
    MAX_PIXELS,
    OCCUPIED_ABOVE,
    OCCUPIED_PIXEL,
    Raster,
    between,
    check_pixels,
    classified,
)

MAX_BYTES = 16 * MAX_PIXELS + 10_000


def read_array(path: Path, resolution: float) -> Raster:
    """Map of a .npy file, its first row the northernmost, an entry a pixel of an edge [m].

    Boolean entries are True for an obstacle. Numbers are probabilities of being occupied, from 0 to 1 or, where one
    exceeds 1, from 0 to 100 as in nav_msgs/OccupancyGrid, with the thresholds of `raster`; negative and NaN: unknown.

    Raises
    ------
    OSError, ValueError : for a file that cannot be read, or holds something else.
    """
    require_file(path, MAX_BYTES)
    try:
        with np.errstate(all="ignore"):  # a shape that no memory holds
            array = np.load(path, mmap_mode="r", allow_pickle=False)
    except OSError:
        raise
    except Exception:  # numpy raises nearly anything on a damaged header
        raise ValueError("it is no whole .npy file of plain numbers; save a 2-D array with numpy.save") from None
    if not isinstance(array, np.ndarray) or array.ndim != 2 or array.dtype.kind not in "biuf":
        what = f"{array.ndim} axes of {array.dtype}" if isinstance(array, np.ndarray) else "several arrays"
        raise ValueError(f"it holds {what}; save a 2-D array of truth values or numbers")
    check_pixels(array.shape[1], array.shape[0])
    if array.dtype.kind == "b":
        return Raster(array.astype(np.uint8) * OCCUPIED_PIXEL, resolution)
    with np.errstate(over="ignore"):  # a number that is refused below
        values = array.astype(np.float32)
    values[values < 0] = np.nan
    largest = float(np.fmax.reduce(values, axis=None, initial=0.0))
    if largest > 100:
        raise ValueError(
            f"its largest value is {largest:g}; save probabilities from 0 to 1, or from 0 to 100, and -1 for unknown"
        )
    if largest > 1:
        values /= np.float32(100.0)
    pixels = classified(values)
    notes = between(values, pixels, "probability", f"below {FREE_BELOW:g}", f"above {OCCUPIED_ABOVE:g}")
    return Raster(pixels, resolution, notes=notes)
