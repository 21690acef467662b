"""The four claims of Zhang et al. 2021 (§1, §4.2) as comparisons, and what its §4.2 leaves to be asked of a lidar."""

from __future__ import annotations

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
        "The same, with H_γ of Eq. 5 read as that of a node's own cell instead of the sum over the cells in range.",
        comparisons("graph-stnn-cell", tuple(f"{name}-cell" for name in _ABLATIONS), _BOTH, (20.0,)),
    ),
    Claim(
        "iii",
        "It generalizes: trained at 20 m, Graph-STNN is better than the other methods at 30 and 40 m, too.",
        comparisons("graph-stnn", ("gcn-no-obs", "gcn-obs", "entropy", "uncertainty", "random"), _BOTH, (30.0, 40.0)),
        architecture=False,
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
)
