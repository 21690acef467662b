"""Trials to look at: a picture of the end, an animation, or a page that plays them."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure

from explore_bench.analysis.tables import trial_table
from explore_bench.errors import RequestError, writing
from explore_bench.files import write_whole
from explore_bench.records.encoding import Replay, TrialRecord
from explore_bench.records.store import Store
from explore_bench.report.drawing import entry_of, save, styled
from explore_bench.report.html import Content, write_page
from explore_bench.report.moment import scene_of
from explore_bench.report.scene import draw_scene, scene_legend
from explore_bench.report.side_by_side import save_side_by_side
from explore_bench.runs.witness import run_witnessed
from explore_bench.trial.spec import TrialSpec

FRAMES_PER_SECOND = 2
SUFFIXES = (".gif", ".png", ".svg", ".html")


def draw_trial(spec: TrialSpec, path: Path) -> TrialRecord:
    """Run a trial and draw it: .png or .svg (its end), .gif (every decision and the end), .html (a player).

    The reason of the record that is returned names the place in the strategy's source where it raised.

    Raises
    ------
    RequestError : for another suffix, a file that cannot be written, or a trial that failed before any decision.
    """
    [[record]] = draw_trials([[spec]], path)
    return record


def draw_trials(rows: Sequence[Sequence[TrialSpec]], path: Path) -> list[list[TrialRecord]]:
    """Run trials and draw them: a single one as `draw_trial` does, several side by side, a row after the other.

    Raises
    ------
    RequestError : as `draw_trial`.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise RequestError(f"output '{path}' has the suffix '{path.suffix}'; end it in {', '.join(SUFFIXES)}.")
    specs = [spec for row in rows for spec in row]
    with tempfile.TemporaryDirectory() as folder:
        store = Store(Path(folder))
        store.open(specs[0].root, specs[0].purpose, scenario=None)
        shown = [[_ran(spec, store) for spec in row] for row in rows]
        records = [record for row in shown for record, _ in row]
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        if suffix == ".html":
            write_page(Content(store, records, trial_table(records), ()), path)
    if suffix != ".html":
        with styled():
            if len(records) == 1:
                _draw_alone(*shown[0][0], path)
            else:
                save_side_by_side(shown, path)
    return [[record for record, _ in row] for row in shown]


def _ran(spec: TrialSpec, store: Store) -> tuple[TrialRecord, Replay]:
    """Run a trial into a store, and return its record and replay."""
    result, reason = run_witnessed(spec)
    store.write(result)
    record, replay = dataclasses.replace(store.find(spec), reason=reason), store.replay(spec)
    if not replay.steps:
        raise RequestError(f"strategy '{spec.strategy}' failed before any decision: {record.reason}.")
    return record, replay


def _draw_alone(record: TrialRecord, replay: Replay, path: Path) -> None:
    figure = plt.figure(figsize=(7.0, 4.9))
    if path.suffix.lower() == ".gif":
        _animate(figure, record, replay, path)
    else:
        _draw(figure, record, replay, len(replay.steps) - 1)
        save(figure, path)


def _draw(figure: Figure, record: TrialRecord, replay: Replay, index: int) -> None:
    figure.clear()
    axes = figure.add_subplot()
    scene = scene_of(record, replay, index)
    draw_scene(axes, scene)
    step = replay.steps[index]
    known, uncertainty = record.steps["explored"][step], record.steps["uncertainty"][step]
    axes.set_title(f"{entry_of(record.spec.strategy).label}: step {step}, {known:.0%} known, U = {uncertainty:.0f} m²")
    figure.legend(handles=scene_legend(scene), loc="outside right center", fontsize=8)


def _animate(figure: Figure, record: TrialRecord, replay: Replay, path: Path) -> None:
    """Draw all decisions, the end held for a second longer."""
    frames = [*range(len(replay.steps)), *[len(replay.steps) - 1] * FRAMES_PER_SECOND]

    def draw(index: int) -> None:
        _draw(figure, record, replay, index)

    animation = FuncAnimation(figure, draw, frames, init_func=lambda: None)
    with tempfile.TemporaryDirectory() as folder:
        drawn = Path(folder, "drawn.gif")
        animation.save(drawn, writer=PillowWriter(fps=FRAMES_PER_SECOND), dpi=90)
        write_whole(path, drawn.read_bytes())
