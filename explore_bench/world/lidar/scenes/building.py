"""What floor plans are made of: spaces side by side, the walls between them, doors, and furniture along the walls."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import minimum_spanning_tree

from explore_bench.world.lidar.scenes.canvas import OUTER_WALL, Box, Canvas

WALL = 0.15
"""Thickness [m] of a wall between two spaces."""

DOOR = (0.95, 1.2)
"""Clear width of a door [m], drawn uniformly."""

JAMB = 0.2
"""Least wall [m] between a door and the corner of a room."""

THRESHOLD = 1.1
"""Depth [m] of what stays free on either side of a door."""

WALKWAY = 0.95
"""Least distance [m] of a piece of furniture from what it does not touch."""


class Wall(NamedTuple):
    """Where two spaces touch.

    Attributes
    ----------
    first, second : places of the spaces in their list, ascending in x or y.
    line : the shared side, a box without width or without height.
    """

    first: int
    second: int
    line: Box

    @property
    def upright(self) -> bool:
        """Whether it runs along y."""
        return self.line.width == 0.0

    @property
    def length(self) -> float:
        """Length of the shared side [m]."""
        return self.line.width + self.line.height


def plan_of(canvas: Canvas) -> Box:
    """Where spaces may lie, up to the middle of the walls around them."""
    return canvas.inside.grown(WALL / 2)


def build(canvas: Canvas, spaces: list[Box]) -> None:
    """Draw spaces with walls around them; the edge of a space is the middle of its walls."""
    canvas.fill(canvas.inside.grown(OUTER_WALL))
    for space in spaces:
        canvas.clear(floor_of(space))


def floor_of(space: Box) -> Box:
    """What the walls around a space leave of it."""
    return space.grown(-WALL / 2)


def walls_between(spaces: list[Box], least: float) -> list[Wall]:
    """Sides of at least this length [m] that two spaces share."""
    upright = _touching(np.array(spaces), least)
    level = _touching(np.array([space.turned for space in spaces]), least)
    walls = [Wall(i, j, Box(x, low, x, high)) for i, j, x, low, high in upright]
    return walls + [Wall(i, j, Box(low, y, high, y)) for i, j, y, low, high in level]


def _touching(boxes: NDArray[np.float64], least: float) -> list[tuple[int, int, float, float, float]]:
    """Pairs of boxes, shape (n, 4), of which the second begins in x where the first ends: (i, j, x, from y, to y)."""
    x0, y0, x1, y1 = boxes.T
    low, high = np.maximum(y0[:, None], y0), np.minimum(y1[:, None], y1)
    firsts, seconds = np.nonzero((np.abs(x1[:, None] - x0) < 1e-6) & (high - low >= least))
    return [
        (i, j, float(x1[i]), float(low[i, j]), float(high[i, j]))
        for i, j in zip(firsts.tolist(), seconds.tolist(), strict=True)
    ]


def opened(walls: list[Wall], spaces: int, extra: float, rng: np.random.Generator) -> list[Wall]:
    """Walls to open so that all spaces join: a random spanning tree, and this share of the others for loops."""
    weights = rng.uniform(1.0, 2.0, len(walls))
    opens = rng.random(len(walls)) < extra
    firsts, seconds = np.array([wall[:2] for wall in walls], dtype=np.int64).reshape(-1, 2).T
    tree = minimum_spanning_tree(coo_array((weights, (firsts, seconds)), shape=(spaces, spaces))).tocoo()
    chosen = set(zip(tree.row.tolist(), tree.col.tolist(), strict=True))
    return [wall for wall, open_ in zip(walls, opens, strict=True) if open_ or wall[:2] in chosen]


def open_door(canvas: Canvas, wall: Wall, width: float, rng: np.random.Generator) -> None:
    """Cut a door of this width [m], or as wide as the wall allows, at a random place of a wall."""
    margin = WALL / 2 + JAMB
    width = min(width, wall.length - 2 * margin)
    line = wall.line.turned if wall.upright else wall.line
    x0 = line.x0 + margin + (wall.length - 2 * margin - width) * float(rng.random())
    _open(canvas, Box(x0, line.y0, x0 + width, line.y0), wall.upright)


def open_wall(canvas: Canvas, wall: Wall) -> None:
    """Take a wall away up to its corners."""
    line = wall.line.turned if wall.upright else wall.line
    _open(canvas, Box(line.x0 + WALL / 2, line.y0, line.x1 - WALL / 2, line.y0), wall.upright)


def _open(canvas: Canvas, line: Box, upright: bool) -> None:
    opening = Box(line.x0, line.y0 - WALL, line.x1, line.y0 + WALL)
    threshold = Box(line.x0, line.y0 - THRESHOLD, line.x1, line.y0 + THRESHOLD)
    canvas.clear(opening.turned if upright else opening)
    canvas.keep_free(threshold.turned if upright else threshold)


def furnish(canvas: Canvas, space: Box, pieces: int, rng: np.random.Generator) -> None:
    """Try to put this many desks and cupboards against the walls of a space, and at times a table in its middle.

    What would stand in front of a door, or leave less than a walkway, is left out. Doors come before furniture.
    """
    floor = floor_of(space)
    for _ in range(pieces):
        _put_against_wall(canvas, floor, rng)
    if rng.random() < 0.5:
        _put_in_the_middle(canvas, floor, rng)


def _put_against_wall(canvas: Canvas, floor: Box, rng: np.random.Generator) -> None:
    length, depth = (1.4, 0.75) if rng.random() < 0.5 else (float(rng.uniform(0.8, 2.4)), 0.45)  # a desk, or a cupboard
    along_y, far_side, place = rng.random() < 0.5, rng.random() < 0.5, float(rng.random())
    room = floor.turned if along_y else floor
    if room.height < depth + WALKWAY or room.width < length + WALKWAY:
        return
    slack = room.width - length
    if place < 0.25 or slack < 2 * WALKWAY:  # a corner; else far enough from both to be walked around
        x0 = room.x0 + (slack if far_side else 0.0)
    else:
        x0 = room.x0 + WALKWAY + (place - 0.25) / 0.75 * (slack - 2 * WALKWAY)
    y0 = room.y1 - depth if rng.random() < 0.5 else room.y0
    piece = Box(x0, y0, x0 + length, y0 + depth)
    piece = piece.turned if along_y else piece
    if canvas.may_stand(piece) and canvas.is_clear(piece.grown(WALKWAY).within(floor)):
        canvas.fill(piece)


def _put_in_the_middle(canvas: Canvas, floor: Box, rng: np.random.Generator) -> None:
    x, y = floor.centre
    if rng.random() < 0.3:
        radius = float(rng.uniform(0.4, 0.6))
        table = Box(x, y, x, y).grown(radius)
    else:
        half, radius = float(rng.uniform(0.6, 1.2)), 0.0
        table = Box(x - half, y - 0.4, x + half, y + 0.4)
        table = table if floor.width > floor.height else Box(x - 0.4, y - half, x + 0.4, y + half)
    around = table.grown(WALKWAY)
    if around.within(floor) != around or not canvas.is_clear(around) or not canvas.may_stand(table):
        return
    if radius:
        canvas.fill_disc(x, y, radius)
    else:
        canvas.fill(table)
