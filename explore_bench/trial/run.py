"""One trial from its specification to its result: a strategy chooses through a rollout, and its rows are kept."""

from __future__ import annotations

import sys
import time
from collections.abc import Generator
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from explore_bench.errors import RequestError, describe
from explore_bench.geometry import Array
from explore_bench.robot.timing import Lap, no_lap
from explore_bench.strategies.contract import Observation, Target
from explore_bench.strategies.loading import StrategyError, check_methods, make_strategy
from explore_bench.trial.containment import Signals, is_breakdown, one_process, time_limit
from explore_bench.trial.explorer import ChoiceError, StandingError, answer_of
from explore_bench.trial.loop import Ending, rollout
from explore_bench.trial.snapshot import Snapshot, take_snapshot
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import World, draw_world


@dataclass(frozen=True)
class TrialResult:
    """What a trial leaves.

    Attributes
    ----------
    steps : one row a step, the first before any step; empty where the trial failed before.
    snapshots : replay of each decision by the number of the step at which it was made, and of the end.
    final_poses, final_covariances : trajectory of the counted steps and its position covariances (xx, xy, yy) as
        estimated at the end, shapes (N, 3); N = 0 for a trial that failed.
    decision_seconds : time the strategy took for each choice.
    transient : whether it failed for want of time, memory or disk, or of something that its strategy needs in order to
        be made, and is worth another try.
    notes : what a reference says of the world, numbers by name; see `Reference`.
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
    notes: dict[str, float] = field(default_factory=dict)


class BreakdownError(RuntimeError):
    """The simulation broke down on its own, between two choices."""


def run_trial(spec: TrialSpec, timeout: float | None = None, lap: Lap = no_lap) -> TrialResult:
    """Run one trial: a pure function of its spec but for the times.

    Whatever the strategy does wrong (raise, answer nonsense, take longer than `timeout` [s]) makes the result
    `failed` with a reason; the rows up to there are kept. One that stays where it is is `stuck`. Where it is the
    simulator or its SLAM that breaks down, the result is `broken`. What a strategy prints goes to stderr, and a process
    that it forks off ends when it comes back from it.

    Raises
    ------
    KeyboardInterrupt : where the user, and not the strategy, wants it to end.
    """
    begin = time.perf_counter()
    world = draw_world(spec.scenario, spec.generator("world"))
    steps: list[Step] = []
    snapshots: dict[int, Snapshot] = {}
    seconds: list[float] = []
    final_poses, final_covariances = np.empty((0, 3)), np.empty((0, 3))
    status, reason, transient = Status.FAILED, "", False
    notes: dict[str, float] = {}
    told = Signals()
    try:
        with redirect_stdout(sys.stderr), time_limit(timeout) as told:
            strategy = strategy_of(spec, world)
            events = rollout(spec.scenario, world, spec.generator("motion"), spec.generator("sensor"), lap)
            ending = _play(events, strategy, steps, snapshots, seconds)
            status, reason = ending.status, ending.reason
            if spec.reference:
                notes = {str(name): float(value) for name, value in getattr(strategy, "notes", {}).items()}
            snapshots[len(steps) - 1] = take_snapshot(ending.belief)
            counted = slice(-len(steps), None)  # moves at the start have poses, and no row
            final_poses = ending.belief.poses[counted]
            final_covariances = ending.belief.pose_covariances[counted, [0, 0, 1], [0, 1, 1]]
    except ChoiceError as error:
        reason = str(error)
    except RequestError as error:
        transient = not steps
        reason = " ".join(str(error).split())
    except (MemoryError, OSError) as error:
        transient = True
        reason = describe(error)
    except BreakdownError as error:
        status, reason = Status.BROKEN, str(error)
    except BaseException as error:
        status = Status.BROKEN if is_breakdown(error) else Status.FAILED
        reason = describe(error)
    if told.interrupted:
        raise KeyboardInterrupt
    if told.expired:  # whatever became of it: what was chosen after that depends on the machine
        status, transient = Status.FAILED, True
        reason = f"took longer than the {timeout:g} s allowed"
        notes, final_poses, final_covariances = {}, final_poses[:0], final_covariances[:0]
    if status in (Status.FAILED, Status.BROKEN):
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
        notes=notes,
    )


def strategy_of(spec: TrialSpec, world: World) -> Any:
    """Make the strategy of a trial and reset it; only a reference is told the world.

    Raises
    ------
    RequestError : where it cannot be made; whatever its own `reset` raises.
    """
    if spec.broken:
        raise StrategyError(spec.broken)
    with one_process():
        strategy = make_strategy(spec.factory, spec.arguments)
        check_methods(strategy, spec.reference)
        rng = spec.generator("strategy")
        if spec.reference:
            strategy.reset_with_world(rng, world)
        else:
            strategy.reset(rng)
    return strategy


def _play(
    events: Generator[Observation | Step, int | Target | None, Ending],
    strategy: Any,
    steps: list[Step],
    snapshots: dict[int, Snapshot],
    seconds: list[float],
) -> Ending:
    """Let a strategy choose through a rollout, noting rows, snapshots and times as they come."""
    choice = event = None
    while True:
        try:
            event = events.send(choice)
        except StopIteration as stop:
            ending: Ending = stop.value
            return ending
        except StandingError as error:
            assert isinstance(event, Observation)
            return Ending(Status.STUCK, f"{error} (at decision {len(seconds) - 1})", event.belief)
        except (ChoiceError, MemoryError, OSError):
            raise
        except Exception as error:
            raise BreakdownError(describe(error)) from error
        choice = None
        if isinstance(event, Step):
            steps.append(event)
            continue
        snapshot = take_snapshot(event.belief, event.candidates.tolist(), event.positions)
        count = len(event.candidates)
        seconds.append(0.0)
        begin = time.perf_counter()
        try:
            with one_process():
                choice = answer_of(strategy.choose(event), count)
        finally:
            seconds[-1] = time.perf_counter() - begin
        snapshots[len(steps) - 1] = _with_answer(snapshot, choice, count)


def _with_answer(snapshot: Snapshot, choice: object, count: int) -> Snapshot:
    """Snapshot with what was answered; what can be neither chosen nor driven to is said in the trial's reason."""
    if isinstance(choice, Target):
        return snapshot._replace(target=list(choice.position))
    if isinstance(choice, int) and 0 <= choice < count:
        return snapshot._replace(choice=choice)
    return snapshot
