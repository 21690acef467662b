"""Plan the tours of the benchmark's worlds, which the references drive and regret is measured by.

    python docs/studies/tours.py [--workers N] [--sizes 20 30 40] [--worlds N]

It plans each world of the suite `paper` as a trial would, from its first decision, and writes
baselines/reference/tours.csv; docs/clairvoyant.md tells more. Rows of other sizes and worlds stay.
"""

from __future__ import annotations

import argparse

import pandas as pd
from joblib import Parallel, delayed

from baselines.reference.clairvoyant import COLUMNS, TOURS, planned, planned_for_accuracy, site_of
from explore_bench import PAPER, Observation, draw_world, rollout, scenario_digest, stream
from explore_bench.runs.suites import SUITES


def row(size: float, trial: int) -> dict[str, object]:
    """Plan one world; a line of the file."""
    scenario = PAPER.replace(size=size)
    drawn, motion, sensor = (stream("evaluate", 0, size, trial, role) for role in ("world", "motion", "sensor"))
    world = draw_world(scenario, drawn)
    observation = next(event for event in rollout(scenario, world, motion, sensor) if isinstance(event, Observation))
    site = site_of(observation, world)
    tour, bound = planned(site, scenario)
    accurate = planned_for_accuracy(site, observation, world, tour)
    views = (" ".join(map(str, way.tolist())) for way in (tour.views, accurate))
    values = scenario_digest(scenario), world.digest, f"{size:g}", trial, bound, f"{tour.steps:g}", *views
    return dict(zip(COLUMNS, values, strict=True))


def main() -> None:
    """Plan the worlds asked for and put them in the place of those stored."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--sizes", type=float, nargs="+", default=SUITES["paper"].sizes)
    parser.add_argument("--worlds", type=int, default=SUITES["paper"].trials)
    asked = parser.parse_args()
    worlds = [(size, trial) for size in asked.sizes for trial in range(asked.worlds)]
    table = pd.DataFrame(Parallel(asked.workers)(delayed(row)(*one) for one in worlds), columns=list(COLUMNS))
    if TOURS.exists():
        known = pd.read_csv(TOURS, dtype=str).astype({"trial": int, "bound": int})
        table = pd.concat((table, known)).drop_duplicates(["scenario", "world"])
    table["order"] = table["size"].astype(float)
    table = table.sort_values(["order", "trial"]).drop(columns="order")
    table.to_csv(TOURS, index=False, lineterminator="\n")
    print(table.groupby("size")[["bound", "steps"]].agg(lambda values: values.astype(float).mean()).to_string())


if __name__ == "__main__":
    main()
