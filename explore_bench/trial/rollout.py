"""`rollout` is the only simulation loop."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from explore_bench.geometry import centres
from explore_bench.robot.belief import Belief
from explore_bench.robot.landmark.smoother import Lap, no_lap
from explore_bench.robot.planning.candidates import Withheld, find_candidates
from explore_bench.strategies.contract import Observation
from explore_bench.trial.landmark import Vehicle
from explore_bench.trial.spec import Status
from explore_bench.trial.steps import Step
from explore_bench.world.landmark.world import World
from explore_bench.world.scenario import Scenario


@dataclass(frozen=True, slots=True)
class Ending:
    """How a rollout ended, why in a sentence (empty where the status says it all), and the last belief."""

    status: Status
    reason: str
    belief: Belief


class ChoiceError(ValueError):
    """A strategy answered something that is no index of a candidate."""


def rollout(
    scenario: Scenario,
    world: World,
    motion: np.random.Generator,
    sensing: np.random.Generator,
    lap: Lap = no_lap,
) -> Generator[Observation | Step, int | None, Ending]:
    """Simulate one trial, yielding a Step after every step and an Observation wherever a choice is due.

    The choice, an index of the observation's candidates, is given by `send`. The generator returns an Ending.

    Parameters
    ----------
    motion, sensing : streams of the motion's and the sensor's standard normals.
    lap : told the name of each part of a step when it is done.

    Raises
    ------
    ChoiceError : when what was sent is no index of a candidate.
    ValueError : when the world does not fit the scenario.
    """
    fewer = scenario.map is not None and len(world.landmarks) < scenario.landmarks  # a map may have no more room
    if (world.cells, world.cell_size) != (scenario.cells, scenario.cell_size) or (
        len(world.landmarks) != scenario.landmarks and not fewer
    ):
        raise ValueError(
            f"the world has {world.cells} cells a side of {world.cell_size:g} m and {len(world.landmarks)} landmarks, "
            f"the scenario {scenario.cells} of {scenario.cell_size:g} m and {scenario.landmarks}; make them agree"
        )
    scenario = scenario.blind
    vehicle = Vehicle(scenario, world, motion, sensing, lap)
    withheld = Withheld()
    yield vehicle.row()
    decisions_here, here = 0, -1
    while (status := vehicle.status()) is None:
        smoother = vehicle.smoother
        found = find_candidates(vehicle.ground(), withheld)
        if not len(found.cells):
            return Ending(Status.STUCK, "no frontier can be reached", smoother.belief())
        own = vehicle.own_cell
        decisions_here = decisions_here + 1 if own == here else 1
        here = own
        if decisions_here > scenario.stuck_decisions:
            return Ending(
                Status.STUCK,
                f"{scenario.stuck_decisions} decisions did not leave cell {own}",
                smoother.belief(),
            )
        # copies: a strategy that forges its observation changes nothing that is driven
        targets, routes = found.cells.tolist(), [path.copy() for path in found.paths]
        positions = centres(found.cells, scenario.cells, scenario.cell_size)
        for array in (found.cells, found.lengths, positions, *found.paths):
            array.setflags(write=False)
        choice = yield Observation(
            belief=smoother.belief(),
            step=vehicle.steps,
            decision=vehicle.decisions,
            candidates=found.cells,
            positions=positions,
            paths=found.paths,
            path_lengths=found.lengths,
        )
        lap("decision")
        index = _checked(choice, len(found.cells))
        vehicle.decisions += 1
        for step in vehicle.drive(routes[index]):
            yield step
            if vehicle.own_cell != here:
                here = -1
        if vehicle.arrived:
            withheld.add(targets[index], vehicle.known)
    return Ending(status, "", vehicle.smoother.belief())


def _checked(choice: object, count: int) -> int:
    if isinstance(choice, bool | np.bool_) or not isinstance(choice, int | np.integer):
        shown = " ".join(repr(choice).split())
        raise ChoiceError(
            f"the answer {shown} is of type {type(choice).__name__}; answer an integer index, 0 to {count - 1}"
        )
    if not 0 <= choice < count:
        raise ChoiceError(f"the answer {int(choice)} is not the index of a candidate; answer 0 to {count - 1}")
    return int(choice)
