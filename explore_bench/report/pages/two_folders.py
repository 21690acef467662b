"""The comparison of two results folders as a table."""

from __future__ import annotations

from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.two_folders import Difference, FolderComparison
from explore_bench.report.drawing import entry_of
from explore_bench.report.tables import Table, heading, interval_text, number_text, p_text, signed_text


def comparison_table(found: FolderComparison) -> Table:
    """Every strategy, size and metric of two folders, B against A."""
    header = ("Method", "size [m], scenario", "metric", "n", "A", "B", "B − A", "p, Holm", "d_z", "P(B better)", "B is")
    note = (
        "Means over the n worlds that every training seed of both folders tried; B − A paired by world [95 % BCa "
        "bootstrap interval]; two-sided permutation test, Holm's correction over the whole table; d_z positive where B "
        "is better; ties count half; both of every training seed, then averaged."
    )
    if found.left_out:
        note += "\n\nNot compared, or with care:\n\n" + "\n".join(f"- {line}" for line in found.left_out)
    return Table("B compared with A", header, tuple(map(_row, found.differences)), note)


def _row(own: Difference) -> tuple[str, ...]:
    return (
        entry_of(own.strategy).label,
        f"{own.size:g}, {own.scenario}",
        heading(METRICS[own.metric]),
        str(own.n),
        *(number_text(mean, mean) for mean in own.means),
        interval_text(own.difference),
        p_text(own.p_holm),
        signed_text(own.effect, 2),
        f"{own.improvement:.2f}",
        own.verdict,
    )
