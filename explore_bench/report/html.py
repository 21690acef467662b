"""The report as one page that needs nothing else: tables, figures, a replay player and where it all comes from."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup

from explore_bench.metrics import score
from explore_bench.records import Store, TrialRecord
from explore_bench.registry import strategies
from explore_bench.report import scene
from explore_bench.report.captions import caption
from explore_bench.report.completeness import endings_table, gaps
from explore_bench.report.origin import origin_tables
from explore_bench.report.replays import choose_trials, packed
from explore_bench.report.style import entry_of
from explore_bench.report.tables import Scope, Table, number_text, shown_name
from explore_bench.report.vector import inline, width_of

POINT = 96 / 72
"""CSS pixels in a point."""

COLORS = {
    "unknown": scene.UNKNOWN,
    "free": scene.FREE,
    "occupied": scene.OCCUPIED,
    "truth": scene.TRUE,
    "estimate": scene.ESTIMATE,
    "ellipse": scene.ELLIPSE,
    "landmark": scene.LANDMARK,
    "candidate": scene.CANDIDATE,
    "chosen": scene.CHOSEN,
    "range": scene.RANGE,
}
"""Of the player: those of the figures."""


@dataclass(frozen=True)
class Section:
    """A part of the page between the introduction and the tables.

    Attributes
    ----------
    title : its heading, also in the contents.
    paragraphs : plain text.
    tables : shown below; see Table.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()


@dataclass(frozen=True)
class Content:
    """What the page shows of a results folder.

    Attributes
    ----------
    store, records : at least one trial.
    trials : rows of `trials.csv`.
    tables : as written in the folder's tables.
    figures : files in SVG.
    sections : parts of their own, in this order.
    """

    store: Store
    records: Sequence[TrialRecord]
    trials: pd.DataFrame
    tables: Sequence[Table]
    figures: Sequence[Path] = ()
    sections: Sequence[Section] = ()


def write_page(content: Content, path: Path) -> Path:
    """Write the page; the same records, code and machine give the same bytes."""
    path.write_text(render_page(content), encoding="utf-8")
    return path


def render_page(content: Content) -> str:
    """Return the page as HTML."""
    names = _names(content.records)
    numbers = {name: i for i, name in enumerate(names)}
    environment = _environment()
    environment.globals |= {
        "scope_of": lambda scopes, i: _row_scope(scopes[i], numbers) if scopes else "",
        "size_of": lambda columns, i: _size(columns[i]) if columns else "",
    }
    replays = _replays(content, names)
    return environment.get_template("page.html.j2").render(
        css=Markup(_text("page.css")),
        script=Markup(_text("player.js")),
        summary=_summary(content.records, names),
        scenario=content.records[0].spec.scenario,
        gaps=gaps(content.trials),
        sections=content.sections,
        strategies=[{"label": shown_name(name), "color": entry_of(name).color} for name in names],
        sizes=[f"{size:g}" for size in sorted({record.spec.scenario.size for record in content.records})],
        tables=content.tables,
        seeded=any(record.spec.training_seed is not None for record in content.records),
        replays=replays,
        replays_json=Markup(script_json(replays)),
        legend=_legend(),
        figures=[_figure(file) for file in sorted(content.figures)],
        endings=endings_table(content.records),
        trials=len(content.records),
        origin=origin_tables(content.records),
    )


def script_json(values: Any) -> str:
    """JSON that may stand in a script element: nothing in it can end the element or open a comment."""
    text = json.dumps(values, ensure_ascii=True, separators=(",", ":"), allow_nan=False)
    return text.replace("&", r"\u0026").replace("<", r"\u003c").replace(">", r"\u003e")


@cache
def _loader() -> jinja2.PackageLoader:
    return jinja2.PackageLoader(__package__, "page")


def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=_loader(), autoescape=True, undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )


def _text(name: str) -> str:
    """Return a file of the page as it is."""
    return _loader().get_source(_environment(), name)[0]


def _names(records: Sequence[TrialRecord]) -> list[str]:
    """Strategies that ran, in the registered order, then others by name."""
    ran = {record.spec.strategy for record in records}
    known = [name for name in strategies() if name in ran]
    return [*known, *sorted(ran - set(known))]


