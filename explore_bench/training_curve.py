"""The training curve that lies beside a file of weights: what a trainer writes and the report reads."""

from __future__ import annotations

from pathlib import Path

WINDOW = 10_000
"""Simulated steps over which a row averages, as the paper's curves do (§4.2)."""

CURVE_COLUMNS: dict[str, str] = {
    "steps": "simulated so far",
    "episodes": "played so far",
    "decisions": "made so far",
    "reward": "of a decision (Eq. 24), mean",
    "time": "T of an episode [steps], mean",
    "efficiency": "η of an episode [m²/step], mean (Eq. 2)",
    "error": "e of an episode [m], mean (Eq. 3)",
    "loss": "of a gradient step, mean; that of the learner's own rule",
}


def curve_path(weights: Path) -> Path:
    """File of the curve that belongs to a file of weights."""
    return weights.with_suffix(".curve.csv")
