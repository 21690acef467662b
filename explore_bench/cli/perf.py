"""`perf`: where a step's time goes."""

from __future__ import annotations

from pathlib import Path

import click

from explore_bench.cli.options import DONE, json_option, strategies_option


@click.command()
@strategies_option("Decisions and trials of these alone, not of all")
@json_option
@click.option(
    "--against", type=click.Path(path_type=Path), metavar="FILE", help="Compare with a stored file of --json: ratios."
)
def perf(names: tuple[str, ...], file: Path | None, against: Path | None) -> int:
    """Print where a step's time goes, as ratios to iSAM2's own update in the same run, and that of the lidar worlds."""
    from explore_bench.runs.perf import measure, text, write_json
    from explore_bench.runs.perf_against import comparison, read_stored

    stored = None if against is None else read_stored(against)
    numbers = measure(lambda line: click.echo(line, err=True), names)
    click.echo(text(numbers))
    if stored is not None:
        click.echo(f"\n{comparison(stored, numbers)}")
    if file is not None:
        write_json(numbers, file)
    return DONE
