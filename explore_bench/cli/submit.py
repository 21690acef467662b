"""`submit`: the trials of a strategy in a file, and what somebody else finds in it."""

from __future__ import annotations

import re
import secrets
from pathlib import Path
from typing import TYPE_CHECKING

import click

from explore_bench.cli.completion import one_of, strategies, suites
from explore_bench.cli.options import DONE, INCOMPLETE, NO, results_option
from explore_bench.errors import RequestError, one_line

if TYPE_CHECKING:
    from explore_bench.runs.submission.checking import Checked
    from explore_bench.runs.submission.manifest import Manifest


@click.command()
@click.argument("suite", required=False, shell_complete=one_of(suites))
@click.option(
    "-s",
    "--strategy",
    metavar="STRATEGY",
    shell_complete=one_of(strategies, files=True),
    help="Whose trials: as it was named to run them.",
)
@results_option
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE.zip",
    help="File to write (default: STRATEGY-SUITE.zip).",
)
@click.option(
    "--check", "file", type=click.Path(path_type=Path), metavar="FILE.zip", help="Look at a submission instead."
)
@click.option(
    "--sample",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    metavar="N",
    help="With --check: run so many of its trials again, and so its code.",
)
@click.option("--workers", type=click.IntRange(1), metavar="N", help="Processes (default: one a processor).")
def submit(
    suite: str | None,
    strategy: str | None,
    results: Path,
    output: Path | None,
    file: Path | None,
    sample: int,
    workers: int | None,
) -> int:
    """Pack the trials of a strategy in SUITE, its code and its weights into one file; or --check such a file.

    A check ends with 1 where the sample comes out otherwise, with 2 where the file is not what it says, and with 3
    where the code or the libraries here are others, so that nothing can be said.
    """
    if file is not None:
        if suite is not None or strategy is not None or output is not None:
            raise RequestError("--check FILE.zip goes alone or with --sample and --workers; leave the others out.")
        return _check(file, sample, workers)
    if suite is None or strategy is None:
        raise RequestError("a suite and a strategy are needed: explore-bench submit SUITE -s STRATEGY.")
    from explore_bench.files import write_whole
    from explore_bench.runs.submission.packing import pack_submission

    manifest, content = pack_submission(suite, strategy, results)
    shown = re.sub(r"[^\w.=-]+", "_", manifest.strategy).rstrip("_")
    path = write_whole(output or Path(f"{shown}-{suite}.zip"), content)
    click.echo(f"{path}: {len(content) / 2**20:.2f} MiB, {_words(manifest)}")
    _tell_contents(manifest)
    return DONE


def _check(file: Path, sample: int, workers: int | None) -> int:
    from explore_bench.runs.runner import crew
    from explore_bench.runs.submission.checking import check_submission

    found = check_submission(file, sample, crew(workers=workers), secrets.token_hex(8))
    click.echo(f"{file}: {_words(found.manifest)}")
    _tell_contents(found.manifest, found)
    if found.differs:
        version = one_line(found.manifest.version, 60)
        click.echo(
            f"nothing can be said of its trials: {'; '.join(found.differs)}; check it with explore-bench {version}"
        )
        return INCOMPLETE
    ended = ", ".join(f"{count} {status}" for status, count in sorted(found.statuses.items()))
    click.echo(f"whole: {ended}")
    if found.verified is None:
        click.echo("none of its code was run; --sample N runs N of its trials again")
        return DONE
    return _tell_sample(found)


def _tell_sample(found: Checked) -> int:
    verified = found.verified
    assert verified is not None
    alike = verified.same + verified.close
    click.echo(f"sample: {alike} of {alike + len(verified.different)} trials came out as they were submitted")
    for spec, what in (*verified.different, *verified.undone):
        click.echo(f"- {spec.scenario.size:g} m, {spec.scenario_name}, world {spec.trial}: {one_line(what)}")
    if verified.different:
        return NO
    return INCOMPLETE if verified.undone or not alike else DONE


def _words(manifest: Manifest) -> str:
    return f"{manifest.trials} trials of {one_line(manifest.strategy, 200)} in suite {manifest.suite}"


def _tell_contents(manifest: Manifest, found: Checked | None = None) -> None:
    click.echo(
        f"explore-bench {one_line(manifest.version, 60)}, code {manifest.code[:12]}, {one_line(manifest.factory, 200)}"
    )
    for name, digest in manifest.source.items():
        lines = f", {found.lines[name]} lines" if found else ""
        click.echo(f"- {name}: {digest[:12]}{lines}")
    for weights in manifest.weights:
        click.echo(f"- weights of training seed {weights.seed}, {one_line(weights.file, 200)}: {weights.digest[:12]}")
