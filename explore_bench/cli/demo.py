"""`demo`: trials to look at."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from explore_bench.cli.completion import one_of, scenarios as known_scenarios, strategies as known_strategies
from explore_bench.cli.options import (
    DONE,
    NO,
    SCENARIO,
    map_options,
    physics_of,
    results_option,
    root_option,
    tell_map,
)
from explore_bench.errors import RequestError, one_line

if TYPE_CHECKING:
    from explore_bench.trial.spec import TrialSpec
    from explore_bench.world.maps import GivenMap

MAX_WORLDS = 100_000


@click.command()
@click.argument(
    "strategies",
    nargs=-1,
    required=True,
    metavar="STRATEGY...",
    shell_complete=one_of(known_strategies, files=True),
)
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
@click.option(
    "--scenario",
    "scenarios",
    multiple=True,
    metavar=SCENARIO,
    shell_complete=one_of(known_scenarios, files=True),
    help="Physical constants instead of the paper's; of several, each makes a row of the picture.",
)
@map_options
@click.option("--output", type=click.Path(path_type=Path), metavar="FILE", help="A .png, .svg, .gif or .html.")
@results_option
def demo(
    strategies: tuple[str, ...],
    size: float | None,
    trial: int,
    seed: int,
    scenarios: tuple[str, ...],
    map_: str | None,
    resolution: float | None,
    cell_size: float | None,
    output: Path | None,
    results: Path,
) -> int:
    """Run one trial of each STRATEGY in the same world and draw it: a picture (.png, .svg), .gif, or a player (.html).

    The .gif of a single trial shows every decision; that of several shows them side by side, step by step.
    """
    from explore_bench.report.demo import draw_trials

    names = tuple(dict.fromkeys(strategies))
    rows = []
    for scenario in dict.fromkeys(scenarios or (None,)):
        asked = [_spec(name, size, trial, seed, scenario, map_, resolution, cell_size) for name in names]
        rows.append([spec for spec, _ in asked])
        tell_map(asked[0][1])
    first = rows[0][0]
    shown = "+".join(re.sub(r"[^\w.=-]+", "_", spec.strategy).rstrip("_") for spec in rows[0])
    path = output or results / f"demo-{shown}-{first.scenario.size:g}m-{trial}.gif"
    records = [record for row in draw_trials(rows, path) for record in row]
    for record in records:
        spec, steps = record.spec, record.steps["step"][-1]
        told = f"{spec.strategy}, {spec.scenario.size:g} m, world {trial}: {record.status} after {steps} steps"
        click.echo(f"{told}; {path}")
        if record.reason:
            click.echo(f"{record.status}: {one_line(record.reason)}", err=True)
    return NO if any(record.status in ("failed", "broken") for record in records) else DONE


def _spec(
    name: str,
    size: float | None,
    trial: int,
    seed: int,
    scenario: str | None,
    map_: str | None,
    resolution: float | None,
    cell_size: float | None,
) -> tuple[TrialSpec, GivenMap | None]:
    """Return the trial of a strategy, with its first training seed, and the map that is given."""
    from explore_bench.runs.suites import plan

    physics, kept_as, given = physics_of(scenario, map_, resolution, cell_size)
    asked = plan("smoke", [name], [] if size is None else [size], 1, seed, physics, kept_as)
    if not asked.specs:
        raise RequestError(f"strategy '{name}' is not trained; choose one that 'explore-bench list' calls ready.")
    return dataclasses.replace(asked.specs[0], trial=trial), given
