"""One moment of a trial in the manner of the paper's Figure 6."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch, Rectangle
from matplotlib.path import Path
from numpy.typing import NDArray

from explore_bench.geometry import Grid
from explore_bench.report.fine_scene import draw_fine_map, fine_map_legend
from explore_bench.report.moment import Scene
from explore_bench.report.scene_colors import (
    CANDIDATE,
    CHOSEN,
    ELLIPSE,
    ESTIMATE,
    FREE,
    LANDMARK,
    OCCUPIED,
    RANGE,
    TRUE,
    UNKNOWN,
)
from explore_bench.trial.snapshot import Snapshot, unpack_ellipses, unpack_map
from explore_bench.world.scenario import Scenario

POSE_ELLIPSES = 12
"""Pose ellipses drawn along a trajectory, evenly spaced."""


def scene_image(scene: Scene, pixels: int = 480) -> NDArray[np.uint8]:
    """Draw a scene alone, shape (pixels, pixels, 3)."""
    figure = Figure(figsize=(4.8, 4.8), dpi=pixels / 4.8)
    canvas = FigureCanvasAgg(figure)
    draw_scene(figure.add_axes((0.01, 0.01, 0.98, 0.98)), scene)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def draw_scene(axes: Axes, scene: Scene) -> None:
    """Draw a moment of a trial into axes: the robot's finer map where it has one, as `draw_fine_map` does.

    Else shown are known and unknown cells, believed obstacles and true ones (outlined), the 1-σ ellipses of the virtual
    landmarks, true (black) and estimated (yellow) landmarks, true (black) and estimated (green) trajectory with
    1-σ pose ellipses, the sensor's range, the candidates (purple) and the chosen one (red).
    """
    if scene.snapshot.fine is None:
        _draw_cells(axes, scene)
    else:
        draw_fine_map(axes, scene, truth=True)
    frame(axes, scene)


def frame(axes: Axes, scene: Scene) -> None:
    """Show the map and what the robot can see beyond its border, and nothing around that."""
    scenario = scene.scenario
    size, around = scenario.size, min((scenario.extent - scenario.size) / 2, scenario.sensor_range)
    axes.set(xlim=(-around, size + around), ylim=(-around, size + around), aspect="equal", xticks=[], yticks=[])
    axes.grid(False)
    if around:
        axes.add_patch(Rectangle((0.0, 0.0), size, size, fill=False, edgecolor=TRUE, linewidth=0.8, linestyle="dashed"))
    for spine in axes.spines.values():
        spine.set_visible(True)


def _draw_cells(axes: Axes, scene: Scene) -> None:
    scenario, world, steps, snapshot = scene.scenario, scene.world, scene.steps, scene.snapshot
    grid = scenario.grid
    belief = unpack_map(snapshot.map, grid.shape)
    shade = np.where(np.isnan(belief), 0, np.where(belief > 0.5, 2, 1))
    for kind, color in enumerate((UNKNOWN, FREE, OCCUPIED)):
        axes.add_patch(PathPatch(squares(shade == kind, grid), facecolor=color, edgecolor="none", zorder=0))
    outlines = squares(world.walls, world.grid)
    axes.add_patch(PathPatch(outlines, fill=False, edgecolor=TRUE, linewidth=0.6, alpha=0.7, zorder=2))
    _ellipses(axes, scenario, snapshot)
    axes.plot(steps["true_x"], steps["true_y"], color=TRUE, linewidth=0.9)
    axes.plot(steps["x"], steps["y"], color=ESTIMATE, linewidth=1.1)
    _pose_ellipses(axes, steps)
    pose = steps["x"][-1], steps["y"][-1]
    axes.add_patch(Circle(pose, scenario.sensor_range, facecolor=RANGE, alpha=0.3, edgecolor="none"))
    axes.plot(*pose, marker="o", color=ESTIMATE, markersize=5, markeredgecolor="white", markeredgewidth=0.6)
    axes.plot(*world.landmarks.T, "+", color=TRUE, markersize=8, markeredgewidth=1.6)
    landmarks = np.array(snapshot.landmark_estimates, dtype=float).reshape(-1, 5)
    axes.plot(*landmarks[:, :2].T, "+", color=LANDMARK, markersize=8, markeredgewidth=1.4)
    if snapshot.candidates:
        points = grid.centres(snapshot.candidates)
        axes.plot(*points.T, "o", color=CANDIDATE, markersize=4, linestyle="none")
        if snapshot.choice is not None:
            axes.plot(*points[snapshot.choice], "o", color=CHOSEN, markersize=6)
        if snapshot.target is not None:
            axes.plot(*snapshot.target, "o", color=CHOSEN, markersize=6)


def scene_legend(scene: Scene) -> list[Line2D | Patch]:
    """Handles of a legend for `draw_scene` of this moment; landmarks stand in it where the world has some."""
    if scene.snapshot.fine is not None:
        return fine_map_legend(scene, truth=True)
    landmarks = [
        Line2D([], [], marker="+", color=TRUE, linestyle="none", markeredgewidth=1.6, label="true landmark"),
        Line2D([], [], marker="+", color=LANDMARK, linestyle="none", markeredgewidth=1.6, label="estimated landmark"),
    ]
    return [
        Patch(facecolor=UNKNOWN, label="unknown"),
        Patch(facecolor=OCCUPIED, label="believed obstacle"),
        Patch(facecolor="none", edgecolor=TRUE, linewidth=0.8, label="true obstacle"),
        Patch(facecolor=RANGE, alpha=0.5, label="sensor range"),
        Line2D([], [], marker="o", color=ELLIPSE, markerfacecolor="none", linestyle="none", label="virtual landmark"),
        Line2D([], [], color=TRUE, label="true trajectory"),
        Line2D([], [], color=ESTIMATE, label="estimated trajectory, 1 σ"),
        *(landmarks if len(scene.world.landmarks) else ()),
        Line2D([], [], marker="o", color=CANDIDATE, linestyle="none", markersize=4, label="candidate"),
        Line2D([], [], marker="o", color=CHOSEN, linestyle="none", label="chosen"),
    ]


def squares(cells: np.ndarray, grid: Grid) -> Path:
    """Outlines [m] of the cells of a grid that are set, shape (n, n), as one path: no seam shows between two."""
    rows, columns = np.nonzero(cells)
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
    points = (np.stack((columns, rows), axis=-1)[:, None] + corners) * grid.resolution + (grid.x0, grid.y0)
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    return Path(points.reshape(-1, 2), np.tile(np.array(codes, dtype=np.uint8), len(rows)))


def _ellipses(axes: Axes, scenario: Scenario, snapshot: Snapshot) -> None:
    values = unpack_ellipses(snapshot.ellipses, scenario.grid.shape, scenario.virtual_sigma).reshape(-1, 3)
    seen = np.flatnonzero(values[:, 1] < 0.995 * scenario.virtual_sigma)
    scale = scenario.cell_size / 2 / scenario.virtual_sigma  # the prior fills its cell
    offsets = scenario.grid.centres(seen)
    _draw_ellipses(axes, offsets, scale * values[seen, :2], values[seen, 2], ELLIPSE, 0.6)


def _pose_ellipses(axes: Axes, steps: dict[str, np.ndarray]) -> None:
    rows = np.unique(np.linspace(0, len(steps["x"]) - 1, POSE_ELLIPSES).astype(int))
    blocks = np.array([[steps["cov_xx"][rows], steps["cov_xy"][rows]], [steps["cov_xy"][rows], steps["cov_yy"][rows]]])
    values, vectors = np.linalg.eigh(np.moveaxis(blocks, -1, 0))
    offsets = np.stack((steps["x"][rows], steps["y"][rows]), axis=1)
    angles = np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])
    _draw_ellipses(axes, offsets, np.sqrt(values[:, ::-1]), angles, ESTIMATE, 0.8)


def _draw_ellipses(
    axes: Axes, offsets: np.ndarray, half_axes: np.ndarray, angles: np.ndarray, color: str, width: float
) -> None:
    """Draw ellipses at offsets [m], shape (K, 2), with half axes [m], shape (K, 2), and angles [rad], shape (K,)."""
    ellipses = EllipseCollection(
        2 * half_axes[:, 0],
        2 * half_axes[:, 1],
        np.degrees(angles),
        units="xy",
        offsets=offsets,
        transOffset=axes.transData,
        facecolors="none",
        edgecolors=color,
        linewidths=width,
    )
    ellipses.set_paths([Path.arc(0, 360, 4)])  # half the curves, off by 0.03 % of the radius
    axes.add_collection(ellipses)
