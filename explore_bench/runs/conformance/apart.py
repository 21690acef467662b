"""The strategy in processes of its own: one where it may do its worst, and the runner's workers."""

from __future__ import annotations

import os
import pickle
import select
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from explore_bench.errors import RequestError, describe
from explore_bench.records.store import Store
from explore_bench.runs.conformance.answers import Answers, play
from explore_bench.runs.conformance.subject import Subject
from explore_bench.runs.conformance.tours import ORDINARY, SITUATIONS, TRIALS, Tour, observations
from explore_bench.runs.runner import execute
from explore_bench.runs.witness import run_witnessed
from explore_bench.runs.workers.fork_server import another_hash_seed, fork
from explore_bench.runs.workers.process import START
from explore_bench.runs.workers.task import warm_up
from explore_bench.strategies.contract import Target
from explore_bench.strategies.loading import StrategyError, check_methods
from explore_bench.strategies.tracing import place_of, with_place
from explore_bench.trial.containment import Signals, time_limit
from explore_bench.trial.spec import Status

TOURS = (*ORDINARY, *SITUATIONS)

WORKERS = 1
"""Processes of the runner: a start costs more than all trials."""

GRACE = 30.0
"""Seconds beyond its limit after which a process that cannot be interrupted is killed."""

ENDING = 5.0
"""Seconds for which the exit code is waited for of a process from which nothing more comes."""


@dataclass(frozen=True)
class Played:
    """How a trial went: its status and reason, the choices, the longest decision and the whole trial [s]."""

    status: Status
    reason: str
    choices: tuple[int | Target, ...]
    late: bool = False
    slowest: float = 0.0
    seconds: float = 0.0


@dataclass
class Examination:
    """What a strategy did in a process that ran nobody else's code, as far as it came.

    Attributes
    ----------
    wrong : what was asked for wrongly (there is no such module, it takes no such parameters); empty where nothing was.
    refusal : why it cannot be made, in a sentence; empty where it can; None where it did not come to that.
    tours : its answers to the observations of each of TOURS, in their order.
    trials : its own trial in each of the worlds of TRIALS that are of a kind which it does not refuse.
    hung : whether it could be stopped only by killing its process.
    death : how its process ended before its time, in words; empty where it did not.
    """

    wrong: str = ""
    refusal: str | None = None
    tours: dict[Tour, Answers] = field(default_factory=dict)
    trials: dict[Tour, Played] = field(default_factory=dict)
    hung: bool = False
    death: str = ""

    @property
    def refused(self) -> dict[str, str]:
        """Kinds of world that it refused whenever it was shown one, and the sentence with which it did."""
        accepted = {tour.kind for tour, answers in self.tours.items() if not answers.refused}
        return {tour.kind: answers.refused for tour, answers in self.tours.items() if tour.kind not in accepted}

    def accepted(self, tours: Iterable[Tour]) -> tuple[Tour, ...]:
        """Those of some tours that are of a kind of world which it does not refuse."""
        return tuple(tour for tour in tours if tour.kind not in self.refused)

    @property
    def complete(self) -> bool:
        """Whether all was done that there is to do."""
        return len(self.tours) == len(TOURS) and len(self.trials) == len(self.accepted(TRIALS))


def examine(subject: Subject) -> Examination:
    """Examine a strategy in a process of its own with another seed of hashes.

    Raises
    ------
    RequestError : where there is no such strategy.
    """
    found = Examination()
    read_end, write_end = os.pipe()
    with Path(os.devnull).open("wb") as nowhere, os.fdopen(read_end, "rb") as pipe:
        child = fork(
            report,
            subject,
            descriptors=[write_end],
            output=nowhere.fileno(),
            preparation=(prepare, ()),
            hash_seed=another_hash_seed(),
        )
        os.close(write_end)
        child.begun(START)  # with all prepared
        try:
            _receive(pipe, found, subject.timeout + GRACE)
        except TimeoutError:
            found.hung = True
            found.death = f"was killed: nothing came of it in {subject.timeout:g} s, nor could it be interrupted"
        except EOFError:
            child.ended(ENDING)
            found.death = f"died (exit code {child.kill()})"
        finally:
            child.kill()
    if found.wrong:
        raise RequestError(found.wrong)
    return found


