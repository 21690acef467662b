"""Maps drawn as images: bright is free, dark is an obstacle, a red dot is the start."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from explore_bench.files import require_file
from explore_bench.world.maps.raster import FREE_PIXEL, MAX_PIXELS, Raster, check_pixels, classified

FORMATS = ("PNG", "PPM", "BMP")
MAX_BYTES = 8 * MAX_PIXELS


def read_image(path: Path, resolution: float) -> Raster:
    """Map of an image, a pixel of an edge [m].

    With the thresholds of `raster` on 1 − brightness, brighter than 0.804 is free, darker than 0.35 an obstacle, what
    lies between or is transparent is unknown. One red dot (red ≥ 200, green and blue ≤ 60) is the start, and free.

    Raises
    ------
    OSError, ValueError : for a file that cannot be read, is damaged or too large, or has two red dots.
    """
    values, colors = load(path)
    pixels = classified((255.0 - values) / 255.0)
    red = (colors[..., 0] >= 200) & (colors[..., 1:3].max(axis=-1) <= 60) & (colors[..., 3] > 0)
    pixels[red] = FREE_PIXEL
    return Raster(pixels, resolution, start=_start(red, resolution))


def load(path: Path) -> tuple[NDArray[np.floating], NDArray[np.uint8]]:
    """Values from 0 (black) to 255, NaN where transparent, shape (h, w), and colours RGBA, shape (h, w, 4).

    A value is the mean of the colours, as map_server takes it.

    Raises
    ------
    OSError, ValueError : for a file that cannot be read, is damaged or too large.
    """
    from PIL import Image

    require_file(path, MAX_BYTES)
    content = path.open("rb")
    with content, warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # we have a limit of our own
        try:
            image = Image.open(content, formats=FORMATS)
        except Image.DecompressionBombError:
            raise ValueError(f"'{path.name}' has more than {MAX_PIXELS:,} pixels; crop it, or scale it down") from None
        except Exception as error:
            raise ValueError(_damaged(path, error)) from None
        check_pixels(*image.size)
        try:
            deep = np.asarray(image, dtype=np.float32) / np.float32(257.0) if image.mode.startswith("I") else None
            colors = np.asarray(image.convert("RGBA"))
        except Exception as error:  # pillow raises nearly anything on a damaged file
            raise ValueError(_damaged(path, error)) from None
    values = colors[..., :3].mean(axis=-1, dtype=np.float32) if deep is None else deep
    values[colors[..., 3] == 0] = np.nan
    return values, colors


def _damaged(path: Path, error: Exception) -> str:
    reason = " ".join(str(error).split()) or type(error).__name__
    if "cannot identify" in reason:
        reason = f"none of {', '.join(FORMATS)}"
    return f"'{path.name}' is no whole image ({reason}); export it anew"


def _start(red: NDArray[np.bool_], resolution: float) -> tuple[float, float] | None:
    """Middle [m] of the one dot in an image, None where there is none."""
    from scipy import ndimage

    _, dots = ndimage.label(red, np.ones((3, 3)))
    if dots > 1:
        raise ValueError(f"it has {dots} red dots; leave one for the start")
    if not dots:
        return None
    rows, columns = np.nonzero(red)
    return float(columns.mean() + 0.5) * resolution, float(len(red) - rows.mean() - 0.5) * resolution
