"""What the grid of decisions costs: the nearest candidate, and the nearest of all frontiers of the fine map.

    python docs/studies/stage_frontiers.py [--scenes N]

Both explore the same calibration scenes. The study writes stage-frontiers.csv beside this file;
docs/stage.md tells more.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from stage_view import WORLDS, lengths

from explore_bench.analysis.statistics import mean_interval
from explore_bench.robot.lidar.frontiers import Frontier
from explore_bench.robot.lidar.navigator import Navigator, Offer
from explore_bench.robot.lidar.terrain import Ways, length_of
from explore_bench.world.scenarios import load_scenario

SCENES = 12

HERE = Path(__file__).parent


def main() -> None:
    """Run both and print a line of each kind of scene."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=SCENES)
    scenes = parser.parse_args().scenes
    base, rows = load_scenario("stage"), []
    offer = Navigator._offer
    for world, changes in {"dense": {}, **WORLDS}.items():
        farther: list[float] = []  # than the nearest of all frontiers, for every decision

        def compared(own: Navigator, found: list[Frontier], ways: Ways, farther: list[float] = farther) -> Offer:
            made = offer(own, found, ways)
            farther.append(float(made.lengths.min() - min(_length(frontier, ways, own) for frontier in found)))
            return made

        def nearest_alone(own: Navigator, found: list[Frontier], ways: Ways) -> Offer:
            return offer(own, [min(found, key=lambda frontier: _length(frontier, ways, own))], ways)

        scenario = base.replace(**changes)
        with patch.object(Navigator, "_offer", compared):
            candidates = lengths("nearest", scenario, scenes)
        with patch.object(Navigator, "_offer", nearest_alone):
            frontiers = lengths("nearest", scenario, scenes)
        other = np.array(farther) > 1e-9
        row = {
            "scenes": f"{scenes} × {world}",
            "decisions": len(farther),
            "another frontier": f"{other.mean():.1%}",
            "then farther by [m]": f"{np.array(farther)[other].mean():.2f}" if other.any() else "–",
        }
        for name, values in (
            ("L90, candidates [m]", candidates),
            ("L90, all frontiers [m]", frontiers),
            ("difference [m]", candidates - frontiers),
        ):
            mean = mean_interval(values)
            row[name] = f"{mean.mean:.1f} [{mean.low:.1f}, {mean.high:.1f}]"
        rows.append(row)
        print(", ".join(f"{key} {value}" for key, value in row.items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "stage-frontiers.csv", index=False)


def _length(frontier: Frontier, ways: Ways, navigator: Navigator) -> float:
    grid = navigator.terrain.grid
    return float(length_of(ways.to(frontier.goal), grid.columns, grid.resolution))


if __name__ == "__main__":
    main()
