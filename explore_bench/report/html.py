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

from explore_bench.analysis.tables import of_paper
from explore_bench.files import write_whole
from explore_bench.records.encoding import TrialRecord
from explore_bench.records.store import Store
from explore_bench.report.answer import answer
from explore_bench.report.captions import caption
from explore_bench.report.completeness import endings_table, gaps
from explore_bench.report.drawing import entry_of
from explore_bench.report.markup import column_attributes, dot, header_groups, row_scope
from explore_bench.report.origin import origin_tables
from explore_bench.report.player import player_data, player_legend
from explore_bench.report.tables import Table, shown_name
from explore_bench.report.vector import inline, width_of
from explore_bench.strategies.registry import in_order

POINT = 96 / 72
"""CSS pixels in a point."""


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
    stale : stored trials of older code, which are left out.
    verdicts : claims as (name, statement, verdict, comparisons); their details are the first section.
    """

    store: Store
    records: Sequence[TrialRecord]
    trials: pd.DataFrame
    tables: Sequence[Table]
    figures: Sequence[Path] = ()
    sections: Sequence[Section] = ()
    stale: int = 0
    verdicts: Sequence[tuple[str, ...]] = ()


def write_page(content: Content, path: Path) -> Path:
    """Write the page; the same records, code and machine give the same bytes."""
    return write_whole(path, render_page(content))


def render_page(content: Content) -> str:
    """Return the page as HTML."""
    names = in_order(record.spec.strategy for record in content.records)
    numbers = {name: i for i, name in enumerate(names)}
    environment = _environment()
    environment.globals |= {
        "scope_of": lambda scopes, i: row_scope(scopes[i], numbers) if scopes else "",
        "dot_of": dot,
        "groups_of": header_groups,
        "nested": lambda groups: any(group.names for group in groups),
        "attributes_of": column_attributes,
    }
    found = answer(content.trials, content.records)
    beside = found.beside if found else ()
    replays = player_data(content.store, content.records, content.trials, names, beside)
    return environment.get_template("page.html.j2").render(
        css=Markup(_text("page.css")),
        script=Markup(_text("player.js")),
        answer=found,
        verdicts=content.verdicts,
        summary=_summary(content.records, names),
        scenario=content.records[0].spec.scenario,
        of_paper=of_paper(content.trials),
        given=all(record.spec.scenario.map is not None for record in content.records),
        gaps=gaps(content.trials, content.stale),
        sections=content.sections,
        strategies=[{"label": shown_name(name), "color": entry_of(name).color} for name in names],
        sizes=[f"{size:g}" for size in sorted({record.spec.scenario.size for record in content.records})],
        tables=content.tables,
        seeded=any(record.spec.training_seed is not None for record in content.records),
        replays=replays,
        replays_json=Markup(script_json(replays)),
        legend=player_legend(content.records),
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
    return jinja2.PackageLoader(__package__, "assets")


def _environment() -> jinja2.Environment:
    return jinja2.Environment(
        loader=_loader(), autoescape=True, undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )


def _text(name: str) -> str:
    """Return a file of the page as it is."""
    return _loader().get_source(_environment(), name)[0]


def _summary(records: Sequence[TrialRecord], names: Sequence[str]) -> str:
    sizes = [f"{size:g}" for size in sorted({record.spec.scenario.size for record in records})]
    worlds = len({record.spec.trial for record in records})
    which = " and ".join([", ".join(sizes[:-1]), sizes[-1]] if len(sizes) > 1 else sizes)
    what = (
        f"{_counted(len(names), 'strategy', 'strategies')} for exploring an unknown map, compared in "
        f"{_counted(len(records), 'simulated trial', 'simulated trials')}"
    )
    first, maps = records[0].spec, {record.spec.scenario.map for record in records}
    if first.scenario.map is not None and len(maps) == 1:
        draws = _counted(worlds, "draw", "draws")
        return f"{what} in one given map, '{first.scenario_name}', {which} m wide, with {draws} of start and noise."
    return f"{what} on {_counted(worlds, 'world', 'worlds')} of each size: {which} m."


def _counted(count: int, one: str, many: str) -> str:
    return f"{count:,} {one if count == 1 else many}"


def _figure(file: Path) -> dict[str, Any]:
    svg = file.read_text(encoding="utf-8")
    words = caption(file.stem)
    drawing = Markup(inline(svg, file.stem, words))
    return {"name": file.stem, "caption": words, "width": round(POINT * width_of(svg)), "svg": drawing}
