"""`run`: what is missing of a suite."""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from explore_bench.cli.completion import one_of, suites
from explore_bench.cli.options import (
    DONE,
    INCOMPLETE,
    NO,
    physics_of,
    results_option,
    root_option,
    strategies_option,
    tell_damaged,
    tell_map,
    world_options,
)
from explore_bench.errors import RequestError, one_line

if TYPE_CHECKING:
    from explore_bench.runs.suites import Plan
    from explore_bench.trial.spec import Outcome, TrialSpec
    from explore_bench.world.maps import GivenMap


@click.command()
@click.argument("suite", shell_complete=one_of(suites))
@strategies_option("Not the suite's")
@click.option("--size", "sizes", type=float, multiple=True, metavar="M", help="Edge of the map [m]; repeatable.")
@click.option("--trials", type=int, metavar="N", help="Worlds a size.")
@click.option("--workers", type=click.IntRange(1), metavar="N", help="Processes (default: one a processor).")
@click.option(
    "--backend", type=click.Choice(["processes", "sequential", "dask"]), default="processes", show_default=True
)
@click.option("--scheduler", metavar="ADDRESS", help="Of the dask cluster that runs the trials, with --backend dask.")
@click.option("--timeout", type=click.FloatRange(0, 1e6, min_open=True), default=600.0, show_default=True, metavar="S")
@click.option(
    "--memory",
    type=click.FloatRange(0, 1e6, min_open=True),
    metavar="GIB",
    help="What a trial may allocate (default: the machine's, over the processes).",
)
@world_options
@root_option
@results_option
@click.option("--dry-run", is_flag=True, help="Print the plan and stop.")
def run(
    suite: str,
    names: tuple[str, ...],
    sizes: tuple[float, ...],
    trials: int | None,
    workers: int | None,
    backend: str,
    scheduler: str | None,
    timeout: float,
    memory: float | None,
    scenario: str | None,
    map_: str | None,
    resolution: float | None,
    cell_size: float | None,
    seed: int,
    results: Path,
    dry_run: bool,
) -> int:
    """Run what is missing of SUITE and write trials.csv; an interrupted run goes on where it stopped."""
    from explore_bench.runs.suites import plan

    if math.isnan(timeout):
        raise RequestError("timeout is nan; give the seconds that one trial may take.")
    if memory is not None and math.isnan(memory):
        raise RequestError("memory is nan; give the GiB that one trial may allocate.")
    physics, kept_as, given = physics_of(scenario, map_, resolution, cell_size)
    asked = plan(suite, names, sizes, trials, seed, physics, kept_as)
    if not asked.specs:
        click.echo(f"nothing to run: not trained: {', '.join(asked.untrained)}")
        return INCOMPLETE
    return _run(asked, given, results, seed, workers, backend, scheduler, timeout, memory, dry_run)


def _run(
    asked: Plan,
    given: GivenMap | None,
    results: Path,
    seed: int,
    workers: int | None,
    backend: str,
    scheduler: str | None,
    timeout: float,
    memory: float | None,
    dry_run: bool,
) -> int:
    from explore_bench.analysis.times import Expectation
    from explore_bench.records.store import Store, missing
    from explore_bench.runs import runner
    from explore_bench.runs.workers import IncompleteError

    workers = runner.crew(backend, workers, scheduler)
    runner.check_runnable(asked.specs, workers, backend, timeout)
    store = Store(results)
    if not dry_run or store.exists():
        store.open(seed, "evaluate", asked.scenario)
    if not dry_run:
        store.take(asked.specs)
    to_do = list(missing(store, asked.specs))
    stored = len(asked.specs) - len(to_do)
    expectation = Expectation(store.folder)
    expected = sum(map(expectation.of, to_do))
    tell_map(given)
    click.echo(
        f"plan: {len(asked.specs)} trials, {stored} stored, {len(to_do)} to do with {workers} workers"
        + (f", about {_duration(expected / workers)} where nothing else runs" if to_do else "")
    )
    if asked.untrained:
        click.echo(f"not trained: {', '.join(asked.untrained)}")
    if asked.elsewhere:
        click.echo(f"not for this kind of world: {', '.join(asked.elsewhere)}")
    if dry_run:
        return DONE
    try:
        with Progress(len(to_do), expectation.of, expected) as advance:
            table = runner.complete(to_do, store, workers, backend, timeout, advance, scheduler, memory)
        rows = runner.asked_for(table, asked.specs)
    except IncompleteError as error:
        click.echo(f"explore-bench: incomplete: {one_line(str(error))}.", err=True)
        return INCOMPLETE
    finally:
        tell_damaged(store.damaged)
    failed, broken = rows["status"] == "failed", rows["status"] == "broken"
    click.echo(
        f"{len(table)} trials in {results / 'trials.csv'}, {failed.sum()} of those asked for failed; "
        f"explore-bench report --results {shlex.quote(str(results))} writes what they show"
    )
    if broken.any():
        click.echo(
            f"explore-bench: the simulator broke down in {broken.sum()} of them, which no table counts; report that: "
            f"{rows.loc[broken, 'reason'].iloc[0]}",
            err=True,
        )
        return INCOMPLETE
    if (failed & (rows["explored"] == 0.0)).all():
        click.echo(f"explore-bench: nothing was measured: {rows['reason'].iloc[0]}", err=True)
        return INCOMPLETE
    return NO if failed.any() else DONE


class Progress:
    """Progress bar on a terminal, a line every tenth elsewhere, both with the time that is left; failures as they come.

    Parameters
    ----------
    total : number of trials.
    weigh : share of a trial in the `weight` of all, the seconds that it is expected to take; by default all are alike.
    """

    def __init__(
        self, total: int, weigh: Callable[[TrialSpec], float] = lambda spec: 1.0, weight: float | None = None
    ) -> None:
        self._total, self._done = total, 0
        self._weigh, self._weight, self._weight_done = weigh, total if weight is None else weight, 0.0
        self._begun = time.monotonic()
        self._bar: Any = None
        if total and sys.stderr.isatty():
            from rich import progress
            from rich.console import Console

            columns = (progress.TextColumn("trials"), progress.BarColumn(), progress.MofNCompleteColumn())
            left = progress.TextColumn("{task.fields[left]}")
            self._bar = progress.Progress(*columns, left, console=Console(stderr=True))
            self._task = self._bar.add_task("trials", total=total, left="")

    def __enter__(self) -> Callable[[Outcome], None]:
        if self._bar:
            self._bar.start()
        return self._advance

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def _advance(self, outcome: Outcome) -> None:
        self._done += 1
        self._weight_done += self._weigh(outcome.spec)
        if outcome.status.value in ("failed", "stuck", "broken"):
            spec = outcome.spec
            place = f"{spec.strategy}, {spec.scenario.size:g} m, world {spec.trial}"
            click.echo(f"{outcome.status.value}: {place}: {one_line(outcome.reason)}", err=True)
        if self._bar:
            self._bar.update(self._task, advance=1, left=self._left())
        elif self._done == self._total or self._done % max(self._total // 10, 1) == 0:
            left = self._left()
            click.echo(f"{self._done} of {self._total} trials{left and ', '}{left}", err=True)

    def _left(self) -> str:
        """Time that is left in words; empty at the end."""
        from explore_bench.analysis.times import seconds_left

        if self._done == self._total:
            return ""
        seconds = seconds_left(time.monotonic() - self._begun, self._weight_done, self._weight)
        return f"about {_duration(seconds)} to go"


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 90 * 60 else f"{seconds / 3600:.1f} h"
