"""Scenes: what is drawn as the truth of a lidar world, one module each.

A scene is a pure function `draw(size, resolution, rng)`: obstacles on a square of `size` metres in cells of
`resolution` metres, shape (n, n), rows along y, with a wall on all four sides. It knows no robot: which of its places
can be reached is `world.py`'s business.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from explore_bench.world.lidar.scenes import dense, hall, maze, office, rooms

Draw = Callable[[float, float, np.random.Generator], NDArray[np.bool_]]

SCENES: dict[str, Draw] = {
    "dense": dense.draw,
    "office": office.draw,
    "rooms": rooms.draw,
    "maze": maze.draw,
    "hall": hall.draw,
}
