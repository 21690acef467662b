"""A maze of narrow corridors with a few loops."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.lidar.scenes.building import WALL, build, open_wall, opened, plan_of, walls_between
from explore_bench.world.lidar.scenes.canvas import Box, Canvas, divided

CORRIDOR = (1.65, 2.15)
"""About the least and greatest distance of two parallel walls [m]."""

LOOPS = 0.07
"""Share of the walls beside a spanning tree's that are taken away."""


def draw(size: float, resolution: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Obstacles, shape (n, n): walls between the squares of a lattice, of which a spanning tree and some more open."""
    canvas = Canvas(size, resolution)
    plan = plan_of(canvas)
    least, most = (width + WALL for width in CORRIDOR)
    columns, rows = (divided(plan.x0, plan.x1, least, most, rng) for _ in range(2))
    spaces = [Box(x0, y0, x1, y1) for y0, y1 in pairwise(rows) for x0, x1 in pairwise(columns)]
    build(canvas, spaces)
    for wall in opened(walls_between(spaces, least / 2), len(spaces), LOOPS, rng):
        open_wall(canvas, wall)
    return canvas.enclosed()
