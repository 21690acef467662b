"""True maps: obstacles, landmarks and a start, drawn at random (§4.1) or placed in a given map."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.errors import RequestError
from explore_bench.geometry import Array, Pose, centre_of, centres
from explore_bench.world.floor_plan import Site, site_of
from explore_bench.world.scenario import Scenario

MAX_DRAWS = 100_000
"""Twice the obstacles at 20 m take 2,500 draws on average."""


@dataclass(frozen=True, eq=False)
class World:
    """A true map.

    Attributes
    ----------
    obstacles : whether a cell is an obstacle, shape (n, n), rows along y, read-only.
    landmarks : true positions [m], shape (M, 2), read-only; the row is the landmark's id.
    start : true pose at step 0.
    cell_size : edge of a cell [m].
    uncounted : cells that do not count towards coverage, ascending, shape (K,), read-only; none in a drawn world. In a
        given map see `site.Site.counted`.
    """

    obstacles: NDArray[np.bool_]
    landmarks: Array
    start: Pose
    cell_size: float
    uncounted: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def __post_init__(self) -> None:
        if self.obstacles.ndim != 2 or self.obstacles.shape[0] != self.obstacles.shape[1]:
            raise ValueError(f"obstacles must be a square grid, not of shape {self.obstacles.shape}")
        if self.landmarks.ndim != 2 or self.landmarks.shape[1] != 2:
            raise ValueError(f"landmarks must have the shape (M, 2), not {self.landmarks.shape}")
        self.obstacles.setflags(write=False)
        self.landmarks.setflags(write=False)
        self.uncounted.setflags(write=False)

    @property
    def cells(self) -> int:
        """Cells along an edge."""
        return self.obstacles.shape[0]

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Whether a cell counts towards coverage, shape (n, n)."""
        counted = np.ones(self.obstacles.size, dtype=bool)
        counted[self.uncounted] = False
        return counted.reshape(self.obstacles.shape)

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that tell this world from any other."""
        digest = hashlib.sha256(str(self.cells).encode() + np.packbits(self.obstacles).tobytes())
        digest.update(self.landmarks.tobytes())
        digest.update(np.array([*self.start, self.cell_size]).tobytes())
        digest.update(self.uncounted.tobytes())
        return digest.hexdigest()[:12]


def draw_world(scenario: Scenario, rng: np.random.Generator) -> World:
    """World of a scenario: its map with landmarks and a start placed in it, or one drawn at random (§4.1).

    Raises
    ------
    RequestError : when 100,000 draws gave no connected world.
    """
    if scenario.map is None:
        return _drawn(scenario, rng)
    return _furnished(scenario, site_of(scenario.map), rng)


def _drawn(scenario: Scenario, rng: np.random.Generator) -> World:
    """World at random: obstacle cells, landmarks uniform inside distinct free cells, the start in another.

    Every free cell can be reached with obstacle and landmark cells blocked; a draw that cannot is drawn anew.
    Without corner cutting an 8-connected path exists exactly where a 4-connected one does.
    """
    n, cell_size = scenario.cells, scenario.cell_size
    for _ in range(MAX_DRAWS):
        order = rng.permutation(scenario.cell_count)
        inside = rng.uniform(-0.5, 0.5, (scenario.landmarks, 2))
        heading = float(rng.uniform(-np.pi, np.pi))
        landmark_cells = order[: scenario.landmarks]
        obstacle_cells = order[scenario.landmarks + 1 : scenario.landmarks + 1 + scenario.obstacles]
        blocked = np.zeros(scenario.cell_count, dtype=bool)
        blocked[landmark_cells] = True
        blocked[obstacle_cells] = True
        if ndimage.label(~blocked.reshape(n, n))[1] != 1:
            continue
        obstacles = np.zeros(scenario.cell_count, dtype=bool)
        obstacles[obstacle_cells] = True
        x, y = centre_of(int(order[scenario.landmarks]), n, cell_size)
        return World(
            obstacles=obstacles.reshape(n, n),
            landmarks=centres(landmark_cells, n, cell_size) + inside * cell_size,
            start=(x, y, heading),
            cell_size=cell_size,
        )
    raise RequestError(
        f"no connected world with {scenario.obstacles} obstacles on {n} × {n} cells was found in {MAX_DRAWS} draws; "
        "lower obstacle_density or obstacle_count."
    )


def _furnished(scenario: Scenario, site: Site, rng: np.random.Generator) -> World:
    """World of a given map: landmarks uniform inside distinct reachable cells beside walls, the start in another.

    Cells are tried in random order. One that would part the rest is passed over, as in a drawn world, so there may be
    fewer landmarks than the scenario asks for. The start is the map's own, or a random cell that stays open.
    """
    n, cell_size = scenario.cells, scenario.cell_size
    order = rng.permutation(scenario.cell_count)
    inside = rng.uniform(-0.5, 0.5, (scenario.landmarks, 2))
    heading = float(rng.uniform(-np.pi, np.pi))
    open_ = site.reachable.reshape(-1).copy()
    chosen: list[int] = []
    for cell in order[site.beside_walls.reshape(-1)[order]].tolist():
        if len(chosen) == scenario.landmarks:
            break
        if cell == site.start:
            continue
        open_[cell] = False
        if ndimage.label(open_.reshape(n, n))[1] == 1:
            chosen.append(cell)
        else:
            open_[cell] = True
    start = int(order[open_[order]][-1]) if site.start is None else site.start
    x, y = centre_of(start, n, cell_size)
    return World(
        obstacles=site.blocked,
        landmarks=centres(np.array(chosen, dtype=np.int64), n, cell_size) + inside[: len(chosen)] * cell_size,
        start=(x, y, heading),
        cell_size=cell_size,
        uncounted=np.flatnonzero(~site.counted),
    )
