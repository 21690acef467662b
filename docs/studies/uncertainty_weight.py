"""Tune w of the `uncertainty` strategy (U + w · length) on calibration worlds, the physics frozen.

The objective is the mean over worlds and sizes of log e − log η: both metrics of the paper count alike. Run again with

    python docs/studies/uncertainty_weight.py [--store FOLDER]

It resumes from its store and writes uncertainty-weight.csv beside this file; docs/uncertainty-weight.md tells more.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path

import numpy as np
import pandas as pd

from explore_bench.analysis.metrics import exploration_efficiency, score, trajectory_error
from explore_bench.analysis.statistics import mean_interval
from explore_bench.records.store import Store, missing
from explore_bench.runs.runner import default_workers, execute
from explore_bench.runs.suites import plan

WEIGHTS = (0.0, 0.2, 0.4, 0.8, 1.6, 2.4, 3.2, 6.4, 12.8, 25.6)  # m² per m
SIZES = (20.0, 30.0, 40.0)
WORLDS = 20

HERE = Path(__file__).parent


def main() -> None:
    """Run the sweep and print it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", type=Path, default=Path("results/calibration"))
    store = Store(parser.parse_args().store)
    store.open(0, "calibrate", scenario=None)
    specs = plan("paper", ["uncertainty"], SIZES, WORLDS, purpose="calibrate").specs
    rows = []
    for weight in WEIGHTS:
        own = [dataclasses.replace(spec, parameters={"weight": weight}) for spec in specs]
        for _ in execute(list(missing(store, own)), store, default_workers()):
            pass
        records = [store.find(spec) for spec in own]
        values = {"weight": weight}
        losses = [math.log(trajectory_error(r)) - math.log(exploration_efficiency(r)) for r in records]
        estimate = mean_interval(np.array(losses))
        values |= {"objective": estimate.mean, "low": estimate.low, "high": estimate.high}
        for size in SIZES:
            here = [record for record in records if record.spec.scenario.size == size]
            values[f"e {size:g}"] = float(np.mean([trajectory_error(record) for record in here]))
            values[f"eta {size:g}"] = float(np.mean([exploration_efficiency(record) for record in here]))
            values[f"T {size:g}"] = float(np.mean([score(record).time for record in here]))
        rows.append(values)
        print(", ".join(f"{name} {value:.3f}" for name, value in values.items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "uncertainty-weight.csv", index=False, float_format="%.4f")


if __name__ == "__main__":
    main()
