"""Maps of ROS: the .yaml and the image that map_saver writes and map_server reads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from explore_bench.errors import one_line
from explore_bench.files import parse_yaml, read_text
from explore_bench.world.maps.images import load
from explore_bench.world.maps.raster import RESOLUTIONS, Raster, classified

KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
MAX_METRES = 1e7


def read_ros(path: Path) -> Raster:
    """Map of a map_server pair in the mode `trinary`.

    p = (255 − value) / 255, or value / 255 where `negate` is set; occupied where p > occupied_thresh, free where
    p < free_thresh, else unknown, as a transparent pixel is. `origin` is the lower left corner, its yaw 0.

    Raises
    ------
    OSError, ValueError : for a file that cannot be read, or says something that is not understood.
    """
    values = _values(path)
    mode = values.get("mode", "trinary")
    if mode != "trinary":
        raise ValueError(f"mode {_shown(mode)} is not supported; save the map in the mode trinary")
    occupied, free = (_number(values, name, 0.0, 1.0) for name in ("occupied_thresh", "free_thresh"))
    if free >= occupied:
        raise ValueError(f"free_thresh {free:g} is not below occupied_thresh {occupied:g}; exchange them")
    negate = values["negate"]
    if negate not in (0, 1):
        raise ValueError(f"negate is {_shown(negate)}; give 0 or 1")
    resolution = _number(values, "resolution", *RESOLUTIONS)
    origin = _origin(values["origin"])
    if not isinstance(values["image"], str):
        raise ValueError(f"image is {_shown(values['image'])}; give the name of a file")
    levels, _ = load(path.parent / values["image"])
    probability = (levels if negate else 255.0 - levels) / 255.0
    return Raster(classified(probability, occupied, free), resolution, origin)


def _values(path: Path) -> dict[str, Any]:
    values = parse_yaml(read_text(path))
    if not isinstance(values, dict):
        raise ValueError("it holds no keys; write lines like resolution: 0.05")
    missing = [name for name in KEYS if name not in values]
    if missing:
        raise ValueError(f"it lacks {', '.join(missing)}; a map of map_server has {', '.join(KEYS)}")
    return values


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


def _origin(value: Any) -> tuple[float, float]:
    """Lower left corner (x, y) [m] of an origin (x, y, yaw)."""
    if not isinstance(value, list) or len(value) != 3:
        raise ValueError(f"origin is {_shown(value)}; give [x, y, yaw]")
    names = dict(zip(("origin's x", "origin's y", "origin's yaw"), value, strict=True))
    x, y, yaw = (_number(names, name, -MAX_METRES, MAX_METRES) for name in names)
    if abs(yaw) > 1e-6:
        raise ValueError(f"origin's yaw is {yaw:g}; turn the image until it is 0")
    return x, y


def _shown(value: Any) -> str:
    return one_line(repr(value), 80)
