"""`verify`: stored trials once more."""

from __future__ import annotations

from pathlib import Path

import click

from explore_bench.cli.options import DONE, INCOMPLETE, NO, results_option, tell_damaged
from explore_bench.errors import one_line

SHOWN = 20


@click.command()
@results_option
@click.option("--sample", type=click.IntRange(1), metavar="N", help="So many of the trials, the same ones each time.")
@click.option("--workers", type=click.IntRange(1), metavar="N", help="Processes (default: one a processor).")
def verify(results: Path, sample: int | None, workers: int | None) -> int:
    """Run stored trials again and say whether they come out the same, and with what differs if not."""
    from explore_bench.cli.run import Progress
    from explore_bench.records.store import Store
    from explore_bench.runs.runner import crew
    from explore_bench.runs.verifying import verify

    store = Store(results)
    total = sum(1 for transient in store.records(lambda record: record.transient)[0] if not transient)
    tell_damaged(store.damaged)
    with Progress(min(total, sample or total)) as advance:
        found = verify(results, sample, crew(workers=workers), progress=advance)
    again = found.same + found.close + len(found.different)
    click.echo(
        f"{again} of {total} trials ran again: {found.same} gave the same bytes, {found.close} the same "
        f"decisions and numbers but for their last digits, {len(found.different)} came out otherwise"
    )
    for spec, what in (*found.different, *found.undone)[:SHOWN]:
        seed = "" if spec.training_seed is None else f", training seed {spec.training_seed}"
        click.echo(f"- {spec.strategy}{seed}, {spec.scenario.size:g} m, world {spec.trial}: {one_line(what)}")
    if found.stale:
        click.echo(f"{found.stale} of older code or libraries: nothing can be said of them")
    if found.different:
        return NO
    return INCOMPLETE if found.undone or not again else DONE
