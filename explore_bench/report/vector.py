"""Small vector graphics: what matplotlib writes as SVG, in fewer bytes and fit to stand in a page beside others.

Nothing is rasterized and nothing moves by more than a fiftieth of a point: coordinates are written relative to the
point before in hundredths of a point, long polylines lose the points that lie on them anyway, and neighbours of one
style become one path.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Sequence
from functools import lru_cache

Point = tuple[int, int]
Cone = tuple[tuple[float, float], tuple[float, float]]

PLACES = 2
"""Decimals kept of a coordinate."""

TOLERANCE = 2
"""How far a point of a polyline may lie off what is drawn without it, in units of the last decimal."""

LONG = 24
"""Polylines of more points than this are thinned."""

_UNIT = 10**PLACES
_PATH = re.compile(r'<path d="([^"]*)"([^>]*?)/>')
_REST = re.compile(r"<!--.*?-->|<metadata>.*?</metadata>", re.DOTALL)
_ALONE = re.compile(r'(?:<path d="[^"]*"([^>]*?)/>)(?:\s*<path d="[^"]*"\1/>)+')
_POINTS = {"M": 1, "L": 1, "Q": 2, "C": 3}


def slim(svg: str) -> str:
    """Write the same picture in fewer bytes; takes what matplotlib writes."""
    svg = _REST.sub("", svg)
    svg = _ALONE.sub(_joined, svg)
    svg = re.sub(r' d="([^"]*)"', lambda found: f' d="{short_path(found[1])}"', svg)
    return re.sub(r"\n\s*", "\n", svg)


def inline(svg: str, name: str, title: str) -> str:
    """Return an SVG file's picture for a page: no prologue, a title, and no id or style that another could meet.

    Every id is prefixed with `name`, which must be one for HTML; the style that matplotlib gives to all elements of the
    document goes to the picture alone.
    """
    svg = svg[svg.index("<svg") :]
    style = re.search(r'<style type="text/css">\*\{([^}]*)\}</style>', svg)
    if style:
        svg = svg.replace(style[0], "")
    svg = re.sub(r'\bid="([^"]*)"', rf'id="{name}-\1"', svg)
    svg = re.sub(r'(xlink:href="|url\()#', rf"\1#{name}-", svg)
    svg = re.sub(r' (width|height)="[\d.]+pt"', "", svg, count=2)
    words = html.escape(title)
    look = f' style="{style[1]}"' if style else ""
    head, rest = svg.split(">", 1)
    return f'{head} role="img" aria-label="{words}"{look}>{rest}'.strip()


def width_of(svg: str) -> float:
    """Width of an SVG [pt]."""
    found = re.search(r'viewBox="[-\d.]+ [-\d.]+ ([\d.]+)', svg)
    return float(found[1]) if found else 0.0


def short_path(data: str) -> str:
    """Write a path of absolute M, L, Q, C and z in relative commands with PLACES decimals; others are left alone."""
    tokens = data.split()
    text: list[str] = []
    here = start = (0, 0)
    i = 0
    while i < len(tokens):
        command = tokens[i]
        i += 1
        if command in "zZ":
            text.append("z")
            here = start
        elif command == "L":
            points = [_point(tokens, i)]
            i += 2
            while i < len(tokens) and tokens[i] == "L":
                points.append(_point(tokens, i + 1))
                i += 3
            text.append(_relative("l", here, thinned([here, *points])[1:], 1))
            here = points[-1]
        elif command in _POINTS:
            count = _POINTS[command]
            points = [_point(tokens, i + 2 * k) for k in range(count)]
            i += 2 * count
            if command == "M":
                text.append(_pairs("M", [points[0]]))
                start = points[0]
            else:
                text.append(_relative(command.lower(), here, points, count))
            here = points[-1]
        else:
            return data
    return "".join(text)


def thinned(points: Sequence[Point]) -> list[Point]:
    """Polyline without the points that lie within TOLERANCE of it; the first and the last stay.

    Sklansky and Gonzalez, "Fast polygonal approximation of digitized curves", 1980: from each point kept, the farthest
    whose ray passes all those between at this distance.
    """
    if len(points) <= LONG:
        return list(points)
    kept, last = [points[0]], points[0]
    cone: Cone | None = None
    for point in points[1:]:
        if not _passes(cone, kept[-1], last, point):
            kept.append(last)
            cone = None
        cone = _narrowed(cone, (point[0] - kept[-1][0], point[1] - kept[-1][1]))
        last = point
    return [*kept, last]


def _passes(cone: Cone | None, anchor: Point, last: Point, point: Point) -> bool:
    """Whether a segment from the anchor to a point leaves none between too far off, and does not turn back."""
    x, y = point[0] - anchor[0], point[1] - anchor[1]
    onward = (last[0] - anchor[0]) * (point[0] - last[0]) + (last[1] - anchor[1]) * (point[1] - last[1]) >= 0
    return onward and (cone is None or (_cross(cone[0], (x, y)) >= 0 and _cross(cone[1], (x, y)) <= 0))


def _narrowed(cone: Cone | None, offset: Point) -> Cone | None:
    """Directions from the anchor, between a right and a left one, that pass a further point at TOLERANCE or less."""
    x, y = offset
    square = x * x + y * y - TOLERANCE * TOLERANCE
    if square <= 0:
        return cone
    along = math.sqrt(square)
    right = (x * along + y * TOLERANCE, y * along - x * TOLERANCE)
    left = (x * along - y * TOLERANCE, y * along + x * TOLERANCE)
    if cone is None:
        return right, left
    return right if _cross(cone[0], right) > 0 else cone[0], left if _cross(cone[1], left) < 0 else cone[1]


def _cross(a: tuple[float, float], b: tuple[float, float]) -> float:
    return a[0] * b[1] - a[1] * b[0]


def _joined(found: re.Match[str]) -> str:
    """Neighbouring paths of one style as one path, where overlaps look the same: strokes that are opaque."""
    style = found[1]
    if "fill: none" not in style or "opacity" in style or "dasharray" in style:
        return found[0]
    data = " ".join(path[1] for path in _PATH.finditer(found[0]))
    return f'<path d="{data}"{style}/>'


def _point(tokens: Sequence[str], i: int) -> Point:
    return round(float(tokens[i]) * _UNIT), round(float(tokens[i + 1]) * _UNIT)


def _relative(command: str, here: Point, points: Sequence[Point], count: int) -> str:
    """Offsets of points: of each from the one before, or of the `count` points of a curve all from its start."""
    offsets = []
    for i, (x, y) in enumerate(points):
        offsets.append((x - here[0], y - here[1]))
        if (i + 1) % count == 0:
            here = (x, y)
    return _pairs(command, offsets)


def _pairs(command: str, points: Sequence[Point]) -> str:
    numbers = [_number(value) for point in points for value in point]
    return command + " ".join(numbers).replace(" -", "-")


@lru_cache(maxsize=1 << 16)
def _number(value: int) -> str:
    sign, value = ("-", -value) if value < 0 else ("", value)
    whole, part = divmod(value, _UNIT)
    decimals = f"{part:0{PLACES}d}".rstrip("0")
    if not decimals:
        return f"{sign}{whole}"
    return f"{sign}{whole or ''}.{decimals}"
