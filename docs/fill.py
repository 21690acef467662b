"""Fill the computed parts of README.md and docs/*.md, draw their ranking, and write submissions/schema.json.

    python docs/fill.py [--check]

A part stands between `<!-- begin NAME -->` and `<!-- end NAME -->`. With --check nothing is written and the exit code
is 1 where a page is out of date.
"""

from __future__ import annotations

import argparse
import inspect
import itertools
import json
import math
import re
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).with_name("studies")))

from field_tuning import SWEEPS

import explore_bench
from baselines.catalogue import CONTROLS, STRATEGIES
from explore_bench.analysis.claims import CONTRADICTED, SUPPORTED
from explore_bench.analysis.csv_files import read_csv
from explore_bench.analysis.metrics import METRICS, REGRETS, all_metrics, metrics_of
from explore_bench.analysis.paired import paired
from explore_bench.analysis.ranking import Standing, duels, standings
from explore_bench.analysis.statistics import Estimate
from explore_bench.analysis.tables import PAPER_SCENARIO, seed_means
from explore_bench.report.answer import headline, how_sure, price_of, training_column, training_minutes
from explore_bench.report.pages.field import TIMES
from explore_bench.report.ranking import Column, ranking_columns, ranking_svg
from explore_bench.report.tables import heading, interval_text, p_text, signed_text
from explore_bench.runs.perf import read_json, text
from explore_bench.runs.submission.manifest import schema
from explore_bench.strategies.loading import load_factory
from explore_bench.strategies.registry import strategies
from explore_bench.trial.snapshot import FINE_COLUMNS, REPLAY_COLUMNS
from explore_bench.trial.steps import FINAL_COLUMNS, step_columns
from explore_bench.world.scenarios import PAPER

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "results"
STUDIES = ROOT / "docs" / "studies"
WEIGHTS = ROOT / "baselines" / "weights"
TOURS = ROOT / "baselines" / "reference" / "tours.csv"
PAGES = ("README.md", *(f"docs/{path.name}" for path in sorted((ROOT / "docs").glob("*.md"))))
STAGE_COLUMNS = (
    *("Method", "scenario", "n", "not explored", "T90 [s]", "T98 [s]", "L90 [m]", "L [m]", "D", "in vain"),
    *("e [m]", "ATE [m]", "NEES", "wall F1, 1 cell", "closures, true", "closures, false", "closures, missed", "C"),
)
"""Columns of the results in lidar worlds that docs/stage.md shows."""
FIELD_COLUMNS = {
    "field": (
        *("Method", "stuck [%]", "e [m]", "η [m²/step]", "T90 [step]", "L [m]", "R", "crossings", "round trips"),
        *("decision, median [ms]", "99 % [ms]"),
    ),
    "field-stage": (
        *("Method", "stuck [%]", "L90 [m]", "T98 [s]", "L [m]", "e [m]", "ATE [m]", "crossings", "round trips"),
        *("decision, median [ms]", "99 % [ms]"),
    ),
}
"""Columns of the results of the suites of the field that docs/field.md shows."""
VALIDATED, NEAR = (500, 1000, 1500, 2000, 3000, 4500, 6000), 100
"""Episodes at which docs/learning.md tells the validations, and how near to them one has to be."""
RANKED, WIDE = (20.0, 40.0), 980
"""Sizes [m] of README.md's ranking, those of the paper's Table 2; width of its picture [px]."""
OURS = "belief-attention"
OF_CELLS = tuple(name for name, entry in strategies().items() if entry.tables == ("cells",))
"""The networks with H_γ of a node's own cell."""
SYMBOLS = {"e": "trajectory_error", "η": "exploration_efficiency"}
PAIRS = (
    ("graph-stnn", "uncertainty"),
    ("graph-stnn", "gcn-obs"),
    ("graph-stnn-path", "graph-stnn"),
    ("graph-stnn-path", "uncertainty"),
    ("gcn-obs", "gcn-no-obs"),
    ("gcn-obs", "gcn-obs-blind"),
    ("graph-stnn", "graph-stnn-1-layer"),
    ("graph-stnn", "graph-stnn-3-layers"),
    *(("graph-stnn", name) for name, entry in strategies().items() if entry.tables == ("table3",)),
    ("graph-stnn", "graph-stnn-cell"),
    *(("graph-stnn-cell", name) for name in OF_CELLS if name != "graph-stnn-cell"),
    *((OURS, name) for name, entry in strategies().items() if entry.tables and not entry.reference and name != OURS),
)
TARGETS = (("graph-stnn", "uncertainty"), ("graph-stnn", "gcn-obs"))
"""Pairs whose margins in the paper's Table 2 stand beside ours."""
CONSTANTS = ["step_length", "odometry_sigma", "obstacle_density"]
PLAIN = {
    "Array": "Numpy array of float64, the type in signatures.",
    "Pose": "(x, y, heading) [m, m, rad], a tuple of three floats.",
    "Published": "The paper's values of a strategy, by table, size and metric.",
    "OCCUPIED_ABOVE": "A cell whose probability exceeds this is believed occupied.",
    "PAPER": "The scenario of the paper.",
    "REWARD_WEIGHTS": "The constants of Eq. 24 with which this project trains.",
    "CANDIDATE_COLUMNS": "Columns of a candidate among the features, in order.",
    "STATE_COLUMNS": "Columns of the state among the features, in order.",
    "CURVE_COLUMNS": "Columns of a training curve.",
    "VALIDATION_COLUMNS": "Columns of the validations of a training.",
    "CURVE_WINDOW": "Steps that a row of a training curve stands for.",
}
"""What those public names are that have no docstring of their own."""


