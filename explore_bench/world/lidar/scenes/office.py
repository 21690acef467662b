"""A floor of offices: corridors that cross, with rooms off both sides."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.lidar.scenes.building import (
    DOOR,
    JAMB,
    WALL,
    Wall,
    build,
    furnish,
    open_door,
    open_wall,
    plan_of,
    walls_between,
)
from explore_bench.world.lidar.scenes.canvas import Box, Canvas, divided

CORRIDOR = (1.8, 2.4)
"""Least and greatest width of a corridor [m]."""

PITCH = 10.5
"""About the distance of two parallel corridors [m]."""

CROSSING = 13.0
"""About the distance of two corridors that cross those [m]."""

ROOM = (2.9, 6.5)
"""About the least and greatest width of a room along its corridor [m]."""

LANDSCAPE = 7.2
"""Depth [m] up to which what lies between two corridors is one row of rooms, open to both."""

LOUNGES = 0.08
"""Share of the rooms that have no wall to the corridor."""

CONNECTED = 0.15
"""Share of the walls between two rooms with a door."""


def draw(size: float, resolution: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Obstacles, shape (n, n): parallel corridors, others across, rooms with doors and furniture; turned at random."""
    canvas = Canvas(size, resolution)
    plan = plan_of(canvas)
    corridors = _corridors(plan, rng)
    crossings = _crossings(plan, corridors, rng)
    rooms = _rooms(plan, corridors, crossings, rng)
    build(canvas, rooms + corridors)
    for crossing in crossings:
        canvas.clear(Box(crossing.x0 + WALL / 2, crossing.y0, crossing.x1 - WALL / 2, crossing.y1))
    _open_rooms(canvas, rooms, corridors + crossings, rng)
    for room in rooms:
        furnish(canvas, room, round(room.width * room.height / 4), rng)
    return np.ascontiguousarray(np.rot90(canvas.enclosed(), int(rng.integers(4))))


def _corridors(plan: Box, rng: np.random.Generator) -> list[Box]:
    """Corridors along x, with half as much room beyond the outer ones as between two."""
    count = max(round(plan.height / PITCH), 1)
    widths = rng.uniform(*CORRIDOR, count)
    shares = np.array([1.0, *[2.0] * (count - 1), 1.0]) * rng.uniform(0.85, 1.15, count + 1)
    depths = shares / shares.sum() * (plan.height - widths.sum())
    lows = plan.y0 + np.cumsum(depths[:-1]) + np.concatenate(([0.0], np.cumsum(widths[:-1])))
    return [Box(plan.x0, low, plan.x1, low + width) for low, width in zip(lows.tolist(), widths.tolist(), strict=True)]


def _crossings(plan: Box, corridors: list[Box], rng: np.random.Generator) -> list[Box]:
    """Corridors along y from the lowest corridor to the highest."""
    if len(corridors) < 2:
        return []
    count = max(round(plan.width / CROSSING), 1)
    crossings = []
    for number in range(count):
        width = float(rng.uniform(*CORRIDOR))
        middle = plan.x0 + plan.width * (number + float(rng.uniform(0.25, 0.75))) / count
        crossings.append(Box(middle - width / 2, corridors[0].y0, middle + width / 2, corridors[-1].y1))
    return crossings


def _rooms(plan: Box, corridors: list[Box], crossings: list[Box], rng: np.random.Generator) -> list[Box]:
    """Rooms in all that corridors leave."""
    rooms = []
    ends = [plan.y0, *[y for corridor in corridors for y in (corridor.y0, corridor.y1)], plan.y1]
    for number, (low, high) in enumerate(zip(ends[::2], ends[1::2], strict=True)):
        between = 0 < number < len(corridors)
        rows = [low, high]
        if between and high - low > LANDSCAPE:
            rows.insert(1, low + (high - low) * float(rng.uniform(0.45, 0.55)))
        sides = [plan.x0, *[x for box in crossings if between for x in (box.x0, box.x1)], plan.x1]
        for x0, x1 in zip(sides[::2], sides[1::2], strict=True):
            for y0, y1 in pairwise(rows):
                rooms += [Box(a, y0, b, y1) for a, b in pairwise(divided(x0, x1, *ROOM, rng))]
    return rooms


def _open_rooms(canvas: Canvas, rooms: list[Box], corridors: list[Box], rng: np.random.Generator) -> None:
    """Give every room a door to a corridor beside it, some a second one, or one to the next room."""
    to_corridors: dict[int, list[Wall]] = {}
    for wall in walls_between(rooms + corridors, DOOR[1] + WALL + 2 * JAMB):
        room, other = sorted(wall[:2])
        if other >= len(rooms) > room:
            to_corridors.setdefault(room, []).append(wall)
        elif other < len(rooms) and rng.random() < CONNECTED:
            open_door(canvas, wall, float(rng.uniform(*DOOR)), rng)
    for walls in to_corridors.values():
        first = int(rng.integers(len(walls)))
        lounge = rng.random() < LOUNGES
        for number, wall in enumerate(walls):
            if number == first and lounge:
                open_wall(canvas, wall)
            elif number == first or rng.random() < 0.4:
                open_door(canvas, wall, float(rng.uniform(*DOOR)), rng)
