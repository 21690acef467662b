"""Maps drawn as images: bright is free, dark is an obstacle, a red dot is the start."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from explore_bench.files import require_file
from explore_bench.world.maps.raster import (
    FREE_BELOW,
    FREE_PIXEL,
    MAX_PIXELS,
    OCCUPIED_ABOVE,
    Raster,
    between,
    check_pixels,
    classified,
)

FORMATS = ("PNG", "PPM", "BMP", "JPEG", "GIF")
"""As pillow names them; PPM is PGM and PBM, too. Of an animation the first picture is the map."""

SUFFIXES = (".png", ".pgm", ".pbm", ".ppm", ".pnm", ".bmp", ".jpg", ".jpeg", ".gif")
MAX_BYTES = 8 * MAX_PIXELS


def read_image(path: Path, resolution: float) -> Raster:
    """Map of an image, a pixel of an edge [m].

    With the thresholds of `raster` on 1 − brightness, brighter than 0.804 is free, darker than 0.35 an obstacle, what
    lies between or is transparent is unknown. One red dot (red ≥ 200, green and blue ≤ 60) is the start, and free.

    Raises
    ------
    OSError, ValueError : for a file that cannot be read, is damaged or too large, or has two red dots.
    """
    levels, colors, _ = load(path)
    levels[colors[..., 3] == 0] = np.nan
    pixels = classified((255.0 - levels) / 255.0)
    red = (colors[..., 0] >= 200) & (colors[..., 1:3].max(axis=-1) <= 60) & (colors[..., 3] > 0)
    pixels[red] = FREE_PIXEL
    notes = grey_notes(levels, pixels, 255.0 * (1.0 - FREE_BELOW), 255.0 * (1.0 - OCCUPIED_ABOVE))
    return Raster(pixels, resolution, start=_start(red, resolution), notes=notes)


def grey_notes(
    levels: NDArray[np.floating], pixels: NDArray[np.uint8], free: float, occupied: float
) -> tuple[str, ...]:
    """Sentences on levels of grey that read as unknown, between the level that is `free` and that is `occupied`."""
    to_free, to_occupied = ("brighter", "darker") if free > occupied else ("darker", "brighter")
    return between(levels, pixels, "grey", f"{to_free} than {free:.0f}", f"{to_occupied} than {occupied:.0f}")


def load(path: Path) -> tuple[NDArray[np.floating], NDArray[np.uint8], bool]:
    """Levels from 0 (black) to 255, shape (h, w), colours RGBA, shape (h, w, 4), and whether the image has alpha.

    A level is the mean of red, green and blue.

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
            has_alpha = image.has_transparency_data
            colors = np.asarray(image.convert("RGBA"))
        except Exception as error:  # pillow raises nearly anything on a damaged file
            raise ValueError(_damaged(path, error)) from None
    levels = colors[..., :3].mean(axis=-1, dtype=np.float32) if deep is None else deep
    return levels, colors, has_alpha


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