def ranking_picture() -> str:
    """The compared strategies, best first: e and η at RANKED sizes, and what they cost."""
    ranking, names = _ranking()
    columns = ranking_columns(ranking, [(PAPER_SCENARIO, size) for size in RANKED])
    decisions = {name: Estimate(own["40"], math.nan, math.nan, 1) for name, own in _decision_ms().items()}
    price = training_column(training_minutes({name: strategies()[name].weights.values() for name in names}), names)
    assert price is not None
    columns += [Column(price.group, "decision, 40 m [ms]", "lower", decisions), price]
    return ranking_svg(names, columns, {name for name in names if strategies()[name].reference}, WIDE)


def ranking_table() -> str:
    """e, η and price of the compared strategies on the largest maps, best first."""
    ranking, names = _ranking()
    size = max(RANKED)
    decisions = _decision_ms()
    minutes = training_minutes({name: strategies()[name].weights.values() for name in names})
    rows = []
    for own in ranking:
        if not strategies()[own.strategy].reference:
            row = {"Strategy": strategies()[own.strategy].label}
            for metric in SYMBOLS.values():
                row[f"{heading(METRICS[metric])}, {size:g} m"] = interval_text(
                    own.means[(PAPER_SCENARIO, size), metric]
                )
            row["decision [ms]"] = f"{decisions[own.strategy][f'{size:g}']:.2g}"
            cost = minutes.get(own.strategy)
            row["training"] = f"{cost.n} × {cost.mean:.0f} min" if cost else "none"
            rows.append(row)
    return markdown(pd.DataFrame(rows))


def ranking_words() -> str:
    """Who explores best, how sure that is, and at what price, as the report says it."""
    return _answer(_trials(), _competitors(_ranking()[0]))


def _answer(trials: pd.DataFrame, competitors: list[str]) -> str:
    """The headline and what stands under it."""
    found = duels(trials, competitors)
    ran = trials[["strategy", "training_seed"]].dropna().drop_duplicates().itertuples(index=False)
    weights: dict[str, list[str]] = {}
    for name, seed in ran:
        weights.setdefault(name, []).append(strategies()[name].weights[seed])
    said = how_sure(competitors, found), price_of(competitors, training_minutes(weights))
    return f"**{headline(competitors, found)}.** {' '.join(said)}"


def _competitors(ranking: list[Standing]) -> list[str]:
    return [own.strategy for own in ranking if not strategies()[own.strategy].reference]


@cache
def _ranking() -> tuple[list[Standing], list[str]]:
    """Standings of the stored trials at all sizes, and the names in their order."""
    ranking = _standings(_trials())
    return ranking, [own.strategy for own in ranking]


def _standings(trials: pd.DataFrame) -> list[Standing]:
    return standings(trials, {name for name, entry in strategies().items() if entry.reference})


def _decision_ms() -> dict[str, dict[str, float]]:
    """Median time of a decision [ms] by strategy and size, as `explore-bench perf` measured it."""
    return read_json(STUDIES / "perf.json").decision_ms


def table2() -> str:
    """Table 2 as `explore-bench report` wrote it."""
    return (ROOT / "results" / "tables" / "table2.md").read_text(encoding="utf-8")


def claims() -> str:
    """Verdicts on the paper's claims as `explore-bench report` wrote them."""
    return (ROOT / "results" / "tables" / "claims.md").read_text(encoding="utf-8")


def calibration_result() -> str:
    """The settings of the last pass, best first."""
    fine = pd.read_csv(STUDIES / "calibration-fine.csv")
    return markdown(fine[[*CONSTANTS, "connected_draws", "worlds", "rms", "low", "high"]].round(3))


def calibration_coarse() -> str:
    """The settings of the first two passes, best first."""
    coarse = pd.read_csv(STUDIES / "calibration-coarse.csv")
    return markdown(coarse[[*CONSTANTS, "worlds", "rms", "low", "high"]].round(3))


def calibration_fit() -> str:
    """Ratio of our mean to the paper's value at the frozen constants, for each of the twelve numbers."""
    fine = pd.read_csv(STUDIES / "calibration-fine.csv")
    frozen = fine[(fine[CONSTANTS] == [getattr(PAPER, name) for name in CONSTANTS]).all(axis=1)].iloc[0]
    cells: dict[str, dict[str, float]] = {}
    for name, value in frozen.drop([*CONSTANTS, "connected_draws", "worlds", "rms", "low", "high"]).items():
        strategy, size, metric = str(name).split()
        symbol = {"trajectory_error": "e", "exploration_efficiency": "η"}[metric]
        cells.setdefault(strategy, {})[f"{symbol}, {size} m"] = round(math.exp(value), 2)
    table = pd.DataFrame(cells).T
    table.insert(0, "ours / paper", table.index)
    return markdown(table)


def weight_sweep(strategy: str, heading: str) -> str:
    """Objective, e and η of every value of a rule's constant."""
    sweep = pd.read_csv(STUDIES / "path-weights.csv").round(3)
    sweep = sweep[sweep["strategy"] == strategy].drop(columns="strategy")
    interval = [f"[{low:.3f}, {high:.3f}]" for low, high in zip(sweep["low"], sweep["high"], strict=True)]
    sweep.insert(2, "95 % interval", interval)
    return markdown(sweep.drop(columns=["low", "high"]).rename(columns={"value": heading}))


def explored_by_rivals() -> pd.DataFrame:
    """Every stored trial of the paper's scenario that explored, of whichever suite, references aside."""
    columns = ("strategy", "scenario", "size", "trial", "status", "steps", *SYMBOLS.values())
    folders = (ROOT / "results" / suite for suite in ("", "field", "robustness", "reference"))
    trials = pd.concat([read_csv(folder / "trials.csv", columns)[[*columns]] for folder in folders])
    references = {name for name, entry in strategies().items() if entry.reference}
    own = (trials["scenario"] == PAPER_SCENARIO) & (trials["status"] == "explored")
    return trials[own & ~trials["strategy"].isin(references)]


