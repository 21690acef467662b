"""The command line. Heavy libraries are imported inside the command that needs them, so `--help` feels instant.

Exit codes: 0 done; 1 it ran and the answer is no (a trial failed); 2 the request or a file is wrong; 3 incomplete,
or nothing was measured; 130 interrupted.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from explore_bench.errors import RequestError, writing

if TYPE_CHECKING:
    from explore_bench.scenario import Scenario
    from explore_bench.spec import Outcome
    from explore_bench.suites import Plan

MAX_WORLDS = 100_000

DONE, NO, WRONG, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130

results_option = click.option(
    "--results",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder of records, tables and figures.",
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the console script: one line on stderr for whatever is wrong, and the exit code."""
    code = DONE
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    try:
        code = cli.main(args=arguments or ["--help"], prog_name="explore-bench", standalone_mode=False) or DONE
    except click.ClickException as error:
        code = _complain(error.format_message().replace("\n", " "))
    except RequestError as error:
        code = _complain(str(error))
    except (click.Abort, KeyboardInterrupt):
        print("explore-bench: interrupted; what is done is stored, the same command goes on.", file=sys.stderr)
        code = INTERRUPTED
    sys.exit(code)


def _complain(sentence: str) -> int:
    print(f"explore-bench: {sentence}", file=sys.stderr)
    return WRONG


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="explore-bench")
def cli() -> None:
    """Compare robot-exploration strategies: paired, seeded trials in one simulator, tables with intervals."""


@cli.command("list")
@click.argument("what", type=click.Choice(["strategies", "scenarios", "suites", "metrics"]), default="strategies")
def list_(what: str) -> None:
    """List strategies (the default), scenarios, suites or metrics."""
    rows: list[tuple[str, ...]]
    if what == "strategies":
        from explore_bench.registry import parameter_count, strategies

        rows = [("name", "label", "tables", "state", "parameters")]
        for name, entry in strategies().items():
            state, count = "ready" if entry.ready else "not trained", ""
            if entry.reference:
                state = "reference: told the truth"
            elif entry.weights:
                seeds = len(entry.weights)
                state = f"learned, {seeds} training seed{'s' if seeds > 1 else ''}"
                count = f"{parameter_count(entry):,}"
            rows.append((name, entry.label, ", ".join(entry.tables), state, count))
    elif what == "scenarios":
        from explore_bench.scenario import SCENARIOS

        rows = [("name", "description"), *((name, text) for name, (_, text) in SCENARIOS.items())]
    elif what == "suites":
        from explore_bench.suites import SUITES

        rows = [("name", "sizes [m]", "worlds", "description")]
        for name, suite in SUITES.items():
            sizes = ", ".join(f"{size:g}" for size in suite.sizes)
            rows.append((name, sizes, str(suite.trials), suite.description))
    else:
        from explore_bench.metrics import METRICS, REGRET

        rows = [("name", "symbol", "unit", "better", "definition")]
        for name, metric in (METRICS | {"regret": REGRET}).items():
            rows.append((name, metric.symbol, metric.unit, metric.better or "–", metric.equation))
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


@cli.command()
@click.argument("suite")
@click.option("-s", "--strategy", "names", multiple=True, metavar="STRATEGY", help="Not the suite's; repeatable.")
@click.option("--size", "sizes", type=float, multiple=True, metavar="M", help="Edge of the map [m]; repeatable.")
@click.option("--trials", type=int, metavar="N", help="Worlds a size.")
@click.option("--workers", type=click.IntRange(1), metavar="N", help="Processes (default: one a processor).")
@click.option("--backend", type=click.Choice(["loky", "sequential"]), default="loky", show_default=True)
@click.option("--timeout", type=click.FloatRange(0, 1e6, min_open=True), default=600.0, show_default=True, metavar="S")
@click.option("--scenario", metavar="NAME|FILE.toml", help="Physical constants instead of the paper's.")
@click.option("--seed", type=int, default=0, show_default=True, metavar="ROOT", help="Root seed; 0 is the benchmark's.")
@results_option
@click.option("--dry-run", is_flag=True, help="Print the plan and stop.")
def run(
    suite: str,
    names: tuple[str, ...],
    sizes: tuple[float, ...],
    trials: int | None,
    workers: int | None,
    backend: str,
    timeout: float,
    scenario: str | None,
    seed: int,
    results: Path,
    dry_run: bool,
) -> int:
    """Run what is missing of SUITE and write trials.csv; an interrupted run goes on where it stopped."""
    from explore_bench.suites import plan

    if math.isnan(timeout):
        raise RequestError("timeout is nan; give the seconds that one trial may take.")
    physics = None
    if scenario is not None:
        from explore_bench.scenario import load_scenario

        physics = load_scenario(scenario)
    asked = plan(suite, names, sizes, trials, seed, physics, Path(scenario or "paper").name)
    if not asked.specs:
        click.echo(f"nothing to run: not trained: {', '.join(asked.untrained)}")
        return INCOMPLETE
    return _run(asked, physics, results, seed, workers, backend, timeout, dry_run)


