"""`compare`: two results folders."""

from __future__ import annotations

import json
from pathlib import Path

import click

from explore_bench.cli.options import DONE, json_option
from explore_bench.files import write_whole


@click.command()
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@json_option
def compare(a: Path, b: Path, file: Path | None) -> int:
    """Compare two results folders by their trials.csv, B against A, paired by world."""
    from explore_bench.analysis.two_folders import compare_folders
    from explore_bench.report.pages.two_folders import comparison_table

    found = compare_folders(a, b)
    click.echo(comparison_table(found).markdown(), nl=False)
    if file is not None:
        write_whole(file, json.dumps(found.values(), indent=1, ensure_ascii=False) + "\n")
    return DONE
