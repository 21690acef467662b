"""Tests of what a strategy's answers depend on: the observations and its own stream, and nothing else."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from explore_bench.runs.conformance.answers import Answers, play
from explore_bench.runs.conformance.evidence import Evidence
from explore_bench.runs.conformance.finding import BrokenError, NotApplicableError
from explore_bench.runs.conformance.tours import ORDINARY, Tour
from explore_bench.trial.spec import Status


def own_stream(evidence: Evidence) -> str:
    """No global generator was used."""
    for tour, answers in evidence.examination.tours.items():
        if answers.drawn:
            raise BrokenError(f"{tour.name}: it used the global generator of {', '.join(answers.drawn)}")
    return ""


def deterministic(evidence: Evidence) -> str:
    """Asked again, here and in another process, it answers the same; states of global generators do not matter."""
    for tour in evidence.examination.accepted(ORDINARY):
        first = evidence.answers(tour)
        _alike(tour, first, play(evidence.subject, tour, chance=1), "when it was asked again")
        _alike(tour, first, evidence.examination.tours[tour], "in another process, with another seed of hashes")
    return ""


def forgets(evidence: Evidence) -> str:
    """An object that played other tours answers as a fresh one does."""
    used = evidence.subject.make()
    for tour in evidence.examination.accepted((*ORDINARY, *ORDINARY)):
        _alike(tour, evidence.answers(tour), play(evidence.subject, tour, used), "after another trial")
    return ""


def unmodified(evidence: Evidence) -> str:
    """No part of an observation has another digest than before."""
    for tour, answers in evidence.examination.tours.items():
        if answers.modified:
            raise BrokenError(f"{tour.name}: it changed {answers.modified}")
    return ""


def truth(evidence: Evidence) -> str:
    """What it chose in a trial, it chooses where its observations are shown while another world is around.

    The trial ran in another process, so nothing of its world is left in this one.
    """
    if evidence.subject.entry.reference:
        raise NotApplicableError("not applicable: a reference is told the truth")
    compared = 0
    for tour, played in evidence.examination.trials.items():
        seen = replace(tour, choices=played.choices)
        elsewhere = play(evidence.subject, seen)
        own = replace(elsewhere, given=played.choices, error="")
        _alike(seen, own, elsewhere, "with another world behind the same observations")
        compared += len(played.choices)
    return f"{compared} decisions compared"


def worker(evidence: Evidence) -> str:
    """The runner's worker processes store the same choices."""
    for tour, there in evidence.in_workers.items():
        here = evidence.examination.trials[tour]
        if there.status in (Status.FAILED, Status.BROKEN):
            raise BrokenError(f"{tour.name} failed there: {there.reason}")
        if there.choices != here.choices:
            raise BrokenError(f"{tour.name}, {_otherwise(here.choices, there.choices)} there")
    return ""


def _alike(tour: Tour, first: Answers, second: Answers, when: str) -> None:
    if not first.same_as(second):
        one, other = ((*answers.given, answers.error) for answers in (first, second))
        raise BrokenError(f"{tour.name}, {_otherwise(one, other)} {when}")


def _otherwise(one: tuple[Any, ...], other: tuple[Any, ...]) -> str:
    """Say in what two sequences of answers differ first."""
    same = next((i for i, pair in enumerate(zip(one, other, strict=False)) if pair[0] != pair[1]), None)
    decision = min(len(one), len(other)) if same is None else same
    before, after = (sequence[decision] if decision < len(sequence) else "nothing" for sequence in (one, other))
    return f"decision {decision}: {before}, but {after}"
