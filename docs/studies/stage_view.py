"""What walls that hide are worth: strategies that know what is in view, and the same seeing through walls.

    python docs/studies/stage_view.py [--scenes N]

Both explore the same calibration scenes. The study writes stage-view.csv beside this file; docs/stage.md tells more.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from explore_bench.analysis.statistics import mean_interval
from explore_bench.geometry import Array
from explore_bench.robot.lidar.graph import LidarGraph
from explore_bench.runs.suites import plan
from explore_bench.trial.run import run_trial
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import load_scenario

SCENES = 8

STRATEGIES = ("entropy", "graph-stnn", "belief-attention")

WORLDS = {
    "dense, range 5 m": {"sensor_range": 5.0},
    "office": {"scene": "office"},
    "rooms": {"scene": "rooms"},
}

HERE = Path(__file__).parent


def through_walls(graph: LidarGraph, scenario: Scenario, places: Array) -> NDArray[np.bool_]:
    """Return all that is in range, as `LidarGraph.view` would if nothing hid anything."""
    return scenario.grid.in_reach(places, scenario.sensor_range)


def main() -> None:
    """Run both and print a line of each strategy and kind of scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=SCENES)
    scenes = parser.parse_args().scenes
    base, rows = load_scenario("stage"), []
    for world, changes in WORLDS.items():
        for strategy in STRATEGIES:
            hidden = lengths(strategy, base.replace(**changes), scenes)
            with patch.object(LidarGraph, "view", through_walls):
                seen = lengths(strategy, base.replace(**changes), scenes)
            row = {"scenes": f"{scenes} × {world}", "strategy": strategy}
            for name, values in (("L90 [m]", hidden), ("through walls [m]", seen), ("difference [m]", hidden - seen)):
                mean = mean_interval(values)
                row[name] = f"{mean.mean:.1f} [{mean.low:.1f}, {mean.high:.1f}]"
            rows.append(row)
            print(", ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "stage-view.csv", index=False)


def lengths(strategy: str, scenario: Scenario, scenes: int) -> Array:
    """Way until 90 % of each calibration scene is known [m], the whole way where it never is, shape (scenes,)."""
    specs = plan("smoke", [strategy], trials=scenes, scenario=scenario, purpose="calibrate").specs
    found = []
    for spec in specs:
        if not spec.training_seed:  # the first of several
            steps = run_trial(spec).steps
            found.append(next((row.path_length for row in steps if row.explored >= 0.9), steps[-1].path_length))
    return np.array(found)


if __name__ == "__main__":
    main()
