"""What holds learning back: other rewards, returns, features and learning rules, one training seed each.

    python docs/studies/learning_causes.py [--out FOLDER] [VARIANT ...]

Without a VARIANT all are trained and judged anew; with some the rows of the others stay. They are judged on validation
worlds of another root than those that chose their weights; shipped weights of every training seed, rules and untrained
strategies play the same worlds. Trainings resume from FOLDER. Writes learning-causes.csv beside this file;
docs/learning.md tells what came of it.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch import Tensor, nn

from baselines.learned.belief_attention import CHANNELS, BeliefAttention
from baselines.learned.candidate_features import CandidateBatch
from baselines.learned.checkpoint import load_weights
from baselines.learned.graph import ExplorationGraph, exploration_graph
from baselines.learned.graph_stnn import GraphSTNN
from baselines.learned.layers import GraphBatch, Noise, NoisyLinear
from baselines.training import train
from baselines.training.episodes import Episode, play
from baselines.training.policy_gradient import PolicyGradientLearner, PolicyGradientSettings
from baselines.training.returns import ReturnsLearner, ReturnsSettings
from explore_bench import Observation
from explore_bench.strategies.entry import parse_factory, weights_file
from explore_bench.strategies.loading import make_strategy
from explore_bench.strategies.registry import strategies
from explore_bench.trial.decision_process import Course
from explore_bench.trial.reward import RewardWeights
from explore_bench.world.scenarios import PAPER

EPISODES = 3000
WORLDS = {20.0: 100, 40.0: 16}
UNTRAINED = ("nearest", "entropy", "uncertainty")
SHIPPED = ("graph-stnn", "belief-attention")


def loud(sigma: float) -> GraphSTNN:
    """Graph-STNN whose noisy layer begins with another σ₀ than 0.5."""
    network = GraphSTNN()
    inputs = network.noisy.sigma_weight.shape[1]
    network.noisy = NoisyLinear(inputs, network.noisy.sigma_weight.shape[0], sigma)
    return network


class GraphPolicy(GraphSTNN):
    """Graph-STNN without its state encoder as a policy: preferences from its head, a value from its pooled features."""

    def __init__(self, **switches: Any) -> None:
        super().__init__(state=False, **switches)
        pooled = 3 * self.embed.out_features
        self.critic = nn.Sequential(nn.Linear(pooled, CHANNELS), nn.ReLU(), nn.Linear(CHANNELS, 1))

    def preferences_and_value(self, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """Preferences of the candidates (B, C), −∞ where padded, and the value of the state (B,)."""
        shown, pooled = self.encode(batch)
        return self.judge(batch, shown, pooled, None), self.critic(pooled).squeeze(-1)


class PlusValues(BeliefAttention):
    """Our extension's features and attention with the noisy head of Graph-STNN: values that learn from returns."""

    def __init__(self) -> None:
        super().__init__()
        self.noisy, self.head = NoisyLinear(CHANNELS, CHANNELS), nn.Linear(CHANNELS, 1)

    def forward(self, batch: CandidateBatch, hidden: Tensor, noise: Noise | None = None) -> tuple[Tensor, Tensor]:
        """Values of the candidates (B, C), −∞ where padded, and the hidden state as given."""
        shown = self.encode(batch)
        if noise is not None:
            shown = shown * noise.kept.unsqueeze(1)
        return batch.masked(self.head(torch.relu(self.noisy(shown, noise))).squeeze(-1)), hidden

    def noise(self, rngs: list, rate: float) -> Noise:
        """Exploration noise for one episode of each generator."""
        return Noise.draw(rngs, CHANNELS, CHANNELS, rate)


RETURNS = ReturnsSettings(decay=EPISODES)
GRADIENT = PolicyGradientSettings(decay=EPISODES)
FAITHFUL = train.Recipe(GraphSTNN, ReturnsLearner, RETURNS, EPISODES)


VARIANTS: dict[str, train.Recipe] = {
    "Eq. 4, returns": FAITHFUL,
    "the same, ω₁ = 2": dataclasses.replace(FAITHFUL, reward=RewardWeights(uncertainty=2.0)),
    "the same, returns over 3 decisions (m of Eq. 21)": dataclasses.replace(
        FAITHFUL, settings=dataclasses.replace(RETURNS, reach=3)
    ),
    "the same, exploration × 4 (σ₀ = 2)": dataclasses.replace(FAITHFUL, network=partial(loud, 2.0)),
    "the same, γ = 1": dataclasses.replace(FAITHFUL, settings=dataclasses.replace(RETURNS, discount=1.0)),
    "the same, one episode an update": dataclasses.replace(
        FAITHFUL, settings=dataclasses.replace(RETURNS, episodes_per_update=1, rate=1e-3)
    ),
    "the same, rate 0.001": dataclasses.replace(FAITHFUL, settings=dataclasses.replace(RETURNS, rate=1e-3)),
    "the same, dropout 0.5 to 0.2": dataclasses.replace(
        FAITHFUL, settings=dataclasses.replace(RETURNS, dropout=0.5, final_dropout=0.2)
    ),
    "the same, 12,000 episodes": dataclasses.replace(
        FAITHFUL, settings=dataclasses.replace(RETURNS, decay=12_000), episodes=12_000
    ),
    "d along the path, returns": dataclasses.replace(FAITHFUL, network=partial(GraphSTNN, distance="path")),
    "Eq. 4, policy gradient": train.Recipe(GraphPolicy, PolicyGradientLearner, GRADIENT, EPISODES),
    "features of belief-attention, returns": train.Recipe(PlusValues, ReturnsLearner, RETURNS, EPISODES),
    "features of belief-attention, policy gradient": train.Recipe(
        BeliefAttention, PolicyGradientLearner, PolicyGradientSettings(decay=8000), 8000
    ),
}


