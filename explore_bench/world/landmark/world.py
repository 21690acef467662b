"""True maps: obstacles, landmarks and a start, drawn at random (§4.1) or placed in a given map."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.errors import RequestError
from explore_bench.geometry import Array, Grid, Pose, centre_of, compose
from explore_bench.world.floor_plan import FloorPlan, floor_plan
from explore_bench.world.landmark.constants import LandmarkScenario

MAX_DRAWS = 100_000
MOST_TAKEN = 0.4
"""Share of the cells of a large map beyond which the others are never connected (site percolation, 1 − 0.593)."""

LARGE = 400
"""Cells from which a map is large in that sense; smaller ones are connected by luck now and then."""

DRAWN_CELLS = 4_000_000
"""Cells of all draws of a world together, after which there is none: a few seconds."""
"""Twice the obstacles at 20 m take 2,500 draws on average."""


@dataclass(frozen=True, eq=False)
class LandmarkWorld:
    """A true map.

    Attributes
    ----------
    grid : of the obstacles.
    obstacles : whether a cell is an obstacle, shape (rows, columns), rows along y, read-only.
    landmarks : true positions [m], shape (M, 2), read-only; the row is the landmark's id.
    start : true pose at step 0.
    uncounted : cells that do not count towards coverage, ascending, shape (K,), read-only; none in a drawn world. In a
        given map see `FloorPlan.counted`.
    """

    grid: Grid
    obstacles: NDArray[np.bool_]
    landmarks: Array
    start: Pose
    uncounted: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def __post_init__(self) -> None:
        if self.obstacles.shape != self.grid.shape:
            raise ValueError(f"obstacles have the shape {self.obstacles.shape}, their grid {self.grid.shape}")
        if self.landmarks.ndim != 2 or self.landmarks.shape[1] != 2:
            raise ValueError(f"landmarks must have the shape (M, 2), not {self.landmarks.shape}")
        self.obstacles.setflags(write=False)
        self.landmarks.setflags(write=False)
        self.uncounted.setflags(write=False)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Whether a cell counts towards coverage, shape (rows, columns)."""
        counted = np.ones(self.obstacles.size, dtype=bool)
        counted[self.uncounted] = False
        return counted.reshape(self.obstacles.shape)

    @property
    def walls(self) -> NDArray[np.bool_]:
        """Obstacles that count, shape (rows, columns): the others no sensor tells from what lies beyond the map."""
        return self.obstacles & self.counted

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that tell this world from any other."""
        digest = hashlib.sha256(str(self.grid.columns).encode() + np.packbits(self.obstacles).tobytes())
        digest.update(self.landmarks.tobytes())
        digest.update(np.array([*self.start, self.grid.resolution]).tobytes())
        digest.update(self.uncounted.tobytes())
        return digest.hexdigest()[:12]

    @classmethod
    def draw(cls, scenario: LandmarkScenario, rng: np.random.Generator) -> Self:
        """World of a scenario: its map with landmarks and a start placed in it, or one drawn at random (§4.1).

        Raises
        ------
        RequestError : when no draw gave a connected world.
        """
        if scenario.map is None:
            return cls(*_drawn(scenario, rng))
        return cls(*_furnished(scenario, floor_plan(scenario.map), rng))

    def facts(self) -> dict[str, Any]:
        """Plain values from which `from_facts` makes the same world."""
        return {
            "obstacles": np.flatnonzero(self.obstacles).tolist(),
            "landmarks": self.landmarks.tolist(),
            "start": list(self.start),
            "uncounted": self.uncounted.tolist(),
        }

    @classmethod
    def from_facts(cls, facts: dict[str, Any], scenario: LandmarkScenario) -> Self:
        """World that a record tells of."""
        obstacles = np.zeros(scenario.cell_count, dtype=bool)
        obstacles[facts["obstacles"]] = True
        x, y, heading = facts["start"]
        return cls(
            scenario.grid,
            obstacles.reshape(scenario.grid.shape),
            np.array(facts["landmarks"], dtype=float).reshape(-1, 2),
            (x, y, heading),
            np.array(facts["uncounted"], dtype=np.int64),
        )


Parts = tuple[Grid, NDArray[np.bool_], Array, Pose, NDArray[np.int64]]
"""The attributes of a LandmarkWorld, in their order."""


def _drawn(scenario: LandmarkScenario, rng: np.random.Generator) -> Parts:
    """World at random: obstacle cells, landmarks uniform inside distinct free cells, the start in another.

    Every free cell can be reached with obstacle and landmark cells blocked; a draw that cannot is drawn anew, and so is
    one whose landmarks would be out of sight during the moves at the start. Without corner cutting an 8-connected path
    exists exactly where a 4-connected one does.
    """
    grid = scenario.grid
    cells = np.flatnonzero(scenario.inside)
    taken = scenario.obstacles + (scenario.landmarks if scenario.landmark_clearance is None else 0)
    draws = min(MAX_DRAWS, max(DRAWN_CELLS // scenario.cell_count, 200))
    if taken > MOST_TAKEN * len(cells) and len(cells) >= LARGE:
        draws = 0
    for _ in range(draws):
        order = cells[rng.permutation(len(cells))]
        inside = rng.uniform(-0.5, 0.5, (scenario.landmarks, 2))
        heading = float(rng.uniform(-np.pi, np.pi))
        landmark_cells = order[: scenario.landmarks]
        start = (*centre_of(grid, int(order[scenario.landmarks])), heading)
        landmarks = grid.centres(landmark_cells) + inside * grid.resolution
        if scenario.landmark_clearance is not None:
            landmarks = _apart(scenario, start, rng)
            landmark_cells = order[:0]  # several may share a cell, and they may stand in obstacles
        if scenario.start_moves and len(landmarks) and not _in_sight(scenario, start, landmarks):
            continue
        obstacle_cells = order[scenario.landmarks + 1 : scenario.landmarks + 1 + scenario.obstacles]
        blocked = np.zeros(scenario.cell_count, dtype=bool)
        blocked[landmark_cells] = True
        blocked[obstacle_cells] = True
        if ndimage.label(~blocked.reshape(grid.shape))[1] != 1:
            continue
        obstacles = np.zeros(scenario.cell_count, dtype=bool)
        obstacles[obstacle_cells] = True
        return grid, obstacles.reshape(grid.shape), landmarks, start, np.flatnonzero(~scenario.inside)
    seen = " and a landmark in sight of the start" if scenario.start_moves else ""
    more = "landmark" if scenario.landmarks > scenario.obstacles and not seen else "obstacle"
    raise RequestError(
        f"no connected world with {scenario.obstacles} obstacles and {scenario.landmarks} landmarks{seen} on "
        f"{grid.columns} × {grid.rows} cells was found in {draws:,} draws; lower {more}_density or "
        f"{more}_count{', or add landmarks' if seen else ''}."
    )


def _apart(scenario: LandmarkScenario, start: Pose, rng: np.random.Generator) -> Array:
    """Landmarks uniform on the map, at least `landmark_clearance` from the start, shape (M, 2)."""
    landmarks = np.empty((0, 2))
    while len(landmarks) < scenario.landmarks:
        drawn = rng.uniform(0.0, scenario.size, (scenario.landmarks, 2))
        far = np.hypot(*(drawn - start[:2]).T) >= (scenario.landmark_clearance or 0.0)
        landmarks = np.concatenate((landmarks, drawn[far]))
    return landmarks[: scenario.landmarks]


def _in_sight(scenario: LandmarkScenario, start: Pose, landmarks: Array) -> bool:
    """Whether a landmark is in range from the start or after one of the moves there, had they no noise."""
    pose = start
    for _ in range(scenario.start_moves + 1):
        if np.any(np.hypot(*(landmarks - pose[:2]).T) < scenario.sensor_range):
            return True
        pose = compose(pose, scenario.noise.start_move.motion)
    return False


def _furnished(scenario: LandmarkScenario, plan: FloorPlan, rng: np.random.Generator) -> Parts:
    """World of a given map: landmarks uniform inside distinct reachable cells beside walls, the start in another.

    Cells are tried in random order. One that would part the rest is passed over, as in a drawn world, so there may be
    fewer landmarks than the scenario asks for. The start is the map's own, or a random cell that stays open.
    """
    grid = scenario.grid
    order = rng.permutation(scenario.cell_count)
    inside = rng.uniform(-0.5, 0.5, (scenario.landmarks, 2))
    heading = float(rng.uniform(-np.pi, np.pi))
    open_ = plan.reachable.reshape(-1).copy()
    chosen: list[int] = []
    for cell in order[plan.beside_walls.reshape(-1)[order]].tolist():
        if len(chosen) == scenario.landmarks:
            break
        if cell == plan.start:
            continue
        open_[cell] = False
        if ndimage.label(open_.reshape(grid.shape))[1] == 1:
            chosen.append(cell)
        else:
            open_[cell] = True
    start = int(order[open_[order]][-1]) if plan.start is None else plan.start
    x, y = centre_of(grid, start)
    landmarks = grid.centres(np.array(chosen, dtype=np.int64)) + inside[: len(chosen)] * grid.resolution
    return grid, plan.blocked, landmarks, (x, y, heading), np.flatnonzero(~plan.counted)
