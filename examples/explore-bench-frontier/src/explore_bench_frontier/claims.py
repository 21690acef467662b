"""What is claimed of the strategies; explore-bench tests it, beside the claims of others, on the trials of a report."""

from explore_bench import Claim, comparisons

CLAIMS = (
    Claim(
        "frontier",
        "The way matters: weighing what is in view against it explores better than the view alone.",
        comparisons("nearby-view", ["largest-view"], ["trajectory_error", "exploration_efficiency"], [20.0]),
        architecture=False,
    ),
)
