"""What training in lidar worlds adds: `belief-attention` as it is, and after 384 more episodes with a lidar.

    python docs/studies/stage_tuning.py [--store FOLDER]

Both in the scenes of the suite `stage`; what it does as it is comes from results/stage. The study resumes from its
store and writes stage-tuning.csv beside this file; docs/stage.md tells more.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from explore_bench.analysis.statistics import paired_difference
from explore_bench.analysis.tables import by_world, trial_table
from explore_bench.records.store import Store, missing
from explore_bench.runs.runner import default_workers, execute
from explore_bench.runs.suites import plan

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WEIGHTS = ROOT / "baselines" / "weights" / "lidar" / "belief-attention-0.safetensors"
METRICS = {"l90": ("L90 [m]", 1), "t90_seconds": ("T90 [s]", 1), "trajectory_error": ("e [m]", 3)}


def main() -> None:
    """Run what is missing and print a line of each kind of scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", type=Path, default=ROOT / "results" / "tuning")
    store = Store(parser.parse_args().store)
    store.open(0, "evaluate", scenario=None)
    rows = []
    specs = plan("stage", [f"belief-attention[weights={WEIGHTS}]"]).specs
    for _ in execute(list(missing(store, specs)), store, default_workers()):
        pass
    tuned = trial_table([store.find(spec) for spec in specs])
    before = pd.read_csv(ROOT / "results" / "stage" / "trials.csv")
    before = before[before["strategy"] == "belief-attention"]
    for scenario in dict.fromkeys(tuned["scenario"]):
        own, other = (trials[trials["scenario"] == scenario] for trials in (tuned, before))
        rows.append({"scenes": scenario, **compared(own, other)})
        print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "stage-tuning.csv", index=False)


def compared(tuned: pd.DataFrame, before: pd.DataFrame) -> dict[str, str]:
    """Means before and after, and differences paired by scene, with 95 % intervals."""
    row = {"n": str(len(tuned)), "explored": str((tuned["status"] == "explored").sum())}
    for name, (heading, digits) in METRICS.items():
        one, other = by_world(before, name), by_world(tuned, name)
        means = (f"{np.mean([*values.values()]):.{digits}f}" for values in (one, other))
        change = paired_difference(other, one)
        row[f"{heading}, before"], row[f"{heading}, after"] = means
        row[f"{heading}, difference"] = f"{change.mean:.{digits}f} [{change.low:.{digits}f}, {change.high:.{digits}f}]"
    return row


if __name__ == "__main__":
    main()
