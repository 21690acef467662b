"""The reward of a decision (Eq. 24), from the rows before and after it; learners and the Gymnasium adapter share it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from explore_bench.trial.error_and_efficiency import trajectory_error
from explore_bench.trial.steps import Step
from explore_bench.world.scenario import Scenario


@dataclass(frozen=True)
class RewardWeights:
    """The constants ω of Eq. 24, all positive; the paper prints none of them (docs/learning.md says how these came).

    Attributes
    ----------
    uncertainty : ω₁, of the change of U per cell of the map [1 / m²].
    turning : ω₂, of the angle turned [1 / rad].
    length : ω₃, of the path's length [1 / m].
    error : ω₄, of the trajectory error e after the decision [1 / m].
    steps : ω₅, of the steps since the beginning per cell of the map.
    explored : ω₆, of the known share of the map after the decision.
    """

    uncertainty: float = 8.0
    turning: float = 0.05
    length: float = 0.1
    error: float = 0.1
    steps: float = 0.1
    explored: float = 0.1

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"the weight '{name}' of the reward is {value}; Eq. 24 asks for a positive number")


REWARD_WEIGHTS = RewardWeights()


def reward(before: Step, after: Step, scenario: Scenario, weights: RewardWeights = REWARD_WEIGHTS) -> float:
    """R = −ω₁ ΔU − ω₂ R₂ − ω₃ R₃ − ω₄ e − ω₅ R₅ + ω₆ R₆ of the decision driven between two rows (Eq. 24).

    ΔU is the change of U, so that reducing it is rewarded; U and the steps are taken per cell of the map, so that
    one set of weights serves maps of all sizes.
    """
    cells = scenario.cell_count
    return (
        -weights.uncertainty * (after.uncertainty - before.uncertainty) / cells
        - weights.turning * (after.turned - before.turned)
        - weights.length * (after.path_length - before.path_length)
        - weights.error * float(trajectory_error(float(after.step), after.peak_trace, scenario))
        - weights.steps * after.step / cells
        + weights.explored * after.explored
    )
