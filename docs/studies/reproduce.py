"""Do the trials of a suite come out as a table of them says? All must be equal, numbers but for their last digit.

    python docs/studies/reproduce.py                    all of results/trials.csv, in half an hour of processor time
    python docs/studies/reproduce.py --trials 1         the first world of every size

The trials run into a folder of their own, and a second call goes on where the first one stopped.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import click
import numpy as np
import pandas as pd

import explore_bench
from explore_bench.analysis.csv_files import KEYS, read_csv
from explore_bench.analysis.rounding import ROUNDING

TOLERANCE = ROUNDING
"""Relative difference that counts as none: the last digit of a table may be rounded the other way."""

SHOWN = 20


def differences(expected: pd.DataFrame, found: pd.DataFrame, tolerance: float = TOLERANCE) -> list[str]:
    """Sentences about every value of the trials found that is not what is expected, and every trial of unknown value.

    Both have the columns KEYS; columns that only one of them has are not compared.
    """
    known = expected.set_index(KEYS)
    said = []
    for key, row in zip(map(tuple, found[KEYS].itertuples(index=False)), found.to_dict("records"), strict=True):
        place = ", ".join(str(part) for part in key if not pd.isna(part))
        rows = known.loc[[key]] if key in known.index else known.iloc[:0]
        if len(rows) != 1:
            said.append(f"{place}: {len(rows)} rows are expected, 1 was found")
            continue
        for name in (column for column in known.columns if column in found.columns):
            was, now = rows.iloc[0][name], row[name]
            if not _same(was, now, tolerance):
                said.append(f"{place}: {name} was {was}, is {now}")
    return said


def as_read(table: pd.DataFrame) -> pd.DataFrame:
    """Rows as they come back from a file, like those that they are compared with; without regret to nobody."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "trials.csv"
        table.to_csv(path, index=False)
        found = read_csv(path, KEYS)
    return found.drop(columns="regret") if found["regret"].isna().all() else found


def _same(was: object, now: object, tolerance: float) -> bool:
    if pd.isna(was) or pd.isna(now):
        return bool(pd.isna(was) and pd.isna(now))
    if isinstance(was, float | np.floating) and isinstance(now, float | np.floating):
        return bool(abs(was - now) <= tolerance * max(abs(was), abs(now)))
    return bool(was == now)


@click.command()
@click.argument("table", type=click.Path(path_type=Path), default=Path("results/trials.csv"))
@click.option("--suite", default="paper", show_default=True)
@click.option("-s", "--strategy", "strategies", multiple=True, help="Not all of the suite's; repeatable.")
@click.option("--trials", type=int, help="Worlds a size (default: the suite's).")
@click.option("--workers", type=int, help="Processes (default: one a processor).")
@click.option("--results", type=click.Path(path_type=Path), default=Path("results/reproduced"), show_default=True)
def main(
    table: Path,
    suite: str,
    strategies: tuple[str, ...],
    trials: int | None,
    workers: int | None,
    results: Path,
) -> None:
    """Run the trials of a suite anew and compare each with its row of TABLE."""
    expected = read_csv(table, KEYS)
    found = as_read(explore_bench.run(suite, strategies, trials=trials, workers=workers, results=results))
    said = differences(expected, found)
    print(f"{len(found)} trials compared with {table}: {len(said)} values differ by more than {TOLERANCE:g}")
    for sentence in said[:SHOWN]:
        print(f"- {sentence}")
    if len(said) > SHOWN:
        print(f"- and {len(said) - SHOWN} more")
    sys.exit(1 if said or not len(found) else 0)


if __name__ == "__main__":
    try:
        main()
    except explore_bench.RequestError as error:
        sys.exit(f"reproduce: {error}")
