"""Tests of what a strategy answers, wherever it is asked; all of it in the process of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from explore_bench.runs.conformance.answers import Answers, Stray
from explore_bench.runs.conformance.apart import TOURS
from explore_bench.runs.conformance.evidence import Evidence
from explore_bench.runs.conformance.finding import BrokenError, NotApplicableError
from explore_bench.runs.conformance.tours import ORDINARY, Tour
from explore_bench.trial.spec import Status


def made(evidence: Evidence) -> str:
    """It can be imported and made."""
    found = evidence.examination
    if found.refusal is None:
        raise BrokenError(f"the process that imported it {found.death}")
    if found.refusal:
        raise BrokenError(found.refusal)
    return ""


def in_time(evidence: Evidence) -> str:
    """No import, tour or trial took longer than it may."""
    found = evidence.examination
    for tour, answers in found.tours.items():
        if answers.late:
            raise BrokenError(f"{tour.name}, decision {len(answers.given)}: {answers.told}")
    for tour, played in found.trials.items():
        if played.late:
            raise BrokenError(f"{tour.name}: it {played.reason}")
    if found.hung:
        raise BrokenError(f"the process that it ran in {found.death}")
    return "; ".join(
        f"{tour.name} {played.seconds:.2g} s, at most {1e3 * played.slowest:.2g} ms for a decision"
        for tour, played in found.trials.items()
    )


def kinds(evidence: Evidence) -> str:
    """It refused no kind of world, or not all and each always."""
    found = evidence.examination
    refused = found.refused
    known = dict.fromkeys(tour.kind for tour in TOURS)
    if refused.keys() == known.keys():
        raise BrokenError(f"it refuses all: {next(iter(refused.values()))}")
    runs = f"it runs in {', '.join(kind for kind in known if kind not in refused)}"
    return "; ".join((runs, *(f"it refuses {kind}: {sentence}" for kind, sentence in refused.items())))


def chooses(evidence: Evidence) -> str:
    """It raised nothing on ordinary maps."""
    return _complete(_answers(evidence, ORDINARY))


def integer(evidence: Evidence) -> str:
    """All answers on ordinary maps were integers or targets."""
    return _integers(_answers(evidence, ORDINARY))


def in_range(evidence: Evidence) -> str:
    """All answers on ordinary maps were indices of candidates or targets within reach."""
    return _indices(_answers(evidence, ORDINARY))


def during(*tours: Tour) -> Callable[[Evidence], str]:
    """Test that every answer to the observations of some tours is a valid one."""

    def test(evidence: Evidence) -> str:
        answers = _answers(evidence, tours)
        return _integers(answers) or _indices(answers) or _complete(answers)

    return test


def plays(evidence: Evidence) -> str:
    """Its own trials went to an end."""
    found = evidence.examination
    for tour, played in found.trials.items():
        if played.status in (Status.FAILED, Status.BROKEN):
            raise BrokenError(f"{tour.name} failed: {played.reason}")
    if found.death:
        raise BrokenError(f"the process that it ran in {found.death}")
    return ", ".join(f"{tour.name}: {played.status.value}" for tour, played in found.trials.items())


def _answers(evidence: Evidence, tours: Sequence[Tour]) -> dict[Tour, Answers]:
    """Its answers to those tours that it does not refuse, in the process of its own, which may have died meanwhile."""
    found = evidence.examination
    shown = found.accepted(tours)
    if not shown:
        raise NotApplicableError(f"not applicable: it refuses worlds of the kind '{tours[0].kind}'")
    for tour in shown:
        if tour not in found.tours:
            if tour is TOURS[len(found.tours)]:
                raise BrokenError(f"{tour.name}: the process that it ran in {found.death}")
            raise NotApplicableError(f"before that, the process that it ran in {found.death}")
    return {tour: found.tours[tour] for tour in shown}


def _complete(answers: dict[Tour, Answers]) -> str:
    for tour, own in answers.items():
        if own.error:
            raise BrokenError(f"{tour.name}, decision {len(own.given)}: {own.told}")
    return f"{sum(len(own.given) for own in answers.values())} decisions were asked for"


def _integers(answers: dict[Tour, Answers]) -> str:
    for tour, own in answers.items():
        for decision, answer in enumerate(own.given):
            if isinstance(answer, str):
                raise BrokenError(f"{tour.name}, decision {decision}: it answered {answer}")
    return ""


def _indices(answers: dict[Tour, Answers]) -> str:
    for tour, own in answers.items():
        for decision, (answer, count) in enumerate(zip(own.given, own.counts, strict=False)):
            if isinstance(answer, int) and not 0 <= answer < count:
                raise BrokenError(f"{tour.name}, decision {decision}: it answered {answer} of {count} candidates")
            if isinstance(answer, Stray):
                raise BrokenError(f"{tour.name}, decision {decision}: {answer.reason}")
    return ""