def _summary(records: Sequence[TrialRecord], names: Sequence[str]) -> str:
    sizes = [f"{size:g}" for size in sorted({record.spec.scenario.size for record in records})]
    worlds = len({record.spec.trial for record in records})
    which = " and ".join([", ".join(sizes[:-1]), sizes[-1]] if len(sizes) > 1 else sizes)
    return (
        f"{_counted(len(names), 'strategy', 'strategies')} for exploring an unknown map, compared in "
        f"{_counted(len(records), 'simulated trial', 'simulated trials')} on {_counted(worlds, 'world', 'worlds')} "
        f"of each size: {which} m."
    )


def _counted(count: int, one: str, many: str) -> str:
    return f"{count:,} {one if count == 1 else many}"


def _row_scope(scope: Scope, numbers: dict[str, int]) -> Markup:
    """Attributes that say which strategies and size a row speaks of; one without trials has the row shown always."""
    own = [str(numbers[name]) for name in scope.strategies if name in numbers]
    return Markup(' data-s="{}"{}').format(" ".join(own), _size(scope)) if own else Markup("")


def _size(scope: Scope) -> Markup:
    return Markup("") if scope.size is None else Markup(' data-z="{}"').format(f"{scope.size:g}")


def _figure(file: Path) -> dict[str, Any]:
    svg = file.read_text(encoding="utf-8")
    words = caption(file.stem)
    drawing = Markup(inline(svg, file.stem, words))
    return {"name": file.stem, "caption": words, "width": round(POINT * width_of(svg)), "svg": drawing}


def _replays(content: Content, names: Sequence[str]) -> dict[str, Any]:
    """What the player reads: strategies, and trials with their replays packed."""
    numbers = {name: i for i, name in enumerate(names)}
    values = content.trials.set_index(["strategy", "size", "trial", "training_seed"])
    trials = []
    for choice in choose_trials(content.records):
        spec, data = choice.record.spec, packed(content.store, choice.record)
        if not data:
            continue
        seed = pd.NA if spec.training_seed is None else spec.training_seed
        row = values.loc[(spec.strategy, spec.scenario.size, spec.trial, seed)]
        e, eta = float(row["trajectory_error"]), float(row["exploration_efficiency"])
        trials.append(
            {
                "strategy": numbers[spec.strategy],
                "size": spec.scenario.size,
                "world": spec.trial,
                "roles": choice.roles,
                "status": choice.record.status.replace("_", " "),
                "T": score(choice.record).time,
                "e": number_text(e, e),
                "eta": number_text(eta, eta),
                "data": data,
            }
        )
    shown = [{"label": shown_name(name), "color": entry_of(name).color} for name in names]
    coverage = content.records[0].spec.scenario.coverage
    return {"strategies": shown, "trials": trials, "colors": COLORS, "coverage": coverage}


def _legend() -> list[dict[str, Any]]:
    """Marks of the player's map, with words."""
    c = COLORS

    def box(color: str, more: str = "") -> str:
        return f'<rect x="5" y="1" width="14" height="12" fill="{color}" {more}/>'

    def line(color: str) -> str:
        return f'<path d="M2 7H22" stroke="{color}" stroke-width="2"/>'

    def cross(color: str) -> str:
        return f'<path d="M6 7H18M12 1V13" stroke="{color}" stroke-width="2.4"/>'

    def disc(color: str, radius: int) -> str:
        return f'<circle cx="12" cy="7" r="{radius}" fill="{color}"/>'

    ring = f'<ellipse cx="12" cy="7" rx="8" ry="5" fill="none" stroke="{c["ellipse"]}"/>'
    dashed = f'stroke="{c["truth"]}" stroke-dasharray="3 2"'
    marks = {
        "unknown": box(c["unknown"]),
        "free": box(c["free"], 'stroke="#ccc"'),
        "believed obstacle": box(c["occupied"]),
        "true obstacle": box("none", dashed),
        "in the sensor’s range": disc(c["range"], 6),
        "how unsure a landmark in the cell would be (1 σ)": ring,
        "way as believed, 1-σ ellipses": line(c["estimate"]),
        "true way": line(c["truth"]),
        "landmark as believed": cross(c["landmark"]),
        "true landmark": cross(c["truth"]),
        "candidate": disc(c["candidate"], 4),
        "chosen": disc(c["chosen"], 6),
    }
    return [{"mark": Markup(mark), "words": words} for words, mark in marks.items()]
