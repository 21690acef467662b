"""`check`: whether a strategy keeps the contract."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path

import click

from explore_bench.cli.completion import one_of, strategies
from explore_bench.cli.options import DONE, NO, json_option
from explore_bench.files import write_whole


@click.command()
@click.argument("strategy", shell_complete=one_of(strategies, files=True))
@click.option(
    "--timeout",
    type=click.FloatRange(0, 1e6, min_open=True),
    default=60.0,
    show_default=True,
    metavar="S",
    help="Seconds that its import or one trial may take.",
)
@json_option
def check(strategy: str, timeout: float, file: Path | None) -> int:
    """Test whether STRATEGY keeps the contract, rule by rule, in all kinds of world."""
    from explore_bench.runs.conformance import Finding, findings

    begin = time.perf_counter()
    found: list[Finding] = []
    for finding in findings(strategy, timeout):
        click.echo(finding)
        found.append(finding)
    broken = sum(not finding.ok for finding in found)
    verdict = f"{broken} of {len(found)} rules broken" if broken else "keeps the contract"
    click.echo(f"{strategy}: {verdict} ({time.perf_counter() - begin:.1f} s)")
    if file is not None:
        values = {"strategy": strategy, "ok": not broken, "findings": [asdict(finding) for finding in found]}
        write_whole(file, json.dumps(values, indent=1, ensure_ascii=False) + "\n")
    return NO if broken else DONE
