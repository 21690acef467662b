"""The kinds of world, and where the parts of each are: named like strategies, imported when first used.

Whatever is true or on board of one kind lives in the folders of its name (`world/landmark`, `robot/landmark`,
`trial/landmark`); everything else knows no kind. A new kind is a line here.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from explore_bench.errors import unknown

if TYPE_CHECKING:  # compiled code takes a second to import, and a list of scenarios needs none
    from explore_bench.geometry import Array, Grid, Pose

DEFAULT_KIND = "landmark"


@dataclass(frozen=True)
class Kind:
    """Parts of a kind of world, each "module:name".

    A trial runs the first four. The others look at what it left, and are empty in a kind of world that has no more to
    say of its trials than all kinds have.

    Attributes
    ----------
    scenario : its Scenario: the protocol with the physics of this kind.
    world : its World, the truth.
    step : the row that is kept of every step.
    explorer : its Explorer, the robot in that world.
    metrics : its metrics beside the common ones, a mapping of names to Metrics.
    facts : what the world of a trial is like, a function of its record that gives plain values by name.
    tables, figures : what a report shows of its trials, functions of the rows of trials.csv that give Tables, and
        matplotlib Figures, by name.
    """

    scenario: str
    world: str
    step: str
    explorer: str
    metrics: str = ""
    facts: str = ""
    tables: str = ""
    figures: str = ""

    @property
    def simulated(self) -> tuple[str, ...]:
        """The parts that a trial runs: an edit of these makes it another one."""
        return self.scenario, self.world, self.step, self.explorer

    def load(self, part: str, absent: Any = None) -> Any:
        """Import the part of this name; `absent` stands for one that the kind does not have."""
        if not getattr(self, part):
            return absent
        module, _, name = getattr(self, part).partition(":")
        return getattr(importlib.import_module(module), name)


KINDS: dict[str, Kind] = {
    "landmark": Kind(
        scenario="explore_bench.world.landmark.constants:LandmarkScenario",
        world="explore_bench.world.landmark.world:LandmarkWorld",
        step="explore_bench.trial.landmark.step:LandmarkStep",
        explorer="explore_bench.trial.landmark.explorer:LandmarkExplorer",
    ),
    "lidar": Kind(
        scenario="explore_bench.world.lidar.constants:LidarScenario",
        world="explore_bench.world.lidar.world:LidarWorld",
        step="explore_bench.trial.lidar.step:LidarStep",
        explorer="explore_bench.trial.lidar.explorer:LidarExplorer",
        metrics="explore_bench.analysis.lidar.metrics:METRICS",
        facts="explore_bench.analysis.lidar.facts:facts",
        tables="explore_bench.report.lidar.tables:tables",
        figures="explore_bench.report.lidar.figures:figures",
    ),
}


def kind_of(name: str) -> Kind:
    """Kind of a name.

    Raises
    ------
    RequestError : where there is none.
    """
    if not isinstance(name, str) or name not in KINDS:
        raise unknown("kind of world", str(name), KINDS)
    return KINDS[name]


class World(Protocol):
    """The truth of one trial, of whatever kind."""

    @property
    def grid(self) -> Grid:
        """Grid of the obstacles."""

    @property
    def obstacles(self) -> NDArray[np.bool_]:
        """Whether a cell is an obstacle, shape (rows, columns)."""

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Whether a cell counts towards coverage, shape (rows, columns)."""

    @property
    def walls(self) -> NDArray[np.bool_]:
        """Whether a cell is an obstacle that a picture of the truth shows, shape (rows, columns)."""

    @property
    def landmarks(self) -> Array:
        """True positions [m], shape (M, 2); none in a kind of world without landmarks."""

    @property
    def start(self) -> Pose:
        """True pose at step 0."""

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that tell this world from any other."""

    @classmethod
    def draw(cls, scenario: Any, rng: np.random.Generator) -> Self:
        """World of a scenario, drawn from a stream."""

    def facts(self) -> dict[str, Any]:
        """Plain values from which `from_facts` makes the same world."""

    @classmethod
    def from_facts(cls, facts: dict[str, Any], scenario: Any) -> Self:
        """World that a record tells of."""


def draw_world(scenario: Any, rng: np.random.Generator) -> World:
    """World of a scenario of any kind, drawn from a stream."""
    world: World = kind_of(scenario.kind).load("world").draw(scenario, rng)
    return world
