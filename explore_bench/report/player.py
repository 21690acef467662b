"""What the page's replay player is given: strategies, packed trials, colours and a legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd
from markupsafe import Markup

from explore_bench.analysis.metrics import counts, score
from explore_bench.records.encoding import TrialRecord
from explore_bench.records.store import Store
from explore_bench.report import scene_colors
from explore_bench.report.drawing import entry_of
from explore_bench.report.replays import choose_trials, packed
from explore_bench.report.tables import number_text, shown_name

COLORS = {
    "unknown": scene_colors.UNKNOWN,
    "free": scene_colors.FREE,
    "occupied": scene_colors.OCCUPIED,
    "truth": scene_colors.TRUE,
    "estimate": scene_colors.ESTIMATE,
    "ellipse": scene_colors.ELLIPSE,
    "landmark": scene_colors.LANDMARK,
    "candidate": scene_colors.CANDIDATE,
    "chosen": scene_colors.CHOSEN,
    "range": scene_colors.RANGE,
    "loop": scene_colors.LOOP,
}
"""Of the player: those of the figures."""


def player_data(
    store: Store,
    records: Sequence[TrialRecord],
    table: pd.DataFrame,
    names: Sequence[str],
    beside: Sequence[str] = (),
) -> dict[str, Any]:
    """What the player reads: the strategies of `names`, and trials with their replays packed.

    `table` holds the rows of `trials.csv`, whose scores stand beside a replay. The player begins with the strategies of
    `beside`, one or two, on the largest map.
    """
    numbers = {name: i for i, name in enumerate(names)}
    values = table.set_index(["strategy", "scenario", "size", "trial", "training_seed"])
    places = list(dict.fromkeys((record.spec.scenario_name, record.spec.scenario.size) for record in records))
    places.sort(key=lambda place: place[1])
    several = len({scenario for scenario, _ in places}) > 1
    trials = []
    for choice in choose_trials([record for record in records if counts(record)]):
        spec, replay = choice.record.spec, packed(store, choice.record)
        if not replay:
            continue
        seed = pd.NA if spec.training_seed is None else spec.training_seed
        place = spec.scenario_name, spec.scenario.size
        row = values.loc[(spec.strategy, *place, spec.trial, seed)]
        e, eta = float(row["trajectory_error"]), float(row["exploration_efficiency"])
        trials.append(
            {
                "strategy": numbers[spec.strategy],
                "map": places.index(place),
                "world": spec.trial,
                "roles": choice.roles,
                "status": choice.record.status.replace("_", " "),
                "T": score(choice.record).time,
                "e": number_text(e, e),
                "eta": number_text(eta, eta),
                "data": replay,
            }
        )
    shown = [{"label": shown_name(name), "color": entry_of(name).color} for name in names]
    coverage = records[0].spec.scenario.coverage
    maps = [f"{size:g} m × {size:g} m" + (f", {scenario}" if several else "") for scenario, size in places]
    data: dict[str, Any] = {"strategies": shown, "maps": maps, "trials": trials, "colors": COLORS, "coverage": coverage}
    if beside:
        picked = dict(zip("ab", (numbers[name] for name in beside), strict=False))
        data["start"] = {"map": len(maps) - 1, **picked}
    return data


def player_legend(records: Sequence[TrialRecord]) -> list[dict[str, Any]]:
    """Marks of the player's map of these trials, with words: landmarks and finer maps where there are some."""
    c = COLORS
    landmarks = any(len(record.world.landmarks) for record in records)
    fine = [record.fine_map is not None for record in records]

    def box(color: str, more: str = "") -> str:
        return f'<rect x="5" y="1" width="14" height="12" fill="{color}" {more}/>'

    def line(color: str, more: str = "") -> str:
        return f'<path d="M2 7H22" stroke="{color}" stroke-width="2" {more}/>'

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
        "true obstacle": box(c["truth"], 'fill-opacity="0.55"') if all(fine) else box("none", dashed),
    }
    if not all(fine):
        marks |= {
            "in the sensor’s range": disc(c["range"], 6),
            "how unsure a landmark in the cell would be (1 σ)": ring,
        }
    marks |= {
        "way as believed" if all(fine) else "way as believed, 1-σ ellipses": line(c["estimate"]),
        "true way": line(c["truth"]),
    }
    if landmarks:
        marks |= {"landmark as believed": cross(c["landmark"]), "true landmark": cross(c["truth"])}
    if any(fine):
        marks |= {"loop closure": line(c["loop"]), "way driven next": line(c["chosen"], 'stroke-dasharray="5 3"')}
    marks |= {"candidate": disc(c["candidate"], 4), "chosen": disc(c["chosen"], 6)}
    return [{"mark": Markup(mark), "words": words} for words, mark in marks.items()]
