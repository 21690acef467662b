"""The robot's last map laid on the truth: its walls, its free space, and how much of what counts it truly covers.

The start is known, so both lie in one frame and nothing is aligned. A cell of the map that obstacles fill in part is
neither open nor solid: it counts among walls only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from explore_bench.geometry import Array
from explore_bench.trial.snapshot import FREE, OCCUPIED
from explore_bench.world.lidar.world import COUNTED_WITHIN

if TYPE_CHECKING:
    from explore_bench.records.encoding import TrialRecord

Cells = NDArray[np.bool_]
AROUND = np.ones((3, 3), dtype=bool)
"""A cell and its 8 neighbours."""


@dataclass(frozen=True, eq=False)
class MapQuality:
    """A believed map beside the truth; arrays have the shape of the map's grid.

    Attributes
    ----------
    free, occupied : what is believed of a cell; neither where it is unknown.
    surfaces : cells with a part of the surface of a true obstacle.
    due : those of them whose surface the open space beside what counts comes to within 0.3 m: space counts only as
        far as 0.1 m from walls.
    open, solid : cells without any obstacle, and those that are all obstacle.
    counted : how many cells of the truth in each count towards coverage.
    robot : (row, column) of the cell in which the robot believes to be.
    """

    free: Cells
    occupied: Cells
    surfaces: Cells
    due: Cells
    open: Cells
    solid: Cells
    counted: Array
    robot: tuple[int, int]

    def wall_precision(self, within: int) -> float:
        """Share of the cells believed occupied with a true surface at most so many cells away, diagonals as one."""
        return _share(self.occupied, _grown(self.surfaces, within))

    def wall_recall(self, within: int) -> float:
        """Share of the true surfaces beside what counts that have a cell believed occupied so near."""
        return _share(self.due, _grown(self.occupied, within))

    def wall_f1(self, within: int) -> float:
        """Harmonic mean of the two; 0 where no wall is where it should be."""
        precision, recall = self.wall_precision(within), self.wall_recall(within)
        return 2.0 * precision * recall / (precision + recall) if precision + recall else 0.0

    def free_iou(self) -> float:
        """Cells rightly believed free, over those that are open and count, and those that are solid and believed free.

        Free space that does not count, behind a grille say, is left out, known or not.
        """
        due, wrong = self.open & (self.counted > 0), self.free & self.solid
        return float((self.free & due).sum() / (due | wrong).sum())

    def covered(self) -> float:
        """Share of the open space that counts within what the robot believes to be the free space around itself.

        That is the cells believed free that steps to the four sides join to the robot's own, each taken to be where the
        map has it. Only what is there in truth counts, so neither a map that drift has smeared beyond the walls nor one
        that shows a room twice covers more, and what false walls shut off from the robot covers nothing.
        """
        labels, _ = ndimage.label(self.free)
        own = self.free & (labels == labels[self.robot])
        due = np.where(self.open, self.counted, 0.0)
        return float(due[own].sum() / due.sum())


@lru_cache(maxsize=1)
def map_quality(record: TrialRecord) -> MapQuality | None:
    """Map with which a trial ended beside the truth; None where none was kept. The newest one is remembered."""
    if record.fine_map is None:
        return None
    world, steps = record.world, record.steps
    scenario: Any = record.spec.scenario
    grid = scenario.map_grid
    share = round(scenario.map_resolution / scenario.resolution)

    def parts(cells: Cells) -> Array:
        return np.asarray(cells.reshape(grid.rows, share, grid.columns, share).sum(axis=(1, 3)), dtype=float)

    near = round(COUNTED_WITHIN / scenario.resolution)
    beside = ndimage.binary_dilation(world.counted, AROUND, iterations=near, mask=~world.obstacles)
    facing = world.obstacles & ndimage.binary_dilation(beside, AROUND)
    obstacles = parts(world.obstacles)
    cell = grid.cell_of(float(steps["x"][-1]), float(steps["y"][-1]))
    return MapQuality(
        free=record.fine_map == FREE,
        occupied=record.fine_map == OCCUPIED,
        surfaces=parts(world.walls) > 0,
        due=parts(facing) > 0,
        open=obstacles == 0,
        solid=obstacles == share * share,
        counted=parts(world.counted),
        robot=(cell // grid.columns, cell % grid.columns),
    )


def _share(of: Cells, among: Cells) -> float:
    """Share of some cells that are among others; 0 where there are none."""
    return float(among[of].mean()) if of.any() else 0.0


def _grown(cells: Cells, steps: int) -> Cells:
    return np.asarray(ndimage.binary_dilation(cells, AROUND, iterations=steps))
