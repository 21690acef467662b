"""`demo`: one trial to look at."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import click

from explore_bench.cli.completion import one_of, strategies
from explore_bench.cli.options import DONE, NO, physics_of, results_option, root_option, tell_map, world_options
from explore_bench.errors import RequestError, one_line

MAX_WORLDS = 100_000


@click.command()
@click.argument("strategy", shell_complete=one_of(strategies, files=True))
@click.option("--size", type=float, metavar="M", help="Edge of the map [m] (default: the scenario's, or 20).")
@click.option(
    "--trial",
    type=click.IntRange(0, MAX_WORLDS),
    default=0,
    show_default=True,
    metavar="N",
    help="Number of the world.",
)
@root_option
@world_options
@click.option("--output", type=click.Path(path_type=Path), metavar="FILE", help="A .png, .svg, .gif or .html.")
@results_option
def demo(
    strategy: str,
    size: float | None,
    trial: int,
    seed: int,
    scenario: str | None,
    map_: str | None,
    resolution: float | None,
    cell_size: float | None,
    output: Path | None,
    results: Path,
) -> int:
    """Run one trial of STRATEGY and draw it: a picture of its end, every decision (.gif), or a player (.html)."""
    from explore_bench.report.demo import draw_trial
    from explore_bench.runs.suites import plan

    physics, kept_as, given = physics_of(scenario, map_, resolution, cell_size)
    asked = plan("smoke", [strategy], [] if size is None else [size], 1, seed, physics, kept_as)
    if not asked.specs:
        raise RequestError(f"strategy '{strategy}' is not trained; choose one that 'explore-bench list' calls ready.")
    spec = dataclasses.replace(asked.specs[0], trial=trial)
    size = spec.scenario.size
    shown = re.sub(r"[^\w.=-]+", "_", spec.strategy).rstrip("_")
    path = output or results / f"demo-{shown}-{size:g}m-{trial}.gif"
    tell_map(given)
    record = draw_trial(spec, path)
    steps = record.steps["step"][-1]
    click.echo(f"{spec.strategy}, {size:g} m, world {trial}: {record.status} after {steps} steps; {path}")
    if record.reason:
        click.echo(f"{record.status}: {one_line(record.reason)}", err=True)
    return NO if record.status in ("failed", "broken") else DONE
