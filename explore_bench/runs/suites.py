"""The named collections of trials, and their plan: which trials a request asks for."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from explore_bench.errors import RequestError, unknown
from explore_bench.strategies.entry import Entry
from explore_bench.strategies.registry import lookup, strategies
from explore_bench.trial.seeding import Purpose
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.maps import gallery
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER, SCENARIOS

MAX_ROOT = 2**32 - 1
MAX_TRIALS = 100_000


@dataclass(frozen=True)
class Suite:
    """Sizes, number of worlds and the tables whose strategies take part.

    Attributes
    ----------
    parts : (table, sizes [m]) pairs; a strategy runs at the sizes of every table that it belongs to. A name that is no
        table of the paper stands for the strategies whose entries take part under it.
    trials : worlds a size.
    scenario : name of the scenario whose constants it runs on; None for the paper's, or whichever is given instead.
    variations : changes of the physical constants by the name under which their trials are kept; none for a suite
        that runs on the constants as they are.
    seeds : training seeds of a learned strategy that take part, the first of them; None for all.
    """

    description: str
    parts: tuple[tuple[str, tuple[float, ...]], ...]
    trials: int = 50
    scenario: str | None = None
    variations: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seeds: int | None = None

    @property
    def sizes(self) -> tuple[float, ...]:
        """All sizes of the suite [m]."""
        return tuple(sorted({size for _, sizes in self.parts for size in sizes}))

    def sizes_of(self, entry: Entry) -> tuple[float, ...]:
        """Sizes at which a strategy runs [m]."""
        own = {*entry.tables, *entry.suites}
        return tuple(sorted({s for table, sizes in self.parts if table in own for s in sizes}))


TABLE2 = ("table2", (20.0, 40.0))
BETWEEN = ("table2", (30.0,))  # the paper prints no such column; the generalization asks for it
TABLE3 = ("table3", (20.0, 30.0, 40.0))
LAYERS = ("layers", (20.0,))
CELLS = ("cells", (20.0,))  # the ablations under the other reading of Eq. 5

ROBUSTNESS: dict[str, dict[str, float | bool]] = {
    "paper": {},
    "odometry noise × 2": {"odometry_sigma": 2 * PAPER.odometry_sigma},
    "odometry noise × 4": {"odometry_sigma": 4 * PAPER.odometry_sigma},
    "sensor range 3 m": {"sensor_range": 3.0},
    "sensor range 8 m": {"sensor_range": 8.0},
    "landmarks × ½": {"landmark_density": 0.5 * PAPER.landmark_density},
    "landmarks × 2": {"landmark_density": 2 * PAPER.landmark_density},
    "obstacles × ½": {"obstacle_density": 0.5 * PAPER.obstacle_density},
    "obstacles × 2": {"obstacle_density": 2 * PAPER.obstacle_density},
    "occlusion": {"occlusion": True},
}
"""What the suite of that name changes, one constant at a time; the first is what the others are compared with."""

MAPS: dict[str, dict[str, Any]] = {name: {"map": rows, "occlusion": True} for name, rows in gallery().items()}
"""The gallery; walls hide what lies behind them."""

RANGES: dict[str, dict[str, float]] = {f"range {metres:g} m": {"sensor_range": metres} for metres in (10.0, 5.0)}
"""Lidars of the suite `stage`: the paper's, and half of that."""

PLANS: dict[str, dict[str, str]] = {scene: {"scene": scene} for scene in ("office", "rooms", "maze", "hall")}
"""Floor plans that lidar worlds can draw."""

FAMILIES: dict[str, str] = {
    "field-way": "looks at the way there",
    "field-view": "looks at what is in view there",
    "field-map": "looks at what the map gains",
    "field-robot": "looks at what certainty gains",
    "field-learned": "learned",
    "field-chance": "chance",
}
"""Whom the suites `field` and `field-stage` compare, by what decides."""

