"""The compared strategies with label, tables and weights, and in `colors.py` their colours.

An ablation is a line, not a class.

`paper.csv` holds what Tables 2 and 3 of Zhang et al. 2021 print. Graph-STNN's e differs between the two, so a value
is keyed by its table. `weights/` holds what `explore-bench train` made: NAME-SEED.safetensors, each with a card.
"""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

from baselines.colors import COLORS
from explore_bench import Entry, Published

WEIGHTS = Path(__file__).with_name("weights")


def _published() -> dict[str, Published]:
    values: dict[str, Published] = defaultdict(dict)
    with Path(__file__).with_name("paper.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            values[row["strategy"]][row["table"], float(row["size"]), row["metric"]] = float(row["value"])
    return values


def _weights() -> dict[str, dict[int, str]]:
    found: dict[str, dict[int, str]] = defaultdict(dict)
    for file in sorted(WEIGHTS.glob("*.safetensors")):
        if parts := re.fullmatch(r"(.+)-(\d+)", file.stem):
            found[parts[1]][int(parts[2])] = f"{WEIGHTS.parent.name}:{WEIGHTS.name}/{file.name}"
    return found


_PAPER, _SHIPPED = _published(), _weights()
_TABLE2, _TABLE3, _LAYERS, _CELLS = ("table2",), ("table3",), ("layers",), ("cells",)
_PLANS, _FIGURE16 = ("plans",), ("figure16",)
_WAY, _VIEW, _MAP = ("field-way",), ("field-view",), ("field-map",)
_ROBOT, _LEARNED, _CHANCE = ("field-robot",), ("field-learned",), ("field-chance",)
"""Parts of the suites `field` and `field-stage`, by what a rule looks at: how far it is, what is in view there, what
the map or the robot's certainty gains, what a network makes of all that, nothing."""

_STNN, _GCN, _TRAINER = (
    "baselines.learned.graph_stnn:strategy",
    "baselines.learned.gcn:strategy",
    "baselines.training.train:train",
)

ENTROPY_WEIGHT = 0.1
"""w [bit per m] of `entropy-path`, tuned on calibration worlds: docs/path-weights.md."""

STRATEGIES: dict[str, Entry] = {}

CONTROLS: dict[str, tuple[str, ...]] = {}
"""Rules of others, each with those that it is measured by: itself with a term off or with other constants, or a plainer
rule."""


def _add(name: str, factory: str, label: str, tables: tuple[str, ...], **options: Any) -> None:
    STRATEGIES[name] = Entry(factory, label, COLORS[name], tables=tables, published=_PAPER[name], **options)


def _field(
    name: str,
    family: tuple[str, ...],
    factory: str,
    label: str,
    *,
    controls: tuple[str, ...] = (),
    kinds: tuple[str, ...] = (),
    **parameters: Any,
) -> None:
    """Add a rule of others that is in no table of the paper; its constants are the factory's but for these."""
    _add(name, f"baselines.field.{factory}", label, (), suites=family, kinds=kinds, parameters=parameters)
    if controls:
        CONTROLS[name] = controls


def _learned(name: str, factory: str, label: str, tables: tuple[str, ...], **options: Any) -> None:
    _add(name, factory, label, tables, trainer=_TRAINER, weights=_SHIPPED[name], **options)


_learned("graph-stnn", _STNN, "Graph-STNN", (*_TABLE2, *_TABLE3, *_LAYERS), suites=(*_PLANS, *_FIGURE16, *_LEARNED))
_learned(
    "belief-attention",
    "baselines.learned.belief_attention:strategy",
    "Belief attention (ours)",
    _TABLE2,
    suites=(*_PLANS, *_LEARNED),
    formerly=("graph-stnn-plus",),
)
_learned("graph-stnn-path", _STNN, "Graph-STNN, path length", _TABLE2, parameters={"distance": "path"})
_learned("graph-stnn-1-layer", _STNN, "Graph-STNN, 1 GCN layer", _LAYERS, parameters={"layers": 1})
_learned("graph-stnn-3-layers", _STNN, "Graph-STNN, 3 GCN layers", _LAYERS, parameters={"layers": 3})
_learned(
    "gcn-no-obs",
    _GCN,
    "GCN-no_obs",
    _TABLE2,
    parameters={"obstacles": False},
    training={"obstacle_count": 0},
)
_learned("gcn-obs", _GCN, "GCN-obs", _TABLE2)
_learned("gcn-obs-blind", _GCN, "GCN-obs, blind", _TABLE2, parameters={"obstacles": False})
_learned("graph-stnn-cell", _STNN, "Graph-STNN, entropy of the cell", _CELLS, parameters={"entropy": "cell"})
for _name, _off in (
    ("no-state", ("state",)),
    ("no-temporal", ("temporal",)),
    ("no-spatial", ("spatial",)),
    ("no-temporal-state", ("temporal", "state")),
    ("no-spatial-state", ("spatial", "state")),
    ("no-spatial-temporal", ("spatial", "temporal")),
):
    _label, _switches = f"no {' and '.join(_off)}", dict.fromkeys(_off, False)
    _learned(_name, _STNN, _label, _TABLE3, parameters=_switches)
    _learned(
        f"{_name}-cell", _STNN, f"{_label}, entropy of the cell", _CELLS, parameters={**_switches, "entropy": "cell"}
    )
_add("entropy", "baselines.entropy:Entropy", "Entropy", _TABLE2, suites=(*_PLANS, *_ROBOT))
_add(
    "entropy-path",
    "baselines.entropy:Entropy",
    "Entropy, path weight (ours)",
    _TABLE2,
    suites=_ROBOT,
    parameters={"weight": ENTROPY_WEIGHT},
)
_add(
    "entropy-per-metre",
    "baselines.entropy_per_metre:EntropyPerMetre",
    "Entropy per metre (ours)",
    _TABLE2,
    suites=_MAP,
)
_add("uncertainty", "baselines.uncertainty:Uncertainty", "Uncertainty", _TABLE2, suites=_ROBOT)
_add("random", "baselines.random_walk:Random", "Random", _TABLE2, suites=(*_PLANS, *_CHANCE))
_add(
    "nearest",
    "baselines.nearest:Nearest",
    "Nearest",
    _TABLE2,
    baseline=True,
    suites=(*_PLANS, *_FIGURE16, *_WAY),
)
_add(
    "clairvoyant",
    "baselines.reference.clairvoyant:Clairvoyant",
    "Clairvoyant",
    _TABLE2,
    suites=("field",),
    reference=True,
    plans=("t90", "regret", "regret_most"),
    kinds=("landmark",),
)
_add(
    "clairvoyant-accurate",
    "baselines.reference.clairvoyant:Clairvoyant",
    "Clairvoyant, e and η",
    _TABLE2,
    parameters={"aim": "accuracy"},
    reference=True,
    plans=("trajectory_error", "exploration_efficiency"),
    kinds=("landmark",),
)

# The field: rules of others, and controls with one term off (docs/field.md)
_LIDAR = ("lidar",)
_field("distance-advantage", _WAY, "scores:DistanceAdvantage", "Distance advantage", controls=("remoteness", "nearest"))
_field("remoteness", _WAY, "scores:DistanceAdvantage", "Distance advantage, no distance", distance=0.0)
_field("cost-utility", _WAY, "scores:CostUtility", "Cost–utility", controls=("cost-utility-no-size",))
_field(
    "cost-utility-code",
    _WAY,
    "scores:CostUtility",
    "Cost–utility, as its code",
    controls=("cost-utility",),
    resolution=0.05,
)
_field("cost-utility-no-size", _WAY, "scores:CostUtility", "Cost–utility, no size", size=0.0)
_field("information-gain", _VIEW, "scores:InformationGain", "Information gain", controls=("visible-unknown", "nearest"))
_field(
    "visible-per-metre",
    _VIEW,
    "scores:VisiblePerMetre",
    "Visible unknown per metre",
    controls=("visible-unknown", "cost-utility-no-size"),
)
_field(
    "heading-aware",
    _VIEW,
    "scores:HeadingAware",
    "Heading-aware gain",
    controls=("heading-aware-no-heading", "heading-aware-no-distance"),
)
_field("heading-aware-no-heading", _VIEW, "scores:HeadingAware", "Heading-aware gain, no heading", turning=0.0)
_field("heading-aware-no-distance", _VIEW, "scores:HeadingAware", "Heading-aware gain, no distance", decay=0.0)
_field("visible-unknown", _VIEW, "scores:HeadingAware", "Visible unknown", decay=0.0, turning=0.0)
_field("burgard", _WAY, "scores:Burgard", "Burgard", controls=("nearest",))
_field(
    "makarenko",
    _ROBOT,
    "scores:Makarenko",
    "Makarenko",
    controls=("makarenko-no-information", "makarenko-no-navigation", "makarenko-no-localizability"),
)
_field("makarenko-no-information", _ROBOT, "scores:Makarenko", "Makarenko, no information", information=0.0)
_field("makarenko-no-navigation", _ROBOT, "scores:Makarenko", "Makarenko, no navigation", navigation=0.0)
_field("makarenko-no-localizability", _ROBOT, "scores:Makarenko", "Makarenko, no localizability", localizability=0.0)
_field(
    "entropy-reduction", _MAP, "scores:EntropyReduction", "Expected entropy reduction", controls=("visible-unknown",)
)
_field("rrt-revenue", _VIEW, "scores:RrtRevenue", "RRT revenue", controls=("rrt-revenue-no-hysteresis",), kinds=_LIDAR)
_field(
    "rrt-revenue-no-hysteresis", _VIEW, "scores:RrtRevenue", "RRT revenue, no hysteresis", kinds=_LIDAR, hysteresis=1.0
)
_field("next-best-view", _VIEW, "sampled:NextBestView", "Next best view", controls=("next-best-view-no-distance",))
_field("next-best-view-no-distance", _VIEW, "sampled:NextBestView", "Next best view, no distance", decay=0.0)
_field(
    "bayesian-optimization",
    _MAP,
    "sampled:BayesianOptimization",
    "Bayesian optimization",
    controls=("entropy-reduction",),
)
_field(
    "bayesian-optimization-per-metre",
    _MAP,
    "sampled:BayesianOptimization",
    "Bayesian optimization, per metre",
    controls=("bayesian-optimization",),
    per_metre=True,
)
_field("frontier-tour", _WAY, "tour:FrontierTour", "Frontier tour", controls=("nearest",))
_field(
    "exploration-transform",
    _WAY,
    "transform:ExplorationTransform",
    "Exploration transform",
    controls=("exploration-transform-no-danger",),
    kinds=_LIDAR,
)
_field(
    "exploration-transform-mapex",
    _WAY,
    "transform:ExplorationTransform",
    "Exploration transform, MapEx",
    controls=("exploration-transform-no-danger",),
    kinds=_LIDAR,
    danger=50.0,
    margin=1.5,
    power=1.0,
)
_field(
    "exploration-transform-no-danger",
    _WAY,
    "transform:ExplorationTransform",
    "Exploration transform, no danger",
    kinds=_LIDAR,
    danger=0.0,
)
_field("graph-d-optimality", _ROBOT, "graph_optimality:GraphOptimality", "Graph D-optimality")
_field(
    "potential-field",
    _WAY,
    "potential:PotentialField",
    "Potential field (MMPF)",
    controls=("potential-field-no-revisits",),
)
_field("potential-field-no-revisits", _WAY, "potential:PotentialField", "Potential field, no revisits", revisit=0.0)
_field(
    "joint-entropy",
    _ROBOT,
    "joint_entropy:JointEntropy",
    "Joint entropy, loops closed",
    controls=("joint-entropy-no-closing",),
)
_field("joint-entropy-no-closing", _ROBOT, "joint_entropy:JointEntropy", "Joint entropy", closing=False)

TUNED: dict[str, dict[str, float]] = {
    "information-gain": {"gain": 24.0},
    "next-best-view": {"decay": 0.3},
    "heading-aware": {"decay": 0.1},
    "cost-utility": {"distance": 30.0},
    "makarenko": {"navigation": 1.5},
    "distance-advantage": {"distance": 8.0},
    "potential-field": {"revisit": 1.0},
    "joint-entropy": {"weight": 0.25},
}
"""Constants by rule for which docs/studies/field_tuning.py finds another value than its own to be best."""

for _name, _constants in TUNED.items():
    _rule = STRATEGIES[_name]
    _field(
        f"{_name}-tuned",
        _rule.suites,
        _rule.factory.removeprefix("baselines.field."),
        f"{_rule.label}, tuned",
        controls=(_name, *CONTROLS[_name]),
        kinds=_rule.kinds,
        **{**_rule.parameters, **_constants},
    )
