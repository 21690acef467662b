"""A metric and a fact that a test gives the second kind of world, which has none of its own.

They lie apart from it: what looks at records is no part of a trial, and an edit of it makes none stale.
"""

from __future__ import annotations

from typing import Any

from explore_bench.analysis.metrics import Metric

METRICS = {
    "turns": Metric("turns", "1", None, "moves along a diagonal", lambda record: float(record.steps["diagonal"].sum()))
}


def facts(record) -> dict[str, Any]:
    """Pawns on the board."""
    return {"pawns": int(record.world.obstacles.sum())}
