"""What the records say of the claims: a verdict and a sentence each, and every comparison with its numbers."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pandas as pd

from explore_bench.analysis.claims import (
    NOT_MEASURED,
    Claim,
    Comparison,
    Finding,
    as_values,
    claims_about,
    examine,
    metric_of,
    verdict,
)
from explore_bench.analysis.statistics import LEVEL
from explore_bench.analysis.training_curve import TRAINING_METRICS
from explore_bench.files import write_whole
from explore_bench.report.drawing import entry_of
from explore_bench.report.html import Section
from explore_bench.report.tables import Scope, Table, interval_text, number_text, p_text, percent_text, signed_text

FILES = ("claims.md", "claims.json")
HEADER = (
    *("claimed better", "than", "metric", "size [m]", "verdict", "n", "means", "difference", "relative [%]"),
    *("p, weights", "Holm", "p, architecture", "Holm", "d_z", "P(better)", "seeds", "single seeds"),
)
NOTE = (
    "Difference: mean of the one claimed better minus the other's over n worlds that all seeds of both tried [95 % BCa "
    "bootstrap interval], training seeds averaged within a world first. Relative: over the other's mean [95 % "
    "percentile interval of the ratio]. p, weights: two-sided permutation test, signs flipped by world. p, "
    "architecture: t-test of training seeds crossed with worlds, degrees of freedom by Satterthwaite; a side with one "
    "seed is taken to vary with it as the other does, one that learns nothing does not vary. Holm: over the "
    "comparisons of the claim. d_z: mean over standard deviation of the paired differences, positive where the claim "
    "would have it; P(better): share of the worlds on which the claim holds, ties half; both of every seed against "
    "every other, then averaged. Single seeds: smallest–largest mean of one training seed. Training curves are "
    "compared between training seeds, unpaired, by Welch's test and interval, which are of the architecture: n is the "
    "smaller number of seeds. "
    + "; ".join(f"{metric.symbol}: {metric.equation}" for metric in TRAINING_METRICS.values())
    + "."
)
INTRODUCTION = (
    f"A comparison is supported (or contradicted) where its p-value after Holm's correction is at most {LEVEL:g}; a "
    "claim is supported where all of its comparisons are, contradicted where one is, and not shown otherwise: the "
    "trials then say neither. Holm's correction asks more of each comparison the more of them there are, so that luck "
    "passes for a finding in at most one of twenty claims of which nothing is true. Intervals over worlds say how sure "
    "a difference is for the weights at hand. A claim about an architecture is about other trainings, too: a "
    "difference that other worlds would show again, and other trainings might not, is one 'for these weights'."
)


def examined(trials: pd.DataFrame) -> dict[Claim, list[Finding]]:
    """Every claim about the scenario of some trials, with what these say of it."""
    return {claim: examine(claim, trials) for claim in claims_about(trials)}


def write_claims(found: dict[Claim, list[Finding]], folder: Path) -> list[Path]:
    """Write claims.md and claims.json; returns the files. Without a claim, remove what an earlier report left."""
    if not found:
        for name in FILES:
            (folder / name).unlink(missing_ok=True)
        return []
    page = [f"# Do the claims hold?\n\n{INTRODUCTION}\n\n{NOTE}\n", overview(found).markdown()]
    for claim, findings in found.items():
        page.append(f"## Claim ({claim.name}): {verdict(findings)}\n\n{claim.statement} {summary(findings)}\n")
        page.append(comparison_table(claim, findings).markdown())
        page.append("\n".join(f"- {sentence(finding)}" for finding in findings) + "\n")
    values = [_values(claim, findings) for claim, findings in found.items()]
    texts = "\n".join(page), json.dumps(values, indent=1, ensure_ascii=False) + "\n"
    for name, text in zip(FILES, texts, strict=True):
        write_whole(folder / name, text)
    return [folder / name for name in FILES]


def _values(claim: Claim, findings: list[Finding]) -> dict[str, Any]:
    """A claim and its findings as plain values, each with its sentence."""
    values = as_values(claim, findings)
    for own, finding in zip(values["comparisons"], findings, strict=True):
        own["sentence"] = sentence(finding)
    return values


def claims_section(found: dict[Claim, list[Finding]]) -> Section:
    """Return the claims as a part of the page."""
    tables = [table(*item) for item in found.items() for table in (words_table, comparison_table)]
    return Section("Do the claims hold?", (INTRODUCTION, NOTE), (overview(found), *tables))


def tried(found: dict[Claim, list[Finding]], trials: pd.DataFrame) -> dict[Claim, list[Finding]]:
    """Claims that were measured, and of whose strategies some ran: the others are nothing to begin with."""
    ran = set(trials["strategy"])
    return {
        claim: own
        for claim, own in found.items()
        if verdict(own) != NOT_MEASURED and any({one.better, one.worse} & ran for one in claim.comparisons)
    }


def overview(found: dict[Claim, list[Finding]]) -> Table:
    """One line a claim."""
    table = Table("Claims and verdicts", ("claim", "statement", "verdict", "comparisons"), verdicts(found))
    return table.naming_each([claim.scenario for claim in found])


def verdicts(found: dict[Claim, list[Finding]]) -> tuple[tuple[str, str, str, str], ...]:
    """Name, statement, verdict and comparisons of every claim."""
    return tuple((claim.name, claim.statement, verdict(own), summary(own)) for claim, own in found.items())


def summary(findings: list[Finding]) -> str:
    """How many comparisons came out how."""
    counts = pd.Series([finding.verdict for finding in findings]).value_counts(sort=False)
    parts = ", ".join(f"{count} {word}" for word, count in counts.items())
    return f"Of {len(findings)} comparisons: {parts}."


def words_table(claim: Claim, findings: list[Finding]) -> Table:
    """Every comparison of a claim as a sentence."""
    rows = tuple((finding.verdict, sentence(finding)) for finding in findings)
    return Table(f"Claim ({claim.name}) in words", ("verdict", "comparison"), rows).naming(claim.scenario)


def comparison_table(claim: Claim, findings: list[Finding]) -> Table:
    """Every comparison of a claim with its numbers."""
    asked = [finding.comparison for finding in findings]
    scopes = tuple(Scope((own.better, own.worse), own.size) for own in asked)
    table = Table(f"Claim ({claim.name}): {claim.statement}", HEADER, tuple(map(_row, findings)), scopes=scopes)
    return table.naming(claim.scenario)


def _row(finding: Finding) -> tuple[str, ...]:
    asked, metric = finding.comparison, metric_of(finding.comparison)
    names = entry_of(asked.better).label, entry_of(asked.worse).label
    size = "training" if asked.size is None else f"{asked.size:g}"
    if not finding.n:
        return (*names, metric.symbol, size, finding.verdict, "0", *["–"] * 11)
    return (
        *names,
        metric.symbol,
        size,
        finding.verdict,
        str(finding.n),
        " / ".join(number_text(mean, mean) for mean in finding.means),
        interval_text(finding.difference),
        percent_text(finding.relative),
        *map(p_text, (finding.p, finding.p_holm, finding.p_architecture, finding.p_architecture_holm)),
        signed_text(finding.effect, 2),
        f"{finding.improvement:.2f}",
        " / ".join(str(count) if count else "–" for count in finding.seeds),
        " / ".join(
            f"{number_text(low, low)}–{number_text(high, high)}" if count > 1 else "–"
            for (low, high), count in zip(finding.ranges, finding.seeds, strict=True)
        ),
    )


def sentence(finding: Finding) -> str:
    """What a comparison found, in plain words."""
    asked, metric = finding.comparison, metric_of(finding.comparison)
    a, b = entry_of(asked.better).label, entry_of(asked.worse).label
    where = "in training" if asked.size is None else f"at {asked.size:g} m"
    if not finding.n:
        return f"{a} and {b} {where}: not both measured in {_named(asked)}."
    first, second = (number_text(mean, mean) for mean in finding.means)
    more = "higher" if finding.difference.mean > 0 else "lower"
    units = f" {metric.unit}" if metric.unit != "1" else ""
    what = "training seeds" if asked.size is None else "worlds"
    share = abs(100 * finding.relative.mean)
    by = "" if math.isnan(share) else f"{share:.0f} % "
    shown = "too few to say" if math.isnan(finding.p_holm) else f"p {_equal(finding.p_holm)} after Holm"
    if not math.isnan(finding.p_architecture) and finding.p_architecture != finding.p:
        shown += f" for these weights, {_equal(finding.p_architecture_holm)} for the architecture"
    return (
        f"{a} has {by}{more} {_named(asked)} than {b} {where} ({first} to {second}"
        f"{units}; difference {interval_text(finding.difference)}, n = {finding.n} {what}, {shown}): {finding.verdict}."
    )


def _equal(p: float) -> str:
    """A p-value behind its sign of equality."""
    text = p_text(p)
    return text if text.startswith("<") else f"= {text}"


def _named(asked: Comparison) -> str:
    """Metric in words, with its symbol where that says more."""
    words, symbol = asked.metric.replace("_", " "), metric_of(asked).symbol
    if asked.size is None:
        return words
    return symbol if words.split()[0] == symbol.lower() else f"{words} {symbol}"
