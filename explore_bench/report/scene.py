"""One moment of a trial in the manner of the paper's Figure 6."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch
from matplotlib.path import Path

from explore_bench.geometry import centres
from explore_bench.records import Replay, TrialRecord
from explore_bench.steps import unpack_ellipses, unpack_map

UNKNOWN, FREE, OCCUPIED = "#d9d9d9", "#ffffff", "#707070"
TRUE, ESTIMATE, ELLIPSE = "#000000", "#2ca02c", "#4878a8"
LANDMARK, CANDIDATE, CHOSEN, RANGE = "#e8b500", "#8a2be2", "#e3001b", "#9fd3ee"

POSE_ELLIPSES = 12
"""Pose ellipses drawn along a trajectory, evenly spaced."""


def draw_scene(axes: Axes, record: TrialRecord, replay: Replay, index: int) -> None:
    """Draw the moment of decision `index` of a replay (−1: the end of the trial) into axes.

    Shown are known and unknown cells, believed obstacles and true ones (outlined), the 1-σ ellipses of the virtual
    landmarks, true (black) and estimated (yellow) landmarks, true (black) and estimated (green) trajectory with
    1-σ pose ellipses, the sensor's range, the candidates (purple) and the chosen one (red).
    """
    scenario = record.spec.scenario
    n, size, cell = scenario.cells, scenario.size, scenario.cell_size
    row = replay.steps[index]
    steps = {name: values[: row + 1] for name, values in record.steps.items()}
    belief = unpack_map(replay.maps[index], n)
    shade = np.where(np.isnan(belief), 0, np.where(belief > 0.5, 2, 1))
    for kind, color in enumerate((UNKNOWN, FREE, OCCUPIED)):
        axes.add_patch(PathPatch(squares(shade == kind, cell), facecolor=color, edgecolor="none", zorder=0))
    outlines = squares(record.world.obstacles & record.world.counted, cell)
    axes.add_patch(PathPatch(outlines, fill=False, edgecolor=TRUE, linewidth=0.6, alpha=0.7, zorder=2))
    _ellipses(axes, replay, index, record)
    axes.plot(steps["true_x"], steps["true_y"], color=TRUE, linewidth=0.9)
    axes.plot(steps["x"], steps["y"], color=ESTIMATE, linewidth=1.1)
    _pose_ellipses(axes, steps)
    pose = steps["x"][-1], steps["y"][-1]
    axes.add_patch(Circle(pose, scenario.sensor_range, facecolor=RANGE, alpha=0.3, edgecolor="none"))
    axes.plot(*pose, marker="o", color=ESTIMATE, markersize=5, markeredgecolor="white", markeredgewidth=0.6)
    axes.plot(*record.world.landmarks.T, "+", color=TRUE, markersize=8, markeredgewidth=1.6)
    axes.plot(*replay.landmarks[index][:, :2].T, "+", color=LANDMARK, markersize=8, markeredgewidth=1.4)
    candidates, choice = replay.candidates[index], replay.choices[index]
    if candidates and choice is not None:
        points = centres(np.array(candidates), n, cell)
        axes.plot(*points.T, "o", color=CANDIDATE, markersize=4, linestyle="none")
        axes.plot(*points[choice], "o", color=CHOSEN, markersize=6)
    axes.set(xlim=(0, size), ylim=(0, size), aspect="equal", xticks=[], yticks=[])
    axes.grid(False)
    for spine in axes.spines.values():
        spine.set_visible(True)


def scene_legend() -> list[Line2D | Patch]:
    """Handles of a legend for `draw_scene`."""
    return [
        Patch(facecolor=UNKNOWN, label="unknown"),
        Patch(facecolor=OCCUPIED, label="believed obstacle"),
        Patch(facecolor="none", edgecolor=TRUE, linewidth=0.8, label="true obstacle"),
        Patch(facecolor=RANGE, alpha=0.5, label="sensor range"),
        Line2D([], [], marker="o", color=ELLIPSE, markerfacecolor="none", linestyle="none", label="virtual landmark"),
        Line2D([], [], color=TRUE, label="true trajectory"),
        Line2D([], [], color=ESTIMATE, label="estimated trajectory, 1 σ"),
        Line2D([], [], marker="+", color=TRUE, linestyle="none", markeredgewidth=1.6, label="true landmark"),
        Line2D([], [], marker="+", color=LANDMARK, linestyle="none", markeredgewidth=1.6, label="estimated landmark"),
        Line2D([], [], marker="o", color=CANDIDATE, linestyle="none", markersize=4, label="candidate"),
        Line2D([], [], marker="o", color=CHOSEN, linestyle="none", label="chosen"),
    ]


def squares(cells: np.ndarray, side: float) -> Path:
    """Outlines [m] of the cells of a grid that are set, shape (n, n), as one path: no seam shows between two."""
    rows, columns = np.nonzero(cells)
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)])
    points = (np.stack((columns, rows), axis=-1)[:, None] + corners) * side
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    return Path(points.reshape(-1, 2), np.tile(np.array(codes, dtype=np.uint8), len(rows)))


def _ellipses(axes: Axes, replay: Replay, index: int, record: TrialRecord) -> None:
    scenario = record.spec.scenario
    values = unpack_ellipses(replay.ellipses[index], scenario.cells, scenario.virtual_sigma).reshape(-1, 3)
    seen = np.flatnonzero(values[:, 1] < 0.995 * scenario.virtual_sigma)
    scale = scenario.cell_size / 2 / scenario.virtual_sigma  # the prior fills its cell
    offsets = centres(seen, scenario.cells, scenario.cell_size)
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
