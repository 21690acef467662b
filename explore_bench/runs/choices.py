"""Agreement of choices: strategies are asked at the same observations, along the trajectories of each of them in turn.

First everybody drives its own trials. Then each of these is driven once more, with the answers that it had, and
everybody is asked at each observation, its driver included. Whoever is asked has been made and reset for that trial
and sees all of its observations in turn, as if its answers were driven, and draws from a generator of its own. Shipped
strategies are asked in one process, a foreign one in a process that is its alone.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from explore_bench.errors import RequestError, describe
from explore_bench.runs.runner import DEFAULT_TIMEOUT, check_runnable
from explore_bench.runs.suites import plan
from explore_bench.runs.workers.fork_server import another_hash_seed
from explore_bench.runs.workers.local import default_workers, results_of
from explore_bench.runs.workers.process import READY, Answer, Job, LostError
from explore_bench.runs.workers.task import owner_of, preparation_of, warm_up
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.containment import Signals, one_process, time_limit
from explore_bench.trial.explorer import ChoiceError, checked
from explore_bench.trial.loop import rollout
from explore_bench.trial.run import run_trial, strategy_of
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world

if TYPE_CHECKING:
    import pandas as pd

    from explore_bench.analysis.choices import Choice, Chooser
    from explore_bench.world.scenario import Scenario

Place = tuple[str, float, int]
"""A world: the name of its scenario, its size [m] and its number."""


@dataclass(frozen=True)
class Agreement:
    """How often strategies choose the same.

    Attributes
    ----------
    table : one row a pair, `analysis.choices.agreement_table`.
    left_out : in words who was left out where, and why.
    """

    table: pd.DataFrame
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Driven:
    """A trial that somebody drove: the candidates of each decision, the answers, and what went wrong."""

    candidates: tuple[tuple[int, ...], ...] = ()
    answers: tuple[int | Target, ...] = ()
    wrong: str = ""


@dataclass
class Heard:
    """What the asked ones answered along a trial by their place in the list, and what went wrong with whom."""

    answers: dict[int, list[int | Target]] = field(default_factory=dict)
    wrong: dict[int, str] = field(default_factory=dict)


def agreement_of_choices(
    strategies: Sequence[str],
    *,
    sizes: Sequence[float] = (),
    trials: int = 10,
    scenario: Scenario | str | None = None,
    seed: int = 0,
    workers: int | None = None,
    timeout: float = DEFAULT_TIMEOUT,
) -> Agreement:
    """Compare how strategies choose at the same observations, in any kind of world; nothing is stored.

    Every two of them are compared along the trajectories of both, in the worlds of the benchmark. A learned strategy
    takes part with each of its training seeds. Whoever fails in a world is left out of it, and named; a reference is
    left out.

    Parameters
    ----------
    strategies : two or more, written as for `explore_bench.run`.
    sizes, trials, scenario, seed : sizes [m], worlds a size, a Scenario or the name or file of one, and the root seed.
    workers, timeout : processes; seconds that one strategy may take for one trial.

    Raises
    ------
    RequestError : where the request is wrong, or leaves nobody to compare.
    """
    from explore_bench.analysis.choices import Chooser, Trajectory, agreement_table
    from explore_bench.world.scenarios import load_scenario

    physics = load_scenario(scenario) if isinstance(scenario, str) else scenario
    name = Path(scenario).name if isinstance(scenario, str) else None if scenario is None else "custom"
    if isinstance(strategies, str) or not strategies:
        raise RequestError(f"strategies is {strategies!r}; name two or more to compare, in a list.")
    asked = plan("smoke", strategies, sizes or (), trials, seed, physics, name).specs
    specs = [spec for spec in asked if not spec.reference]
    said = [
        f"{reference} is a reference: it is told the true world and does not choose by what the others see"
        for reference in dict.fromkeys(spec.strategy for spec in asked if spec.reference)
    ]
    if not specs:
        raise RequestError(f"of {', '.join(strategies)} only references are left; name strategies to compare.")
    crew = workers or default_workers()
    check_runnable(specs, crew, "processes", timeout)
    driven = _all_driven(specs, crew, timeout)
    heard = _all_asked(specs, driven, crew, timeout)
    wrong: dict[Chooser, dict[Place, str]] = {}
    found = []
    for number, spec in enumerate(specs):
        own, place = driven[number], _place(spec)
        if own.wrong:
            wrong.setdefault(_chooser(spec), {})[place] = own.wrong
            continue
        answered: dict[Chooser, tuple[Choice, ...]] = {}
        for other, (answers, reason) in heard[number].items():
            chooser = _chooser(specs[other])
            if reason:
                wrong.setdefault(chooser, {}).setdefault(place, f"{reason}, asked where {_chooser(spec)} drove")
            else:
                answered[chooser] = _choices(spec, own, answers)
        counts = tuple(len(cells) for cells in own.candidates)
        found.append(Trajectory(Chooser(*_chooser(spec)), *place, counts, _choices(spec, own, own.answers), answered))
    said += [_failed(chooser, places) for chooser, places in wrong.items()]
    if not found:
        raise RequestError(f"nobody is left to compare: {'; '.join(said)}.")
    table = agreement_table(found)
    said += [
        f"{Chooser(a, None)} answers differently when it is asked again: it draws from elsewhere than its generator"
        for a in dict.fromkeys(table[(table["a"] == table["b"]) & _same_seed(table) & (table["agreement"] < 1.0)]["a"])
    ]
    return Agreement(table, tuple(said))


def drive(spec: TrialSpec, seconds: float, folder: Path) -> Iterator[Any]:
    """Run a trial and tell what was answered in it: a Job."""
    warm_up(spec.scenario.tiny)
    yield READY
    result = run_trial(spec, seconds)
    if result.status in (Status.FAILED, Status.BROKEN):
        yield Answer(Driven(wrong=result.reason), last=result.transient)
        return
    made = [snapshot for _, snapshot in sorted(result.snapshots.items()) if snapshot.candidates is not None]
    answers = tuple(Target((one.target[0], one.target[1])) if one.target else one.choice for one in made)
    if len(made) != result.steps[-1].decisions:
        yield Answer(Driven(wrong="a decision of it took no step"))
        return
    yield Answer(Driven(tuple(tuple(one.candidates or ()) for one in made), answers))  # type: ignore[arg-type]


def ask(specs: Sequence[TrialSpec], driven: Driven, seconds: float, folder: Path) -> Iterator[Any]:
    """Drive a trial once more by its answers, and ask strategies at every observation: a Job.

    `specs` are trials of whom is asked, all in the driven world.
    """
    warm_up(specs[0].scenario.tiny)
    yield READY
    told, heard = Signals(), Heard()
    try:
        with redirect_stdout(sys.stderr), time_limit(seconds) as told:
            _ask_along(specs, driven, heard, told)
    except BaseException:
        if not told.expired:
            raise
    if told.expired:  # whatever became of it
        late = f"took longer than the {seconds:g} s allowed"
        heard.wrong = dict.fromkeys(range(len(specs)), late) | heard.wrong
    yield Answer(heard, last=told.expired)


def _ask_along(specs: Sequence[TrialSpec], driven: Driven, heard: Heard, told: Signals) -> None:
    spec = specs[0]
    world = draw_world(spec.scenario, spec.generator("world"))
    made: dict[int, Any] = {}
    for number, own in enumerate(specs):
        try:
            with one_process():
                made[number] = strategy_of(own, world)
            heard.answers[number] = []
        except BaseException as error:
            heard.wrong[number] = _blamed(error, told)
    events = rollout(spec.scenario, world, spec.generator("motion"), spec.generator("sensor"))
    answers = iter(zip(driven.candidates, driven.answers, strict=True))
    event: Observation | Step | None = next(events)
    while event is not None:
        answer = None
        if isinstance(event, Observation):
            candidates, answer = next(answers)
            if tuple(event.candidates.tolist()) != candidates:
                raise RuntimeError("the trial came out otherwise when it was driven again")
            for number, strategy in list(made.items()):
                try:
                    with one_process():
                        chosen = strategy.choose(event)
                    heard.answers[number].append(checked(chosen, len(candidates), event.roads))
                except BaseException as error:
                    del made[number]
                    heard.wrong[number] = f"{_blamed(error, told)} (at decision {event.decision})"
        try:
            event = events.send(answer)
        except StopIteration:
            event = None


def _blamed(error: BaseException, told: Signals) -> str:
    """What a strategy raised, in words; raised again where it was the clock's or the user's."""
    if told.expired or told.interrupted:
        raise error
    plain = isinstance(error, RequestError | ChoiceError)
    return " ".join(str(error).split()) if plain else describe(error)


def _all_driven(specs: Sequence[TrialSpec], crew: int, timeout: float) -> dict[int, Driven]:
    jobs = [Job(drive, (spec, timeout), timeout, owner_of(spec), preparation_of(spec)) for spec in specs]
    return {
        number: Driven(wrong=str(found)) if isinstance(found, LostError) else found
        for number, found in results_of(jobs, crew)
    }


def _all_asked(
    specs: Sequence[TrialSpec], driven: Mapping[int, Driven], crew: int, timeout: float
) -> dict[int, dict[int, tuple[list[int | Target], str]]]:
    """By the number of a driven trial and of a trial of whom was asked: the answers, and what went wrong."""
    places: dict[Place, list[int]] = {}
    for number, spec in enumerate(specs):
        places.setdefault(_place(spec), []).append(number)
    jobs, meant, seed = [], [], another_hash_seed()
    for number in (number for number in range(len(specs)) if not driven[number].wrong):
        groups: dict[object, list[int]] = {}
        for other in places[_place(specs[number])]:
            owner = owner_of(specs[other])
            groups.setdefault((owner, other) if owner else "", []).append(other)
        for group in groups.values():
            seconds = timeout * len(group)
            own = [specs[other] for other in group]
            jobs.append(
                Job(ask, (own, driven[number], seconds), seconds, owner_of(own[0]), preparation_of(own[0]), seed)
            )
            meant.append((number, group))
    heard: dict[int, dict[int, tuple[list[int | Target], str]]] = {number: {} for number in driven}
    for job, found in results_of(jobs, crew):
        number, group = meant[job]
        for k, other in enumerate(group):
            lost = isinstance(found, LostError)
            reason = str(found) if lost else found.wrong.get(k, "")
            heard[number][other] = ([] if reason else found.answers[k], reason)
    return heard


def _choices(spec: TrialSpec, driven: Driven, answers: Sequence[int | Target]) -> tuple[Choice, ...]:
    """Answers as choices that can be compared, on the grid of decisions."""
    from explore_bench.analysis.choices import Choice

    return tuple(
        Choice(None, spec.scenario.grid.cell_of(*answer.position))
        if isinstance(answer, Target)
        else Choice(answer, cells[answer])
        for cells, answer in zip(driven.candidates, answers, strict=True)
    )


def _chooser(spec: TrialSpec) -> Chooser:
    from explore_bench.analysis.choices import Chooser

    return Chooser(spec.strategy, spec.training_seed)


def _place(spec: TrialSpec) -> Place:
    return spec.scenario_name, spec.scenario.size, spec.trial


def _same_seed(table: pd.DataFrame) -> pd.Series:
    return table["seed_a"].fillna(-1) == table["seed_b"].fillna(-1)


def _failed(chooser: Chooser, places: Mapping[Place, str]) -> str:
    """Sentence on somebody who failed."""
    (_, size, trial), reason = next(iter(places.items()))
    count = f"in {len(places)} world{'s' * (len(places) > 1)}"
    return f"{chooser} failed {count}, first in world {trial} of {size:g} m: {reason}; no pair with it counts there"