def entropy_by_distance(seen: ExplorationGraph) -> np.ndarray:
    """H_γ / (d + 5 m) of each candidate, shape (C,); both come in tens."""
    distance, entropy = seen.features[-seen.candidates :].T
    return entropy / (distance + 0.5)


Rule = Callable[[ExplorationGraph], np.ndarray]
RULES: dict[str, tuple[tuple[str, str], Rule]] = {
    "least d": (("distance", "shannon"), lambda seen: -seen.features[-seen.candidates :, 0]),
    "most H_γ / (d + 5 m)": (("distance", "shannon"), entropy_by_distance),
    "most H_γ / (d + 5 m), d along the path": (("path_length", "shannon"), entropy_by_distance),
}
"""Rules without learning on features of Eq. 4: columns, and what a candidate is worth."""


def learned(name: str, recipe: train.Recipe, out: Path) -> dict[str, object]:
    """Train a variant and let its best weights play."""
    entry = dataclasses.replace(strategies()["graph-stnn"], factory="learning_causes:none", parameters={})
    train.RECIPES["learning_causes"] = recipe
    path = train.train("graph-stnn", entry, 0, None, True, out / re.sub(r"\W+", "-", name), print)
    network = recipe.network()
    load_weights(network, path)
    return {"episodes": recipe.episodes} | scores(lambda course, count: train.greedy(network, course, count))


def shipped(name: str, seed: int) -> dict[str, object]:
    """Let the shipped weights of a training seed play."""
    entry = strategies()[name]
    network = train.RECIPES[parse_factory(entry.factory)[0]].network(**entry.parameters)
    card = load_weights(network, weights_file(entry.weights[seed]))
    return {"episodes": card["episodes"]} | scores(lambda course, count: train.greedy(network, course, count))


def untrained(name: str) -> dict[str, object]:
    """Let an untrained strategy play."""
    entry = strategies()[name]

    def episodes(course: Course, count: int) -> list[Episode]:
        made = [make_strategy(entry.factory, entry.parameters) for _ in range(count)]
        for number, strategy in enumerate(made):
            strategy.reset(course.generator(number, "strategy"))

        def act(waiting: list[int], observations: list[Observation]) -> list[int]:
            return [made[i].choose(observation) for i, observation in zip(waiting, observations, strict=True)]

        return play(course, range(count), act)

    return {"episodes": 0} | scores(episodes)


def ruled(name: str) -> dict[str, object]:
    """Let a rule without learning play."""
    columns, worth = RULES[name]

    def act(waiting: list[int], observations: list[Observation]) -> list[int]:
        return [int(worth(exploration_graph(observation, columns)).argmax()) for observation in observations]

    return {"episodes": 0} | scores(lambda course, count: play(course, range(count), act))


def scores(episodes: Callable[[Course, int], list[Episode]]) -> dict[str, object]:
    """Mean T, η, e and log e − log η of episodes at each size."""
    row: dict[str, object] = {}
    for size, count in WORLDS.items():
        course = Course(PAPER.replace(size=size), "validate", 1)
        values = np.array([episode.score(course.scenario) for episode in episodes(course, count)])
        objective = (np.log(values[:, 2]) - np.log(values[:, 1])).mean()
        means = dict(zip(("T", "η", "e"), values.mean(axis=0), strict=True)) | {"log e − log η": objective}
        row |= {f"{key}, {size:g} m": value for key, value in means.items()}
    return row


def main() -> None:
    """Run all variants, or those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("results/learning"))
    parser.add_argument("variants", nargs="*", metavar="VARIANT")
    asked = parser.parse_args()
    makers = {name: partial(learned, name, VARIANTS[name], asked.out) for name in VARIANTS}
    makers |= {
        f"`{name}` as shipped, seed {seed}": partial(shipped, name, seed)
        for name in SHIPPED
        for seed in sorted(strategies()[name].weights)
    }
    makers |= {name: partial(ruled, name) for name in RULES}
    makers |= {f"`{name}`": partial(untrained, name) for name in UNTRAINED}
    path = Path(__file__).with_name("learning-causes.csv")
    rows = pd.read_csv(path).set_index("variant").to_dict("index") if asked.variants and path.is_file() else {}
    for name in asked.variants or makers:
        if name not in makers:
            parser.error(f"there is no variant '{name}'; choose one of {', '.join(makers)}")
        rows[name] = makers[name]()
    table = pd.DataFrame([{"variant": name} | rows[name] for name in makers if name in rows])
    table.to_csv(path, index=False, float_format="%.4g")
    print(table.to_string(index=False))


if __name__ == "__main__":
    main()
