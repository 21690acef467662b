"""The paper's result figures from stored records, as SVG and PNG."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from explore_bench.analysis.metrics import CURVES, curve, finished
from explore_bench.analysis.statistics import CONFIDENCE, resample_weights
from explore_bench.analysis.tables import PAPER_SCENARIO
from explore_bench.records.encoding import TrialRecord
from explore_bench.records.store import Store
from explore_bench.report.drawing import entry_of, save_all, styled
from explore_bench.report.fine_scene import draw_fine_map, draw_truth, fine_map_legend, truth_legend
from explore_bench.report.moment import Scene, scene_of
from explore_bench.report.scene import draw_scene, frame, scene_legend
from explore_bench.report.tables import shown_name
from explore_bench.strategies.registry import in_order, strategies

CURVE_FIGURES = {
    "figure-08": ("layers", 20.0),
    "figure-10": ("table2", 20.0),
    "figure-11": ("table2", 40.0),
    "figure-13": ("table3", 20.0),
    "figure-14": ("table3", 30.0),
    "figure-15": ("table3", 40.0),
}
"""Figure → table and size [m] of its strategies."""

FIGURE_16_SUITE = "figure16"
"""Suite whose first strategy Figure 16 shows, where it has trials."""

PRINTED = ("table2", "table3")
"""Tables whose numbers the paper prints."""

VARIANTS = ("table3", "layers")
"""Tables of one network and its variants, whose differences to it are drawn, too."""

EXAMPLE_TRIAL = 0
"""World of the example trials (a): the first, not a chosen one."""

RESAMPLES = 1000

Groups = dict[str, list[TrialRecord]]

Curves = dict[str, dict[str, dict[int, np.ndarray]]]
"""Curve, strategy and world → values by step."""


def write_figures(store: Store, records: Sequence[TrialRecord], folder: Path) -> list[Path]:
    """Draw every figure for which there are trials; returns the files written.

    A figure is drawn where a strategy that the paper shows in it, or one that is not registered (a plugin's file, a
    strategy with parameters), has trials of its size in the paper's own scenario; strategies without trials are left
    out of it, and a network without its variants has no figure of variants. Figure 16 is drawn where a robot has a map
    finer than the grid of decisions.
    """
    written: list[Path] = []
    papers = [record for record in records if record.spec.scenario_name == PAPER_SCENARIO]
    with styled():
        for name, (table, size) in CURVE_FIGURES.items():
            groups = _groups(papers, table, size)
            shown = any(_belongs(strategy, table, size) for strategy in groups)
            shown &= not without_variants(table, groups)
            written += save_all(_examples(store, groups) if shown else None, folder / f"{name}a")
            length = _length(groups) if shown else 0
            values = {curve: {n: _of_worlds(own, curve, length) for n, own in groups.items()} for curve in CURVES}
            written += save_all(_curves(groups, values, size) if shown else None, folder / f"{name}b")
            whole = _whole(groups) if shown and table in VARIANTS else None
            written += save_all(_differences(groups, values, whole) if whole else None, folder / f"{name}c")
        written += save_all(_figure_6(store, papers), folder / "figure-06")
        moment = _moment_of_16(store, records)
        written += save_all(moment and _figure_16a(*moment), folder / "figure-16a")
        written += save_all(moment and _figure_16b(*moment), folder / "figure-16b")
    return written


def _belongs(strategy: str, table: str, size: float) -> bool:
    """Whether the paper's figure shows this strategy, or it is not registered."""
    entry = strategies().get(strategy)
    if entry is None or table not in PRINTED:
        return True
    return any(t == table and s == size for t, s, _ in entry.published)


def _groups(records: Sequence[TrialRecord], table: str, size: float) -> Groups:
    """Records of a size by strategy, for the strategies of a table, in the registered order."""
    groups: Groups = {}
    for name in in_order(record.spec.strategy for record in records):
        if table in entry_of(name).tables:
            own = [r for r in records if r.spec.strategy == name and r.spec.scenario.size == size]
            if own:
                groups[name] = own
    return groups


def _examples(store: Store, groups: Groups) -> Figure | None:
    """Last decision of one example trial per strategy, all on the same world."""
    shown = {
        name: record
        for name, own in groups.items()
        for record in reversed(own)  # of several training seeds the first
        if record.spec.trial == EXAMPLE_TRIAL and len(record.steps["step"]) > 1
    }
    if not shown:
        return None
    columns = min(3 if len(shown) <= 6 else 4, len(shown))
    rows = math.ceil(len(shown) / columns)
    size = (3.4 * columns, 3.6 * rows + 0.95)
    figure, grid = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="compressed")  # squares
    for axes, (name, record) in zip(grid.flat, shown.items(), strict=False):
        replay = store.replay(record.spec)
        scene = scene_of(store.find(record.spec), replay, max(len(replay.steps) - 2, 0))
        draw_scene(axes, scene)
        axes.set_title(f"{shown_name(name)}\n{record.status} after {record.steps['step'][-1]} steps")
    for axes in grid.flat[len(shown) :]:
        axes.set_axis_off()
    figure.legend(handles=scene_legend(scene), loc="outside lower center", ncols=min(4, 2 * columns), fontsize=8)
    return figure


