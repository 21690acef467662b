"""What each figure shows, in words."""

from __future__ import annotations

from explore_bench.analysis.statistics import CONFIDENCE
from explore_bench.report.figures import CURVE_FIGURES
from explore_bench.report.pages.training import TRAINING_FIGURES, VALIDATION_FIGURES

_GROUPS = {
    "layers": "Graph-STNN with one, two and three layers of graph convolution",
    "table2": "the compared methods",
    "table3": "Graph-STNN and its ablations",
}


def caption(name: str) -> str:
    """Caption of a figure by the name of its file; the name itself for one that is not known."""
    number = name.removeprefix("figure-").lstrip("0")
    if name == "figure-06":
        return "Figure 6. The simulated world in the middle of a trial."
    if name == "figure-16a":
        return (
            "Figure 16a. The true scene in the middle third of a trial, before its longest drive there: the robot, its "
            "way so far, and what its lidar sees."
        )
    if name == "figure-16b":
        return (
            "Figure 16b. What the robot has mapped by then: its estimated way, the loops that it closed, the frontiers "
            "that it may choose from, and the way that it drives next."
        )
    if name == "stage-ranking":
        return (
            "Lidar worlds. Way driven until 90 % of the map are known, and time until 98 %: means over worlds with "
            f"{CONFIDENCE:.0%} bootstrap intervals. Further left is better."
        )
    if name == "field":
        return (
            "Rules of others beside the compared methods: the two metrics that rank, means over worlds with "
            f"{CONFIDENCE:.0%} bootstrap intervals, best first. A colour says what a strategy looks at."
        )
    if name == "field-terms":
        return (
            "What the terms of the rules do: how many times as good each is as the same rule, or a plainer one, "
            f"without one, paired by world with {CONFIDENCE:.0%} intervals. Filled: shown, after Holm's correction."
        )
    if name == "ways":
        return "The map, and the true ways of the strategies through it in one world; light grey does not count."
    if name.startswith("times-"):
        return (
            f"Times to coverage at {name.removeprefix('times-').removesuffix('m')} m: the share of trials that do not "
            "yet know 50, 80 and 90 % of the map; one that ended before never does."
        )
    if name in TRAINING_FIGURES:
        return (
            f"Figure {number}. Training of {_GROUPS[TRAINING_FIGURES[name]]}: reward, η and e over simulated steps; "
            "bands span the training seeds."
        )
    if name in VALIDATION_FIGURES:
        return (
            f"Validation of {_GROUPS[VALIDATION_FIGURES[name]]}: the policies without noise, after so many episodes of "
            "training, in worlds that are the same for all who validate at the same sizes (Belief attention does so at "
            "two); bands span the training seeds."
        )
    if name[:-1] not in CURVE_FIGURES:
        return name
    table, size = CURVE_FIGURES[name[:-1]]
    if name.endswith("a"):
        return (
            f"Figure {number}. One trial of each of {_GROUPS[table]} on the same {size:g} m map, at its last decision: "
            "what the robot knows, where it went and where it may go next."
        )
    if name.endswith("c"):
        return (
            f"Figure {number}. The same curves, {_GROUPS[table]} on {size:g} m maps: each variant less Graph-STNN, "
            f"paired by world, mean with a {CONFIDENCE:.0%} bootstrap band: above 0 the variant has more. Were the two "
            "one, a band would miss 0 in about one step of twenty, often in a whole stretch, for steps hang together."
        )
    return (
        f"Figure {number}. Known share of the map, e and η over the steps, {_GROUPS[table]} on {size:g} m maps: mean "
        f"over worlds with a {CONFIDENCE:.0%} bootstrap band. Below: trials still running."
    )