def _run(
    asked: Plan,
    physics: Scenario | None,
    results: Path,
    seed: int,
    workers: int | None,
    backend: str,
    timeout: float,
    dry_run: bool,
) -> int:
    from explore_bench import runner
    from explore_bench.records import Store, missing
    from explore_bench.results import expected_seconds, select
    from explore_bench.scenario import PAPER

    runner.check_runnable(asked.specs)
    store = Store(results)
    if not dry_run or store.exists():
        store.open(seed, "evaluate", None if asked.varied else physics or PAPER)
    to_do = list(missing(store, asked.specs))
    workers = workers or runner.default_workers()
    stored = len(asked.specs) - len(to_do)
    click.echo(
        f"plan: {len(asked.specs)} trials, {stored} stored, {len(to_do)} to do with {workers} workers"
        + (f", about {_duration(expected_seconds(store.folder, to_do) / workers)}" if to_do else "")
    )
    if asked.untrained:
        click.echo(f"not trained: {', '.join(asked.untrained)}")
    if dry_run:
        return DONE
    try:
        with Progress(len(to_do)) as advance:
            table = runner.complete(to_do, store, workers, backend, timeout, advance)
    except runner.IncompleteError as error:
        click.echo(f"explore-bench: incomplete: {error}.", err=True)
        return INCOMPLETE
    failed = int((select(table, asked.specs)["status"] == "failed").sum())
    click.echo(f"{len(table)} trials in {results / 'trials.csv'}, {failed} of those asked for failed")
    return NO if failed else DONE


@cli.command()
@results_option
def report(results: Path) -> int:
    """Write tables, figures and a page with replays from stored records; simulates nothing."""
    from explore_bench.report.render import write_report

    written = write_report(results)
    stale = f", {written.stale} of older code left out" if written.stale else ""
    click.echo(f"{len(written.files)} files in {results} from {written.trials} trials{stale}")
    return DONE


