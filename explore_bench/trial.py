"""One trial: `rollout` is the only simulation loop, `run_trial` lets a strategy choose in it and keeps the rows."""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from explore_bench.geometry import Array, centres
from explore_bench.planning.frontier import Withheld, find_candidates
from explore_bench.scenario import Scenario
from explore_bench.simulator.world import World, draw_world
from explore_bench.slam.belief import Belief
from explore_bench.slam.smoother import Lap, no_lap
from explore_bench.spec import Status, TrialSpec
from explore_bench.steps import Snapshot, Step, take_snapshot
from explore_bench.strategy import Observation, describe, make_strategy
from explore_bench.vehicle import Vehicle


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
    if (world.cells, world.cell_size, len(world.landmarks)) != (
        scenario.cells,
        scenario.cell_size,
        scenario.landmarks,
    ):
        raise ValueError(
            f"the world has {world.cells} cells a side of {world.cell_size:g} m and {len(world.landmarks)} landmarks, "
            f"the scenario {scenario.cells} of {scenario.cell_size:g} m and {scenario.landmarks}; make them agree"
        )
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


@dataclass(frozen=True)
class TrialResult:
    """What a trial leaves.

    Attributes
    ----------
    steps : one row a step, the first before any step; empty where the trial failed before.
    snapshots : replay of each decision by the number of the step at which it was made, and of the end.
    final_poses, final_covariances : trajectory and its position covariances (xx, xy, yy) as estimated at the end,
        shapes (N, 3); N = 0 for a trial that failed.
    decision_seconds : time the strategy took for each choice.
    transient : whether it failed for want of time, memory or disk, and is worth another try.
    """

    spec: TrialSpec
    world: World
    status: Status
    reason: str
    steps: list[Step]
    snapshots: dict[int, Snapshot]
    final_poses: Array
    final_covariances: Array
    decision_seconds: list[float]
    seconds: float
    transient: bool = False


def run_trial(spec: TrialSpec, timeout: float | None = None, lap: Lap = no_lap) -> TrialResult:
    """Run one trial: a pure function of its spec but for the times.

    Whatever the strategy does wrong (raise, answer nonsense, take longer than `timeout` [s]) makes the result
    `failed` with a reason; the rows up to there are kept.
    """
    begin = time.perf_counter()
    world = draw_world(spec.scenario, spec.generator("world"))
    steps: list[Step] = []
    snapshots: dict[int, Snapshot] = {}
    seconds: list[float] = []
    final_poses, final_covariances = np.empty((0, 3)), np.empty((0, 3))
    status, reason, transient = Status.FAILED, "", False
    try:
        with time_limit(timeout):
            strategy = make_strategy(spec.factory, spec.arguments)
            if spec.reference:
                strategy.reset_with_world(spec.generator("strategy"), world)
            else:
                strategy.reset(spec.generator("strategy"))
            events = rollout(spec.scenario, world, spec.generator("motion"), spec.generator("sensor"), lap)
            ending = _play(events, strategy, steps, snapshots, seconds)
            status, reason = ending.status, ending.reason
            snapshots[len(steps) - 1] = take_snapshot(ending.belief)
            final_poses = ending.belief.poses
            final_covariances = ending.belief.pose_covariances[:, [0, 0, 1], [0, 1, 1]]
    except OutOfTime:
        transient = True
        reason = f"took longer than the {timeout:g} s allowed"
    except ChoiceError as error:
        reason = str(error)
    except KeyboardInterrupt:
        raise
    except (MemoryError, OSError) as error:
        transient = True
        reason = describe(error)
    except BaseException as error:
        reason = describe(error)
    if status is Status.FAILED:
        reason += f" (at decision {len(seconds) - 1})" if seconds else " (before the first decision)"
    return TrialResult(
        spec=spec,
        world=world,
        status=status,
        reason=reason,
        steps=steps,
        snapshots=snapshots,
        final_poses=final_poses,
        final_covariances=final_covariances,
        decision_seconds=seconds,
        seconds=time.perf_counter() - begin,
        transient=transient,
    )


def _play(
    events: Generator[Observation | Step, int | None, Ending],
    strategy: Any,
    steps: list[Step],
    snapshots: dict[int, Snapshot],
    seconds: list[float],
) -> Ending:
    """Let a strategy choose through a rollout, noting rows, snapshots and times as they come."""
    choice = None
    while True:
        try:
            event = events.send(choice)
        except StopIteration as stop:
            ending: Ending = stop.value
            return ending
        choice = None
        if isinstance(event, Step):
            steps.append(event)
            continue
        snapshot = take_snapshot(event.belief, event.candidates.tolist())
        count = len(event.candidates)
        seconds.append(0.0)
        begin = time.perf_counter()
        try:
            choice = strategy.choose(event)
        finally:
            seconds[-1] = time.perf_counter() - begin
        if isinstance(choice, int | np.integer) and 0 <= choice < count:
            snapshots[len(steps) - 1] = snapshot._replace(choice=int(choice))


REMINDER = 5.0
"""Seconds after which a strategy that swallowed the first OutOfTime is sent another."""


class OutOfTime(BaseException):
    """A trial took longer than it may; no `except Exception` of a strategy holds it."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Raise OutOfTime in the block after some seconds, where the platform has timers and this is the main thread."""
    if not seconds or not math.isfinite(seconds) or threading.current_thread() is not threading.main_thread():
        yield
        return

    def expire(signum: int, frame: object) -> None:
        raise OutOfTime

    previous = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, seconds, REMINDER)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)
