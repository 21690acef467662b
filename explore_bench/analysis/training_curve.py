"""The training curve that lies beside a file of weights: what a trainer writes, the report draws and claims compare."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import read_csv
from explore_bench.analysis.metrics import Metric
from explore_bench.strategies.entry import Entry, weights_file

CURVE_WINDOW = 10_000
"""Simulated steps over which a row averages, as the paper's curves do (§4.2)."""

EARLY = 200_000
"""Simulated steps within which faster learning shows."""

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


def training_curves(entry: Entry) -> dict[int, pd.DataFrame]:
    """Curve of every training seed that ships with one; a training shorter than a row has none.

    Raises
    ------
    RequestError : for a file that is no curve.
    """
    files = {seed: curve_path(weights_file(weights)) for seed, weights in entry.weights.items()}
    curves = {seed: read_csv(file, tuple(CURVE_COLUMNS)) for seed, file in files.items() if file.is_file()}
    return {seed: curve for seed, curve in curves.items() if len(curve)}


def on_one_axis(curves: list[pd.DataFrame], column: str) -> tuple[np.ndarray, np.ndarray]:
    """Curves of several seeds at common numbers of steps.

    Returns
    -------
    Steps, shape (K,), up to where the shortest curve ends, and values, shape (seeds, K).
    """
    end = min(float(curve["steps"].iloc[-1]) for curve in curves)
    steps = np.linspace(0.0, end, max(math.ceil(end / CURVE_WINDOW), 2))[1:]
    values = [np.interp(steps, curve["steps"], curve[column]) for curve in curves]
    return steps, np.array(values)


def _early_reward(curve: pd.DataFrame) -> float:
    return float(curve["reward"][curve["steps"] <= EARLY].mean())


def _final_reward(curve: pd.DataFrame) -> float:
    return float(curve["reward"].iloc[-max(len(curve) // 10, 1) :].mean())


TRAINING_METRICS: dict[str, Metric] = {
    "early_reward": Metric(
        "r, early",
        "1",
        "higher",
        f"reward of a decision, mean over the first {EARLY:,} steps",
        _early_reward,
    ),
    "final_reward": Metric(
        "r, final", "1", "higher", "reward of a decision, mean over the last tenth of the training", _final_reward
    ),
}
"""What a training curve says, by training seed."""


def training_values(entry: Entry, metric: str) -> dict[int, float]:
    """One of TRAINING_METRICS for every training seed with a curve."""
    return {seed: TRAINING_METRICS[metric].value(curve) for seed, curve in training_curves(entry).items()}
