"""The same search of hyper-parameters for the paper's network and both of [8]: 20 configurations each.

    python docs/studies/search.py [--out FOLDER] [--workers N]

A configuration is a width, a dropout, γ, a rate and a length; the first is the shipped one, the others are one Latin
hypercube, the same for all three. Each is trained with one seed and judged by its best validation, on the worlds that
choose the weights of every training; no world of the benchmark is seen. It is successive halving (Jamieson and
Talwalkar 2016) with one cut: all are trained for 1,000 episodes, the best five and the shipped one to their length.
Trainings resume from FOLDER, and what search-cut.csv beside this file has of the first 1,000 episodes is not done
again; all of them take some hours of a core. Writes search-cut.csv and search.csv.

The best of twenty by one seed is the luckiest as well. So the best one but the shipped is trained with two more seeds,
and its three play 100 validation worlds at 20 m and 50 at 40 m that chose nothing, beside the shipped weights of the
same seeds: search-margins.csv has the differences of log e − log η, averaged over seeds, paired by world.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
from scipy.stats import qmc

from baselines.learned import gcn, graph_stnn
from baselines.learned.checkpoint import load_weights
from baselines.training import train
from explore_bench import PAPER, validations_path
from explore_bench.analysis.statistics import mean_interval
from explore_bench.strategies.entry import parse_factory, weights_file
from explore_bench.strategies.registry import strategies
from explore_bench.trial.decision_process import Course

NAMES = ("graph-stnn", "gcn-obs", "gcn-no-obs")
COUNT = 20
ROOT = 2021
WIDTHS = (32, 64, 128)
DROPOUTS = (0.0, 0.1, 0.2, 0.3, 0.5)
DISCOUNTS = (0.8, 0.9, 0.95, 0.99)
RATES = (1e-4, 8e-3)
LENGTHS = (1500, 3000, 4500)
CUT = 1000
"""Episodes after which it is decided who goes on."""

KEPT = 5
SEEDS = 3
"""Training seeds that the best and the shipped configuration are compared with."""

WORLDS = {20.0: 100, 40.0: 50}
HERE = Path(__file__).parent
BY = ["strategy", "configuration"]


@dataclass(frozen=True)
class Configuration:
    """What the search varies.

    Attributes
    ----------
    width : channels of the network.
    dropout : share of channels dropped: at the start (Graph-STNN), in the loss (GCN).
    discount : γ.
    rate : step size of Adam at the start; it falls to the same share of it as with the shipped settings.
    episodes : length; what falls with time falls over the same share of it as with the shipped settings.
    """

    width: int
    dropout: float
    discount: float
    rate: float
    episodes: int


def shipped(name: str) -> Configuration:
    """Return the configuration with which a strategy's weights were made."""
    recipe = _recipe(name)
    settings: Any = recipe.settings
    width = graph_stnn.CHANNELS if recipe.network is graph_stnn.GraphSTNN else gcn.CHANNELS
    return Configuration(width, settings.dropout, settings.discount, settings.rate, recipe.episodes)


def drawn() -> list[Configuration]:
    """Draw all but the shipped configuration: one Latin hypercube, rates evenly in their logarithm."""

    def pick(values: tuple, share: float) -> Any:
        return values[int(share * len(values))]

    low, high = map(math.log, RATES)
    return [
        Configuration(
            width=pick(WIDTHS, shares[0]),
            dropout=pick(DROPOUTS, shares[1]),
            discount=pick(DISCOUNTS, shares[2]),
            rate=float(f"{math.exp(low + shares[3] * (high - low)):.2g}"),
            episodes=pick(LENGTHS, shares[4]),
        )
        for shares in qmc.LatinHypercube(5, rng=ROOT).random(COUNT - 1)
    ]


def recipe_of(name: str, configuration: Configuration) -> train.Recipe:
    """Turn the recipe of a strategy into that of a configuration."""
    recipe = _recipe(name)
    settings: Any = recipe.settings
    wanted = replace(
        settings,
        dropout=configuration.dropout,
        discount=configuration.discount,
        rate=configuration.rate,
        final_rate=configuration.rate * settings.final_rate / settings.rate,
        decay=round(settings.decay * configuration.episodes / recipe.episodes),
    )
    network: Callable[..., Any] = partial(recipe.network, channels=configuration.width)
    return replace(recipe, network=network, settings=wanted, episodes=configuration.episodes)


def _recipe(name: str) -> train.Recipe:
    return train.RECIPES[parse_factory(strategies()[name].factory)[0]]


def trained(name: str, number: int, configuration: Configuration, out: Path, episodes: int, seed: int = 0) -> Path:
    """Train a configuration for at most so many episodes; returns its best weights until then."""
    entry = replace(strategies()[name], factory="search:none")
    train.RECIPES["search"] = recipe_of(name, configuration)
    return train.train(name, entry, seed, episodes, True, out / f"{name}-{number:02d}", lambda line: None)