def tours() -> str:
    """Stored tours of the benchmark's worlds beside the lower bound and the fastest stored trials."""
    stored = pd.read_csv(TOURS)
    trials = read_csv(ROOT / "results" / "trials.csv", ("strategy", "size", "trial", "steps", "status"))
    fastest = explored_by_rivals().groupby(["size", "trial"])["steps"].min().rename("fastest")
    rows = []
    driven = trials[trials["strategy"] == "clairvoyant"].set_index(["size", "trial"])["steps"].rename("driven")
    for size, here in stored.join(fastest, on=["size", "trial"]).join(driven, on=["size", "trial"]).groupby("size"):
        rows.append(
            {
                "size [m]": f"{size:g}",
                "worlds": len(here),
                "tour": f"{here['steps'].mean():.1f}",
                "bound": f"{here['bound'].mean():.1f}",
                "bound / tour, median": f"{(here['bound'] / here['steps']).median():.2f}",
                "fastest of all trials": f"{here['fastest'].mean():.1f}",
                "worlds in which a trial is faster than the tour": f"{(here['fastest'] < here['steps']).mean():.0%}",
                "than the tour as driven": f"{(here['fastest'] < here['driven']).mean():.0%}",
                "below the bound": f"{(here['fastest'] < here['bound']).mean():.0%}",
            }
        )
    return markdown(pd.DataFrame(rows))


def accurate_tours() -> str:
    """The tours for e and η as they were driven, beside the best stored trial of each world."""
    trials = read_csv(ROOT / "results" / "trials.csv", ("strategy", "size", "trial", "status", *SYMBOLS.values()))
    trials, rivals = (
        table.assign(objective=np.log(table[SYMBOLS["e"]]) - np.log(table[SYMBOLS["η"]]))
        for table in (trials, explored_by_rivals())
    )
    best = rivals.groupby(["size", "trial"])["objective"].min()
    rows = []
    for size, here in trials[trials["strategy"] == "clairvoyant-accurate"].groupby("size"):
        least = best.loc[size].reindex(here["trial"])
        ours = trials[(trials["size"] == size) & (trials["strategy"] == OURS)]
        row = {"size [m]": f"{size:g}", "worlds": len(here)}
        for symbol, metric in SYMBOLS.items():
            row |= {
                f"{symbol}, driven": f"{here[metric].mean():.3f}",
                f"{symbol}, `{OURS}`": f"{ours[metric].mean():.3f}",
            }
        row["log e − log η, driven"] = f"{here['objective'].mean():.2f}"
        row["the best of all trials"] = f"{least.mean():.2f}"
        row["worlds in which a trial is better"] = f"{(least.to_numpy() < here['objective'].to_numpy()).mean():.0%}"
        rows.append(row)
    return markdown(pd.DataFrame(rows))


def entropy_fringe() -> str:
    """What known cells promise to `entropy`."""
    return markdown(pd.read_csv(STUDIES / "entropy-fringe.csv"))


def chen2020() -> str:
    """Steps and entropies in [8]'s protocol beside [8]'s own."""
    return markdown(pd.read_csv(STUDIES / "chen2020.csv"))


def stage_choices() -> str:
    """What the choices behind the lidar worlds do."""
    return markdown(pd.read_csv(STUDIES / "stage-choices.csv"))


def stage_view() -> str:
    """What it is worth to know what walls hide."""
    return markdown(pd.read_csv(STUDIES / "stage-view.csv"))


def stage_frontiers() -> str:
    """What the grid of decisions costs the nearest frontier."""
    return markdown(pd.read_csv(STUDIES / "stage-frontiers.csv"))


def stage_tuning() -> str:
    """What training in lidar worlds adds."""
    return markdown(pd.read_csv(STUDIES / "stage-tuning.csv"))


def lidar_results(suite: str) -> str:
    """The table of a suite of lidar worlds, as `explore-bench report` wrote it, its most telling columns."""
    table = pd.read_csv(ROOT / "results" / suite / "tables" / "stage.csv")
    return markdown(table[list(STAGE_COLUMNS)].fillna("–"))


def lidar_transfer(suite: str) -> str:
    """What the comparisons of learned strategies in a suite of lidar worlds found, one sentence each."""
    lines = []
    for claim in json.loads((ROOT / "results" / suite / "claims.json").read_text(encoding="utf-8")):
        lines.append(f"**{claim['claim']}**: {claim['verdict']}.\n")
        lines += [f"- {comparison['sentence']}" for comparison in claim["comparisons"]]
        lines.append("")
    return "\n".join(lines)


def choices(scenario: str, study: str = "choices") -> str:
    """How often methods choose the same, in percent with intervals; training seeds averaged within their method."""
    table = pd.read_csv(STUDIES / f"{study}.csv")
    table = table[table["scenario"] == scenario]
    names = list(dict.fromkeys(table["a"]))
    rows = []
    for place, a in enumerate(names):
        row = {"%": f"`{a}`"} | {f"`{b}`": "" for b in names}
        for b in names[place:]:
            own = table[(table["a"] == a) & (table["b"] == b)]
            if a == b and len(own) > 1:  # a network with itself says nothing
                own = own[own["seed_a"] != own["seed_b"]]
            row[f"`{b}`"] = _percent(own)
        rows.append(row)
    chance = table[table["a"] != table["b"]]["chance"].mean()
    worlds = " and ".join(str(n) for n in sorted(set(table["n"])))
    return f"{markdown(pd.DataFrame(rows))}\n\n{worlds} worlds; by chance {100 * chance:.0f} %."


