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
from explore_bench.world.scenarios import PAPER

MAX_ROOT = 2**32 - 1
MAX_TRIALS = 100_000


@dataclass(frozen=True)
class Suite:
    """Sizes, number of worlds and the tables whose strategies take part.

    Attributes
    ----------
    parts : (table, sizes [m]) pairs; a strategy runs at the sizes of every table that it belongs to.
    trials : worlds a size.
    variations : changes of the physical constants by the name under which their trials are kept; none for a suite
        that runs on the constants as they are.
    seeds : training seeds of a learned strategy that take part, the first of them; None for all.
    """

    description: str
    parts: tuple[tuple[str, tuple[float, ...]], ...]
    trials: int = 50
    variations: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    seeds: int | None = None

    @property
    def sizes(self) -> tuple[float, ...]:
        """All sizes of the suite [m]."""
        return tuple(sorted({size for _, sizes in self.parts for size in sizes}))

    def sizes_of(self, entry: Entry) -> tuple[float, ...]:
        """Sizes at which a strategy runs [m]."""
        return tuple(sorted({s for table, sizes in self.parts if table in entry.tables for s in sizes}))


TABLE2 = ("table2", (20.0, 40.0))
BETWEEN = ("table2", (30.0,))  # the paper prints no such column; the generalization asks for it
TABLE3 = ("table3", (20.0, 30.0, 40.0))
LAYERS = ("layers", (20.0,))

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

SUITES: dict[str, Suite] = {
    "smoke": Suite("a look at every strategy in under a minute", (("table2", (20.0,)),), trials=4),
    "table2": Suite("Table 2, Figures 10 and 11: the compared methods at 20 and 40 m", (TABLE2,)),
    "table3": Suite("Table 3, Figures 13 to 15: the ablations at 20, 30 and 40 m", (TABLE3,)),
    "layers": Suite("Figure 8: Graph-STNN with 1, 2 and 3 GCN layers at 20 m", (LAYERS,)),
    "paper": Suite("all of the paper: table2 (also at 30 m), table3 and layers", (TABLE2, BETWEEN, TABLE3, LAYERS)),
    "robustness": Suite(
        "all strategies at 20 m under other noise, sensor ranges, densities and occlusion; give it a folder of its own",
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
}


@dataclass(frozen=True)
class Plan:
    """Trials that a request asks for.

    Attributes
    ----------
    untrained : strategies it names that cannot run for want of weights.
    varied : whether its trials run on several sets of physical constants.
    """

    specs: tuple[TrialSpec, ...]
    untrained: tuple[str, ...]
    varied: bool = False


def plan(
    suite: str,
    names: Sequence[str] = (),
    sizes: Sequence[float] = (),
    trials: int | None = None,
    root: int = 0,
    scenario: Scenario | None = None,
    scenario_name: str = "paper",
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

    Raises
    ------
    RequestError : for an unknown suite or strategy, or a size, number or seed out of range.
    """
    if suite not in SUITES:
        raise unknown("suite", suite, SUITES)
    chosen = SUITES[suite]
    count = chosen.trials if trials is None else trials
    if not isinstance(count, int) or not 1 <= count <= MAX_TRIALS:
        raise RequestError(f"trials is {count}; ask for a whole number from 1 to {MAX_TRIALS}.")
    if not 0 <= root <= MAX_ROOT:
        raise RequestError(f"seed is {root}; give a root seed from 0 to {MAX_ROOT}.")
    base = scenario or PAPER
    if base.map is not None and any("map" in changes for changes in chosen.variations.values()):
        raise RequestError(f"suite '{suite}' has maps of its own; leave yours out, or choose another suite.")
    asked_sizes = bool(sizes)
    if not sizes and scenario is not None and "size" in scenario.model_fields_set:
        sizes = (scenario.size,)
    sizes = tuple(dict.fromkeys(sizes))
    picked = [lookup(name) for name in dict.fromkeys(names)] or list(strategies().items())
    if len({name for name, _ in picked}) < len(picked):
        raise RequestError(f"two of {', '.join(names)} have the same name; rename one factory or leave one out.")
    variations = chosen.variations or {scenario_name: {}}
    alone: list[tuple[int | None, str | None]] = [(None, None)]  # without training seeds
    specs: list[TrialSpec] = []
    untrained: list[str] = []
    for name, entry in picked:
        own_sizes = tuple(sizes) or chosen.sizes_of(entry) or (chosen.sizes if names else ())
        if not own_sizes or (not names and not chosen.sizes_of(entry)):
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
    return Plan(tuple(specs), tuple(untrained), bool(chosen.variations))
