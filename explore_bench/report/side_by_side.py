"""Several trials in one picture: a row a world, a panel a strategy, all of a row at the same time."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from explore_bench.analysis.metrics import finished
from explore_bench.files import write_whole
from explore_bench.records.encoding import Replay, TrialRecord
from explore_bench.report.drawing import entry_of, save
from explore_bench.report.moment import scene_at
from explore_bench.report.scene import draw_scene
from explore_bench.report.tables import shown_name

MOMENTS, FRAMES_PER_SECOND, HELD_SECONDS = 90, 12, 2
"""Moments of an animation, evenly spaced until the last trial of a row has ended, and how they are shown."""

PANEL, DPI = (2.4, 2.75), 100
"""Size of a panel [inch], and pixels to an inch in an animation."""

COLORS = 48
"""Colours of an animation: few, so that its file is small."""

Shown = tuple[TrialRecord, Replay]


def save_side_by_side(rows: Sequence[Sequence[Shown]], path: Path) -> None:
    """Draw trials with their replays, a row of them after the other, as `path` says: .gif moves, others show the end.

    The steps of a row are those of its longest trial; rows begin and end together, whatever a step is in each.
    """
    if path.suffix.lower() == ".gif":
        write_whole(path, _animation(rows))
    else:
        save(_picture(rows), path)


def _picture(rows: Sequence[Sequence[Shown]]) -> Figure:
    columns = max(map(len, rows))
    size = PANEL[0] * columns, PANEL[1] * len(rows)
    figure, grid = plt.subplots(len(rows), columns, figsize=size, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for row, own in zip(grid, rows, strict=True):
        for axes, shown in zip(row, own, strict=False):
            axes.set_axis_on()
            _draw(axes, shown, _last(shown))
    return figure


def _animation(rows: Sequence[Sequence[Shown]]) -> bytes:
    """GIF of all moments, its last one held; equal pixels of two frames cost nothing in it."""
    ends = [max(map(_last, own)) for own in rows]
    drawn: dict[tuple[int, int, int], NDArray[np.uint8]] = {}
    frames = []
    for moment in range(MOMENTS + 1):
        images = []
        for i, own in enumerate(rows):
            now = round(ends[i] * moment / MOMENTS)
            panels = []
            for j, shown in enumerate(own):
                key = i, j, min(now, _last(shown))
                if key not in drawn:  # once a trial has ended, its panel stands
                    drawn = {k: image for k, image in drawn.items() if k[:2] != key[:2]} | {key: _panel(shown, key[2])}
                panels.append(drawn[key])
            images.append(np.concatenate(panels, axis=1))
        width = max(image.shape[1] for image in images)
        wide = [np.pad(one, ((0, 0), (0, width - one.shape[1]), (0, 0)), constant_values=255) for one in images]
        frames.append(Image.fromarray(np.concatenate(wide)))
    palette = frames[-1].quantize(COLORS, dither=Image.Dither.NONE)  # at the end every colour is there
    first, *others = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames)
    durations = [1000 // FRAMES_PER_SECOND] * MOMENTS + [1000 * HELD_SECONDS]
    file = io.BytesIO()
    first.save(file, "GIF", save_all=True, append_images=others, duration=durations, loop=0, optimize=True)
    return file.getvalue()


def _panel(shown: Shown, step: int) -> NDArray[np.uint8]:
    """Panel of a trial at a step, shape (height, width, 3)."""
    figure = Figure(figsize=PANEL, dpi=DPI)
    figure.set_layout_engine("none")
    canvas = FigureCanvasAgg(figure)
    _draw(figure.add_axes((0.03, 0.02, 0.94, 0.94 * PANEL[0] / PANEL[1])), shown, step)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _draw(axes: Axes, shown: Shown, step: int) -> None:
    record, _ = shown
    draw_scene(axes, scene_at(*shown, step))
    known = f"{record.steps['explored'][step]:.0%} known"
    ended = step >= _last(shown)
    how = "done" if finished(record) else record.status.replace("_", " ")
    words = f"{how} after {step} steps" if ended else f"step {step}, {known}"
    axes.set_title(f"{shown_name(record.spec.strategy)}\n{words}", fontsize=8.5, fontweight="bold" if ended else None)
    for spine in axes.spines.values():
        spine.set(color=entry_of(record.spec.strategy).color, linewidth=2.5)


def _last(shown: Shown) -> int:
    return len(shown[0].steps["step"]) - 1
