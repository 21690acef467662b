"""One moment of a trial in the manner of the paper's Figure 6."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

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
    axes.imshow(
        shade, origin="lower", extent=(0, size, 0, size), cmap=ListedColormap([UNKNOWN, FREE, OCCUPIED]), vmin=0, vmax=2
    )
    for obstacle in np.flatnonzero(record.world.obstacles):
        x, y = obstacle % n * cell, obstacle // n * cell
        axes.plot(*zip(*_square(x, y, cell), strict=True), color=TRUE, linewidth=0.6, alpha=0.7)
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


def _square(x: float, y: float, side: float) -> list[tuple[float, float]]:
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)]


def _ellipses(axes: Axes, replay: Replay, index: int, record: TrialRecord) -> None:
    scenario = record.spec.scenario
    values = unpack_ellipses(replay.ellipses[index], scenario.cells, scenario.virtual_sigma).reshape(-1, 3)
    seen = np.flatnonzero(values[:, 1] < 0.995 * scenario.virtual_sigma)
    scale = scenario.cell_size / 2 / scenario.virtual_sigma  # the prior fills its cell
    axes.add_collection(
        EllipseCollection(
            2 * scale * values[seen, 0],
            2 * scale * values[seen, 1],
            np.degrees(values[seen, 2]),
            units="xy",
            offsets=centres(seen, scenario.cells, scenario.cell_size),
            transOffset=axes.transData,
            facecolors="none",
            edgecolors=ELLIPSE,
            linewidths=0.6,
        )
    )


def _pose_ellipses(axes: Axes, steps: dict[str, np.ndarray]) -> None:
    rows = np.unique(np.linspace(0, len(steps["x"]) - 1, POSE_ELLIPSES).astype(int))
    blocks = np.array([[steps["cov_xx"][rows], steps["cov_xy"][rows]], [steps["cov_xy"][rows], steps["cov_yy"][rows]]])
    values, vectors = np.linalg.eigh(np.moveaxis(blocks, -1, 0))
    axes.add_collection(
        EllipseCollection(
            2 * np.sqrt(values[:, 1]),
            2 * np.sqrt(values[:, 0]),
            np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])),
            units="xy",
            offsets=np.stack((steps["x"][rows], steps["y"][rows]), axis=1),
            transOffset=axes.transData,
            facecolors="none",
            edgecolors=ESTIMATE,
            linewidths=0.8,
        )
    )