def _figure_6(store: Store, records: Sequence[TrialRecord]) -> Figure | None:
    """An example of the simulation environment: the paper's size, half-way through the first such trial."""
    competitors = {name: own for name, own in _groups(records, "table2", 20.0).items() if not entry_of(name).reference}
    for record in (record for own in competitors.values() for record in own):
        spec = record.spec
        if spec.trial == EXAMPLE_TRIAL and len(record.steps["step"]) > 1:
            figure, axes = plt.subplots(figsize=(6.6, 4.6))
            replay = store.replay(spec)
            scene = scene_of(store.find(spec), replay, len(replay.steps) // 2)
            draw_scene(axes, scene)
            axes.set_title(f"{shown_name(spec.strategy)}, step {replay.steps[len(replay.steps) // 2]}")
            figure.legend(handles=scene_legend(scene), loc="outside right center", fontsize=8)
            return figure
    return None


def _moment_of_16(store: Store, records: Sequence[TrialRecord]) -> tuple[str, Scene] | None:
    """The moment that Figure 16 shows: in the first world of its suite's strategy, or of another; words for it.

    It is the decision before the longest drive of the middle third, so that there is a way to be seen.
    """
    own = [r for r in records if r.fine_map is not None and len(r.steps["step"]) > 1]
    names = in_order(record.spec.strategy for record in own)
    if not names:
        return None
    name = next((name for name in names if FIGURE_16_SUITE in entry_of(name).suites), names[0])
    spec = min((one.spec for one in own if one.spec.strategy == name), key=lambda spec: spec.trial)
    record, replay = store.find(spec), store.replay(spec)
    third = (len(replay.steps) - 1) // 3
    driven = np.diff(record.steps["path_length"][replay.steps])
    chosen = third + int(driven[third : 2 * third + 1].argmax())
    words = f"{shown_name(name)}, key pose {replay.steps[chosen]} of {replay.steps[-1]}"
    return words, scene_of(record, replay, chosen)


def _figure_16a(words: str, scene: Scene) -> Figure:
    """The true scene."""
    figure, axes = plt.subplots(figsize=(6.4, 4.9))
    draw_truth(axes, scene)
    frame(axes, scene)
    axes.set_title(f"The scene: {words}")
    figure.legend(handles=truth_legend(), loc="outside right center", fontsize=8)
    return figure


def _figure_16b(words: str, scene: Scene) -> Figure:
    """The map that the robot has made of it so far."""
    figure, axes = plt.subplots(figsize=(6.4, 4.9))
    draw_fine_map(axes, scene, truth=False)
    frame(axes, scene)
    axes.set_title(f"The robot's map: {words}")
    figure.legend(handles=fine_map_legend(scene, truth=False), loc="outside right center", fontsize=8)
    return figure


def _curves(groups: Groups, values: Curves, size: float) -> Figure:
    """Means over worlds with bootstrap bands, and the number of trials still running below."""
    ends = {name: np.array([_duration(record) for record in own]) for name, own in groups.items()}
    length = _length(groups)
    figure, grid = plt.subplots(
        2, 3, figsize=(11.5, 4.6), sharex=True, height_ratios=(4, 1), gridspec_kw={"hspace": 0.05}
    )
    step = np.arange(length)
    for column, (name, (title, unit)) in enumerate(CURVES.items()):
        axes = grid[0, column]
        for strategy, own in groups.items():
            if name != "explored" and not entry_of(strategy).fills(name):
                continue
            _band(axes, step, np.array(list(values[name][strategy].values())), strategy, own[0].spec.root)
        axes.set_title(title)
        axes.set_ylabel(f"[{unit}]" if unit != "1" else "known share")
        if name == "explored":
            axes.set_ylim(0, 1)
        elif name == "exploration_efficiency":  # it starts at infinity
            early = [line.get_ydata()[_early(length)] for line in axes.get_lines()]
            axes.set_ylim(0, 1.1 * max((value for value in early if math.isfinite(value) and value > 0), default=1.0))
        below = grid[1, column]
        for strategy, own_ends in ends.items():
            running = (own_ends[:, None] > step).mean(axis=0) * _worlds(groups[strategy])
            below.step(step, running, color=entry_of(strategy).color, linewidth=1.0, where="post")
        below.set(xlabel="step", xlim=(0, length - 1))
        below.set_ylim(bottom=0)
    grid[1, 0].set_ylabel("running")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(groups)), fontsize=8)
    worlds = max(_worlds(own) for own in groups.values())
    figure.suptitle(f"{size:g} m × {size:g} m, {worlds} worlds, mean and {CONFIDENCE:.0%} bootstrap band", fontsize=10)
    return figure


