"""`train`: a learned strategy."""

from __future__ import annotations

from pathlib import Path

import click

from explore_bench.cli.completion import learned, one_of, scenarios
from explore_bench.cli.options import DONE, INTERRUPTED
from explore_bench.errors import RequestError


@click.command()
@click.argument("name", shell_complete=one_of(learned))
@click.option(
    "--seed", type=click.IntRange(0, 99_999), default=0, show_default=True, metavar="S", help="Training seed."
)
@click.option("--episodes", type=click.IntRange(1), metavar="N", help="Episodes in all (default: the strategy's own).")
@click.option("--resume", is_flag=True, help="Go on from the last checkpoint, where there is one.")
@click.option(
    "--scenario",
    metavar="NAME|FILE.toml",
    shell_complete=one_of(scenarios, files=True),
    help="Train and validate in its worlds instead of the paper's.",
)
@click.option("--from", "start", metavar="FILE", help="Weights to start from (.safetensors, its card beside it).")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results/training"),
    show_default=True,
    help="Folder of weights, cards, curves and checkpoints.",
)
def train(
    name: str, seed: int, episodes: int | None, resume: bool, scenario: str | None, start: str | None, out: Path
) -> int:
    """Train the learned strategy NAME on one core; its weights are the best of its own validation worlds."""
    from explore_bench.strategies.entry import weights_file
    from explore_bench.strategies.loading import load_factory
    from explore_bench.strategies.registry import lookup

    name, entry = lookup(name)
    if entry.trainer is None:
        raise RequestError(f"strategy '{name}' is not learned; choose one that 'explore-bench list' calls learned.")
    begun = None if start is None else weights_file(start)
    try:
        path = load_factory(entry.trainer)(name, entry, seed, episodes, resume, out, click.echo, scenario, begun)
    except KeyboardInterrupt:
        click.echo("explore-bench: interrupted; add --resume to go on, less than a minute is lost.", err=True)
        return INTERRUPTED
    click.echo(f"best weights: {path}")
    return DONE
