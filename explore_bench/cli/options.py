"""The commands, a module each; heavy libraries are imported inside a command, so `--help` feels instant.

Exit codes: 0 done; 1 it ran and the answer is no (a trial failed, say); 2 the request or a file is wrong; 3 incomplete,
or nothing was measured; 130 interrupted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from explore_bench.cli.completion import maps, one_of, scenarios, strategies
from explore_bench.errors import RequestError, one_line

if TYPE_CHECKING:
    from explore_bench.world.maps import GivenMap
    from explore_bench.world.scenario import Scenario

DONE, NO, WRONG, INCOMPLETE, INTERRUPTED = 0, 1, 2, 3, 130

SCENARIO = "NAME|FILE.toml"
"""What --scenario takes."""

results_option = click.option(
    "--results",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder of records, tables and figures.",
)
root_option = click.option(
    "--seed", type=int, default=0, show_default=True, metavar="ROOT", help="Root seed; 0 is the benchmark's."
)
json_option = click.option(
    "--json", "file", type=click.Path(path_type=Path), metavar="FILE", help="Write the numbers as JSON, too."
)


def strategies_option(help: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Option of strategies as `lookup` takes them; repeatable."""
    return click.option(
        "-s",
        "--strategy",
        "names",
        multiple=True,
        metavar="STRATEGY",
        shell_complete=one_of(strategies, files=True),
        help=f"{help}: NAME, MODULE:FACTORY or FILE.py:FACTORY, then [key=value,…] if need be; repeatable.",
    )


def tell_damaged(shards: Sequence[Path]) -> None:
    """Name the shards that were damaged and moved aside, where there are any."""
    if shards:
        names = ", ".join(path.name for path in shards)
        what = "1 damaged record was" if len(shards) == 1 else f"{len(shards)} damaged records were"
        sentence = f"{what} moved to '{shards[0].parent}': {names}"
        click.echo(f"explore-bench: {one_line(sentence)}; a run of their suite replaces them.", err=True)


def world_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options of a command that say in which world its trials run; see `physics_of`."""
    command = map_options(command)
    return click.option(
        "--scenario",
        metavar=SCENARIO,
        shell_complete=one_of(scenarios, files=True),
        help="Physical constants instead of the paper's.",
    )(command)


def map_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Those of world_options that are about a given map."""
    own = "A world of your own: .yaml of map_server, an image, .npy or .txt; or one of the suite 'maps'."
    pixel = "Edge of a pixel of the map [m], where its file does not say (default: a cell)."
    options = (
        click.option("--map", "map_", metavar="FILE|NAME", shell_complete=one_of(maps, files=True), help=own),
        click.option("--resolution", type=float, metavar="M", help=pixel),
        click.option(
            "--cell-size", type=float, metavar="M", help="Edge of a cell of the map [m], where decisions are made."
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


def physics_of(
    scenario: str | None, map_: str | None, resolution: float | None, cell_size: float | None
) -> tuple[Scenario | None, str | None, GivenMap | None]:
    """Scenario that the `world_options` ask for, and its name (None: the suite's own), and the map that it gives."""
    from explore_bench.world.maps import read_map
    from explore_bench.world.scenarios import PAPER, read_scenario

    for name, value in (("resolution", resolution), ("cell-size", cell_size)):
        if value is not None and map_ is None:
            raise RequestError(f"{name} {value:g} is given without a map; add --map FILE.")
    physics, given = (None, None) if scenario is None else read_scenario(scenario)
    if map_ is not None:
        given = read_map(physics or PAPER, map_, resolution, cell_size)
        physics = given.scenario
    names = [Path(name).name for name in (scenario, map_) if name is not None]
    return physics, ", ".join(names) or None, given


def tell_map(given: GivenMap | None) -> None:
    """Print what was understood of a map, where one is given."""
    from explore_bench.trial.seeding import stream
    from explore_bench.world.kinds import draw_world
    from explore_bench.world.maps.account import account

    if given is not None:
        world = draw_world(given.scenario, stream("evaluate", 0, given.scenario.size, 0, "world"))
        click.echo("\n  ".join((f"map {one_line(given.name)}:", *account(given, world))))
