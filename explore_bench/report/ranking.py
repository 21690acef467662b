"""The ranking as a picture that a person reads in seconds: a line a strategy, best first, a column a metric and place.

It is an SVG that stands alone, on white, and takes the colours of the page where it stands in one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import groupby

from explore_bench.analysis.metrics import all_metrics
from explore_bench.analysis.ranking import Place, Standing
from explore_bench.analysis.statistics import Estimate
from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import heading, interval_text, shown_name

NAMES, GAP, ROW, HEAD, FOOT = 196, 20, 18, 50, 20
"""Widths of the names and of the gap before a column; heights of a line, of what stands above all and below [px]."""

WIDTH, LEAST, MOST = 1200, 110, 240
"""Width that a picture should have, least and most width of a column [px]."""

INK, SOFT, LINE, FAINT, CARD = (
    f"var(--{name},{color})"
    for name, color in (
        ("ink", "#1c2024"),
        ("soft", "#5b646d"),
        ("line", "#d9dde1"),
        ("faint", "#f1f3f4"),
        ("card", "#ffffff"),
    )
)
FONT = "font-family:system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;font-size:12px"


@dataclass(frozen=True)
class Column:
    """A column of the picture.

    Attributes
    ----------
    group : what stands above it and its neighbours of the same group.
    title : of the column, with the unit.
    better : which direction is better.
    values : by strategy; intervals may be NaN.
    none : strategies of which there is nothing to measure, as is said in their lines.
    """

    group: str
    title: str
    better: str
    values: Mapping[str, Estimate]
    none: Collection[str] = ()
    places: tuple[float, float] = field(init=False)

    def __post_init__(self) -> None:
        ends = [end for own in self.values.values() for end in (own.mean, own.low, own.high) if end > 0]
        low, high = (min(ends), max(ends)) if ends else (1.0, 1.0)
        object.__setattr__(self, "places", (math.log(low) - 0.05, math.log(high) + 0.05))

    def at(self, value: float) -> float:
        """Place of a value on the logarithmic axis, from 0 to 1."""
        low, high = self.places
        return min(max((math.log(max(value, 1e-9)) - low) / (high - low), 0.0), 1.0)

    def ticks(self) -> list[float]:
        """Two to four round numbers on the axis."""
        low, high = map(math.exp, self.places)
        powers = [10.0**power for power in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)]
        found: list[float] = []
        for steps in ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 5.0, 7.0), range(10, 100)):
            found = [one / (10 if one >= 10 else 1) * power for power in powers for one in steps]
            found = [one for one in found if low <= one <= high]
            if len(found) > 1:
                break
        return found[:: max(1, math.ceil(len(found) / 4))]


def ranking_columns(ranking: Sequence[Standing], places: Sequence[Place]) -> list[Column]:
    """Columns of the metrics that rank, grouped by place; a scenario is named where there are several."""
    several = len({scenario for scenario, _ in places}) > 1
    known, columns = all_metrics(), []
    for scenario, size in places:
        group = f"{scenario}, {size:g} m" if several else f"map of {size:g} m"
        for metric in dict.fromkeys(metric for own in ranking for _, metric in own.means):
            values = {own.strategy: mean for own in ranking if (mean := own.means.get(((scenario, size), metric)))}
            columns.append(Column(group, heading(known[metric]), str(known[metric].better), values))
    return columns


def ranking_svg(
    names: Sequence[str], columns: Sequence[Column], references: Collection[str] = (), width: int = WIDTH
) -> str:
    """Draw strategies, best first, with their means and 95 % intervals; the first is marked, references stand apart."""
    competitors = [name for name in names if name not in references]
    lines = {name: HEAD + ROW * (i + (0.5 if name in references else 0)) for i, name in enumerate(names)}
    bottom = HEAD + ROW * (len(names) + (0.5 if len(competitors) < len(names) else 0))
    wide = min(max((width - NAMES) // max(len(columns), 1) - GAP, LEAST), MOST)
    width, height = NAMES + len(columns) * (wide + GAP) + 6, bottom + FOOT
    words = "Ranking, best first: " + ", ".join(shown_name(name) for name in names) + "."
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height:g}" width="{width}" role="img" '
        f'height="{height:g}" aria-label="{escape(words)}" style="{FONT};fill:{INK}">',
        f'<rect width="{width}" height="{height:g}" style="fill:{CARD}"/>',
        f'<rect y="{HEAD}" width="{width}" height="{ROW}" style="fill:{FAINT}"/>' if len(competitors) > 1 else "",
        *(_name(name, lines[name], name in references, name == names[0] and len(competitors) > 1) for name in names),
    ]
    left = NAMES + GAP
    for group, own in groupby(columns, key=lambda column: column.group):
        count = len(list(own))
        middle = left + (count * (wide + GAP) - GAP) / 2
        parts.append(f'<text x="{middle:g}" y="15" text-anchor="middle" font-weight="600">{escape(group)}</text>')
        left += count * (wide + GAP)
    for i, column in enumerate(columns):
        parts += _column(column, NAMES + GAP + i * (wide + GAP), wide, lines, bottom, references)
    return "".join(parts) + "</svg>"


def _name(name: str, y: float, reference: bool, first: bool) -> str:
    """Dot and label of a strategy."""
    color, weight, middle = (SOFT if reference else INK), ("700" if first else "400"), y + ROW / 2
    return (
        f'<circle cx="9" cy="{middle:g}" r="4" fill="{entry_of(name).color}" style="stroke:{SOFT};stroke-width:.5"/>'
        f'<text x="19" y="{middle + 4:g}" font-weight="{weight}" style="fill:{color}">{escape(shown_name(name))}</text>'
    )


def _column(
    column: Column, left: float, wide: float, lines: Mapping[str, float], bottom: float, references: Collection[str]
) -> list[str]:
    """Title, axis and marks of a column that begins at `left` and is so wide."""
    arrow = {"lower": "◂ better", "higher": "better ▸"}.get(column.better, "")
    small = f'font-size="10.5" style="fill:{SOFT}"'
    anchor, x = ("end", left + wide) if column.better == "higher" else ("start", left)
    parts = [
        f'<text x="{left + wide / 2:g}" y="31" text-anchor="middle">{escape(column.title)}</text>',
        f'<text x="{x:g}" y="45" text-anchor="{anchor}" {small}>{arrow}</text>',
    ]
    for tick in column.ticks():
        x = left + wide * column.at(tick)
        parts.append(f'<path d="M{x:.1f} {HEAD}V{bottom:g}" style="stroke:{LINE}"/>')
        parts.append(f'<text x="{x:.1f}" y="{bottom + 14:g}" text-anchor="middle" {small}>{tick:g}</text>')
    for name, value in column.values.items():
        if name not in lines or not math.isfinite(value.mean):
            continue
        color, y = entry_of(name).color, lines[name] + ROW / 2
        low, mid, high = (
            left + wide * column.at(end if math.isfinite(end) else value.mean)
            for end in (value.low, value.mean, value.high)
        )
        fill = f'style="fill:{CARD}" stroke="{color}" stroke-width="2"' if name in references else f'fill="{color}"'
        title = f"{shown_name(name)}, {column.group}: {column.title} {interval_text(value)}"
        parts.append(
            f'<g><title>{escape(title)}</title><path d="M{low:.1f} {y:g}H{high:.1f}" stroke="{color}" '
            f'stroke-width="2.6"/><circle cx="{mid:.1f}" cy="{y:g}" r="3.6" {fill}/></g>'
        )
    for name in column.none:
        if name in lines:
            y = lines[name] + ROW / 2 + 4
            parts.append(f'<text x="{left:g}" y="{y:g}" {small}>none</text>')
    return parts
