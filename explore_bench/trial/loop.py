"""`rollout` is the only simulation loop. It knows no kind of world."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from explore_bench.robot.belief import Belief
from explore_bench.robot.timing import Lap, no_lap
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.explorer import StuckError, explorer_of
from explore_bench.trial.spec import Status
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import World
from explore_bench.world.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Ending:
    """How a rollout ended, why in a sentence (empty where the status says it all), and the last belief."""

    status: Status
    reason: str
    belief: Belief


def rollout(
    scenario: Scenario,
    world: World,
    motion: np.random.Generator,
    sensing: np.random.Generator,
    lap: Lap = no_lap,
) -> Generator[Observation | Step, int | Target | None, Ending]:
    """Simulate one trial, yielding a Step after every step and an Observation wherever a choice is due.

    The choice, an index of the observation's candidates or a Target, is given by `send`. The generator returns an
    Ending.

    Parameters
    ----------
    motion, sensing : streams of the motion's and the sensor's standard normals.
    lap : told the name of each part of a step when it is done.

    Raises
    ------
    ChoiceError : when what was sent can be neither chosen nor driven to.
    ValueError : when the world does not fit the scenario.
    """
    explorer = explorer_of(scenario, world, motion, sensing, lap)
    yield explorer.row()
    while (status := explorer.status()) is None:
        try:
            observation = explorer.observe()
        except StuckError as stuck:
            return Ending(Status.STUCK, str(stuck), explorer.belief())
        choice = yield observation
        lap("decision")
        yield from explorer.drive(choice)
    return Ending(status, "", explorer.belief())
