"""One moment of a trial whose robot has a map finer than the grid of decisions, as in the paper's Figure 16."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Affine2D
from numpy.typing import NDArray

from explore_bench.geometry import TAU, Array, Grid, Pose
from explore_bench.geometry.rays import cast, leaps
from explore_bench.report.moment import Scene
from explore_bench.report.scene_colors import CANDIDATE, CHOSEN, ESTIMATE, LOOP, OCCUPIED, RANGE, TRUE, UNKNOWN
from explore_bench.trial import snapshot as classes
from explore_bench.trial.snapshot import unpack_fine_map

BEAMS, BEAMS_DRAWN = 720, 72
"""Rays that bound the area in sight, and those of them that are drawn."""

_ROBOT = Path(np.array([(1.0, 0.0), (-0.7, 0.65), (-0.35, 0.0), (-0.7, -0.65), (1.0, 0.0)]), closed=True)


def draw_truth(axes: Axes, scene: Scene) -> None:
    """Draw the true scene: obstacles, what the lidar sees from where the robot is, and its true way so far."""
    world, steps = scene.world, scene.steps
    axes.add_patch(PathPatch(bands(world.obstacles, world.grid.resolution), facecolor=OCCUPIED, edgecolor="none"))
    _draw_sight(axes, scene, beams=True)
    axes.plot(steps["true_x"], steps["true_y"], color=TRUE, linewidth=1.2)
    _draw_robot(axes, _true_pose(scene), TRUE)


def draw_fine_map(axes: Axes, scene: Scene, *, truth: bool) -> None:
    """Draw the robot's map: estimated trajectory, loop closures, candidates, and the way that it took next.

    With `truth` the true obstacles are outlined in it, and the true way and what is in sight are drawn.
    """
    world, snapshot, steps = scene.world, scene.snapshot, scene.steps
    assert snapshot.fine is not None
    scenario: Any = scene.scenario  # of a kind with such a map
    grid: Grid = scenario.map_grid
    cells = unpack_fine_map(snapshot.fine, grid.shape)
    for one, color in ((classes.UNKNOWN, UNKNOWN), (classes.OCCUPIED, OCCUPIED)):  # what is free is paper
        axes.add_patch(PathPatch(bands(cells == one, grid.resolution), facecolor=color, edgecolor="none", zorder=0))
    if truth:
        _draw_sight(axes, scene, beams=False)
        edges = outline(world.obstacles, world.grid.resolution)
        axes.add_patch(PathPatch(edges, fill=False, edgecolor=TRUE, linewidth=0.6, alpha=0.7, zorder=1))
    places = np.array(snapshot.trajectory).reshape(-1, 2)
    axes.plot(*places.T, color=ESTIMATE, linewidth=1.9)
    if truth:
        axes.plot(steps["true_x"], steps["true_y"], color=TRUE, linewidth=0.7)
    for pair in np.array(snapshot.loops, dtype=int).reshape(-1, 2):
        axes.plot(*places[pair].T, color=LOOP, linewidth=2.4, solid_capstyle="round")
    axes.plot(*scene.way.T, color=CHOSEN, linewidth=1.5, linestyle=(0, (2.5, 1.5)))
    points = np.array(snapshot.positions or ()).reshape(-1, 2)
    axes.plot(*points.T, "o", color=CANDIDATE, markersize=4, linestyle="none")
    chosen = snapshot.target if snapshot.choice is None else points[snapshot.choice]
    if chosen is not None:
        axes.plot(*chosen, "o", color=CHOSEN, markersize=6.5, markeredgecolor="white", markeredgewidth=0.6)
    x, y = places[-1].tolist()
    _draw_robot(axes, (x, y, float(steps["heading"][-1])), ESTIMATE)


def truth_legend() -> list[Line2D | Patch]:
    """Handles of a legend for `draw_truth`."""
    return [
        Patch(facecolor=OCCUPIED, label="obstacle"),
        Patch(facecolor=RANGE, alpha=0.5, label="seen by the lidar"),
        Line2D([], [], color=TRUE, label="true trajectory"),
        _robot_handle(TRUE),
    ]


def fine_map_legend(scene: Scene, *, truth: bool) -> list[Line2D | Patch]:
    """Handles of a legend for `draw_fine_map` of this moment."""
    loops = len(scene.snapshot.loops or ()) // 2
    sight = [
        Patch(facecolor="none", edgecolor=TRUE, linewidth=0.8, label="true obstacle"),
        Patch(facecolor=RANGE, alpha=0.5, label="seen by the lidar"),
        Line2D([], [], color=TRUE, linewidth=0.8, label="true trajectory"),
    ]
    return [
        Patch(facecolor=UNKNOWN, label="unknown"),
        Patch(facecolor=OCCUPIED, label="believed obstacle"),
        *(sight if truth else ()),
        Line2D([], [], color=ESTIMATE, linewidth=1.9, label="estimated trajectory"),
        Line2D([], [], color=LOOP, linewidth=2.4, label=f"loop closure ({loops} so far)"),
        Line2D([], [], marker="o", color=CANDIDATE, linestyle="none", markersize=4, label="candidate"),
        Line2D([], [], marker="o", color=CHOSEN, linestyle="none", label="chosen"),
        Line2D([], [], color=CHOSEN, linewidth=1.5, linestyle=(0, (2.5, 1.5)), label="way driven next"),
        _robot_handle(ESTIMATE),
    ]


def bands(cells: NDArray[np.bool_], side: float) -> Path:
    """Outlines [m] of the runs of cells that are set in each row of a grid, shape (rows, columns), as one path."""
    rows, starts, ends = _runs(cells)
    corners = np.stack([(starts, rows), (ends, rows), (ends, rows + 1), (starts, rows + 1), (starts, rows)])
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    points = corners.transpose(2, 0, 1).reshape(-1, 2) * side
    return Path(points, np.tile(np.array(codes, dtype=np.uint8), len(rows)))


def outline(cells: NDArray[np.bool_], side: float) -> Path:
    """Lines [m] between cells of a grid that are set, shape (rows, columns), and others, as one path."""
    padded = np.pad(cells, 1)
    rows, starts, ends = _runs(padded[1:, 1:-1] != padded[:-1, 1:-1])
    level = np.stack([(starts, rows), (ends, rows)])
    columns, lows, highs = _runs((padded[1:-1, 1:] != padded[1:-1, :-1]).T)
    upright = np.stack([(columns, lows), (columns, highs)])
    points = np.concatenate((level, upright), axis=2).transpose(2, 0, 1).reshape(-1, 2) * side
    return Path(points, np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=np.uint8), len(points) // 2))


def _runs(cells: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Row, first column and one past the last of each run of set cells in a row."""
    edges = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, starts = np.nonzero(edges == 1)
    return rows, starts, np.nonzero(edges == -1)[1]


