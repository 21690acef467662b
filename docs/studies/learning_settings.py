"""Compare settings of Graph-STNN's learning: one training seed each, judged on validation worlds of another root.

    python docs/studies/learning_settings.py [--out FOLDER]

Trainings resume from FOLDER. Writes learning-settings.csv beside this file; docs/learning.md tells what came of it.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.learned import graph_stnn
from baselines.learned.checkpoint import load_weights
from baselines.training import train
from baselines.training.episodes import Course
from baselines.training.returns import ReturnsSettings
from explore_bench.registry import strategies
from explore_bench.scenario import PAPER

MODULE = "baselines.learned.graph_stnn"
BEFORE = ReturnsSettings(rate=1e-3, final_rate=1e-4, decay=10_000)
VARIANTS = {
    "rate 0.001": BEFORE,
    "rate 0.001, 4 episodes an update": dataclasses.replace(BEFORE, episodes_per_update=4),
    "rate 0.003": dataclasses.replace(BEFORE, rate=3e-3),
    "rate 0.003, γ 0.95": dataclasses.replace(BEFORE, rate=3e-3, discount=0.95),
    "rate 0.006": dataclasses.replace(BEFORE, rate=6e-3),
    "rate 0.001, 32 channels": BEFORE,
}
EPISODES = {"rate 0.001": 5000, "rate 0.001, 32 channels": 5000}
FEW = 3000  # episodes of the others
WORLDS = {20.0: 100, 40.0: 16}


def result(name: str, settings: ReturnsSettings, out: Path) -> dict[str, object]:
    """Train one variant and play its best weights."""
    channels = 32 if "32 channels" in name else 64
    graph_stnn.CHANNELS = graph_stnn.HEAD_CHANNELS = channels
    train.RECIPES[MODULE] = dataclasses.replace(train.RECIPES[MODULE], settings=settings)
    entry, episodes = strategies()["graph-stnn"], EPISODES.get(name, FEW)
    path = train.train("graph-stnn", entry, 0, episodes, True, out / name.replace(" ", "-"), print)
    network = graph_stnn.GraphSTNN()
    load_weights(network, path)
    row: dict[str, object] = {"variant": name, "episodes": episodes}
    for size, count in WORLDS.items():
        course = Course(PAPER.replace(size=size), "validate", 1)
        scores = np.array([episode.score(course.scenario) for episode in train.greedy(network, course, count)])
        objective = (np.log(scores[:, 2]) - np.log(scores[:, 1])).mean()
        means = dict(zip(("T", "η", "e"), scores.mean(axis=0), strict=True))
        row |= {f"{key}, {size:g} m": value for key, value in means.items()} | {f"objective, {size:g} m": objective}
    return row


def main() -> None:
    """Run all variants."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/learning"))
    out = parser.parse_args().out
    table = pd.DataFrame([result(name, settings, out) for name, settings in VARIANTS.items()])
    table.to_csv(Path(__file__).with_name("learning-settings.csv"), index=False, float_format="%.4g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
