"""The contract, rule by rule: a rule is a sentence, and what breaks it is said in the words that follow it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from explore_bench.runs.conformance import answering, independence
from explore_bench.runs.conformance.evidence import Evidence
from explore_bench.runs.conformance.finding import BrokenError, Finding, NotApplicableError, Verdict
from explore_bench.runs.conformance.tours import CORNERS, MANY, MANY_CANDIDATES, NO_LANDMARK, ONE_CANDIDATE


@dataclass(frozen=True)
class Rule:
    """A rule of the contract.

    Attributes
    ----------
    name, sentence : what it is called, and what it says.
    test : returns what was measured, or raises BrokenError or NotApplicableError with what happened.
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
        except BrokenError as broken:
            verdict, detail = Verdict.BROKEN, str(broken)
        except NotApplicableError as reason:
            verdict, detail = Verdict.SKIPPED, str(reason)
        return Finding(self.name, self.sentence, verdict, detail)


RULES = (
    Rule("made", "It can be imported and made, and has the methods reset and choose.", answering.made),
    Rule("in-time", "It decides within the time limit.", answering.in_time, ("made",)),
    Rule(
        "kinds",
        "It runs in every kind of world, or refuses one: by the kinds of its entry, or in a sentence at once.",
        answering.kinds,
        ("in-time",),
    ),
    Rule("chooses", "It chooses at every decision.", answering.chooses, ("kinds",)),
    Rule("integer", "It answers an integer, or a Target: no bool, no float, no None.", answering.integer, ("chooses",)),
    Rule(
        "in-range",
        "It answers the index of a candidate, 0 or more and less than their number, or a Target that can be reached.",
        answering.in_range,
        ("integer",),
    ),
    Rule("one-candidate", "It chooses where there is one candidate.", answering.during(ONE_CANDIDATE), ("in-range",)),
    Rule(
        "many-candidates",
        f"It chooses where there are {MANY} candidates.",
        answering.during(MANY_CANDIDATES),
        ("in-range",),
    ),
    Rule("corners", "It chooses in each corner of the map.", answering.during(*CORNERS), ("in-range",)),
    Rule("no-landmark", "It chooses where no landmark was seen.", answering.during(NO_LANDMARK), ("in-range",)),
    Rule(
        "plays",
        "It plays whole trials.",
        answering.plays,
        ("in-range", "one-candidate", "many-candidates", "corners", "no-landmark"),
    ),
    Rule(
        "own-stream",
        "It draws from the generator that reset gives it, from no global one.",
        independence.own_stream,
        ("chooses",),
    ),
    Rule(
        "deterministic",
        "The same stream and the same observations give the same decisions, in another process, too.",
        independence.deterministic,
        ("own-stream",),
    ),
    Rule("forgets", "It keeps nothing from one trial to the next.", independence.forgets, ("deterministic",)),
    Rule("unmodified", "It leaves the observation as it is.", independence.unmodified, ("chooses",)),
    Rule(
        "truth",
        "It does not know the truth: with another world behind the same observations it decides the same.",
        independence.truth,
        ("plays", "deterministic"),
    ),
    Rule("worker", "It decides the same in a worker process.", independence.worker, ("plays", "deterministic")),
)
"""All rules, in the order in which they are tested."""
