"""Rooms that open into each other, as in a flat or a museum: no corridor, several ways around."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.lidar.scenes.building import (
    DOOR,
    JAMB,
    WALL,
    build,
    furnish,
    open_door,
    opened,
    plan_of,
    walls_between,
)
from explore_bench.world.lidar.scenes.canvas import Box, Canvas

SIDES = (2.8, 8.0)
"""Least side of a room, and the longest that is never divided further [m]."""

LOOPS = 0.3
"""Share of the walls beside a spanning tree's that have a door, too."""

WIDE = 0.2
"""Share of the doors that are passages of up to twice the width."""


def draw(size: float, resolution: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Obstacles, shape (n, n): rooms of a binary space partition, with doors and furniture."""
    canvas = Canvas(size, resolution)
    spaces = _partition(plan_of(canvas), rng)
    build(canvas, spaces)
    walls = walls_between(spaces, DOOR[1] + WALL + 2 * JAMB)
    for wall in opened(walls, len(spaces), LOOPS, rng):
        width = float(rng.uniform(*DOOR))
        open_door(canvas, wall, 2 * width if rng.random() < WIDE else width, rng)
    for space in spaces:
        furnish(canvas, space, round(space.width * space.height / 5), rng)
    return canvas.enclosed()


def _partition(plan: Box, rng: np.random.Generator) -> list[Box]:
    """Cut a box across its longer side again and again; a box of medium size is at times left whole."""
    least, most = SIDES
    waiting, spaces = [plan], []
    while waiting:
        box = waiting.pop()
        longer = max(box.width, box.height)
        if longer < 2 * least or (longer <= most and rng.random() < 0.3):
            spaces.append(box)
            continue
        upright = box.width >= box.height
        whole = box if upright else box.turned
        cut = float(
            rng.uniform(max(whole.x0 + least, whole.x0 + 0.3 * longer), min(whole.x1 - least, whole.x1 - 0.3 * longer))
        )
        parts = Box(whole.x0, whole.y0, cut, whole.y1), Box(cut, whole.y0, whole.x1, whole.y1)
        waiting += [part if upright else part.turned for part in parts]
    return spaces
