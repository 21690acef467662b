"""By how much does the time order of covariance intersection matter? U fused forwards against backwards.

    python docs/studies/virtual_map_order.py

Writes the relative difference of U at the end of calibration trials to virtual-map-order.csv for docs/protocol.md.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from explore_bench.analysis.statistics import mean_interval
from explore_bench.robot.virtual_map import VirtualMap
from explore_bench.trial.loop import rollout
from explore_bench.trial.seeding import stream
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenarios import PAPER

WORLDS = 20


def difference(size: float, trial: int) -> float:
    """(U backwards − U forwards) / U forwards at the end of a trial of random choices."""
    scenario = PAPER.replace(size=size)
    world, motion, sensor, strategy = (
        stream("calibrate", 0, size, trial, role) for role in ("world", "motion", "sensor", "strategy")
    )
    events = rollout(scenario, draw_world(scenario, world), motion, sensor)
    choice = None
    try:
        while True:
            event = events.send(choice)
            candidates = getattr(event, "candidates", None)
            choice = None if candidates is None else int(strategy.integers(len(candidates)))
    except StopIteration as stop:
        belief = stop.value.belief
    backwards = VirtualMap(scenario)
    every = np.ones(len(belief.poses), dtype=bool)
    backwards.fuse(belief.poses[::-1].copy(), belief.pose_covariances[::-1].copy(), every)
    return backwards.uncertainty / belief.uncertainty - 1.0


def main() -> None:
    """Print and write the mean difference at 20 and 40 m with its interval."""
    rows = []
    for size in (20.0, 40.0):
        values = np.array([difference(size, trial) for trial in range(WORLDS)])
        estimate = mean_interval(values)
        rows.append({"size_m": size, "worlds": WORLDS, "mean": estimate.mean, "low": estimate.low})
        rows[-1] |= {"high": estimate.high, "largest": float(np.abs(values).max())}
    table = pd.DataFrame(rows)
    table.to_csv(Path(__file__).with_name("virtual-map-order.csv"), index=False, float_format="%.6f")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
