"""What defines a trial, and how it can end."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from explore_bench.strategies.entry import weights_file
from explore_bench.trial.seeding import Purpose, Role, stream
from explore_bench.world.scenario import Scenario


class Status(StrEnum):
    """How a trial ended: `failed` is the strategy's fault, `broken` that of the simulator or its SLAM."""

    EXPLORED = "explored"
    STEP_LIMIT = "step_limit"
    STUCK = "stuck"
    FAILED = "failed"
    BROKEN = "broken"


@dataclass(frozen=True)
class TrialSpec:
    """Everything that defines a trial.

    Attributes
    ----------
    strategy : name under which its rows are kept.
    factory, parameters, reference : of its Entry.
    scenario : physical constants, the size among them.
    scenario_name : name under which they are kept.
    purpose, root, trial : of its random streams.
    broken : of its Entry; such a trial fails with this sentence.
    training_seed, weights : of a learned strategy, the seed with which it was trained and the file of its weights,
        as its Entry names it.
    """

    strategy: str
    factory: str
    scenario: Scenario
    trial: int
    parameters: Mapping[str, Any] = field(default_factory=dict)
    reference: bool = False
    scenario_name: str = "paper"
    purpose: Purpose = "evaluate"
    root: int = 0
    training_seed: int | None = None
    weights: str | None = None
    broken: str = ""

    @property
    def arguments(self) -> dict[str, Any]:
        """Keyword arguments of the factory: the parameters, and the weights where there are any."""
        return {**self.parameters, **({"weights": str(weights_file(self.weights))} if self.weights else {})}

    def generator(self, role: Role) -> np.random.Generator:
        """Return the trial's stream of a role."""
        return stream(self.purpose, self.root, self.scenario.size, self.trial, role)


@dataclass(frozen=True)
class Outcome:
    """What a worker reports of a trial that it has stored; the times are not part of any record."""

    spec: TrialSpec
    status: Status
    reason: str
    steps: int
    seconds: float
    decision_seconds: tuple[float, ...]
