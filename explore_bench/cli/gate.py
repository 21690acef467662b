"""`gate`: results against an accepted reference."""

from __future__ import annotations

import json
import os
from pathlib import Path

import click

from explore_bench.cli.options import DONE, INCOMPLETE, NO, json_option, results_option
from explore_bench.errors import RequestError, writing
from explore_bench.files import write_whole


@click.command()
@results_option
@click.option(
    "--reference",
    type=click.Path(path_type=Path),
    default=Path("results/reference"),
    show_default=True,
    metavar="DIR",
    help="Folder of thresholds.toml and the accepted trials.",
)
@json_option
@click.option("--summary", type=click.Path(path_type=Path), metavar="FILE", help="Write the table as Markdown, too.")
@click.option("--accept", is_flag=True, help="Make the results the new reference instead.")
@click.option("--reason", metavar="TEXT", help="Why they are accepted.")
def gate(
    results: Path, reference: Path, file: Path | None, summary: Path | None, accept: bool, reason: str | None
) -> int:
    """Compare results with an accepted reference: exit code 1 where a metric has become worse than is tolerated.

    The table also goes to the job's summary where GitHub Actions names one.
    """
    from explore_bench.analysis.gate import accepted

    if accept != (reason is not None):
        raise RequestError("--accept and --reason TEXT go together; give both, or none to compare.")
    if reason is not None:
        count = accepted.accept(reference, results, reason)
        click.echo(f"{count} trials of '{results}' are the reference in '{reference}' now: {reason.strip()}")
        return DONE
    from explore_bench.analysis.gate.judging import Verdict, judge
    from explore_bench.report.pages.gate import gate_table

    known = accepted.read_accepted(reference)
    found = judge(known.family, known.trials, accepted.read_results(results, known.family))
    table = gate_table(found, results, reference).markdown()
    click.echo(table, nl=False)
    if file is not None:
        write_whole(file, json.dumps(found.values(), indent=1, ensure_ascii=False) + "\n")
    _summarize(table, summary)
    return {Verdict.REGRESSED: NO, Verdict.MISSING: INCOMPLETE}.get(found.verdict, DONE)


def _summarize(table: str, file: Path | None) -> None:
    """Write the table to a file, and add it to the one that GitHub Actions names."""
    if file is not None:
        write_whole(file, table)
    step = os.environ.get("GITHUB_STEP_SUMMARY")
    if step:
        with writing(Path(step)), Path(step).open("a", encoding="utf-8") as stream:
            stream.write(table)