def tried(name: str, number: int, configuration: Configuration, out: Path, episodes: int) -> dict[str, object]:
    """Train a configuration for at most so many episodes and say what its best validation until then was."""
    wanted = min(episodes, configuration.episodes)
    path = trained(name, number, configuration, out, wanted)
    validations = pd.read_csv(validations_path(path))
    best = validations[validations["episodes"] <= wanted].sort_values("objective").iloc[0]
    row = {"strategy": name, "configuration": number, **asdict(configuration), "trained": wanted}
    row |= {"best_after": int(best["episodes"]), "objective": best["objective"]}
    print(row, flush=True)
    return row


def objectives(network: Any, weights: Path, size: float) -> np.ndarray:
    """Log e − log η of weights in each of the worlds that chose nothing, shape (WORLDS[size],)."""
    load_weights(network, weights)
    course = Course(PAPER.replace(size=size), "validate", 1)
    scores = np.array([episode.score(course.scenario) for episode in train.greedy(network, course, WORLDS[size])])
    return np.log(scores[:, 2]) - np.log(scores[:, 1])


def margins(name: str, number: int, configuration: Configuration, out: Path) -> list[dict[str, object]]:
    """Compare a configuration with the shipped weights, a row a size; a difference below 0 is in its favour."""
    entry, seeds = strategies()[name], range(SEEDS)
    recipes = {"best": recipe_of(name, configuration), "shipped": _recipe(name)}
    weights = {
        "best": [trained(name, number, configuration, out, configuration.episodes, seed) for seed in seeds],
        "shipped": [weights_file(entry.weights[seed]) for seed in seeds],
    }
    rows = []
    for size, count in WORLDS.items():
        played = {
            side: np.array([objectives(recipes[side].network(**entry.parameters), path, size) for path in paths])
            for side, paths in weights.items()
        }
        estimate = mean_interval((played["best"] - played["shipped"]).mean(axis=0))
        row: dict[str, object] = {"strategy": name, "configuration": number, "size": size, "worlds": count}
        row |= {side: values.mean() for side, values in played.items()}
        row |= {"difference": estimate.mean, "low": estimate.low, "high": estimate.high}
        row |= {f"{side}, seed {seed}": played[side][seed].mean() for side in played for seed in seeds}
        print(row, flush=True)
        rows.append(row)
    return rows


def main() -> None:
    """Train all configurations, the longest first, and write the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/search"))
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    jobs = [
        (name, number, configuration)
        for name in NAMES
        for number, configuration in enumerate([shipped(name), *drawn()])
    ]
    jobs.sort(key=lambda job: -job[2].width)

    def all_of(some: list[tuple[str, int, Configuration]], episodes: int) -> list[dict[str, Any]]:
        parallel = joblib.Parallel(n_jobs=asked.workers, batch_size=1)
        return list(parallel(joblib.delayed(tried)(*job, asked.out, episodes) for job in some))

    cut = HERE / "search-cut.csv"
    done = pd.read_csv(cut) if cut.exists() else pd.DataFrame(columns=BY)
    known = set(done[BY].itertuples(index=False, name=None))
    first = pd.concat([done, pd.DataFrame(all_of([job for job in jobs if job[:2] not in known], CUT))])
    first = first.sort_values([BY[0], "objective"])
    first.to_csv(cut, index=False, float_format="%.6g")
    order = first.groupby("strategy")["objective"].rank()
    kept = first[(order <= KEPT) | (first["configuration"] == 0)]
    going_on = set(kept[BY].itertuples(index=False, name=None))
    rows = all_of([job for job in jobs if job[:2] in going_on], max(LENGTHS))
    table = first.merge(
        pd.DataFrame(rows)[[*BY, "trained", "best_after", "objective"]], on=BY, how="left", suffixes=("_at_the_cut", "")
    ).sort_values([BY[0], "objective", "objective_at_the_cut"])
    table.to_csv(HERE / "search.csv", index=False, float_format="%.4g")
    print(table.to_string(index=False))
    best = table[table["configuration"] != 0].groupby("strategy").head(1)
    wanted = set(best[BY].itertuples(index=False, name=None))
    others = [job for job in jobs if job[:2] in wanted]
    found = joblib.Parallel(n_jobs=asked.workers, batch_size=1)(
        joblib.delayed(margins)(*job, asked.out) for job in others
    )
    pd.DataFrame([row for rows in found for row in rows]).to_csv(
        HERE / "search-margins.csv", index=False, float_format="%.4g"
    )


if __name__ == "__main__":
    main()
