"""True maps of lidar worlds: a drawn scene, and a start from which the robot reaches every place where it fits."""

from __future__ import annotations

import base64
import hashlib
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.errors import RequestError
from explore_bench.geometry import Array, Grid, Pose, centre_of
from explore_bench.world.floor_plan import FloorPlan, floor_plan
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.scenes import SCENES
from explore_bench.world.scenario import border_cells

MAX_DRAWS = 200
"""With the constants as they are, 40 m of `dense` take 1.3 draws on average; the other scenes 1.0."""

START_ROOM = 0.2
"""What the start has more of clearance than the passage [m], to turn and look around."""

COUNTED_WITHIN = 0.30
"""A free cell counts towards coverage this near [m] to a place that the robot reaches."""

LOST = 1.0
"""Most area [m²] for the robot's centre in a gap that is filled in; with a larger one the world is drawn anew."""


@dataclass(frozen=True, eq=False)
class LidarWorld:
    """A true map on a fine grid; arrays have the shape (rows, columns), rows along y, and are read-only.

    Attributes
    ----------
    grid : of the obstacles.
    obstacles : whether a cell is an obstacle.
    counted : whether a cell counts towards coverage: in a drawn world those that are free and within 0.30 m of a place
        that the robot reaches with the passage's clearance all the way.
    start : true pose at step 0.
    """

    grid: Grid
    obstacles: NDArray[np.bool_]
    counted: NDArray[np.bool_]
    start: Pose

    def __post_init__(self) -> None:
        for name in ("obstacles", "counted"):
            cells = getattr(self, name)
            if cells.shape != self.grid.shape:
                raise ValueError(f"{name} have the shape {cells.shape}, their grid {self.grid.shape}")
            cells.setflags(write=False)

    @property
    def landmarks(self) -> Array:
        """True positions of landmarks, of which there are none: shape (0, 2)."""
        return np.empty((0, 2))

    @cached_property
    def clearance(self) -> Array:
        """Distance [m] from each cell's centre to that of the nearest obstacle, beyond the grid included; read-only.

        The obstacle itself begins 0.5 to 0.7 of a cell nearer.
        """
        clearance = clearance_of(self.obstacles, self.grid.resolution)
        clearance.setflags(write=False)
        return clearance

    @property
    def walls(self) -> NDArray[np.bool_]:
        """Obstacles with a free cell among their 8 neighbours: their surface, shape (rows, columns)."""
        return self.obstacles & ndimage.binary_dilation(~self.obstacles, np.ones((3, 3)))

    @cached_property
    def digest(self) -> str:
        """Twelve hexadecimal digits that tell this world from any other."""
        digest = hashlib.sha256(str(self.grid.columns).encode())
        digest.update(np.packbits(self.obstacles).tobytes() + np.packbits(self.counted).tobytes())
        digest.update(np.array([*self.start, self.grid.resolution]).tobytes())
        return digest.hexdigest()[:12]

    @classmethod
    def draw(cls, scenario: LidarScenario, rng: np.random.Generator) -> Self:
        """World of a scenario: its map, in which a start is drawn where it names none, or a scene drawn at random.

        In a drawn one the robot reaches every place where it fits: gaps that are too narrow for the passage are closed,
        and so are pockets behind them; a scene is drawn anew where that would lose more than a square metre for the
        robot.

        Raises
        ------
        RequestError : when 200 draws gave no such world, or the robot does not fit into a given map.
        """
        if scenario.map is not None:
            return cls(scenario.truth_grid, *_given(scenario, floor_plan(scenario.map), rng))
        grid, passage = scenario.truth_grid, scenario.passage
        for _ in range(MAX_DRAWS):
            scene = SCENES[scenario.scene](scenario.size, scenario.resolution, rng)
            clearance = clearance_of(scene, grid.resolution)
            reached = _largest_region(clearance >= passage)
            away = ndimage.distance_transform_edt(~reached) * grid.resolution
            gaps = _gaps(~scene & (away > passage), clearance >= scenario.robot_radius, LOST / grid.resolution**2)
            if gaps is None:
                continue
            obstacles = scene | gaps
            if gaps.any():
                clearance = clearance_of(obstacles, grid.resolution)
            starts = np.flatnonzero(reached & (clearance >= passage + START_ROOM))
            if not len(starts):
                continue
            x, y = centre_of(grid, int(rng.choice(starts)))
            return cls(grid, obstacles, _counted(obstacles, away, passage), (x, y, float(rng.uniform(-np.pi, np.pi))))
        raise RequestError(
            f"no {scenario.scene} world of {scenario.size:g} m with a passage of {passage:g} m to every place was "
            f"found in {MAX_DRAWS} draws; lower passage or enlarge size."
        )

    def facts(self) -> dict[str, Any]:
        """Plain values from which `from_facts` makes the same world, some kilobytes."""
        return {
            "obstacles": _packed(self.obstacles),
            "counted": _packed(self.counted),
            "start": list(self.start),
        }

    @classmethod
    def from_facts(cls, facts: dict[str, Any], scenario: LidarScenario) -> Self:
        """World that a record tells of."""
        grid = scenario.truth_grid
        x, y, heading = facts["start"]
        return cls(grid, _unpacked(facts["obstacles"], grid), _unpacked(facts["counted"], grid), (x, y, heading))


