"""How often two strategies choose the same where they see the same.

    python docs/studies/choices.py [--field]
    python docs/studies/choices.py -s nearest -s ./mine.py:Mine --scenario stage --trials 5 --output mine.csv

Without -s it asks five methods, Graph-STNN with each of its training seeds, in both kinds of world, and writes
choices.csv for docs/choices.md; with --field the rules of others that do well, what they are measured by, and ours, and
writes field-choices.csv for docs/field.md.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import pandas as pd

import explore_bench

STRATEGIES = ("nearest", "uncertainty", "entropy", "random", "graph-stnn")
FIELD = (
    *("belief-attention", "entropy-path", "entropy-per-metre", "uncertainty", "information-gain-tuned"),
    *("heading-aware-tuned", "next-best-view", "visible-per-metre", "visible-unknown", "nearest"),
)
WORLDS = {"paper": 10, "stage": 4}
"""By scenario; a trial with a lidar takes twenty times as long."""


@click.command(help=__doc__)
@click.option("-s", "--strategy", "strategies", multiple=True, help="As for explore-bench run; repeatable.")
@click.option("--field", is_flag=True, help="Ask rules of others instead of the five methods.")
@click.option("--scenario", help="A name or a TOML file.  [default: paper]")
@click.option("--size", "sizes", type=float, multiple=True, help="Edge of the map [m]; repeatable.")
@click.option("--trials", type=int, default=10, show_default=True, help="Worlds a size.")
@click.option("--seed", type=int, default=0, show_default=True, help="Root seed of the worlds.")
@click.option("--workers", type=int, help="Processes (default: one a processor).")
@click.option("--output", type=click.Path(path_type=Path), help="A CSV file.")
def main(
    strategies: tuple[str, ...],
    field: bool,
    scenario: str | None,
    sizes: tuple[float, ...],
    trials: int,
    seed: int,
    workers: int | None,
    output: Path | None,
) -> None:
    """Ask, print and write."""
    asked = {scenario: trials} if strategies else WORLDS
    found = [
        explore_bench.agreement_of_choices(
            strategies or (FIELD if field else STRATEGIES),
            sizes=sizes,
            trials=count,
            scenario=name,
            seed=seed,
            workers=workers,
        )
        for name, count in asked.items()
    ]
    table = pd.concat([each.table for each in found], ignore_index=True)
    print(table.to_string(index=False))
    for sentence in dict.fromkeys(sentence for each in found for sentence in each.left_out):
        print(f"- {sentence}")
    if not (output or strategies):
        output = Path(__file__).with_name("field-choices.csv" if field else "choices.csv")
    if output is not None:
        table.to_csv(output, index=False, lineterminator="\n")


if __name__ == "__main__":
    try:
        main()
    except explore_bench.RequestError as error:
        sys.exit(f"choices: {error}")
