"""`merge`: results folders of several machines."""

from __future__ import annotations

from pathlib import Path

import click

from explore_bench.cli.options import DONE, INCOMPLETE, results_option


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path))
@results_option
def merge(folders: tuple[Path, ...], results: Path) -> int:
    """Add the trials of results folders to those of another; records that disagree are refused."""
    from explore_bench.runs.merging import merge

    done = merge(folders, results)
    total = done.added + done.known
    click.echo(f"{total} trials in {results}, {done.added} of them new")
    if done.stale:
        click.echo(f"{done.stale} of other code or libraries than those here: kept, but not shown")
    return INCOMPLETE if done.stale == total else DONE