def _receive(pipe: BinaryIO, found: Examination, limit: float) -> None:
    """Read what comes, until all is done or something ends the examination."""
    while not (found.complete or found.refusal or found.wrong):
        if not select.select([pipe], [], [], limit)[0]:
            raise TimeoutError
        name, tour, value = pickle.load(pipe)
        if tour is None:
            setattr(found, name, value)
        else:
            getattr(found, name)[tour] = value
            if value.late:
                return


def prepare() -> None:
    """Make and compile what every examination begins with."""
    for tour in TOURS:
        observations(tour)
    for tour in TRIALS:
        warm_up(tour.scenario.tiny)


def report(subject: Subject, descriptor: int) -> None:
    """Examine a strategy, and write each thing found as soon as it is (in the child)."""
    with os.fdopen(descriptor, "wb") as pipe:
        for found in _stages(subject):
            pipe.write(pickle.dumps(found))
            pipe.flush()


def _stages(subject: Subject) -> Iterator[tuple[str, Tour | None, object]]:
    try:
        refusal = _refusal(subject)
    except RequestError as error:
        yield "wrong", None, str(error)
        return
    yield "refusal", None, refusal
    if refusal:
        return
    found = Examination()
    for tour in TOURS:
        found.tours[tour] = play(subject, tour)
        yield "tours", tour, found.tours[tour]
    for tour in found.accepted(TRIALS):
        result, told = run_witnessed(subject.spec(tour), subject.timeout)
        answers = ((made.choice, made.target) for made in result.snapshots.values() if made.candidates is not None)
        choices = _choices(answers)
        slowest = max(result.decision_seconds, default=0.0)
        late = result.transient and result.seconds >= subject.timeout
        yield "trials", tour, Played(result.status, told, choices, late, slowest, result.seconds)


def _choices(answers: Iterable[tuple[int | None, Sequence[float] | None]]) -> tuple[int | Target, ...]:
    """What was chosen, from the index or the target of each decision."""
    chosen = (Target((target[0], target[1])) if target else choice for choice, target in answers)
    return tuple(one for one in chosen if one is not None)


def _refusal(subject: Subject) -> str:
    """Why a strategy cannot be made; empty where it can."""
    if subject.entry.broken:
        return subject.entry.broken
    told, refusal = Signals(), ""
    try:
        with time_limit(subject.timeout) as told:
            check_methods(subject.make(), subject.entry.reference)
    except StrategyError as error:
        refusal = with_place(str(error).rstrip("."), place_of(error, subject.entry.factory))
    except RequestError:
        raise
    except BaseException as error:
        refusal = with_place(f"making it raised {describe(error)}", place_of(error, subject.entry.factory))
    return f"its import took longer than the {subject.timeout:g} s allowed" if told.expired else refusal


def run_in_workers(subject: Subject, tours: Sequence[Tour]) -> dict[Tour, Played]:
    """Run its trials in the worlds of tours as `explore_bench.run` does: in worker processes, stored and read again.

    The tours' numbers differ. What was played stands in the order of the tours, not in that in which it was done.
    """
    found = {}
    with TemporaryDirectory() as folder:
        store = Store(Path(folder))
        store.open(0, "calibrate", None)
        specs = {subject.spec(tour).trial: tour for tour in tours}
        assert len(specs) == len(tours)
        for outcome in execute([subject.spec(tour) for tour in tours], store, WORKERS, timeout=subject.timeout):
            replay = store.replay(outcome.spec)
            choices = _choices(zip(replay.choices, replay.targets, strict=True))
            found[specs[outcome.spec.trial]] = Played(outcome.status, outcome.reason, choices)
    return {tour: found[tour] for tour in tours}
