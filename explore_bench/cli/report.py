"""`report`: tables, figures and a page from stored records."""

from __future__ import annotations

from pathlib import Path

import click

from explore_bench.cli.options import DONE, results_option, tell_damaged


@click.command()
@results_option
def report(results: Path) -> int:
    """Write tables, figures and a page with replays from stored records; simulates nothing."""
    from explore_bench.report.render import write_report

    written = write_report(results)
    stale = f", {written.stale} of older code left out" if written.stale else ""
    page = next((f"; open {file} in a browser" for file in written.files if file.name == "report.html"), "")
    click.echo(f"{len(written.files)} files in {results} from {written.trials} trials{stale}{page}")
    tell_damaged(written.damaged)
    return DONE