@cli.command()
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
@click.option("--json", "file", type=click.Path(path_type=Path), metavar="FILE", help="Write the numbers as JSON, too.")
def compare(a: Path, b: Path, file: Path | None) -> int:
    """Compare two results folders by their trials.csv, B against A, paired by world."""
    from explore_bench.comparison import compare_folders
    from explore_bench.report.comparison import comparison_table

    found = compare_folders(a, b)
    click.echo(comparison_table(found).markdown(), nl=False)
    if file is not None:
        with writing(file):
            file.write_text(json.dumps(found.values(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return DONE


@cli.command()
@click.argument("strategy")
@click.option("--size", type=float, metavar="M", help="Edge of the map [m] (default: the scenario's, or 20).")
@click.option(
    "--trial",
    type=click.IntRange(0, MAX_WORLDS),
    default=0,
    show_default=True,
    metavar="N",
    help="Number of the world.",
)
@click.option("--seed", type=int, default=0, show_default=True, metavar="ROOT", help="Root seed.")
@click.option("--scenario", metavar="NAME|FILE.toml", help="Physical constants instead of the paper's.")
@click.option("--output", type=click.Path(path_type=Path), metavar="FILE", help="A .png, .svg, .gif or .html.")
@results_option
def demo(
    strategy: str, size: float | None, trial: int, seed: int, scenario: str | None, output: Path | None, results: Path
) -> int:
    """Run one trial of STRATEGY and draw it: a picture of its end, every decision (.gif), or a player (.html)."""
    from explore_bench.report.demo import draw_trial
    from explore_bench.scenario import load_scenario
    from explore_bench.suites import plan

    physics = load_scenario(scenario) if scenario else None
    asked = plan("smoke", [strategy], [] if size is None else [size], 1, seed, physics, Path(scenario or "paper").name)
    if not asked.specs:
        raise RequestError(f"strategy '{strategy}' is not trained; choose one that 'explore-bench list' calls ready.")
    spec = dataclasses.replace(asked.specs[0], trial=trial)
    size = spec.scenario.size
    path = output or results / f"demo-{spec.strategy}-{size:g}m-{trial}.gif"
    record = draw_trial(spec, path)
    steps = record.steps["step"][-1]
    click.echo(f"{spec.strategy}, {size:g} m, world {trial}: {record.status} after {steps} steps; {path}")
    return NO if record.status == "failed" else DONE


@cli.command()
@click.argument("name")
@click.option(
    "--seed", type=click.IntRange(0, 99_999), default=0, show_default=True, metavar="S", help="Training seed."
)
@click.option("--episodes", type=click.IntRange(1), metavar="N", help="Episodes in all (default: the strategy's own).")
@click.option("--resume", is_flag=True, help="Go on from the last checkpoint, where there is one.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results/training"),
    show_default=True,
    help="Folder of weights, cards, curves and checkpoints.",
)
def train(name: str, seed: int, episodes: int | None, resume: bool, out: Path) -> int:
    """Train the learned strategy NAME on one core; its weights are the best of its own validation worlds."""
    from explore_bench.registry import lookup
    from explore_bench.strategy import load_factory

    name, entry = lookup(name)
    if entry.trainer is None:
        raise RequestError(f"strategy '{name}' is not learned; choose one that 'explore-bench list' calls learned.")
    try:
        path = load_factory(entry.trainer)(name, entry, seed, episodes, resume, out, click.echo)
    except KeyboardInterrupt:
        click.echo("explore-bench: interrupted; add --resume to go on, at most 30 s are lost.", err=True)
        return INTERRUPTED
    click.echo(f"best weights: {path}")
    return DONE


@cli.command()
@click.option("--json", "file", type=click.Path(path_type=Path), metavar="FILE", help="Write the numbers as JSON, too.")
def perf(file: Path | None) -> int:
    """Print where a step's time goes, as ratios to iSAM2's own update in the same run."""
    from explore_bench.perf import measure, text, write_json

    numbers = measure(lambda line: click.echo(line, err=True))
    click.echo(text(numbers))
    if file is not None:
        write_json(numbers, file)
    return DONE


class Progress:
    """Progress bar on a terminal, a line every tenth elsewhere; failures are printed as they come."""

    def __init__(self, total: int) -> None:
        self._total, self._done = total, 0
        self._bar: Any = None
        if total and sys.stderr.isatty():
            from rich import progress
            from rich.console import Console

            columns = (progress.TextColumn("trials"), progress.BarColumn(), progress.MofNCompleteColumn())
            self._bar = progress.Progress(*columns, progress.TimeRemainingColumn(), console=Console(stderr=True))
            self._task = self._bar.add_task("trials", total=total)

    def __enter__(self) -> Callable[[Outcome], None]:
        if self._bar:
            self._bar.start()
        return self._advance

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def _advance(self, outcome: Outcome) -> None:
        self._done += 1
        if outcome.status.value in ("failed", "stuck"):
            spec = outcome.spec
            place = f"{spec.strategy}, {spec.scenario.size:g} m, world {spec.trial}"
            click.echo(f"{outcome.status.value}: {place}: {outcome.reason}", err=True)
        if self._bar:
            self._bar.advance(self._task)
        elif self._done == self._total or self._done % max(self._total // 10, 1) == 0:
            click.echo(f"{self._done} of {self._total} trials", err=True)


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90 else f"{seconds / 60:.0f} min"