def _percent(pairs: pd.DataFrame) -> str:
    """Agreement of one pair with its interval, or the least and the largest of several."""
    if len(pairs) == 1:
        row = pairs.iloc[0]
        if row["ci_low"] == row["ci_high"]:
            return f"{100 * row['agreement']:.0f}"
        return f"{100 * row['agreement']:.0f} [{100 * row['ci_low']:.0f}, {100 * row['ci_high']:.0f}]"
    ends = (100 * pairs["agreement"].min(), 100 * pairs["agreement"].max())
    return f"{ends[0]:.0f}–{ends[1]:.0f} ({len(pairs)} pairs of weights)"


def stage_slam() -> str:
    """What window and anchors do to the errors of the lidar SLAM."""
    return markdown(pd.read_csv(STUDIES / "stage-slam.csv").round(3))


def map_order() -> str:
    """By how much the order of fusion matters."""
    table = pd.read_csv(STUDIES / "virtual-map-order.csv")
    return "\n".join(
        f"- {row.size_m:g} m, {row.worlds} worlds: fused backwards in time, U is {row.mean:+.2%} "
        f"[{row.low:+.2%}, {row.high:+.2%}] of U fused forwards, at most {row.largest:.2%} in any world."
        for row in table.itertuples()
    )


def columns() -> str:
    """Columns of a shard with type, unit and meaning."""
    rows = (step_columns("landmark") | FINAL_COLUMNS | REPLAY_COLUMNS | FINE_COLUMNS).items()
    table = [{"column": f"`{n}`", "type": c.dtype, "unit": c.unit, "meaning": c.meaning or "〃"} for n, c in rows]
    return markdown(pd.DataFrame(table))


def lidar_columns() -> str:
    """Columns of a row that only lidar worlds have."""
    rows = {name: column for name, column in step_columns("lidar").items() if name not in step_columns("landmark")}
    table = [{"column": f"`{n}`", "type": c.dtype, "unit": c.unit, "meaning": c.meaning} for n, c in rows.items()]
    return markdown(pd.DataFrame(table))


def lidar_metrics() -> str:
    """Metrics that trials in lidar worlds have beside the common ones."""
    rows = [
        {"column": f"`{name}`", "unit": own.unit, "better": own.better or "–", "definition": own.equation}
        for name, own in metrics_of("lidar").items()
    ]
    return markdown(pd.DataFrame(rows))


def public() -> str:
    """Public names with what they are and the module that defines them."""
    rows = [
        {"name": f"`{name}`", "what": _summary(name), "module": f"`explore_bench.{module}`"}
        for name, module in explore_bench.PUBLIC.items()
    ]
    return markdown(pd.DataFrame(rows))


def _summary(name: str) -> str:
    """First line of a public name's docstring, or the text for what has none."""
    if name in PLAIN:
        return PLAIN[name]
    return str(getattr(explore_bench, name).__doc__).strip().splitlines()[0].replace("|", "\\|")


def performance() -> str:
    """What `explore-bench perf` printed."""
    return f"```\n{text(read_json(STUDIES / 'perf.json'))}\n```"


def weights() -> str:
    """What the cards of the shipped weights say, by strategy."""
    cards = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(WEIGHTS.glob("*.json"))]
    order = list(strategies())
    rows = []
    for name in sorted({card["strategy"] for card in cards}, key=order.index):
        own = [card for card in cards if card["strategy"] == name]
        rows.append(
            {
                "strategy": f"`{name}`",
                "seeds": len(own),
                "parameters": f"{own[0]['parameter_count']:,}",
                "episodes of the best weights": _range(own, "episodes", 1),
                "thousand steps": _range(own, "steps", 1e-3),
                "minutes": _range(own, "wall_seconds", 1 / 60),
                "validation: log e − log η": ", ".join(f"{card['validation']['objective']:.2f}" for card in own),
            }
        )
    return f"{markdown(pd.DataFrame(rows))}\n\n{_throughput(cards)}"


def _throughput(cards: list[dict]) -> str:
    """What the trainings of these cards took together, until their best weights."""
    steps, seconds = (sum(card[key] for card in cards) for key in ("steps", "wall_seconds"))
    return (
        f"Together, until their best weights: {len(cards)} trainings, {steps / 1e6:.1f} million simulated steps in "
        f"{seconds / 60:,.0f} minutes,\n{steps / seconds:,.0f} steps a second, learning and validation included."
    )


def validations() -> str:
    """Mean over the training seeds of log e − log η on the validation worlds, after about so many episodes."""
    rows = []
    for name in strategies():
        files = (path for path in WEIGHTS.iterdir() if re.fullmatch(rf"{name}-\d+\.validations\.csv", path.name))
        own = [pd.read_csv(path) for path in files]
        if own:
            rows.append(
                {"strategy": f"`{name}`", "seeds": len(own)} | {f"{at:,}": _validated(own, at) for at in VALIDATED}
            )
    return markdown(pd.DataFrame(rows))


def _validated(tables: list[pd.DataFrame], episodes: int) -> str:
    """Mean of the objective at the validation nearest to a number of episodes; a dash where there is none near."""
    nearest = [table.iloc[(table["episodes"] - episodes).abs().argmin()] for table in tables]
    if any(abs(row["episodes"] - episodes) > NEAR for row in nearest):
        return "–"
    return signed_text(sum(row["objective"] for row in nearest) / len(nearest), 2)


def learning_causes() -> str:
    """Settings of Graph-STNN's learning and what they led to."""
    return markdown(pd.read_csv(STUDIES / "learning-causes.csv"))


