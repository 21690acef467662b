"""Calibrate what the paper leaves out against Table 2: step length, odometry noise and obstacle density.

Only untrained strategies and only calibration worlds take part. A first pass looks at step length and noise with few
worlds, a second at the obstacle density of the best, a third at the best of all with more worlds. Beside each density
stands the share of random draws at 20 m that are connected, so that it is plain how random its worlds are. Run it
again with

    python docs/studies/calibration.py [--store FOLDER]

It resumes from its store. docs/calibration.md tells what came of it.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import ndimage

from explore_bench.analysis.metrics import exploration_efficiency, trajectory_error
from explore_bench.records.store import Store, missing
from explore_bench.runs.runner import default_workers, execute
from explore_bench.runs.suites import plan
from explore_bench.strategies.registry import strategies
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

STRATEGIES = ("random", "entropy", "uncertainty")
PARAMETERS = {"uncertainty": {"weight": 0.0}}  # its weight is tuned afterwards, on the physics found here
SIZES = (20.0, 40.0)
METRICS = {"trajectory_error": trajectory_error, "exploration_efficiency": exploration_efficiency}

STEP_LENGTHS = (0.5, 0.7, 1.0, 1.4)  # m
ODOMETRY_SIGMAS = (0.02, 0.04, 0.07, 0.1)  # m a straight step
OBSTACLE_DENSITIES = (1.5, 0.75, 2.0, 2.5, 3.0, 3.5)  # per cell of edge; the first pass uses the first one
FEW, MANY = 6, 30  # worlds a size
KEPT, FINALISTS = 4, 8  # settings that go on to the second and the third pass
RESAMPLES = 2000
DRAWS = 20_000

HERE = Path(__file__).parent


def misfit(scenario: Scenario, worlds: int, store: Store) -> dict[str, float]:
    """Log ratios of our means to the twelve numbers of Table 2, and their root mean square with its interval.

    The interval is a 95 % percentile bootstrap over worlds.
    """
    sums: dict[tuple[str, float, str], list[float]] = {}
    for size in SIZES:
        specs = [
            dataclasses.replace(spec, parameters=PARAMETERS.get(spec.strategy, {}))
            for spec in plan("table2", STRATEGIES, (size,), worlds, scenario=scenario, purpose="calibrate").specs
        ]
        for _ in execute(list(missing(store, specs)), store, default_workers()):
            pass
        for spec in specs:
            record = store.find(spec)
            for name, value in METRICS.items():
                sums.setdefault((spec.strategy, size, name), []).append(value(record))
    papers = np.array([strategies()[strategy].published["table2", size, metric] for strategy, size, metric in sums])
    ours = np.array(list(sums.values()))  # the twelve numbers by world
    weights = np.random.default_rng(0).multinomial(worlds, np.full(worlds, 1 / worlds), RESAMPLES) / worlds
    resampled = np.sqrt((np.log(weights @ ours.T / papers) ** 2).mean(axis=1))
    low, high = np.quantile(resampled, [0.025, 0.975])
    ratios = np.log(ours.mean(axis=1) / papers)
    rms = {"rms": math.sqrt(float((ratios**2).mean())), "low": float(low), "high": float(high)}
    names = [f"{strategy} {size:g} {metric}" for strategy, size, metric in sums]
    return rms | dict(zip(names, ratios.tolist(), strict=True))


def connected_share(density: float) -> float:
    """Share of random draws at 20 m with this obstacle density in which every free cell can be reached."""
    scenario = PAPER.replace(size=SIZES[0], obstacle_density=density)
    rng = np.random.default_rng(0)
    connected = 0
    for _ in range(DRAWS):
        blocked = np.zeros(scenario.cell_count, dtype=bool)
        blocked[rng.permutation(scenario.cell_count)[: scenario.landmarks + scenario.obstacles]] = True
        connected += ndimage.label(~blocked.reshape(scenario.grid.shape))[1] == 1
    return connected / DRAWS


def sweep(settings: list[tuple[float, float, float]], worlds: int, store: Store) -> pd.DataFrame:
    """Misfit of every setting (step length, odometry σ, obstacle density), best first."""
    rows = []
    for step_length, sigma, density in settings:
        scenario = PAPER.replace(step_length=step_length, odometry_sigma=sigma, obstacle_density=density)
        setting = {"step_length": step_length, "odometry_sigma": sigma, "obstacle_density": density}
        rows.append({**setting, "worlds": worlds, **misfit(scenario, worlds, store)})
        print(", ".join(f"{name} {value:g}" for name, value in list(rows[-1].items())[:5]), flush=True)
    return pd.DataFrame(rows).sort_values("rms", ignore_index=True)


def main() -> None:
    """Run the three passes and write calibration-coarse.csv and calibration-fine.csv beside this file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--store", type=Path, default=Path("results/calibration"))
    store = Store(parser.parse_args().store)
    store.open(0, "calibrate", scenario=None)
    first, *rest = OBSTACLE_DENSITIES
    coarse = sweep([(*pair, first) for pair in itertools.product(STEP_LENGTHS, ODOMETRY_SIGMAS)], FEW, store)
    kept = coarse[["step_length", "odometry_sigma"]].head(KEPT).to_numpy().tolist()
    others = sweep([(*pair, density) for pair in kept for density in rest], FEW, store)
    coarse = pd.concat((coarse, others)).sort_values("rms", ignore_index=True)
    coarse.to_csv(HERE / "calibration-coarse.csv", index=False, float_format="%.4f")
    best = coarse[["step_length", "odometry_sigma", "obstacle_density"]].head(FINALISTS)
    fine = sweep([tuple(row) for row in best.to_numpy().tolist()], MANY, store)
    fine.insert(3, "connected_draws", [connected_share(density) for density in fine["obstacle_density"]])
    fine.to_csv(HERE / "calibration-fine.csv", index=False, float_format="%.4f")
    print(fine.round(3).to_string())


if __name__ == "__main__":
    main()
