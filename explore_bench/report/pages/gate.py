"""The gate's judgements as a table, with what to do about each verdict."""

from __future__ import annotations

import math
import shlex
from pathlib import Path

from explore_bench.analysis.gate.judging import STATED_LOSS, Gate, Judgement, Verdict
from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.statistics import LEVEL
from explore_bench.analysis.tables import PAPER_SCENARIO
from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import Table, heading, number_text, p_text

HEADER = (
    *("Method", "size [m], scenario", "metric", "n", "reference", "now", "worse by", "tolerated", "p, Holm"),
    *("not explored", f"power, {100 * STATED_LOSS:g} %", "verdict"),
)
NOTE = (
    "Means over the n worlds of the reference. Worse by: mean change for the worse, paired by world, as a share of the "
    "reference's mean (a gain is negative) [lower bound at the level of Holm's method over this table, upper bound at "
    f"{LEVEL:g}]. Regressed: the lower bound is above what is tolerated; pass: the upper bound is below it. Trials "
    "that did not explore, of the reference → now, are scored by the rule for such trials. Power: the chance that a "
    f"loss of {100 * STATED_LOSS:g} % is called a regression."
)
ADVICE = {
    Verdict.MISSING: "Nothing is said of what is missing. Run it: `{run}`",
    Verdict.REGRESSED: "A regression that is meant is accepted as an improvement is: `{accept}`",
    Verdict.INCONCLUSIVE: (
        "Inconclusive fails nothing: neither a loss above what is tolerated nor its absence is shown. More worlds "
        "tell, in the reference as well."
    ),
    Verdict.IMPROVED: "The reference is behind; accept what is better, so that it cannot be lost again: `{accept}`",
}


def gate_table(gate: Gate, results: Path, reference: Path) -> Table:
    """Every pair of the family; the note says what is missing and what to do, for these two folders."""
    accept = ["explore-bench", "gate", "--results", str(results), "--reference", str(reference), "--accept"]
    commands = {"accept": shlex.join([*accept, "--reason", "TEXT"]), "run": _run_command(gate, results)}
    advice = [text.format(**commands) for verdict, text in ADVICE.items() if gate.of(verdict)]
    absent = [f"{own.pair.threshold.place}: {own.pair.missing}" for own in gate.of(Verdict.MISSING)]
    worse = [own.pair.threshold for own in gate.of(Verdict.REGRESSED)]
    reasons = [f"{one.place}, {one.metric}: {one.reason}" for one in worse]
    parts = [NOTE, *_listed("Missing:", absent), *_listed("Why no more is tolerated:", reasons), *advice]
    title = f"Gate: {gate.verdict} ({len(gate.of(gate.verdict))} of {len(gate.judgements)} pairs)"
    return Table(title, HEADER, tuple(map(_row, gate.judgements)), "\n\n".join(parts))


def _run_command(gate: Gate, results: Path) -> str:
    """Command that runs what is missing, given that strategies are known by their names."""
    pairs = [own.pair for own in gate.of(Verdict.MISSING)]
    parts = ["explore-bench", "run", "smoke"]
    for name in dict.fromkeys(pair.threshold.strategy for pair in pairs):
        parts += ["-s", name]
    for size in dict.fromkeys(pair.threshold.size for pair in pairs):
        parts += ["--size", f"{size:g}"]
    for scenario in dict.fromkeys(pair.threshold.scenario for pair in pairs):
        parts += ["--scenario", scenario] if scenario != PAPER_SCENARIO else []
    worlds = max((len(pair.before) for pair in pairs), default=0)
    return shlex.join([*parts, "--trials", str(worlds), "--results", str(results)])


def _listed(title: str, lines: list[str]) -> list[str]:
    """A title over different lines; nothing without any."""
    return ["\n".join([title, "", *(f"- {line}" for line in dict.fromkeys(lines))])] if lines else []


def _row(judgement: Judgement) -> tuple[str, ...]:
    pair, decision = judgement.pair, judgement.decision
    one, mean = pair.threshold, float(pair.before.mean())
    found = decision.verdict is not Verdict.MISSING
    bounds = f"{_percent(decision.loss)} [{_percent(decision.at_least)}, {_percent(decision.at_most)}] %"
    return (
        entry_of(one.strategy).label,
        f"{one.size:g}, {one.scenario}",
        heading(METRICS[one.metric]),
        str(len(pair.before)),
        number_text(mean, mean),
        number_text(float(pair.now.mean()), mean) if found else "–",
        bounds if found else "–",
        f"{100 * one.tolerance:g} %",
        p_text(decision.p_holm),
        f"{pair.unexplored[0]} → {pair.unexplored[1] if found else '–'}",
        f"{math.floor(100 * judgement.power)} %",
        decision.verdict,
    )


def _percent(share: float) -> str:
    text = f"{100 * share:.1f}"
    return "0.0" if text == "-0.0" else text.replace("-", "−")