def _whole(groups: Groups) -> str | None:
    """Network that the others are variants of: the one that the paper prints with its competitors, too; or none."""
    return next((name for name in groups if _is_whole(name) and len(groups) > 1), None)


def _is_whole(name: str) -> bool:
    return {table for table, _, _ in entry_of(name).published} >= set(PRINTED)


def without_variants(table: str, names: Collection[str]) -> bool:
    """Whether a table of variants would show their whole network alone, which has its place among its competitors."""
    return table in VARIANTS and len(names) == 1 and all(map(_is_whole, names))


def _differences(groups: Groups, values: Curves, whole: str) -> Figure | None:
    """Each variant's curves less those of the whole network, paired by world, with bootstrap bands; a column each."""
    worlds = {name: sorted(values["explored"][name].keys() & values["explored"][whole].keys()) for name in groups}
    others = [name for name in groups if name != whole and worlds[name]]
    if not others:
        return None
    length = _length(groups)
    step = np.arange(length)
    width, height = max(1.2 + 1.9 * len(others), 6.4), 5.8  # the title is as wide as that
    figure, grid = plt.subplots(
        *(len(CURVES), len(others)), figsize=(width, height), sharex=True, sharey="row", squeeze=False, layout="none"
    )
    figure.subplots_adjust(1.0 / width, 0.5 / height, 1 - 0.1 / width, 1 - 0.75 / height, wspace=0.08, hspace=0.22)
    for i, (name, (title, unit)) in enumerate(CURVES.items()):
        row, ends = grid[i], []
        for axes, other in zip(row, others, strict=True):
            pairs = np.array([values[name][other][world] - values[name][whole][world] for world in worlds[other]])
            axes.axhline(0.0, color=entry_of(whole).color, linewidth=1.0)
            low, high = _band(axes, step, pairs, other, groups[other][0].spec.root)
            ends += [low[_early(length) :], high[_early(length) :]]
            off = np.mean((low > 0) | (high < 0))
            said = f"off 0 in {off:.0%} of steps" if len(pairs) > 1 else ""
            axes.set_title(f"{shown_name(other)}\n{said}" if not i else said, fontsize=8.5)
        reach = max((float(np.nanmax(np.abs(one))) for one in ends if np.isfinite(one).any()), default=0.0) or 1.0
        row[0].set_ylim(-1.1 * reach, 1.1 * reach)  # the first steps differ by what nobody chose
        row[0].set_ylabel(f"{title}\n[{unit}]" if unit != "1" else title, fontsize=8)
    for axes in grid[-1]:
        axes.set(xlabel="step", xlim=(0, length - 1))
    figure.suptitle(
        f"Difference to {shown_name(whole)}, paired by world: mean and {CONFIDENCE:.0%} bootstrap band", fontsize=10
    )
    return figure


def _length(groups: Groups) -> int:
    """Steps that curves show: until 95 % of the trials of every strategy have ended."""
    return 1 + int(max(np.quantile([_duration(record) for record in own], 0.95) for own in groups.values()))


def _early(length: int) -> int:
    """Step from which on η is drawn in full: it starts at infinity."""
    return min(max(length // 8, 1), length - 1)


def _worlds(records: Sequence[TrialRecord]) -> int:
    return len({record.spec.trial for record in records})


def _of_worlds(records: Sequence[TrialRecord], name: str, length: int) -> dict[int, np.ndarray]:
    """Curve of a strategy in each world, averaged over its training seeds, shape (length,) each."""
    worlds: dict[int, list[np.ndarray]] = {}
    for record in records:
        worlds.setdefault(record.spec.trial, []).append(curve(record, name, length))
    return {world: np.mean(own, axis=0) for world, own in worlds.items()}


def _duration(record: TrialRecord) -> int:
    """Steps that a trial ran, by the rule for unfinished ones: until the step limit."""
    return int(record.steps["step"][-1]) if finished(record) else record.spec.scenario.step_limit


def _band(axes: Axes, step: np.ndarray, values: np.ndarray, strategy: str, root: int) -> tuple[np.ndarray, np.ndarray]:
    """Draw the mean over worlds of values, shape (worlds, steps), and its pointwise bootstrap band; return this."""
    entry = entry_of(strategy)
    count = len(values)
    weights = resample_weights(count, root, RESAMPLES) / count
    ends = [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]
    low, high = np.quantile(values.T @ weights.T, ends, axis=1)
    style = "--" if entry.reference else "-"
    axes.plot(step, values.mean(axis=0), color=entry.color, linestyle=style, linewidth=1.3, label=shown_name(strategy))
    if count > 1:
        axes.fill_between(step, low, high, color=entry.color, alpha=0.18, linewidth=0)
    return low, high
