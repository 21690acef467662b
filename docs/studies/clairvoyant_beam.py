"""Sweep the clairvoyant's beam and its expectation of the path still needed.

    python docs/studies/clairvoyant_beam.py [--store FOLDER]

Runs on calibration worlds, resumes from its store and writes clairvoyant-beam.csv; docs/clairvoyant.md tells more.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pandas as pd

from explore_bench.analysis.metrics import score
from explore_bench.analysis.statistics import mean_interval
from explore_bench.records.store import Store, missing
from explore_bench.runs.runner import default_workers, execute
from explore_bench.runs.suites import plan

BEAMS = (8, 24, 72)
METRES_PER_CELL = (0.4, 0.6, 0.8, 1.0)
WORLDS = {20.0: 20, 40.0: 8}

HERE = Path(__file__).parent


def main() -> None:
    """Run the sweep and print the mean number of steps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", type=Path, default=Path("results/calibration"))
    store = Store(parser.parse_args().store)
    store.open(0, "calibrate", scenario=None)
    rows = []
    for (size, worlds), metres, beam in itertools.product(WORLDS.items(), METRES_PER_CELL, BEAMS):
        specs = plan("paper", ["clairvoyant"], (size,), worlds, purpose="calibrate").specs
        own = [dataclasses.replace(s, parameters={"beam": beam, "metres_per_cell": metres}) for s in specs]
        for _ in execute(list(missing(store, own)), store, default_workers()):
            pass
        steps = mean_interval(np.array([float(score(store.find(spec)).time) for spec in own]))
        rows.append({"size": size, "metres_per_cell": metres, "beam": beam, "worlds": worlds})
        rows[-1] |= {"steps": steps.mean, "low": steps.low, "high": steps.high}
        print(", ".join(f"{name} {value:g}" for name, value in rows[-1].items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "clairvoyant-beam.csv", index=False, float_format="%.2f")


if __name__ == "__main__":
    main()
