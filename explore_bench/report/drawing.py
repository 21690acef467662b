"""How figures look: one set of matplotlib settings, bytes that do not change from run to run."""

from __future__ import annotations

import io
import pickle
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, LogLocator, NullFormatter

from explore_bench.errors import RequestError, writing
from explore_bench.files import write_whole
from explore_bench.report.vector import slim
from explore_bench.strategies.entry import Entry
from explore_bench.strategies.registry import entry_named
from explore_bench.trial.spec import TrialSpec

SETTINGS: Any = {
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 10,
    "figure.constrained_layout.use": True,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "savefig.dpi": 120,
    "svg.fonttype": "path",
    "svg.hashsalt": "explore-bench",
    "text.parse_math": False,  # a label may hold dollar signs
}


@contextmanager
def styled() -> Iterator[None]:
    """Draw in the benchmark's style, and close every figure afterwards."""
    with matplotlib.rc_context(SETTINGS):
        try:
            yield
        finally:
            plt.close("all")


_references: ContextVar[frozenset[str]] = ContextVar("references", default=frozenset())


@contextmanager
def showing(specs: Iterable[TrialSpec]) -> Iterator[None]:
    """Mark as references, in the block, the strategies that were told the truth when their trials ran."""
    token = _references.set(frozenset(spec.strategy for spec in specs if spec.reference))
    try:
        yield
    finally:
        _references.reset(token)


def entry_of(name: str) -> Entry:
    """Entry of a strategy, also of one that is not registered (any more), for then its name says it all."""
    return entry_named(name, _references.get())


class _RoundNumbers(LogLocator):
    """1, 2 and 5 times the powers of ten; any round numbers where fewer than two of these are in view."""

    def __init__(self) -> None:
        super().__init__(subs=(1, 2, 5))

    def tick_values(self, vmin: float, vmax: float) -> Any:
        ticks = np.asarray(super().tick_values(vmin, vmax))
        return ticks if ((vmin <= ticks) & (ticks <= vmax)).sum() > 1 else AutoLocator().tick_values(vmin, vmax)


def plain_log(axis: Axis) -> None:
    """Mark a logarithmic axis at round numbers, in plain digits."""
    axis.set_major_locator(_RoundNumbers())
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


_postponed: ContextVar[list[tuple[bytes, Path]] | None] = ContextVar("postponed", default=None)


@contextmanager
def postponing() -> Iterator[list[tuple[bytes, Path]]]:
    """Write no figure in the block: `save_all` puts them into the list that this gives, as `draw` takes them."""
    postponed: list[tuple[bytes, Path]] = []
    token = _postponed.set(postponed)
    try:
        yield postponed
    finally:
        _postponed.reset(token)


def save_all(figure: Figure | None, stem: Path) -> list[Path]:
    """Write a figure as SVG and PNG and return the files; without one, remove what an earlier report left."""
    files = [stem.with_name(stem.name + suffix) for suffix in (".svg", ".png")]
    if figure is None:
        for file in files:
            file.unlink(missing_ok=True)
        return []
    if (postponed := _postponed.get()) is not None:
        postponed.append((pickle.dumps(figure), stem))
    else:
        if layout := figure.get_layout_engine():
            layout.execute(figure)  # once for both files: it takes as long as drawing one
            figure.set_layout_engine("none")
        for file in files:
            save(figure, file)
    plt.close(figure)
    return files


def draw(pickled: bytes, stem: Path) -> None:
    """Write a figure that was postponed."""
    with styled():
        save_all(pickle.loads(pickled), stem)


def save(figure: Figure, path: Path) -> None:
    """Write a figure to a file of the kind that its suffix names, without a date.

    Raises
    ------
    RequestError : where the file cannot be written or the suffix is none of .png and .svg.
    """
    suffix = path.suffix.lower()
    if suffix not in (".png", ".svg"):
        raise RequestError(f"output '{path}' has the suffix '{path.suffix}'; end it in .png, .svg or .gif.")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    drawn = io.BytesIO()
    figure.dpi = matplotlib.rcParams["savefig.dpi"]
    if suffix == ".png":  # not by figure.savefig, which draws all of it once more for a layout that is done
        FigureCanvasAgg(figure).print_png(drawn, metadata={"Software": None})
        write_whole(path, drawn.getvalue())
    else:
        FigureCanvasSVG(figure).print_svg(drawn, metadata={"Date": None})
        write_whole(path, slim(drawn.getvalue().decode()))
