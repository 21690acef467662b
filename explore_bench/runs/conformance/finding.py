"""What is found of one rule."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class BrokenError(Exception):
    """A rule does not hold: what happened."""


class NotApplicableError(Exception):
    """A rule says nothing of this strategy: why."""


class Verdict(StrEnum):
    """Whether a rule holds; SKIPPED where that cannot be told, or the rule does not apply."""

    OK = "ok"
    BROKEN = "broken"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Finding:
    """What is found of one rule.

    Attributes
    ----------
    rule, sentence : the rule's name, and what it says.
    verdict : whether it holds.
    detail : what happened where it is broken, why it was skipped, or what was measured.
    """

    rule: str
    sentence: str
    verdict: Verdict
    detail: str = ""

    @property
    def ok(self) -> bool:
        """Whether the rule is not broken."""
        return self.verdict is not Verdict.BROKEN

    def __str__(self) -> str:
        tail = f" {self.detail[0].upper()}{self.detail[1:]}." if self.detail else ""
        return f"{self.verdict:<8} {self.rule:<16} {self.sentence}{tail}"
