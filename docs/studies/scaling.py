"""How cost, memory and metrics grow with the size of the map, from 20 to 200 m.

    python docs/studies/scaling.py [--workers N] [--out FOLDER] [-s STRATEGY ...] [--sizes 20 40 60 100 200]
        [--worlds 3] [--steps N]

Each trial runs in a process of its own, on calibration worlds, until its map is explored or --steps are taken. A trial
that is done is not run again: FOLDER keeps one row a trial. Writes scaling.csv, means by strategy and size, beside this
file, and scaling.png and .svg into docs/images.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from explore_bench import PAPER, Observation, draw_world, rollout, stream
from explore_bench.analysis.ranking import COMPARED
from explore_bench.errors import describe
from explore_bench.files import write_whole
from explore_bench.report.drawing import entry_of, plain_log, save_all, styled
from explore_bench.runs.stopwatch import Stopwatch
from explore_bench.runs.workers.task import warm_up
from explore_bench.strategies.entry import weights_file
from explore_bench.strategies.loading import make_strategy
from explore_bench.strategies.registry import lookup
from explore_bench.trial.error_and_efficiency import score

DOCS = Path(__file__).parents[1]
WINDOW = 100
"""Steps whose mean cost stands for the end of a trial, a tenth as many decisions; of a short trial the last half."""
PARTS = ("driver", "world", "isam2", "estimate", "covariances", "virtual map", "occupancy", "row")
"""Parts of a step, as a trial tells when they are done."""


def measured(name: str, size: float, number: int, most: int) -> dict[str, Any]:
    """Run one trial for at most so many steps and tell what it cost; CPU times in ms, memory in MiB."""
    _, entry = lookup(name)
    scenario = PAPER.replace(size=size)
    drawn, motion, sensor, choosing = (
        stream("calibrate", 0, size, number, role) for role in ("world", "motion", "sensor", "strategy")
    )
    warm_up(scenario.tiny)
    weights = {"weights": str(weights_file(entry.weights[0]))} if entry.weights else {}
    strategy = make_strategy(entry.factory, {**entry.parameters, **weights})
    strategy.reset(choosing)
    watch = Stopwatch(time.process_time)
    events = rollout(scenario, draw_world(scenario, drawn), motion, sensor, watch.lap)
    answer, status, rows = None, "cut off", []
    steps: list[float] = []
    decisions: list[float] = []
    candidates: list[int] = []
    before = time.process_time()
    while len(rows) <= most:
        try:
            event = events.send(answer)
        except StopIteration as end:
            status = end.value.status.value
            break
        except Exception as error:  # the simulator's: the strategy is asked outside of this block
            status = f"broken: {describe(error)}"
            break
        now = time.process_time()
        answer = None
        if isinstance(event, Observation):
            candidates.append(len(event.candidates))
            answer = strategy.choose(event)
            decisions.append(time.process_time() - before)  # frontiers, paths and the choice
        else:
            rows.append(event)
            steps.append(now - before)
        before = time.process_time()
    last = rows[-1]
    ending = min(WINDOW, len(steps) // 2)
    final = score(status, max(last.step, 1), last.uncertainty, last.peak_trace, scenario)
    done = status == "explored"
    return {
        "strategy": name,
        "size": size,
        "world": number,
        "status": status,
        "steps": last.step,
        "explored": last.explored,
        "e": final.trajectory_error if done else np.nan,
        "eta": final.exploration_efficiency if done else np.nan,
        "step_ms": 1e3 * np.median(steps),
        "last_step_ms": 1e3 * np.mean(steps[-ending:]),
        "decision_ms": 1e3 * np.median(decisions),
        "last_decision_ms": 1e3 * np.mean(decisions[-min(WINDOW // 10, len(decisions) // 2) :]),
        "candidates": np.mean(candidates),
        "seconds": sum(steps) + sum(decisions),
        **{
            f"last_{part.replace(' ', '_')}_ms": 1e3 * np.mean([step[part] for step in watch.steps[-ending - 1 : -1]])
            for part in PARTS
        },
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def kept(folder: Path, name: str, size: float, number: int, most: int) -> dict[str, Any]:
    """Row of a trial: from its file, or measured now in a process of its own."""
    file = folder / f"{name}-{size:g}-{number}-{most}.json"
    if not file.exists():
        command = [sys.executable, __file__, "--trial", name, f"{size:g}", str(number), str(most)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        write_whole(file, done.stdout.splitlines()[-1] + "\n")
    row: dict[str, Any] = json.loads(file.read_text())
    return row


def draw(table: pd.DataFrame, place: Path) -> None:
    """Draw metrics and cost over the edge of the map; an empty circle is of trials cut off, which have no metrics.

    The strategies are those of Table 2.
    """
    panels = {"steps": "steps T", "e": "trajectory error e [m]", "eta": "efficiency η [m²/step]"}
    panels |= {"last_step_ms": "step at the end [CPU ms]", "last_decision_ms": "decision at the end [CPU ms]"}
    panels |= {"memory": "memory [MiB]"}
    metrics = ["steps", "e", "eta"]
    shown = table[[COMPARED in entry_of(name).tables for name in table["strategy"]]].copy()
    shown.loc[shown["explored_trials"] < shown["trials"], metrics] = np.nan
    with styled():
        figure, grid = plt.subplots(2, 3, figsize=(10.5, 6.6))
        for axes, (column, title) in zip(grid.flat, panels.items(), strict=True):
            for name, own in shown.groupby("strategy", sort=False):
                entry = entry_of(str(name))
                whole = own["explored_trials"] == own["trials"]
                axes.plot(own["size"], own[column].where(whole), "o-", ms=3, color=entry.color, label=entry.label)
                axes.plot(own["size"], own[column].mask(whole), "o", ms=4, mfc="none", color=entry.color)
            axes.set(title=title, xlabel="edge of the map [m]", xscale="log", yscale="log")
            axes.set_xticks(sorted(table["size"].unique()), [f"{size:g}" for size in sorted(table["size"].unique())])
            axes.minorticks_off()
            plain_log(axes.yaxis)
        handles, labels = grid[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=8)
        save_all(figure, place)


def main() -> None:
    """Run what is missing and write the table and the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("results/scaling"))
    parser.add_argument("-s", "--strategy", dest="strategies", action="append")
    parser.add_argument("--sizes", type=float, nargs="+", default=[20.0, 40.0, 60.0, 100.0])
    parser.add_argument("--worlds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=10**9)
    parser.add_argument("--trial", nargs=4, metavar=("STRATEGY", "SIZE", "WORLD", "STEPS"))
    asked = parser.parse_args()
    if asked.trial:
        name, size, number, most = asked.trial
        print(json.dumps(measured(name, float(size), int(number), int(most))))
        return
    asked.out.mkdir(parents=True, exist_ok=True)
    wanted = [
        (asked.out, name, size, number, asked.steps)
        for size in asked.sizes
        for name in asked.strategies or ["nearest"]
        for number in range(asked.worlds)
    ]
    with ThreadPoolExecutor(asked.workers) as pool:
        list(pool.map(lambda one: kept(*one), wanted))
    rows = pd.DataFrame([json.loads(file.read_text()) for file in sorted(asked.out.glob("*.json"))])
    counted = rows.assign(
        trials=1, explored_trials=rows["status"] == "explored", broken_trials=rows["status"].str.startswith("broken")
    )
    sums = counted.groupby(["strategy", "size"])[["trials", "explored_trials", "broken_trials"]].sum()
    means = rows.groupby(["strategy", "size"]).mean(numeric_only=True).drop(columns="world")
    table = sums.join(means).reset_index()
    table.to_csv(Path(__file__).with_suffix(".csv"), index=False, float_format="%.4g")
    draw(table, DOCS / "images" / "scaling")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
