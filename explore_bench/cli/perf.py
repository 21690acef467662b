"""`perf`: where a step's time goes."""

from __future__ import annotations

from pathlib import Path

import click

from explore_bench.cli.options import DONE, json_option


@click.command()
@json_option
def perf(file: Path | None) -> int:
    """Print where a step's time goes, as ratios to iSAM2's own update in the same run, and that of the lidar worlds."""
    from explore_bench.runs.perf import measure, text, write_json

    numbers = measure(lambda line: click.echo(line, err=True))
    click.echo(text(numbers))
    if file is not None:
        write_json(numbers, file)
    return DONE
