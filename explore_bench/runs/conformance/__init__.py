"""The conformance kit: the contract of a strategy as rules, each a sentence and the message of its failure.

    from explore_bench.runs.conformance import check

    def test_mine_keeps_the_contract():
        for finding in check("./mine.py:Mine"):
            assert finding.ok, finding

A test, not a proof: docs/conformance.md says what it cannot see.
"""

from __future__ import annotations

from collections.abc import Iterator

from explore_bench.runs.conformance.evidence import Evidence
from explore_bench.runs.conformance.finding import Finding, Verdict
from explore_bench.runs.conformance.rules import RULES
from explore_bench.runs.conformance.subject import TIMEOUT, Subject

__all__ = ["RULES", "Finding", "Verdict", "check", "findings"]


def check(strategy: str, timeout: float = TIMEOUT) -> list[Finding]:
    """Return what is found of every rule, in all kinds of world; ten seconds for a simple strategy.

    Parameters
    ----------
    strategy : registered name, "module:factory" or "file.py:factory". A learned one is checked with the weights of
        its first training seed.
    timeout : seconds that its import, a trial, or the decisions of a trial may take.

    Raises
    ------
    RequestError : where there is no such strategy, or it is not trained.
    """
    return list(findings(strategy, timeout))


def findings(strategy: str, timeout: float = TIMEOUT) -> Iterator[Finding]:
    """Yield what `check` returns, rule by rule."""
    evidence = Evidence(Subject.of(strategy, timeout))
    unmet: set[str] = set()  # one that does not apply is not among them
    for rule in RULES:
        first = next((name for name in rule.needs if name in unmet), None)
        if first:
            finding = Finding(rule.name, rule.sentence, Verdict.SKIPPED, f"the rule '{first}' comes first")
        else:
            finding = rule.apply(evidence)
        if first or not finding.ok:
            unmet.add(rule.name)
        yield finding