def scaling_means(own: dict[str, Any]) -> dict[str, str]:
    """Mean metrics of the trials of a strategy at a size; none where some were cut off."""
    if own["explored_trials"] < own["trials"]:
        return {"T [step]": f"cut off at {own['steps']:.0f}", "e [m]": "–", "η [m²/step]": "–"}
    return {"T [step]": f"{own['steps']:.0f}", "e [m]": f"{own['e']:.2f}", "η [m²/step]": f"{own['eta']:.2f}"}


def scaling_trials(size: float) -> str:
    """What whole trials on a map of an edge [m] give and cost, by strategy; no metric of one that was cut off."""
    table = pd.read_csv(STUDIES / "scaling.csv")
    rows = [
        {
            "strategy": f"`{own['strategy']}`",
            "explored": f"{own['explored_trials']} of {own['trials']}",
            **scaling_means(own),
            "step, median [ms]": f"{own['step_ms']:.2f}",
            "at the end [ms]": f"{own['last_step_ms']:.1f}",
            "decision, median [ms]": f"{own['decision_ms']:.1f}",
            "at the end [ms] ": f"{own['last_decision_ms']:.1f}",
            "trial [s]": f"{own['seconds']:.1f}",
            "memory [MiB]": f"{own['memory']:.0f}",
        }
        for own in table[table["size"] == size].sort_values("seconds").to_dict("records")
    ]
    return markdown(pd.DataFrame(rows))


def scaling_sizes(strategy: str) -> str:
    """What the map of an edge [m] asks of one strategy's trials."""
    table = pd.read_csv(STUDIES / "scaling.csv")
    rows = [
        {
            "edge [m]": f"{own['size']:g}",
            "landmarks": str(PAPER.replace(size=own["size"]).landmarks),
            "trials": str(own["trials"]),
            **scaling_means(own),
            "candidates": f"{own['candidates']:.0f}",
            "step at the end [ms]": f"{own['last_step_ms']:.2f}",
            "decision at the end [ms]": f"{own['last_decision_ms']:.2f}",
            "trial [s]": f"{own['seconds']:.1f}",
            "memory [MiB]": f"{own['memory']:.0f}",
        }
        for own in table[table["strategy"] == strategy].to_dict("records")
    ]
    return markdown(pd.DataFrame(rows))


def scaling_parts(strategy: str) -> str:
    """What each part of a step takes at the end of one strategy's trials [µs], by the map's edge [m]."""
    table = pd.read_csv(STUDIES / "scaling.csv")
    own = table[table["strategy"] == strategy]
    parts = [column for column in own if re.fullmatch(r"last_(?!step|decision)\w+_ms", column)]
    rows = [
        {"edge [m]": f"{row['size']:g}", "poses": f"{row['steps']:.0f}"}
        | {part[5:-3].replace("_", " "): f"{1e3 * row[part]:,.0f}" for part in parts}
        for row in own.to_dict("records")
    ]
    return markdown(pd.DataFrame(rows))


def search() -> str:
    """Configurations that the search trained to their length, and what their best validation was."""
    table = pd.read_csv(STUDIES / "search.csv")
    table = table[table["objective"].notna()].sort_values(["strategy", "objective"], ascending=[False, True])
    shown = pd.DataFrame(
        {
            "strategy": [f"`{name}`" for name in table["strategy"]],
            "configuration": ["shipped" if number == 0 else str(number) for number in table["configuration"]],
            "width": table["width"],
            "dropout": table["dropout"],
            "γ": table["discount"],
            "rate": table["rate"],
            "episodes": table["episodes"],
            "best until 1,000": [signed_text(value, 3) for value in table["objective_at_the_cut"]],
            "best": [signed_text(value, 3) for value in table["objective"]],
            "after": table["best_after"].astype(int),
        }
    )
    return markdown(shown)


def search_margins() -> str:
    """The best configuration of a search beside the shipped weights in worlds that chose nothing."""
    table = pd.read_csv(STUDIES / "search-margins.csv").sort_values("strategy", ascending=False, kind="stable")
    seeds = {side: [name for name in table.columns if name.startswith(f"{side}, seed")] for side in ("best", "shipped")}
    rows = []
    for row in table.to_dict("records"):
        own = {"strategy": f"`{row['strategy']}`", "configuration": row["configuration"]}
        own["size [m]"] = f"{row['size']:g}"
        for side, names in seeds.items():
            each = sorted(row[name] for name in names)
            own[side] = f"{signed_text(row[side], 2)} ({signed_text(each[0], 2)} to {signed_text(each[-1], 2)})"
        estimate = Estimate(row["difference"], row["low"], row["high"], row["worlds"])
        rows.append({**own, "difference, 95 % interval": interval_text(estimate)})
    return markdown(pd.DataFrame(rows))


def margins() -> str:
    """Relative differences of e and η between pairs of strategies, paired by world; bold where A is clearly better."""
    trials = _trials()
    sizes = sorted(set(trials["size"]))
    rows = []
    for a, b in PAIRS:
        cells = {}
        for symbol in SYMBOLS:
            for size in sizes:
                margin = Margin.of(trials, a, b, symbol, size)
                cell = "–" if margin is None else str(margin)
                cells[f"{symbol}, {size:g} m"] = f"**{cell}**" if margin and margin.better else cell
        rows.append({"pair": f"`{a}` to `{b}`", **cells})
    return markdown(pd.DataFrame(rows))


