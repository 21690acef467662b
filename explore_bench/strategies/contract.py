"""The contract of a strategy: what it sees at a decision, and what it may answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from explore_bench.geometry import Array, Pose
    from explore_bench.robot.belief import Belief
    from explore_bench.robot.planning.roads import Reachable, Roads
    from explore_bench.world.kinds import World
    from explore_bench.world.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Target:
    """A place of the strategy's own to drive to, instead of a candidate.

    It must lie in one of the cells of `Observation.reachable`; the robot drives through the centres of the cells on the
    way and then to the place itself.

    Attributes
    ----------
    position : (x, y) [m].
    """

    position: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Observation:
    """All that a strategy may use for one decision. Every array is read-only; nothing in it leads to the truth.

    Attributes
    ----------
    belief : estimates, covariances, occupancy and virtual map; `belief.predict(path)` propagates it.
    step, decision : how many steps were taken and decisions made before this one.
    candidates : target cells to choose from, shape (C,), ascending, at least one.
    positions : centres of the candidates [m], shape (C, 2).
    paths : for each candidate the cells of its path, from the robot's own cell to the candidate.
    path_lengths : length of each path [m], shape (C,).
    roads : the cells that the robot drives through, with the way to each.
    robot : number of the robot that decides.
    """

    belief: Belief
    step: int
    decision: int
    candidates: NDArray[np.int64]
    positions: Array
    paths: tuple[NDArray[np.int64], ...]
    path_lengths: Array
    roads: Roads
    robot: int = 0

    @property
    def reachable(self) -> Reachable:
        """Cells that can be reached, with the length of the drive to each: where a Target may lie. Computed by need."""
        return self.roads.reachable

    @property
    def scenario(self) -> Scenario:
        """The physical constants."""
        return self.belief.scenario

    @property
    def pose(self) -> Pose:
        """Estimated pose (x, y, heading) [m, m, rad]."""
        return self.belief.pose


@runtime_checkable
class Strategy(Protocol):
    """What the benchmark asks of a strategy; any object with these two methods is one."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial. All randomness of the trial must come from `rng`, nothing may be kept from the last one."""

    def choose(self, observation: Observation) -> int | Target:
        """Return the index of the chosen candidate, 0 ≤ index < C, or a Target of one's own."""


@runtime_checkable
class Reference(Protocol):
    """A strategy that is told the truth: a bound to compare with, never a competitor.

    It may have an attribute `notes`, numbers by name that are kept with its trial. Regret is measured by two of them:
    `tour`, the steps of a way without noise that explores this world, and `bound`, steps below which no way does.
    """

    def reset_with_world(self, rng: np.random.Generator, world: World) -> None:
        """Begin a trial in a world that is known."""

    def choose(self, observation: Observation) -> int | Target:
        """Return the index of the chosen candidate, 0 ≤ index < C, or a Target of one's own."""