def _draw_sight(axes: Axes, scene: Scene, *, beams: bool) -> None:
    """Draw the area that the lidar sees from the robot's true pose, and some of its beams."""
    x, y, ends = _sight(scene)
    axes.fill(*ends.T, facecolor=RANGE, alpha=0.35, edgecolor="none", zorder=0.5)
    if beams:
        some = ends[:: BEAMS // BEAMS_DRAWN]
        rays = np.stack((np.tile((x, y), (len(some), 1)), some), axis=1).reshape(-1, 2)
        codes = np.tile(np.array([Path.MOVETO, Path.LINETO], dtype=np.uint8), len(some))
        axes.add_patch(PathPatch(Path(rays, codes), fill=False, edgecolor=LOOP, linewidth=0.4, alpha=0.5, zorder=0.6))


def _sight(scene: Scene) -> tuple[float, float, Array]:
    """True place of the robot, and where beams end that it sends from there, shape (BEAMS, 2) [m]."""
    world, reach = scene.world, scene.scenario.sensor_range
    x, y, heading = _true_pose(scene)
    ranges = cast((x, y, heading), BEAMS, reach, world.obstacles, leaps(world.obstacles, world.grid), world.grid)
    angles, lengths = heading + TAU * np.arange(BEAMS) / BEAMS, np.minimum(ranges, reach)
    return x, y, np.stack((x + lengths * np.cos(angles), y + lengths * np.sin(angles)), axis=1)


def _true_pose(scene: Scene) -> Pose:
    x, y, heading = (float(scene.steps[name][-1]) for name in ("true_x", "true_y", "true_heading"))
    return x, y, heading


def _draw_robot(axes: Axes, pose: Pose, color: str) -> None:
    turned = MarkerStyle(_ROBOT, transform=Affine2D().rotate(pose[2]))
    axes.plot(pose[0], pose[1], marker=turned, color=color, markersize=11, markeredgecolor="white", markeredgewidth=0.7)


def _robot_handle(color: str) -> Line2D:
    turned = MarkerStyle(_ROBOT, transform=Affine2D().rotate(math.pi / 4))
    return Line2D([], [], marker=turned, color=color, linestyle="none", markersize=11, label="robot")
