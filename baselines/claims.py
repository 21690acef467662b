"""The four claims of Zhang et al. 2021 (§1, §4.2) as comparisons, and what its §4.2 leaves to be asked of a lidar.

Also what whoever adds a term to a rule, or tunes it, says of it, of the rules of others: that it helps.
"""

from __future__ import annotations

from collections.abc import Iterator

from baselines.catalogue import CONTROLS, STRATEGIES
from explore_bench import Claim, comparisons

_BOTH = ("trajectory_error", "exploration_efficiency")
_ABLATIONS = (
    *("no-state", "no-temporal", "no-spatial"),
    *("no-temporal-state", "no-spatial-state", "no-spatial-temporal"),
)

_LIDAR_WORLDS = {
    "range 10 m": "lidar worlds full of obstacles, with a range of 10 m,",
    "range 5 m": "lidar worlds full of obstacles, with a range of 5 m,",
    "office": "offices",
    "rooms": "suites of rooms",
    "maze": "mazes",
    "hall": "halls",
}
"""Scenarios of the suites `stage` and `plans`, in words."""


def _terms(scenario: str, kind: str, metrics: tuple[str, ...], sizes: tuple[float, ...]) -> Iterator[Claim]:
    """Every rule of others that runs in a kind of world against its controls, in the metrics that rank there."""
    for rule, controls in CONTROLS.items():
        beside = [name for name in controls if STRATEGIES[name].runs_in(kind)]
        if STRATEGIES[rule].runs_in(kind) and beside:
            label, others = STRATEGIES[rule].label, "; ".join(STRATEGIES[name].label for name in beside)
            yield Claim(
                rule if kind == "landmark" else f"{rule}, {scenario}",
                f"{label} explores better than what it is measured by ({others}).",
                comparisons(rule, beside, metrics, sizes),
                architecture=False,
                scenario=scenario,
            )


CLAIMS = (
    Claim(
        "i",
        "Obstacles in the graph help: a network that sees them chooses better targets than one that does not.",
        comparisons("gcn-obs", ("gcn-no-obs", "gcn-obs-blind"), _BOTH, (20.0, 40.0)),
    ),
    Claim(
        "ii",
        "Spatial and temporal information help: the whole network explores better than it does without an encoder.",
        comparisons("graph-stnn", _ABLATIONS, _BOTH, (20.0, 30.0, 40.0)),
    ),
    Claim(
        "ii, H_γ of a cell",
        "The same at 20 m, with H_γ of Eq. 5 read as that of a node's own cell, not the sum over the cells in range.",
        comparisons("graph-stnn-cell", tuple(f"{name}-cell" for name in _ABLATIONS), _BOTH, (20.0,)),
    ),
    Claim(
        "iii",
        "It generalizes: trained at 20 m, Graph-STNN is better than the other methods at 30 and 40 m, too.",
        comparisons("graph-stnn", ("gcn-no-obs", "gcn-obs", "entropy", "uncertainty", "random"), _BOTH, (30.0, 40.0)),
    ),
    Claim(
        "iv",
        "It converges faster and earns more reward in training than the graph networks without its encoders.",
        comparisons(
            "graph-stnn",
            ("gcn-obs", "gcn-no-obs"),
            ("early_reward", "final_reward", "early_validation", "final_validation"),
        ),
    ),
    *(
        Claim(
            f"{which}, {where}",
            f"What {whom} learned among landmarks explores {what} after less driving and sooner than the nearest "
            "frontier and than entropy.",
            comparisons(strategy, ("nearest", "entropy"), ("l90", "t90_seconds"), (20.0,)),
            architecture=False,
            scenario=where,
        )
        for which, strategy, whom in (("v", "graph-stnn", "Graph-STNN"), ("vi", "belief-attention", "Belief attention"))
        for where, what in _LIDAR_WORLDS.items()
    ),
    *_terms("paper", "landmark", _BOTH, (20.0, 30.0, 40.0)),
    *(
        claim
        for scenario in ("range 10 m", "range 5 m")
        for claim in _terms(scenario, "lidar", ("l90", "t98_seconds"), (20.0,))
    ),
)
