"""Eq. 2 and 3, and the rule for a trial that did not explore: the one place that says how a trial is scored.

A trial that did not explore is scored with T = n_a = the step limit, its last U (U₀ where it has none) and the larger
of its last max trace and 2 σ₀²: stopping early or crashing never pays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from explore_bench.trial.spec import Status
from explore_bench.world.scenario import Scenario

Number = TypeVar("Number", float, np.ndarray)


@dataclass(frozen=True)
class Score:
    """What Eq. 2 and 3 need of a trial: time T, uncertainty U_T [m²] and max trace [m² + rad²]."""

    scenario: Scenario
    time: int
    uncertainty: float
    peak_trace: float

    @property
    def trajectory_error(self) -> float:
        """Eq. 3."""
        return float(trajectory_error(float(self.time), self.peak_trace, self.scenario))

    @property
    def uncertainty_reduction(self) -> float:
        """ΔU = U₀ − U_T, with U of Eq. 1."""
        return self.scenario.prior_uncertainty - self.uncertainty

    @property
    def exploration_efficiency(self) -> float:
        """Eq. 2: η = (U₀ − U_T) / T; a trial that explored without a step has none (NaN)."""
        return self.uncertainty_reduction / self.time if self.time else math.nan


def score(status: str, time: int, uncertainty: float | None, peak_trace: float, scenario: Scenario) -> Score:
    """Score of a trial by its status and its last row; `uncertainty` is None where it has no row."""
    last = scenario.prior_uncertainty if uncertainty is None else uncertainty
    if status == Status.EXPLORED:
        return Score(scenario, time, last, peak_trace)
    return Score(scenario, scenario.step_limit, last, max(peak_trace, 2.0 * scenario.virtual_sigma**2))


def trajectory_error(time: Number, peak_trace: Number, scenario: Scenario) -> Number:
    """Eq. 3: e = n_a / n_g · √(max tr Σ) [m], of numbers or of arrays of one shape."""
    return time / scenario.cell_count * np.sqrt(peak_trace)
