"""A plugin package for explore-bench: what it registers. The strategy itself is imported when a trial asks for it."""

from explore_bench import Entry

_FACTORY = "explore_bench_frontier.next_best_view:NextBestView"

STRATEGIES = {
    "nearby-view": Entry(_FACTORY, "Nearby view", "#2f4f8f"),
    "largest-view": Entry(_FACTORY, "Largest view", "#8f2f4f", parameters={"decay": 0.0}),
}