def clearance_of(obstacles: NDArray[np.bool_], resolution: float) -> Array:
    """Distance [m] from each cell's centre to that of the nearest obstacle, shape (rows, columns).

    What lies beyond the grid is an obstacle.
    """
    free = np.pad(~obstacles, 1)
    distance: Array = ndimage.distance_transform_edt(free)[1:-1, 1:-1]
    return distance * resolution


def _given(
    scenario: LidarScenario, plan: FloorPlan, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Pose]:
    """Obstacles, what counts, and the start in a given map; all around it is wall.

    The robot starts where the map says, or else at a random place indoors; of the regions in which it can go about with
    the passage's clearance, in that with the most of them. Where none is indoors the largest region is the one.
    """
    grid, passage = scenario.truth_grid, scenario.passage
    border = border_cells(scenario.plan_border, grid.resolution)
    of_map = slice(border, border + len(plan.blocked))
    obstacles, indoors = np.ones(grid.shape, dtype=bool), np.zeros(grid.shape, dtype=bool)
    obstacles[of_map, of_map], indoors[of_map, of_map] = plan.blocked, _enclosed(plan.blocked)
    clearance = clearance_of(obstacles, grid.resolution)
    fits = clearance >= passage
    heading = float(rng.uniform(-np.pi, np.pi))
    if plan.start is None:
        inside = fits & indoors
        places = inside if inside.any() else fits
        reached = _region_with_most(places, fits)
        starts = np.flatnonzero(reached & places & (clearance >= passage + START_ROOM))
        starts = starts if len(starts) else np.flatnonzero(reached & places)
        start = int(rng.choice(starts)) if len(starts) else -1
    else:
        row, column = divmod(plan.start, len(plan.blocked))
        start = (row + border) * grid.columns + column + border
        reached = _region_of(fits, start)
    if start < 0 or not reached.reshape(-1)[start]:
        nowhere = "anywhere in the map; look at the resolution", "where the map starts; move the start"
        raise RequestError(
            f"a robot of {scenario.robot_radius:g} m with a passage of {passage:g} m does not fit "
            f"{nowhere[start >= 0]}, or lower robot_radius and passage."
        )
    away = ndimage.distance_transform_edt(~reached) * grid.resolution
    x, y = centre_of(grid, start)
    return obstacles, _counted(obstacles, away, passage), (x, y, heading)


def _enclosed(obstacles: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Free cells from which obstacles lie in each of the four directions: indoors, though a door stands open."""
    seen = np.logical_or.accumulate
    down, up = seen(obstacles, axis=0), seen(obstacles[::-1], axis=0)[::-1]
    right, left = seen(obstacles, axis=1), seen(obstacles[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(~obstacles & down & up & right & left)


def _counted(obstacles: NDArray[np.bool_], away: Array, passage: float) -> NDArray[np.bool_]:
    """Free cells near to what is reached; `away` is how far a cell is from that [m].

    No wider than the passage, whose disc around a reached cell is free: else it would count across thin walls.
    """
    return np.asarray(~obstacles & (away <= min(COUNTED_WITHIN, passage)))


def _region_of(cells: NDArray[np.bool_], cell: int) -> NDArray[np.bool_]:
    """The region of cells joined to one by steps to the four sides; none where that is none of them."""
    labels, _ = ndimage.label(cells)
    return np.asarray(cells & (labels == labels.reshape(-1)[cell]))


def _largest_region(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The largest region of cells joined to one another; none where there are no cells."""
    return _region_with_most(cells, cells)


def _region_with_most(wanted: NDArray[np.bool_], cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The region of cells, joined by steps to the four sides, with the most wanted ones; none where there are none."""
    labels, _ = ndimage.label(cells)
    sizes = np.bincount(labels[wanted], minlength=1)
    sizes[0] = 0
    return np.asarray(cells & (labels == sizes.argmax()))


def _gaps(away: NDArray[np.bool_], fits: NDArray[np.bool_], most: float) -> NDArray[np.bool_] | None:
    """Cells of the gaps into which the robot fits, but cannot be brought with the passage's clearance.

    A gap is free cells joined to each other that are all farther `away` from every place that is reached than the
    passage's clearance: filling it in takes clearance from none of these. The corners of a room are away as well, but
    too narrow for the robot. None where the robot fits into more than `most` cells of a gap.
    """
    labels, count = ndimage.label(away)
    room = np.bincount(labels[fits], minlength=count + 1)
    room[0] = 0
    return None if (room > most).any() else np.asarray((room > 0)[labels])


def _packed(cells: NDArray[np.bool_]) -> str:
    return base64.b64encode(zlib.compress(np.packbits(cells).tobytes(), 9)).decode()


def _unpacked(text: str, grid: Grid) -> NDArray[np.bool_]:
    packed = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8)
    return np.unpackbits(packed, count=grid.cells).astype(bool).reshape(grid.shape)
