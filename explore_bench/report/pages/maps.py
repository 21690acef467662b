"""How strategies do in given maps: a table of strategy and map, and a figure of the ways through each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch

from explore_bench.analysis.metrics import METRICS
from explore_bench.records.encoding import TrialRecord
from explore_bench.report.drawing import entry_of, save_all, styled
from explore_bench.report.scene import squares
from explore_bench.report.tables import PAPER_METRICS, Table, heading, mean_text, shown_name
from explore_bench.strategies.registry import in_order

SHOWN_METRICS = (*PAPER_METRICS, "t90", "explored")
COLUMNS = 4
OBSTACLE, UNCOUNTED, LANDMARK = "#707070", "#e4e4e4", "#000000"


def write_map_report(trials: pd.DataFrame, records: Sequence[TrialRecord], folder: Path) -> list[Path]:
    """Write the table and the figure `maps`; returns the files."""
    written = maps_table(trials).write(folder / "tables", "maps")
    with styled():
        return written + save_all(maps_figure(records), folder / "figures" / "maps")


def maps_table(trials: pd.DataFrame) -> Table:
    """Means of e, η, the time to 90 % and the known share of every strategy in every map."""
    maps = sorted(set(trials["scenario"]))
    cells = {(str(name), str(own)): cell for (name, own), cell in trials.groupby(["strategy", "scenario"])}
    rows = []
    for strategy in in_order({strategy for strategy, _ in cells}):
        own = [cells.get((strategy, one), trials[:0]) for one in maps]
        label = shown_name(strategy)
        rows += [(label, heading(METRICS[name]), *(mean_text(cell, name) for cell in own)) for name in SHOWN_METRICS]
        rows.append((label, "trials not explored", *map(_unfinished, own)))
    note = (
        "Mean over worlds of a map, which differ in landmarks and start [95 % BCa bootstrap interval], training seeds "
        "averaged within a world first. e and η are over all cells of the square that holds the map, T90 and the known "
        "share c over those that count: the ones that can be reached and the obstacles beside them."
    )
    return Table("Strategies in given maps", ("Method", "", *maps), tuple(rows), note)


def _unfinished(cell: pd.DataFrame) -> str:
    return "–" if cell.empty else f"{int((cell['status'] != 'explored').sum())} of {len(cell)}"


def maps_figure(records: Sequence[TrialRecord]) -> Figure | None:
    """Every map with its landmarks in the first world and the true ways through it, of one training seed each."""
    first = min((record.spec.trial for record in records), default=0)
    shown: dict[str, dict[str, TrialRecord]] = {}
    for record in records:
        if record.spec.trial == first and len(record.steps["step"]):
            shown.setdefault(record.spec.scenario_name, {}).setdefault(record.spec.strategy, record)
    if not shown:
        return None
    columns = min(COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    edge = 3.2 if len(shown) > 1 else 6.4
    figure, grid = plt.subplots(rows, columns, figsize=(edge * columns, (edge + 0.2) * rows + 0.6), squeeze=False)
    for axes in grid.flat[len(shown) :]:
        axes.remove()
    for axes, (name, own) in zip(grid.flat, sorted(shown.items()), strict=False):
        axes.set_title(name)
        _draw_ways(axes, own)
    names = in_order({name for own in shown.values() for name in own})
    handles = [Line2D([], [], color=entry_of(name).color, label=shown_name(name)) for name in names]
    if any(len(record.world.landmarks) for own in shown.values() for record in own.values()):
        handles.append(Line2D([], [], marker="+", color=LANDMARK, linestyle="none", label="landmark"))
    figure.legend(handles=handles, loc="outside lower center", ncols=6, fontsize=8)
    figure.suptitle(f"True ways in world {first}; light grey does not count", fontsize=10)
    return figure


def _draw_ways(axes: Axes, own: dict[str, TrialRecord]) -> None:
    """Draw the true map and the true trajectories of some strategies in it."""
    world = next(iter(own.values())).world
    edge = world.grid.columns * world.grid.resolution
    for cells, color in ((~world.counted, UNCOUNTED), (world.walls, OBSTACLE)):
        axes.add_patch(PathPatch(squares(cells, world.grid), facecolor=color, edgecolor="none"))
    for name in in_order(own):
        steps = own[name].steps
        style = "--" if entry_of(name).reference else "-"
        axes.plot(steps["true_x"], steps["true_y"], style, color=entry_of(name).color, linewidth=0.9)
    axes.plot(*world.landmarks.T, "+", color=LANDMARK, markersize=7, markeredgewidth=1.4)
    axes.set(xlim=(0, edge), ylim=(0, edge), aspect="equal", xticks=[], yticks=[])
    axes.grid(False)
