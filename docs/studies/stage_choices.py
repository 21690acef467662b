"""What the choices behind the lidar worlds do to a trial, one changed at a time.

    python docs/studies/stage_choices.py [--store FOLDER]

`nearest` explores the same calibration scenes under every variant. The study resumes from its store and writes
stage-choices.csv beside this file; docs/stage.md tells more.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from explore_bench.analysis.metrics import absolute_trajectory_error, finished, pose_nees
from explore_bench.analysis.statistics import mean_interval
from explore_bench.records.encoding import TrialRecord
from explore_bench.records.store import Store, missing
from explore_bench.runs.runner import default_workers, execute
from explore_bench.runs.suites import plan
from explore_bench.world.scenarios import load_scenario

SCENES = 12

VARIANTS: dict[str, Mapping[str, Any]] = {
    "as shipped": {},
    "720 beams": {"beams": 720},
    "known after 3 beams": {"known_after": 3},
    "map of 5 cm": {"map_resolution": 0.05},
    "dynamic window": {"local_planner": "dwa"},
    "odometry without white noise": {"odometry_noise": 0.0, "heading_noise": 0.0},
    "odometry noise × 3": {"odometry_noise": 0.06, "heading_noise": 0.06},
    "exact ranges": {"range_sigma": 0.0},
    "range of 5 m": {"sensor_range": 5.0},
    "5 m, nothing returned clears nothing": {"sensor_range": 5.0, "no_return_clears": False},
    "5 m, the same, known after 3 beams": {"sensor_range": 5.0, "no_return_clears": False, "known_after": 3},
}

HERE = Path(__file__).parent


def main() -> None:
    """Run the variants and print a line of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", type=Path, default=Path("results/calibration"))
    store = Store(parser.parse_args().store)
    store.open(0, "calibrate", scenario=None)
    base, rows = load_scenario("stage"), []
    for name, changes in VARIANTS.items():
        specs = plan("smoke", ["nearest"], trials=SCENES, scenario=base.replace(**changes), purpose="calibrate").specs
        own = [dataclasses.replace(spec, scenario_name=name) for spec in specs]
        for _ in execute(list(missing(store, own)), store, default_workers()):
            pass
        rows.append({"variant": name, "scenes": SCENES, **summary([store.find(spec) for spec in own])})
        print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "stage-choices.csv", index=False)


def summary(records: list[TrialRecord]) -> dict[str, Any]:
    """Return how many trials explored, and means with 95 % intervals of time, way and error."""
    done = [record for record in records if finished(record)]
    columns = {
        "T98 [s]": (1, [float(record.steps["seconds"][-1]) for record in done]),
        "L90 [m]": (1, [_length_at(record, 0.9) for record in done]),
        "L98 [m]": (1, [_length_at(record, 0.98) for record in done]),
        "decisions": (1, [float(record.steps["decisions"][-1]) for record in done]),
        "ATE [m]": (4, [absolute_trajectory_error(record) for record in done]),
        "NEES": (2, [pose_nees(record) for record in done]),
    }
    row: dict[str, Any] = {"explored": len(done)}
    for name, (digits, values) in columns.items():
        mean = mean_interval(np.array(values))
        row[name] = f"{mean.mean:.{digits}f} [{mean.low:.{digits}f}, {mean.high:.{digits}f}]"
    row["worst ATE [m]"] = round(max(columns["ATE [m]"][1]), 4)
    row["closures"] = sum(int(record.steps["closures"][-1]) for record in done)
    row["false"] = sum(int(record.steps["false_closures"][-1]) for record in done)
    row["contacts"] = sum(int(record.steps["collisions"][-1]) for record in done)
    return row


def _length_at(record: TrialRecord, share: float) -> float:
    return float(record.steps["path_length"][np.argmax(record.steps["explored"] >= share)])


if __name__ == "__main__":
    main()
