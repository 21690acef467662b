"""Large halls with columns, racks and pallets, and a row of small rooms along one side: a warehouse, say."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.lidar.scenes.building import (
    DOOR,
    JAMB,
    WALKWAY,
    WALL,
    build,
    floor_of,
    furnish,
    open_door,
    plan_of,
    walls_between,
)
from explore_bench.world.lidar.scenes.canvas import Box, Canvas, divided

HALL = 28.0
"""Width [m] from which there are two halls."""

ROOMS = (3.5, 6.5)
"""About the least and greatest width of a small room [m]; its depth is between as well, up to 5 m."""

GATE = (2.2, 3.2)
"""Width of a gate between two halls [m]."""

AISLE = (1.8, 2.8)
"""About the width of the ways between racks [m]."""

RACK = (4.0, 8.0)
"""About the length of a rack [m]."""

COLUMNS = (3.5, 5.5)
"""Distance of columns [m]."""


def draw(size: float, resolution: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Obstacles, shape (n, n): one or two halls and small rooms; turned at random."""
    canvas = Canvas(size, resolution)
    plan = plan_of(canvas)
    top = plan.y1 - float(rng.uniform(ROOMS[0], 5.0))
    rooms = [Box(x0, top, x1, plan.y1) for x0, x1 in pairwise(divided(plan.x0, plan.x1, *ROOMS, rng))]
    middle = [plan.x0 + plan.width * float(rng.uniform(0.4, 0.6))] if size >= HALL else []
    halls = [Box(x0, plan.y0, x1, top) for x0, x1 in pairwise([plan.x0, *middle, plan.x1])]
    build(canvas, rooms + halls)
    _open(canvas, rooms, halls, rng)
    for room in rooms:
        furnish(canvas, room, 4, rng)
    for hall in halls:
        _fill_hall(canvas, floor_of(hall), rng)
    return np.ascontiguousarray(np.rot90(canvas.enclosed(), int(rng.integers(4))))


def _open(canvas: Canvas, rooms: list[Box], halls: list[Box], rng: np.random.Generator) -> None:
    """Doors from the rooms to the halls, some between rooms, and two gates between the halls."""
    for wall in walls_between(rooms + halls, DOOR[1] + WALL + 2 * JAMB):
        places = [place >= len(rooms) for place in wall[:2]]
        if all(places):
            middle = wall.line.centre[1]
            for half in (wall.line._replace(y1=middle), wall.line._replace(y0=middle)):
                open_door(canvas, wall._replace(line=half), float(rng.uniform(*GATE)), rng)
        elif any(places) or rng.random() < 0.3:
            open_door(canvas, wall, float(rng.uniform(*DOOR)), rng)


def _fill_hall(canvas: Canvas, hall: Box, rng: np.random.Generator) -> None:
    """Racks in one part of a hall, columns and pallets in the other."""
    low, high = (hall.y0, hall.y1) if rng.random() < 0.5 else (hall.y1, hall.y0)
    cut = low + (high - low) * float(rng.uniform(0.5, 0.7))
    _put_racks(canvas, Box(hall.x0, min(low, cut), hall.x1, max(low, cut)), rng)
    _put_columns(canvas, Box(hall.x0, min(cut, high), hall.x1, max(cut, high)), rng)


def _put_racks(canvas: Canvas, zone: Box, rng: np.random.Generator) -> None:
    """Rows of racks along x, an aisle from each other and from the walls, with ways across."""
    aisle, depth = float(rng.uniform(*AISLE)), float(rng.uniform(0.9, 1.3))
    count = max(round((zone.height - aisle) / (aisle + depth)), 1)
    pitch = (zone.height + depth) / (count + 1)
    cuts = divided(zone.x0 + aisle / 2, zone.x1 - aisle / 2, RACK[0] + aisle, RACK[1] + aisle, rng)
    for row in range(1, count + 1):
        y1 = zone.y0 + row * pitch
        for x0, x1 in pairwise(cuts):
            if rng.random() < 0.9:
                _put(canvas, Box(x0 + aisle / 2, y1 - depth, x1 - aisle / 2, y1))


def _put_columns(canvas: Canvas, zone: Box, rng: np.random.Generator) -> None:
    """Columns on a lattice, round or square, and pallets wherever there is room for some."""
    half, is_round = float(rng.uniform(0.2, 0.35)), rng.random() < 0.5
    across, up = (max(round(length / float(rng.uniform(*COLUMNS))), 1) for length in (zone.width, zone.height))
    for x in zone.x0 + (np.arange(across) + 0.5) * zone.width / across:
        for y in zone.y0 + (np.arange(up) + 0.5) * zone.height / up:
            if is_round:
                canvas.fill_disc(float(x), float(y), half)
            else:
                canvas.fill(Box(float(x), float(y), float(x), float(y)).grown(half))
    for _ in range(round(zone.width * zone.height / 9)):
        x0, y0 = float(rng.uniform(zone.x0, zone.x1)), float(rng.uniform(zone.y0, zone.y1))
        width, height = (1.2, 0.8) if rng.random() < 0.5 else (0.8, 1.2)
        _put(canvas, Box(x0, y0, x0 + width * int(rng.integers(1, 3)), y0 + height))


def _put(canvas: Canvas, piece: Box) -> None:
    """Put something where it stands free."""
    if canvas.may_stand(piece) and canvas.is_clear(piece.grown(WALKWAY)):
        canvas.fill(piece)
