"""The contract, rule by rule: a rule is a sentence, and what breaks it is said in the words that follow it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from explore_bench.conformance.answers import Answers, play
from explore_bench.conformance.apart import TOURS
from explore_bench.conformance.evidence import Evidence
from explore_bench.conformance.tours import (
    CORNERS,
    LARGE,
    MANY,
    MANY_CANDIDATES,
    NO_LANDMARK,
    ONE_CANDIDATE,
    SMALL,
    Tour,
)
from explore_bench.conformance.verdict import Broken, Finding, NotApplicable, Verdict
from explore_bench.runner import IncompleteError
from explore_bench.spec import Status


@dataclass(frozen=True)
class Rule:
    """A rule of the contract.

    Attributes
    ----------
    name, sentence : what it is called, and what it says.
    test : returns what was measured, or raises Broken or NotApplicable with what happened.
    needs : rules without which nothing can be told of this one; they come before it.
    """

    name: str
    sentence: str
    test: Callable[[Evidence], str]
    needs: tuple[str, ...] = ()

    def apply(self, evidence: Evidence) -> Finding:
        """Return what the evidence says of it."""
        try:
            verdict, detail = Verdict.OK, self.test(evidence)
        except Broken as broken:
            verdict, detail = Verdict.BROKEN, str(broken)
        except NotApplicable as reason:
            verdict, detail = Verdict.SKIPPED, str(reason)
        return Finding(self.name, self.sentence, verdict, detail)


# What a strategy answers


def _made(evidence: Evidence) -> str:
    found = evidence.examination
    if found.refusal is None:
        raise Broken(f"the process that imported it {found.death}")
    if found.refusal:
        raise Broken(found.refusal)
    return ""


def _in_time(evidence: Evidence) -> str:
    found = evidence.examination
    for tour, answers in found.tours.items():
        if answers.late:
            raise Broken(f"{tour.name}, decision {len(answers.given)}: {answers.error}")
    for tour, played in found.trials.items():
        if played.late:
            raise Broken(f"a trial of {tour.name} {played.reason}")
    if found.death:
        raise Broken(f"the process that it ran in {found.death}")
    whole = found.trials[LARGE]
    return f"a trial of {LARGE.name} took {whole.seconds:.2g} s, its slowest decision {1e3 * whole.slowest:.2g} ms"


def _chooses(evidence: Evidence) -> str:
    return _complete(evidence.examination.tours)


def _integer(evidence: Evidence) -> str:
    for tour, answers in evidence.examination.tours.items():
        _integers(tour, answers)
    return ""


def _in_range(evidence: Evidence) -> str:
    for tour, answers in evidence.examination.tours.items():
        _indices(tour, answers)
    return ""


def _during(*tours: Tour) -> Callable[[Evidence], str]:
    """Test that every answer to the observations of some tours is a valid one."""

    def test(evidence: Evidence) -> str:
        answers = {tour: evidence.answers(tour) for tour in tours}
        for tour in tours:
            _integers(tour, answers[tour])
            _indices(tour, answers[tour])
        return _complete(answers)

    return test


def _plays(evidence: Evidence) -> str:
    for tour, played in evidence.examination.trials.items():
        if played.status is Status.FAILED:
            raise Broken(f"a trial of {tour.name} failed: {played.reason}")
    ends = [f"{tour.name} {played.status.value}" for tour, played in evidence.examination.trials.items()]
    return ", ".join(ends)


def _complete(answers: dict[Tour, Answers]) -> str:
    for tour, own in answers.items():
        if own.error:
            raise Broken(f"{tour.name}, decision {len(own.given)}: {own.error}")
    return f"{sum(len(own.given) for own in answers.values())} decisions were asked for"


def _integers(tour: Tour, answers: Answers) -> None:
    for decision, answer in enumerate(answers.given):
        if isinstance(answer, str):
            raise Broken(f"{tour.name}, decision {decision}: it answered {answer}")


def _indices(tour: Tour, answers: Answers) -> None:
    for decision, (answer, count) in enumerate(zip(answers.given, answers.counts, strict=False)):
        if isinstance(answer, int) and not 0 <= answer < count:
            raise Broken(f"{tour.name}, decision {decision}: it answered {answer} of {count} candidates")


# What its answers may depend on


def _own_stream(evidence: Evidence) -> str:
    for tour in TOURS:
        first = evidence.answers(tour)
        if first.drawn:
            raise Broken(f"{tour.name}: it used the global generator of {', '.join(first.drawn)}")
        _alike(tour, first, play(evidence.subject, tour, chance=1), "with other seeds of the global generators")
    return ""


def _deterministic(evidence: Evidence) -> str:
    for tour in TOURS:
        first = evidence.answers(tour)
        _alike(tour, first, play(evidence.subject, tour), "when it was asked again")
        _alike(tour, first, evidence.examination.tours[tour], "in another process, with another seed of hashes")
    return ""


def _forgets(evidence: Evidence) -> str:
    used = evidence.subject.make()
    for tour in (LARGE, SMALL, LARGE):
        _alike(tour, evidence.answers(tour), play(evidence.subject, tour, used), "after another trial")
    return ""


def _unmodified(evidence: Evidence) -> str:
    for tour in (LARGE, SMALL, ONE_CANDIDATE, MANY_CANDIDATES, NO_LANDMARK, *CORNERS):
        if part := evidence.answers(tour).modified:
            raise Broken(f"{tour.name}: it changed {part}")
    return ""


def _truth(evidence: Evidence) -> str:
    if evidence.subject.entry.reference:
        raise NotApplicable("not applicable: a reference is told the truth")
    compared = 0
    for tour, played in evidence.examination.trials.items():
        seen = replace(tour, name=f"a trial of {tour.name}", choices=played.choices)
        elsewhere = play(evidence.subject, seen)
        own = replace(elsewhere, given=played.choices, error="")
        _alike(seen, own, elsewhere, "with another world behind the same observations")
        compared += len(played.choices)
    return f"{compared} decisions compared"


def _worker(evidence: Evidence) -> str:
    try:
        trials = evidence.in_workers
    except IncompleteError as error:
        raise Broken(str(error)) from None
    for tour, there in trials.items():
        here = evidence.examination.trials[tour]
        if there.status is Status.FAILED:
            raise Broken(f"a trial of {tour.name} failed there: {there.reason}")
        if there.choices != here.choices:
            raise Broken(f"a trial of {tour.name}: {_otherwise(here.choices, there.choices)} there")
    return ""


def _alike(tour: Tour, first: Answers, second: Answers, when: str) -> None:
    if not first.same_as(second):
        one, other = ((*answers.given, answers.error) for answers in (first, second))
        raise Broken(f"{tour.name}, {_otherwise(one, other)} {when}")


def _otherwise(one: tuple[int | str, ...], other: tuple[int | str, ...]) -> str:
    """Say in what two sequences of answers differ first."""
    same = next((i for i, pair in enumerate(zip(one, other, strict=False)) if pair[0] != pair[1]), None)
    decision = min(len(one), len(other)) if same is None else same
    before, after = (sequence[decision] if decision < len(sequence) else "nothing" for sequence in (one, other))
    return f"decision {decision}: {before}, but {after}"


RULES = (
    Rule("made", "It can be imported and made, and has the methods reset and choose.", _made),
    Rule("in-time", "It decides within the time limit.", _in_time, ("made",)),
    Rule("chooses", "It chooses at every decision.", _chooses, ("in-time",)),
    Rule("integer", "It answers an integer: no bool, no float, no None.", _integer, ("chooses",)),
    Rule("in-range", "It answers the index of a candidate: 0 or more, less than their number.", _in_range, ("integer",)),
    Rule("one-candidate", "It chooses where there is one candidate.", _during(ONE_CANDIDATE), ("in-range",)),
    Rule("many-candidates", f"It chooses where there are {MANY} candidates.", _during(MANY_CANDIDATES), ("in-range",)),
    Rule("corners", "It chooses in each corner of the map.", _during(*CORNERS), ("in-range",)),
    Rule("no-landmark", "It chooses where no landmark was seen.", _during(NO_LANDMARK), ("in-range",)),
    Rule(
        "plays",
        "It plays whole trials.",
        _plays,
        ("in-range", "one-candidate", "many-candidates", "corners", "no-landmark"),
    ),
    Rule("own-stream", "It draws from the generator that reset gives it, from no global one.", _own_stream, ("chooses",)),
    Rule(
        "deterministic",
        "The same stream and the same observations give the same decisions, in another process, too.",
        _deterministic,
        ("own-stream",),
    ),
    Rule("forgets", "It keeps nothing from one trial to the next.", _forgets, ("deterministic",)),
    Rule("unmodified", "It leaves the observation as it is.", _unmodified, ("chooses",)),
    Rule(
        "truth",
        "It does not know the truth: with another world behind the same observations it decides the same.",
        _truth,
        ("plays", "deterministic"),
    ),
    Rule("worker", "It decides the same in a worker process.", _worker, ("plays", "deterministic")),
)
"""All rules, in the order in which they are tested."""
