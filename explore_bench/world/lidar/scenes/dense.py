"""A box full of blocks and pillars, as in Fig. 16a."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.lidar.scenes.canvas import Box, Canvas

DENSITY = 40 / 400
"""Obstacles a square metre: about forty are in Fig. 16a."""

PILLARS = 0.3
"""Share of the obstacles that are discs."""

SIDES = (0.4, 2.0)
"""Least and greatest side of a block [m]."""

RADII = (0.2, 0.6)
"""Least and greatest radius of a pillar [m]."""


def draw(size: float, resolution: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Obstacles, shape (n, n): blocks and pillars, uniformly placed; they may overlap each other and the wall."""
    canvas = Canvas(size, resolution)
    count = round(DENSITY * size**2)
    places = rng.uniform(0.0, size, (count, 2)).tolist()
    sides = rng.uniform(*SIDES, (count, 2)).tolist()
    radii = rng.uniform(*RADII, count).tolist()
    is_pillar = (rng.random(count) < PILLARS).tolist()
    for (x, y), (width, height), radius, pillar in zip(places, sides, radii, is_pillar, strict=True):
        if pillar:
            canvas.fill_disc(x, y, radius)
        else:
            canvas.fill(Box(x - width / 2, y - height / 2, x + width / 2, y + height / 2))
    return canvas.enclosed()