def targets() -> str:
    """The paper's margins beside ours."""
    trials = _trials()
    rows = []
    for a, b in TARGETS:
        own, other = (strategies()[name].published for name in (a, b))
        for symbol, size in itertools.product(SYMBOLS, (20.0, 40.0)):
            key = ("table2", size, SYMBOLS[symbol])
            target = 100 * (own[key] / other[key] - 1)
            margin = Margin.of(trials, a, b, symbol, size)
            assert margin is not None, f"results/trials.csv has no trials of {a} and {b} at {size:g} m"
            rows.append(
                {
                    "pair": f"`{a}` to `{b}`",
                    "metric": f"{symbol}, {size:g} m",
                    "in the paper": f"{signed_text(target)} %",
                    "here": str(margin),
                    "single training seeds": f"{signed_text(min(margin.seeds))} to {signed_text(max(margin.seeds))} %",
                    "reached": "yes" if margin.mean / target >= 1 else "no",
                }
            )
    return markdown(pd.DataFrame(rows))


def lead() -> str:
    """How far our extension is ahead of every other strategy, and the one that comes closest to it."""
    trials = _trials()
    rows = []
    for symbol in SYMBOLS:
        for size in sorted(set(trials["size"])):
            found = {b: Margin.of(trials, OURS, b, symbol, size) for a, b in PAIRS if a == OURS}
            known = {b: margin for b, margin in found.items() if margin}
            closest = min(known, key=lambda b: known[b].gain)
            clear = sum(margin.better for margin in known.values())
            rows.append(
                {
                    "metric": f"{symbol}, {size:g} m",
                    "clearly better than": f"{clear} of {len(known)}",
                    "the closest": f"`{closest}`",
                    "to it": str(known[closest]),
                }
            )
    return markdown(pd.DataFrame(rows))


@dataclass(frozen=True)
class Margin:
    """(Mean of A − mean of B) / mean of B, paired by world [%].

    Attributes
    ----------
    mean, low, high : with the interval of the ratio, paired by world.
    gain : lower end of what A gains over B.
    seeds : for single training seeds of A.
    """

    mean: float
    low: float
    high: float
    gain: float
    seeds: tuple[float, ...]

    @classmethod
    def of(cls, trials: pd.DataFrame, a: str, b: str, symbol: str, size: float) -> Margin | None:
        """None where one of them has no trials of this size."""
        metric = SYMBOLS[symbol]
        here = trials[trials["size"] == size]
        own, other = (here[here["strategy"] == name] for name in (a, b))
        if own.empty or other.empty:
            return None
        pair = paired(own, other, metric)
        estimate, mean = pair.relative, pair.means[1]
        ends = [100 * value for value in (estimate.mean, estimate.low, estimate.high)]
        gain = ends[1] if METRICS[metric].better == "higher" else -ends[2]
        return cls(*ends, gain, tuple(100 * (value / mean - 1) for value in seed_means(own, metric)))

    @property
    def better(self) -> bool:
        """Whether A is better by an interval clear of zero."""
        return self.gain > 0

    def __str__(self) -> str:
        return f"{signed_text(self.mean)} % [{signed_text(self.low)}, {signed_text(self.high)}]"


def _trials(results: Path = RESULTS) -> pd.DataFrame:
    columns = ("strategy", "training_seed", "scenario", "size", "trial", *SYMBOLS.values())
    return read_csv(results / "trials.csv", columns)


def field_rules() -> str:
    """The table of rules that stands in docs/field.md, its last column filled with their controls."""
    page = (ROOT / "docs" / "field.md").read_text(encoding="utf-8")
    match = re.search(r"<!-- begin field-rules -->\n(.*?)\n<!-- end field-rules -->", page, re.DOTALL)
    assert match is not None, "docs/field.md has no table of rules"
    header, rule, *rows = match[1].strip().splitlines()
    lines = [header, rule]
    told = set()
    for row in rows:
        name = row.split("`")[1]
        told.add(name)
        controls = ", ".join(f"`{control}`" for control in CONTROLS.get(name, ())) or "–"
        lines.append(f"{row.rsplit('|', 2)[0]}| {controls} |")
    untold = {name for name in CONTROLS if not name.endswith("-tuned")} - told
    assert not untold, f"docs/field.md has no row of {sorted(untold)}"
    return "\n".join(lines)


def field_words(results: Path) -> str:
    """Who explores best, and which rule of others does, with what its constants and its terms do."""
    trials = _trials(results)
    competitors = _competitors(_standings(trials))
    best = next((name for name in competitors if STRATEGIES[name].factory.startswith("baselines.field.")), None)
    if best is None:
        return _answer(trials, competitors)
    place, label = competitors.index(best) + 1, STRATEGIES[best].label
    text = f"Of the rules of others, {label} (`{best}`) does best, place {place} of {len(competitors)}."
    table = pd.read_csv(results / "tables" / "field.csv", dtype=str)
    last = table[table["Method"] == label].iloc[-1]
    if last[TIMES[0]] != "–":
        text += f" A decision of it takes {last[TIMES[0]]} ms at {last['size [m]']} m, the median."
    effects = _effects(results)
    beside = [
        f" {STRATEGIES[rule].label} is shown to be better than {STRATEGIES[control].label} in {helped or 'none'} of "
        f"{count} comparisons and worse in {harmed or 'none'}."
        for (rule, control), (helped, harmed, count) in effects.items()
        if rule == best
    ]
    return f"{_answer(trials, competitors)}\n\n{text}{''.join(beside)}"


def field_table(results: Path, **where: str) -> str:
    """Rows of the table of a suite of the field, as `explore-bench report` wrote it, its most telling columns."""
    table = pd.read_csv(results / "tables" / "field.csv", dtype=str)
    for column, value in where.items():
        table = table[table[column] == value]
    return markdown(table[list(FIELD_COLUMNS[results.name])].fillna("–"))