SUITES: dict[str, Suite] = {
    "smoke": Suite("a look at every strategy in under a minute", (("table2", (20.0,)),), trials=4),
    "table2": Suite("Table 2, Figures 10 and 11: the compared methods at 20 and 40 m", (TABLE2,)),
    "table3": Suite("Table 3, Figures 13 to 15: the ablations at 20, 30 and 40 m", (TABLE3,)),
    "layers": Suite("Figure 8: Graph-STNN with 1, 2 and 3 GCN layers at 20 m", (LAYERS,)),
    "cells": Suite("the ablations at 20 m with H_γ of Eq. 5 read as that of a node's own cell", (CELLS,)),
    "paper": Suite(
        "all of the paper: table2 (also at 30 m), table3, layers and cells", (TABLE2, BETWEEN, TABLE3, LAYERS, CELLS)
    ),
    "robustness": Suite(
        "table2, table3, layers at 20 m: other noise, ranges, densities, and occlusion; give it a folder of its own",
        tuple((table, (20.0,)) for table in ("table2", "table3", "layers")),
        trials=20,
        variations=ROBUSTNESS,
        seeds=1,
    ),
    "maps": Suite(
        "the compared methods in the maps of the gallery, where walls hide what is behind; give it a folder of its own",
        (("table2", (40.0,)),),
        trials=20,
        variations=MAPS,
        seeds=1,
    ),
    "stage": Suite(
        "the compared methods in lidar worlds full of obstacles, at two ranges; give it a folder of its own",
        (("table2", (20.0,)),),
        scenario="stage",
        variations=RANGES,
        seeds=1,
    ),
    "plans": Suite(
        "five methods in floor plans of four kinds, with a lidar; give it a folder of its own",
        (("plans", (20.0,)),),
        trials=10,
        scenario="stage",
        variations=PLANS,
        seeds=1,
    ),
    "figure16": Suite(
        "Figure 16: Graph-STNN and the nearest frontier with a lidar; give it a folder of its own",
        (("figure16", (20.0,)),),
        trials=5,
        scenario="stage",
        seeds=1,
    ),
    "field": Suite(
        "rules of others beside nearest, entropy and ours, at 20, 30 and 40 m; give it a folder of its own",
        tuple((part, (20.0, 30.0, 40.0)) for part in ("field", *FAMILIES)),
        seeds=1,
    ),
    "field-stage": Suite(
        "the same in the lidar worlds of the suite stage, at its ranges; give it a folder of its own",
        tuple((family, (20.0,)) for family in FAMILIES),
        scenario="stage",
        variations=RANGES,
        seeds=1,
    ),
    "confirmation": Suite(
        "all strategies of paper and field at 20, 30 and 40 m; give it a root seed and a folder of its own",
        tuple((table, (20.0, 30.0, 40.0)) for table in ("table2", "table3", "layers", "cells", *FAMILIES)),
        trials=200,
        seeds=1,
    ),
}


@dataclass(frozen=True)
class Plan:
    """Trials that a request asks for.

    Attributes
    ----------
    scenario : physical constants of all of its trials, sizes aside; None where they run on several sets of them.
    untrained : strategies that it leaves out for want of weights.
    elsewhere : strategies of the suite that it leaves out, since they cannot run in worlds of this kind.
    """

    specs: tuple[TrialSpec, ...]
    scenario: Scenario | None
    untrained: tuple[str, ...] = ()
    elsewhere: tuple[str, ...] = ()


