"""How near the scenario `chen2020` comes to the code of Chen et al. 2020 ([8]).

    python docs/studies/chen2020.py [--worlds N]

Every strategy that has a counterpart there, and two more, play the same worlds. What is compared is the number of steps
until more than 85 % are known, and the entropy of the map then as [8] sums it: −Σ p ln p over all cells, less what the
cells beyond the border would have if nothing were known of them. It writes chen2020.csv beside this file;
docs/chen2020.md has the table.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from explore_bench.runs.suites import plan
from explore_bench.trial.run import TrialResult, run_trial
from explore_bench.trial.snapshot import unpack_map
from explore_bench.world.scenarios import CHEN_2020

WORLDS = 50
HERE = Path(__file__).parent


class Theirs(NamedTuple):
    """Steps in [8]'s worlds: mean, standard deviation and number of worlds; mean entropy at the end [nat]."""

    steps: float
    deviation: float
    worlds: int
    entropy: float


THEIRS = {
    "nearest": Theirs(151.0, 15.0, 20, 55.0),
    "random": Theirs(282.0, 40.0, 20, 58.6),
    "gcn-no-obs": Theirs(158.5, 19.4, 50, math.nan),
}
"""The first two were measured with [8]'s public C++ code, the last is its network as published."""

STRATEGIES = (*THEIRS, "uncertainty", "graph-stnn")


def final_entropy(result: TrialResult) -> float:
    """Entropy of the map at the end as [8] sums it [nat]."""
    scenario = CHEN_2020
    last = result.snapshots[max(result.snapshots)]
    probability = np.nan_to_num(unpack_map(last.map, scenario.grid.shape), nan=0.5)
    beyond = scenario.cell_count - scenario.inside.sum()
    return float(-(probability * np.log(probability)).sum() + 0.5 * math.log(0.5) * beyond)


def difference(steps: np.ndarray, theirs: Theirs) -> tuple[float, float, float]:
    """Mean of ours less theirs, with Welch's 95 % interval."""
    own, other = steps.var(ddof=1) / len(steps), theirs.deviation**2 / theirs.worlds
    freedom = (own + other) ** 2 / (own**2 / (len(steps) - 1) + other**2 / (theirs.worlds - 1))
    mean, half = steps.mean() - theirs.steps, stats.t.ppf(0.975, freedom) * math.sqrt(own + other)
    return float(mean), float(mean - half), float(mean + half)


def row(name: str, worlds: int) -> dict[str, object]:
    """Play one strategy; a line of the table."""
    specs = [
        spec
        for spec in plan("table2", [name], trials=worlds, scenario=CHEN_2020, scenario_name="chen2020").specs
        if not spec.training_seed
    ]
    results = [run_trial(spec) for spec in specs]
    assert all(result.status == "explored" for result in results), [result.reason for result in results]
    steps = np.array([result.steps[-1].step for result in results], dtype=float)
    entropy = np.array([final_entropy(result) for result in results])
    line: dict[str, object] = {
        "strategy": f"`{name}`",
        "worlds": worlds,
        "steps": f"{steps.mean():.1f} ± {steps.std(ddof=1):.1f}",
        "entropy [nat]": f"{entropy.mean():.1f} ± {entropy.std(ddof=1):.1f}",
        "steps in [8]": "–",
        "entropy in [8] [nat]": "–",
        "steps, ours less theirs": "–",
    }
    if name in THEIRS:
        theirs = THEIRS[name]
        mean, low, high = difference(steps, theirs)
        line["steps in [8]"] = f"{theirs.steps:g} ± {theirs.deviation:g} ({theirs.worlds} worlds)"
        line["entropy in [8] [nat]"] = "–" if math.isnan(theirs.entropy) else f"{theirs.entropy:g}"
        line["steps, ours less theirs"] = f"{mean:+.1f} [{low:.1f}, {high:.1f}]"
    return line


def main() -> None:
    """Play and print a line a strategy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=WORLDS)
    worlds, rows = parser.parse_args().worlds, []
    for name in STRATEGIES:
        rows.append(row(name, worlds))
        print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "chen2020.csv", index=False)


if __name__ == "__main__":
    main()
