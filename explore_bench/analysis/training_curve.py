"""What lies beside a file of weights of its training: what a trainer writes, the report draws and claims compare.

The curve is of episodes that explore, each learner in its own worlds. Validations are of the greedy policy in worlds
that are the same for all who validate at the same sizes.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

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


VALIDATION_COLUMNS: dict[str, str] = {
    "episodes": "played so far in training",
    "objective": "log e − log η of an episode without noise, mean over the validation worlds",
    "time": "T [steps], mean over them",
    "efficiency": "η [m²/step], mean over them (Eq. 2)",
    "error": "e [m], mean over them (Eq. 3)",
}

EARLY_EPISODES, LAST_VALIDATIONS = 1500, 3
"""Episodes within which faster learning shows in validations, and how many of the last say what came of it."""


class Training(NamedTuple):
    """What is stored of a training: rows of CURVE_COLUMNS, and of VALIDATION_COLUMNS or None."""

    curve: pd.DataFrame
    validations: pd.DataFrame | None


def curve_path(weights: Path) -> Path:
    """File of the curve that belongs to a file of weights."""
    return weights.with_suffix(".curve.csv")


def validations_path(weights: Path) -> Path:
    """File of the validations that belong to a file of weights."""
    return weights.with_suffix(".validations.csv")


def trainings(entry: Entry) -> dict[int, Training]:
    """Training of every seed that ships with a curve; one shorter than a row of it has none.

    Raises
    ------
    RequestError : for a file that is none of the kind.
    """
    found = {}
    for seed, weights in entry.weights.items():
        curve, validations = curve_path(weights_file(weights)), validations_path(weights_file(weights))
        rows = read_csv(curve, tuple(CURVE_COLUMNS)) if curve.is_file() else None
        if rows is not None and len(rows):
            made = read_csv(validations, tuple(VALIDATION_COLUMNS)) if validations.is_file() else None
            found[seed] = Training(rows, made if made is not None and len(made) else None)
    return found


def on_one_axis(
    curves: list[pd.DataFrame], column: str, along: str = "steps", spacing: float = CURVE_WINDOW
) -> tuple[np.ndarray, np.ndarray]:
    """Curves of several seeds at common places along a column, about so far apart.

    Returns
    -------
    Places, shape (K,), up to where the shortest curve ends, and values, shape (seeds, K).
    """
    end = min(float(curve[along].iloc[-1]) for curve in curves)
    places = np.linspace(0.0, end, max(math.ceil(end / spacing), 2))[1:]
    values = [np.interp(places, curve[along], curve[column]) for curve in curves]
    return places, np.array(values)


def _early_reward(training: Training) -> float:
    return float(training.curve["reward"][training.curve["steps"] <= EARLY].mean())


def _final_reward(training: Training) -> float:
    return float(training.curve["reward"].iloc[-max(len(training.curve) // 10, 1) :].mean())


def _early_validation(training: Training) -> float:
    own = training.validations  # made at the end of the round of episodes in which one is due
    return math.nan if own is None else float(own["objective"][own["episodes"] < 1.1 * EARLY_EPISODES].mean())


def _final_validation(training: Training) -> float:
    own = training.validations
    return math.nan if own is None else float(own["objective"].iloc[-LAST_VALIDATIONS:].mean())


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
    "early_validation": Metric(
        "log e − log η, early",
        "1",
        "lower",
        f"of greedy episodes in the worlds of validation, mean over the first {EARLY_EPISODES:,} episodes of training",
        _early_validation,
    ),
    "final_validation": Metric(
        "log e − log η, final",
        "1",
        "lower",
        f"of greedy episodes in the worlds of validation, mean over the last {LAST_VALIDATIONS} validations",
        _final_validation,
    ),
}
"""What is measured of a training, by training seed."""


def training_values(entry: Entry, metric: str) -> dict[int, float]:
    """One of TRAINING_METRICS for every training seed with a curve; NaN where validations are missing."""
    return {seed: TRAINING_METRICS[metric].value(training) for seed, training in trainings(entry).items()}