def plan(
    suite: str,
    names: Sequence[str] = (),
    sizes: Sequence[float] = (),
    trials: int | None = None,
    root: int = 0,
    scenario: Scenario | None = None,
    scenario_name: str | None = None,
    purpose: Purpose = "evaluate",
) -> Plan:
    """List the trials of a suite: pure, cheap, in the order of strategies, sizes, variations, seeds and trials.

    Parameters
    ----------
    suite : its name.
    names : strategies instead of the suite's; a plugin runs at all sizes of the suite.
    sizes : edges of the maps [m] instead of the suite's.
    trials : number of worlds instead of the suite's.
    root : root seed; 0 is the benchmark's own.
    scenario : physical constants instead of the paper's; a size that it sets stands unless `sizes` is given. The
        variations of a suite change them further. A map has a size of its own.
    scenario_name : under which its trials are kept where the suite does not vary the constants.

    Raises
    ------
    RequestError : for an unknown suite or strategy, a size, number or seed out of range, a scenario that the suite does
        not take, or a named strategy that cannot run in it.
    """
    if suite not in SUITES:
        raise unknown("suite", suite, SUITES)
    chosen = SUITES[suite]
    count = chosen.trials if trials is None else trials
    if not isinstance(count, int) or not 1 <= count <= MAX_TRIALS:
        raise RequestError(f"trials is {count}; ask for a whole number from 1 to {MAX_TRIALS}.")
    if not 0 <= root <= MAX_ROOT:
        raise RequestError(f"seed is {root}; give a root seed from 0 to {MAX_ROOT}.")
    base = _base(suite, chosen, scenario)
    asked_sizes = bool(sizes)
    if not sizes and scenario is not None and "size" in scenario.model_fields_set:
        sizes = (scenario.size,)
    sizes = tuple(dict.fromkeys(sizes))
    picked = _picked(names) or list(strategies().items())
    variations = chosen.variations or {scenario_name or chosen.scenario or "paper": {}}
    alone: list[tuple[int | None, str | None]] = [(None, None)]  # without training seeds
    specs: list[TrialSpec] = []
    untrained: list[str] = []
    elsewhere: list[str] = []
    for name, entry in picked:
        own_sizes = tuple(sizes) or chosen.sizes_of(entry) or (chosen.sizes if names else ())
        if not own_sizes or (not names and not chosen.sizes_of(entry)):
            continue
        if not entry.runs_in(base.kind):
            if names:
                kinds = " or ".join(entry.kinds)
                raise RequestError(
                    f"strategy '{name}' runs in worlds of kind {kinds}, not '{base.kind}'; leave it out."
                )
            elsewhere.append(name)
            continue
        if not entry.ready:
            untrained.append(name)
            continue
        for size, (kept_as, changes) in itertools.product(own_sizes, variations.items()):
            physics = base.replace(**({"size": size} if asked_sizes or "map" not in changes else {}), **changes)
            specs += [
                TrialSpec(
                    strategy=name,
                    factory=entry.factory,
                    scenario=physics,
                    trial=trial,
                    parameters=dict(entry.parameters),
                    reference=entry.reference,
                    scenario_name=kept_as,
                    purpose=purpose,
                    root=root,
                    training_seed=seed,
                    weights=weights,
                    broken=entry.broken,
                )
                for seed, weights in list(entry.weights.items())[: chosen.seeds] or alone
                for trial in range(count)
            ]
    return Plan(tuple(specs), None if chosen.variations else base, tuple(untrained), tuple(elsewhere))


def _picked(names: Sequence[str]) -> list[tuple[str, Entry]]:
    """Strategies that are named, no two of one name."""
    found: dict[str, tuple[str, Entry]] = {}
    for asked in dict.fromkeys(names):
        name, entry = lookup(asked)
        if name in found:
            other, known = found[name]
            both = f"strategies '{other}' and '{asked}' have the same name, '{name}'"
            if entry == known:
                raise RequestError(f"{both}, and are both {_origin(entry)}; leave one out.")
            raise RequestError(
                f"{both}: one is {_origin(known)}, the other {_origin(entry)}; rename one factory or leave one out."
            )
        found[name] = asked, entry
    return [(name, entry) for name, (_, entry) in found.items()]


def _origin(entry: Entry) -> str:
    """Where a strategy is from, in words: its factory, and the files of its weights."""
    weights = f" with the weights {', '.join(entry.weights.values())}" if entry.weights else ""
    return f"{entry.factory}{weights}"


def _base(name: str, suite: Suite, scenario: Scenario | None) -> Scenario:
    """Constants on which a suite runs, or those that its variations change."""
    if suite.scenario is not None:
        if scenario is not None:
            raise RequestError(
                f"suite '{name}' runs in the scenario '{suite.scenario}' alone; leave your scenario or map out, or "
                "choose another suite."
            )
        return SCENARIOS[suite.scenario][0]
    base = scenario or PAPER
    if suite.variations and base.kind != PAPER.kind:
        raise RequestError(
            f"suite '{name}' varies worlds of kind '{PAPER.kind}', not '{base.kind}'; leave your scenario out, or "
            "choose another suite."
        )
    if base.map is not None and any("map" in changes for changes in suite.variations.values()):
        raise RequestError(f"suite '{name}' has maps of its own; leave yours out, or choose another suite.")
    return base