def field_terms(results: Path) -> str:
    """What the terms of the rules of others do: each rule beside each of its controls, p after Holm's correction."""
    rows: dict[tuple[str, str], dict[str, str]] = {}
    for scenario, comparison in _of_terms(results):
        asked = comparison["comparison"]
        pair = asked["better"], asked["worse"]
        where = f"{asked['size']:g} m" if scenario == PAPER_SCENARIO else scenario
        share = comparison["relative"]
        text = f"{signed_text(100 * share['mean'])} % ({p_text(_number(comparison['p_holm']))})"
        shown = comparison["verdict"].startswith((SUPPORTED, CONTRADICTED))
        rows.setdefault(pair, {})[f"{all_metrics()[asked['metric']].symbol}, {where}"] = (
            f"**{text}**" if shown else text
        )
    table = [
        {
            "rule": f"`{rule}`",
            "control": f"`{control}`",
            "the rule": _effect(*_effects(results)[rule, control]),
            **cells,
        }
        for (rule, control), cells in rows.items()
    ]
    return markdown(pd.DataFrame(table).fillna("–"))


def _of_terms(results: Path) -> list[tuple[str, dict]]:
    """Comparisons of rules with their controls that were measured, each behind its scenario."""
    found = []
    for claim in json.loads((results / "claims.json").read_text(encoding="utf-8")):
        rule, _, scenario = claim["claim"].partition(", ")
        if rule in CONTROLS:
            found += [(scenario or PAPER_SCENARIO, one) for one in claim["comparisons"] if one["n"]]
    return found


def _effects(results: Path) -> dict[tuple[str, str], tuple[int, int, int]]:
    """Comparisons by rule and control: in which the rule is shown to be better, in which worse, and all of them."""
    found: dict[tuple[str, str], list[str]] = {}
    for _, comparison in _of_terms(results):
        asked = comparison["comparison"]
        found.setdefault((asked["better"], asked["worse"]), []).append(comparison["verdict"])
    return {
        pair: (
            sum(one.startswith(SUPPORTED) for one in own),
            sum(one.startswith(CONTRADICTED) for one in own),
            len(own),
        )
        for pair, own in found.items()
    }


def _effect(helped: int, harmed: int, count: int) -> str:
    """How a rule does beside another one, in a word, and in how many comparisons that is shown."""
    if helped and harmed:
        return f"better in {helped}, worse in {harmed} of {count}"
    if helped or harmed:
        return f"{'better' if helped else 'worse'} in {helped or harmed} of {count}"
    return "not shown"


def _number(value: float | None) -> float:
    return math.nan if value is None else value


def confirmation() -> str:
    """What came out of every attempt at a confirmation that was declared."""
    folder = RESULTS / "confirmation"
    rows = []
    for one in tomllib.loads((folder / "attempts.toml").read_text(encoding="utf-8"))["attempt"]:
        answer = folder / f"{one['root']}.json"
        found = json.loads(answer.read_text(encoding="utf-8"))["comparisons"] if answer.exists() else []
        shown = sum(own["verdict"].startswith(SUPPORTED) for own in found)
        row = {
            "root seed": str(one["root"]),
            "said to be better": f"`{one['better']}`",
            "than": f"{len({own['comparison']['worse'] for own in found})} others" if found else "–",
            "worlds": f"{one['worlds']} of {' and '.join(f'{size:g}' for size in one['sizes'])} m each",
            "shown to be better in": f"{'all' if shown == len(found) else shown} of {len(found)}"
            if found
            else "not run",
        }
        for metric in one["metrics"]:
            own = [each for each in found if each["comparison"]["metric"] == metric]
            least = min(own, key=lambda each: abs(each["relative"]["mean"]), default=None)
            row[f"least gain in {all_metrics()[metric].symbol}"] = _least_gain(least)
        rows.append(row)
    return markdown(pd.DataFrame(rows))


def _least_gain(finding: dict | None) -> str:
    if finding is None:
        return "–"
    share, asked = finding["relative"], finding["comparison"]
    ends = f"[{signed_text(100 * share['low'])}, {signed_text(100 * share['high'])}]"
    return f"{signed_text(100 * share['mean'])} {ends} % over `{asked['worse']}` at {asked['size']:g} m"


def field_tuning(study: Path) -> str:
    """The constant that was tuned of each rule of others, untuned and at its best.

    Of values that are equally good the untuned one is taken, else the smallest.

    Raises
    ------
    AssertionError : where the best value is another than the untuned one and the catalogue's TUNED has not it.
    """
    table = pd.read_csv(study)
    rows = []
    for name, own in table.groupby("strategy", sort=False):
        entry, parameter = STRATEGIES[str(name)], SWEEPS[str(name)].parameter
        untuned = entry.parameters.get(parameter)
        if untuned is None:
            untuned = inspect.signature(load_factory(entry.factory)).parameters[parameter].default
        at = own.set_index("value")
        least = at["objective"].min()
        best = untuned if at.loc[untuned, "objective"] == least else float(at["objective"].idxmin())
        edge = {at.index.min(): ", the smallest tried", at.index.max(): ", the largest tried"}.get(best, "")
        registered = STRATEGIES.get(f"{name}-tuned")
        if best != untuned:
            assert registered is not None, f"baselines/catalogue.py: TUNED lacks {name!r}: {{{parameter!r}: {best:g}}}"
            kept = registered.parameters[parameter]
            assert kept == best, f"baselines/catalogue.py: TUNED has {parameter} {kept:g} of {name}, the study {best:g}"
        rows.append(
            {
                "rule": f"`{name}`",
                "constant": f"`{parameter}`",
                "untuned": f"{untuned:g}",
                "log e − log η": _objective(at.loc[untuned]),
                "best": "all are alike" if at["objective"].max() == least else f"{best:g}{edge}",
                "log e − log η there": _objective(at.loc[best]),
                "registered as": f"`{name}-tuned`" if best != untuned else "–",
            }
        )
    return markdown(pd.DataFrame(rows))


