"""What the window of the lidar SLAM, and from where its matches are measured, do to its errors, on the same scans.

    python docs/studies/stage_slam.py

`nearest` explores ten calibration scenes once; its scans and its odometry are then taken in anew with other constants.
The study writes stage-slam.csv beside this file; docs/stage.md tells more. Two minutes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pandas as pd

from explore_bench.geometry import Pose, wrap_angle
from explore_bench.robot.lidar import slam
from explore_bench.robot.lidar.mapper import Mapper
from explore_bench.strategies.contract import Observation
from explore_bench.trial.lidar import explorer
from explore_bench.trial.loop import rollout
from explore_bench.trial.seeding import stream
from explore_bench.world.kinds import draw_world
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import RangeScan

SCENES = 10

SETTINGS: dict[str, dict[str, Any]] = {
    "as shipped": {"WINDOW": slam.WINDOW},
    **{f"window of {window}": {"WINDOW": window} for window in (1, 5, 10, 20, 40, 120)},
    "measured from the pose before": {"anchor_at": lambda number, newest: newest - 1},
    "measured from 25 poses before": {"anchor_at": lambda number, newest: max(newest - 25, 0) // 5 * 5},
    "measured from 50 poses before": {"anchor_at": lambda number, newest: max(newest - 50, 0) // 5 * 5},
}

HERE = Path(__file__).parent
Update = tuple[Pose, float, float, RangeScan]


def main() -> None:
    """Record the drives, run the settings and print a line of each."""
    scenario = LidarScenario()
    drives = [recorded(scenario, trial) for trial in range(SCENES)]
    rows = []
    for name, changes in SETTINGS.items():
        with patch.multiple(slam, **changes):
            rows.append({"setting": name, **errors(scenario, drives)})
        print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "stage-slam.csv", index=False, float_format="%.4f")


def recorded(scenario: LidarScenario, trial: int) -> tuple[list[Update], np.ndarray]:
    """Return all that SLAM was given in an exploration, its start first, and the true key poses, shape (N, 3)."""
    given: list[Any] = []

    class Recorder(Mapper):
        def __init__(self, scenario: LidarScenario, start: Pose, scan: RangeScan, *rest: Any) -> None:
            given.append((start, 0.0, 0.0, scan))
            super().__init__(scenario, start, scan, *rest)

        def update(self, *values: Any) -> float:
            given.append(values)
            return super().update(*values)

    def generator(role: Any) -> np.random.Generator:
        return stream("calibrate", 0, scenario.size, trial, role)

    truth: list[Pose] = []
    with patch.object(explorer, "Mapper", Recorder):
        events = rollout(scenario, draw_world(scenario, generator("world")), generator("motion"), generator("sensor"))
        choice = None
        while True:
            try:
                event = events.send(choice)
            except StopIteration:
                return given, np.array(truth)
            choice = None
            if isinstance(event, Observation):
                choice = int(np.argmin(event.path_lengths))
            else:
                truth.append((event.true_x, event.true_y, event.true_heading))


def errors(scenario: LidarScenario, drives: list[tuple[list[Update], np.ndarray]]) -> dict[str, float]:
    """Return means over the drives of ATE [m], heading error [°] and NEES of key poses, and the largest error [m]."""
    rows = []
    for given, truth in drives:
        own = slam.Slam(scenario, given[0][0], given[0][3])
        for update in given[1:]:
            own.update(*update)
        own.refresh()
        error = own.poses - truth
        error[:, 2] = [wrap_angle(angle) for angle in error[:, 2].tolist()]
        away = np.hypot(error[:, 0], error[:, 1])
        nees = np.einsum("ti,ti->t", error, np.linalg.solve(own.covariances, error[..., None])[..., 0])
        rows.append((np.sqrt((away**2).mean()), np.degrees(np.abs(error[:, 2]).mean()), nees[1:].mean(), away.max()))
    ate, heading, nees_, worst = np.array(rows).T
    return {"ATE [m]": ate.mean(), "heading [°]": heading.mean(), "NEES": nees_.mean(), "worst [m]": worst.max()}


if __name__ == "__main__":
    main()
