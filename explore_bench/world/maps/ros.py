"""Maps of ROS: the .yaml and the image that map_saver writes and map_server reads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from explore_bench.errors import one_line
from explore_bench.files import parse_yaml, read_text
from explore_bench.world.maps.images import grey_notes, load
from explore_bench.world.maps.raster import FREE_BELOW, OCCUPIED_ABOVE, RESOLUTIONS, Raster, classified, rotated

KEYS = ("image", "resolution", "origin")
USUAL = {"negate": 0, "occupied_thresh": OCCUPIED_ABOVE, "free_thresh": FREE_BELOW}
"""What map_saver writes, for keys that a file by hand leaves out."""

MODES = ("trinary", "scale", "raw")
MAX_METRES = 1e7


def read_ros(path: Path) -> Raster:
    """Map of a map_server pair, by the rules of ROS 2's (nav2_map_server, `map_io.cpp`).

    The level of a pixel is the mean of its colours, in the mode `trinary` of an image with alpha that of its colours
    and alpha, as ROS 1 averaged all channels: opaque 205 is free there, and what is transparent and black an obstacle.
    p = (255 − level) / 255, or level / 255 where `negate` is set. In the mode

    - `trinary`, occupied is p > occupied_thresh, free is p < free_thresh, and the rest unknown;
    - `scale`, the same, but what is not opaque is unknown, and what lies between is 100 (p − free_thresh) /
      (occupied_thresh − free_thresh), rounded;
    - `raw`, the level itself, 0 to 100, whatever `negate` says; above, unknown.

    The last two give the percentages of nav_msgs/OccupancyGrid, which are read as those of an array are: above 65 an
    obstacle, below 19.6 free. `origin` is the pose of the lower left corner: the image is turned by its yaw, of which
    map_server itself makes nothing but a part of the message.

    Raises
    ------
    OSError, ValueError : for a file that cannot be read, or says something that is not understood.
    """
    values, notes = _values(path)
    mode = values.get("mode", MODES[0])
    if not isinstance(mode, str) or mode.lower() not in MODES:
        raise ValueError(f"mode is {_shown(mode)}; give one of {', '.join(MODES)}")
    mode = mode.lower()
    occupied, free = (_number(values, name, 0.0, 1.0) for name in ("occupied_thresh", "free_thresh"))
    if free >= occupied and mode != "raw":
        raise ValueError(f"free_thresh {free:g} is not below occupied_thresh {occupied:g}; exchange them")
    negate = values["negate"]
    if negate not in (0, 1):
        raise ValueError(f"negate is {_shown(negate)}; give 0 or 1")
    resolution = _number(values, "resolution", *RESOLUTIONS)
    x, y, yaw = _origin(values["origin"])
    if not isinstance(values["image"], str):
        raise ValueError(f"image is {_shown(values['image'])}; give the name of a file")
    levels, colors, has_alpha = load(path.parent / values["image"])
    if mode == "trinary" and has_alpha:
        levels = (3.0 * levels + colors[..., 3]) / 4.0
        notes.append("its image has alpha, which is averaged with the colours, as map_server does in the mode trinary")
    if mode == "raw":
        pixels = classified(np.where(np.round(levels) <= 100, np.round(levels) / 100.0, np.nan))
    else:
        probability = (levels if negate else 255.0 - levels) / 255.0
        if mode == "scale":
            pixels = classified(_scaled(probability, colors[..., 3] == 255, occupied, free))
        else:
            pixels = classified(probability, occupied, free)
            bounds = (255.0 * (p if negate else 1.0 - p) for p in (free, occupied))
            notes += grey_notes(levels, pixels, *bounds)
    return rotated(Raster(pixels, resolution, (x, y), notes=tuple(notes)), yaw)


def _scaled(
    probability: NDArray[np.floating], opaque: NDArray[np.bool_], occupied: float, free: float
) -> NDArray[np.floating]:
    """Probabilities of the mode `scale`, NaN for unknown, of those of the levels, shape as given."""
    shares = np.rint(np.clip((probability - free) / (occupied - free), 0.0, 1.0) * 100.0) / 100.0
    shares[probability > occupied], shares[probability < free] = 1.0, 0.0
    shares[~opaque] = np.nan
    return np.asarray(shares)


def _values(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Values of a .yaml with the usual ones where keys are missing, and sentences on these."""
    values = parse_yaml(read_text(path))
    if not isinstance(values, dict):
        raise ValueError("it holds no keys; write lines like resolution: 0.05")
    missing = [name for name in KEYS if name not in values]
    if missing:
        raise ValueError(f"it lacks {', '.join(missing)}; a map of map_server has {', '.join((*KEYS, *USUAL))}")
    assumed = {name: value for name, value in USUAL.items() if name not in values}
    notes = [f"it does not say {name}, and {value:g} is taken" for name, value in assumed.items()]
    return assumed | values, notes


def _number(values: dict[str, Any], name: str, low: float, high: float) -> float:
    """Value of a key as a number; YAML takes 5e-2 for text."""
    value = values[name]
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not low <= number <= high:
        raise ValueError(f"{name} is {_shown(value)}; give a number from {low:g} to {high:g}")
    return number


def _origin(value: Any) -> tuple[float, float, float]:
    """Pose (x, y, yaw) [m, rad] of the lower left corner."""
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"origin is {_shown(value)}; give [x, y, yaw]")
    names = dict(zip(("origin's x", "origin's y", "origin's yaw"), value, strict=True))
    x, y, yaw = (_number(names, name, -MAX_METRES, MAX_METRES) for name in names)
    return x, y, yaw


def _shown(value: Any) -> str:
    return one_line(repr(value), 80)