def _objective(row: pd.Series) -> str:
    return f"{signed_text(row['objective'], 3)} [{signed_text(row['low'], 3)}, {signed_text(row['high'], 3)}]"


def regrets() -> str:
    """Mean regret of every strategy and size as a bracket: to the fastest tour known, and to the lower bound."""
    summary = read_csv(ROOT / "results" / "summary.csv", ("strategy", "size", "metric", "mean"))
    own = summary[summary["metric"].isin(REGRETS)].drop_duplicates(["strategy", "size", "metric"])
    cells: dict[str, dict[str, str]] = {}
    for (size, strategy), lines in own.groupby(["size", "strategy"], sort=False):
        if not strategies()[str(strategy)].reference:
            means = lines.set_index("metric")["mean"].reindex(list(REGRETS)).dropna()
            cells.setdefault(f"{size:g} m", {})[f"`{strategy}`"] = " to ".join(f"{mean:.2f}" for mean in means)
    table = pd.DataFrame(cells).fillna("–")
    table.insert(0, "regret", table.index)
    return markdown(table)


WHOLE: dict[str, Callable[[], str]] = {
    "docs/images/ranking.svg": ranking_picture,
    "submissions/schema.json": lambda: json.dumps(schema(), indent=1) + "\n",
}
"""Files that are computed as a whole."""

PARTS: dict[str, Callable[[], str]] = {
    "ranking": ranking_table,
    "ranking-words": ranking_words,
    "table2": table2,
    "claims": claims,
    "calibration-result": calibration_result,
    "calibration-coarse": calibration_coarse,
    "calibration-fit": calibration_fit,
    "weights-uncertainty": partial(weight_sweep, "uncertainty", "w [m²/m]"),
    "weights-entropy": partial(weight_sweep, "entropy", "w [bit/m]"),
    "weights-entropy-per-metre": partial(weight_sweep, "entropy-per-metre", "c [m]"),
    "tours": tours,
    "accurate-tours": accurate_tours,
    "entropy-fringe": entropy_fringe,
    "chen2020": chen2020,
    "stage-choices": stage_choices,
    "choices-paper": partial(choices, "paper"),
    "choices-stage": partial(choices, "stage"),
    "field-choices-paper": partial(choices, "paper", "field-choices"),
    "field-choices-stage": partial(choices, "stage", "field-choices"),
    "stage-slam": stage_slam,
    "stage-frontiers": stage_frontiers,
    "stage-tuning": stage_tuning,
    "stage-view": stage_view,
    "stage-results": partial(lidar_results, "stage"),
    "plans-results": partial(lidar_results, "plans"),
    "stage-transfer": partial(lidar_transfer, "stage"),
    "plans-transfer": partial(lidar_transfer, "plans"),
    "confirmation": confirmation,
    "field-rules": field_rules,
    "field-words": partial(field_words, RESULTS / "field"),
    "field-stage-words": partial(field_words, RESULTS / "field-stage"),
    "field-results": partial(field_table, RESULTS / "field", **{"size [m]": "40"}),
    "field-stage-results": partial(field_table, RESULTS / "field-stage", scenario="range 10 m"),
    "field-terms": partial(field_terms, RESULTS / "field"),
    "field-stage-terms": partial(field_terms, RESULTS / "field-stage"),
    "field-tuning": partial(field_tuning, STUDIES / "field-tuning.csv"),
    "map-order": map_order,
    "columns": columns,
    "lidar-columns": lidar_columns,
    "lidar-metrics": lidar_metrics,
    "public": public,
    "perf": performance,
    "weights": weights,
    "validations": validations,
    "targets": targets,
    "lead": lead,
    "margins": margins,
    "regrets": regrets,
    "learning-causes": learning_causes,
    "scaling-trials": partial(scaling_trials, 100.0),
    "scaling-sizes": partial(scaling_sizes, "nearest"),
    "scaling-parts": partial(scaling_parts, "nearest"),
    "search": search,
    "search-margins": search_margins,
}


def filled(page: str) -> str:
    """Return a page with all its parts computed anew."""

    def part(match: re.Match[str]) -> str:
        return f"{match[1]}\n{PARTS[match[2]]().strip()}\n{match[3]}"

    return re.sub(r"(<!-- begin ([\w-]+) -->).*?(<!-- end \2 -->)", part, page, flags=re.DOTALL)


def main() -> int:
    """Fill or check every page and picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    stale = []
    for page in (*PAGES, *WHOLE):
        path = ROOT / page
        before = path.read_text(encoding="utf-8") if path.is_file() else ""
        after = WHOLE[page]() if page in WHOLE else filled(before)
        if after != before:
            stale.append(page)
            if not check:
                path.write_text(after, encoding="utf-8")
    print(f"{'out of date' if check else 'filled'}: {', '.join(stale) or 'none'}")
    return 1 if check and stale else 0


def _range(cards: list[dict], key: str, scale: float) -> str:
    values = sorted({round(card[key] * scale) for card in cards})
    return " to ".join(f"{value:,}" for value in dict.fromkeys((values[0], values[-1])))


def markdown(table: pd.DataFrame) -> str:
    """Table in Markdown."""
    lines = [[str(name) for name in table.columns], ["---"] * len(table.columns)]
    lines += [
        [f"{cell:g}" if isinstance(cell, float) else str(cell) for cell in row] for row in table.to_numpy().tolist()
    ]
    rows = ("| " + " | ".join(line) + " |" for line in lines)
    return "\n".join(row.replace("] [", "] \\[") for row in rows)  # two pairs of brackets are no link


if __name__ == "__main__":
    sys.exit(main())
