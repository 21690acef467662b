"""Tune how much the length of the path counts in the rules without learning, on calibration worlds, the physics frozen.

The objective is the mean over worlds and sizes of log e − log η: both metrics of the paper count alike. Run again with

    python docs/studies/path_weights.py [--store FOLDER] [--workers N] [STRATEGY ...]

It resumes from its store and writes path-weights.csv beside this file; docs/path-weights.md tells more.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from explore_bench.analysis.metrics import exploration_efficiency, score, trajectory_error
from explore_bench.analysis.statistics import mean_interval
from explore_bench.records.store import Store, missing
from explore_bench.runs.runner import default_workers, execute
from explore_bench.runs.suites import plan


class Sweep(NamedTuple):
    """Parameter of a strategy, and the values that are tried."""

    parameter: str
    values: tuple[float, ...]


SWEEPS = {
    "uncertainty": Sweep("weight", (0.0, 0.2, 0.4, 0.8, 1.6, 2.4, 3.2, 6.4, 12.8, 25.6)),  # m² per m
    "entropy": Sweep("weight", (0.0, 0.025, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 1.6, 3.2)),  # bit per m
    "entropy-per-metre": Sweep("offset", (0.5, 1.0, 2.0, 3.5, 5.0, 7.5, 10.0, 20.0)),  # m
}
SIZES = (20.0, 30.0, 40.0)
WORLDS = 20


def swept(name: str, sweep: Sweep, store: Store, workers: int) -> list[dict[str, object]]:
    """Run the sweep of a strategy and print a line a value; returns the lines."""
    specs = plan("paper", [name], SIZES, WORLDS, purpose="calibrate").specs
    rows = []
    for value in sweep.values:
        own = [dataclasses.replace(spec, parameters={**spec.parameters, sweep.parameter: value}) for spec in specs]
        for _ in execute(list(missing(store, own)), store, workers):
            pass
        records = [store.find(spec) for spec in own]
        losses = [math.log(trajectory_error(r)) - math.log(exploration_efficiency(r)) for r in records]
        estimate = mean_interval(np.array(losses))
        row: dict[str, object] = {"strategy": name, "value": value, "objective": estimate.mean}
        row |= {"low": estimate.low, "high": estimate.high}
        for size in SIZES:
            here = [record for record in records if record.spec.scenario.size == size]
            row[f"e {size:g}"] = float(np.mean([trajectory_error(record) for record in here]))
            row[f"eta {size:g}"] = float(np.mean([exploration_efficiency(record) for record in here]))
            row[f"T {size:g}"] = float(np.mean([score(record).time for record in here]))
        rows.append(row)
        print(", ".join(f"{k} {v:.3f}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
    return rows


def tune(description: str | None, sweeps: Mapping[str, Sweep], file: Path) -> None:
    """Run the sweeps that the command line asks for and put them in the place of those stored in a file."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", type=Path, default=Path("results/calibration"))
    parser.add_argument("--workers", type=int, default=default_workers())
    parser.add_argument("strategies", nargs="*", choices=[[], *sweeps], default=[])
    asked = parser.parse_args()
    store = Store(asked.store)
    store.open(0, "calibrate", scenario=None)
    for name in asked.strategies or sweeps:
        rows = pd.DataFrame(swept(name, sweeps[name], store, asked.workers))
        known = pd.read_csv(file) if file.exists() else rows.iloc[:0]
        order = list(sweeps)
        table = pd.concat((known[known["strategy"] != name], rows), ignore_index=True)
        table = table.sort_values("strategy", key=lambda names: names.map(order.index), kind="stable")
        table.to_csv(file, index=False, float_format="%.4f")


if __name__ == "__main__":
    tune(__doc__, SWEEPS, Path(__file__).with_name("path-weights.csv"))
