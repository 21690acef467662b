"""Policy gradient (PPO, Schulman et al. 2017) on the two metrics themselves: how `belief-attention` learns.

The reward of a decision is the change of −(log e − log η), with log T taken by its slope at T = n_g: rewards add up
to the benchmark's own objective, every step and every loss of accuracy is paid for where it happens, and maps of all
sizes count alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from baselines.training.episodes import Episode, play
from baselines.training.learner import OneNetwork, descend, set_rate
from explore_bench import Course, Observation


@dataclass(frozen=True)
class PolicyGradientSettings:
    """Hyper-parameters.

    Attributes
    ----------
    episodes_per_update : episodes played with one policy.
    passes, batch : how often their decisions are gone through, and how many make a gradient step.
    rate, final_rate : step size of Adam, falling linearly over `decay` episodes.
    discount, trace : γ and λ of the generalized advantage estimate.
    ratio : clip range of the policy's ratio.
    entropy, final_entropy : weight of the policy's entropy, falling linearly over `decay` episodes.
    decay : episodes over which they fall.
    clip : largest norm of a gradient.
    """

    episodes_per_update: int = 96
    passes: int = 3
    batch: int = 256
    rate: float = 1e-3
    final_rate: float = 1e-4
    discount: float = 0.99
    trace: float = 0.95
    ratio: float = 0.2
    entropy: float = 0.02
    final_entropy: float = 0.0
    decay: int = 6_000
    clip: float = 1.0


class PolicyGradientLearner(OneNetwork):
    """PPO with a clipped ratio and generalized advantages."""

    def __init__(self, network: Any, course: Course, settings: PolicyGradientSettings) -> None:
        self.network, self.course, self.settings = network, course, settings
        self.optimizer = torch.optim.Adam(network.parameters(), lr=settings.rate)
        self.episodes_at_once = settings.episodes_per_update
        self._entropy = math.nan

    def improve(self, numbers: Sequence[int]) -> tuple[list[Episode], float]:
        """Play these episodes with the policy and improve it; return them with the mean loss.

        Raises
        ------
        DivergedError : when a loss is not finite.
        """
        settings, network = self.settings, self.network
        rng = self.course.generator(numbers[0], "learning")
        seen: list[list[Any]] = [[] for _ in numbers]
        choices: list[list[int]] = [[] for _ in numbers]
        logs: list[list[float]] = [[] for _ in numbers]
        values: list[list[float]] = [[] for _ in numbers]
        marks: list[list[tuple[int, float]]] = [[] for _ in numbers]

        def act(waiting: list[int], observations: list[Observation]) -> list[int]:
            items = [network.read(observation) for observation in observations]
            with torch.no_grad():
                preferences, value = network.preferences_and_value(network.collate(items))
                probabilities = torch.log_softmax(preferences, dim=1).numpy().astype(float)
            gumbel = rng.gumbel(size=probabilities.shape)
            chosen: list[int] = (probabilities + gumbel).argmax(axis=1).tolist()
            for row, i in enumerate(waiting):
                seen[i].append(items[row])
                choices[i].append(chosen[row])
                logs[i].append(float(probabilities[row, chosen[row]]))
                values[i].append(float(value[row]))
                marks[i].append(_mark(observations[row]))
            return chosen

        network.train()
        episodes = play(self.course, numbers, act)
        advantages, targets = [], []
        for episode, own, passed in zip(episodes, values, marks, strict=True):
            rewards = objective_changes(episode, passed, self.course)
            gains = advantage_estimates(rewards, own, settings.discount, settings.trace)
            advantages += gains.tolist()
            targets += (gains + np.array(own)).tolist()
        flat = [item for own in seen for item in own]
        if not flat:
            return episodes, math.nan
        return episodes, self._learn(
            rng,
            flat,
            torch.tensor([c for own in choices for c in own]),
            torch.tensor([v for own in logs for v in own], dtype=torch.float32),
            torch.tensor(advantages, dtype=torch.float32),
            torch.tensor(targets, dtype=torch.float32),
            numbers[0],
        )

    def _learn(
        self,
        rng: np.random.Generator,
        seen: list[Any],
        choices: Tensor,
        logs: Tensor,
        advantages: Tensor,
        targets: Tensor,
        number: int,
    ) -> float:
        settings = self.settings
        progress = min(number / settings.decay, 1.0)
        set_rate(self.optimizer, settings.rate + progress * (settings.final_rate - settings.rate))
        weight = settings.entropy + progress * (settings.final_entropy - settings.entropy)
        advantages = (advantages - advantages.mean()) / (advantages.std(unbiased=False) + 1e-6)
        losses = []
        for _ in range(settings.passes):
            order = rng.permutation(len(seen))
            for first in range(0, len(order), settings.batch):
                rows = order[first : first + settings.batch]
                preferences, value = self.network.preferences_and_value(self.network.collate([seen[i] for i in rows]))
                index = torch.from_numpy(rows)
                probabilities = torch.log_softmax(preferences, dim=1)
                own = probabilities.gather(1, choices[index].unsqueeze(1)).squeeze(1)
                ratio = torch.exp(own - logs[index])
                clipped = ratio.clamp(1.0 - settings.ratio, 1.0 + settings.ratio)
                surrogate = torch.minimum(ratio * advantages[index], clipped * advantages[index]).mean()
                finite = probabilities.masked_fill(torch.isinf(probabilities), 0.0)
                entropy = -(finite.exp() * finite).sum(dim=1).mean()
                loss = -surrogate + 0.5 * (value - targets[index]).square().mean() - weight * entropy
                descend(loss, self.network, self.optimizer, settings.clip)
                losses.append(float(loss.detach()))
                self._entropy = float(entropy.detach())
        return float(np.mean(losses))

    def exploration(self) -> str:
        """How much the policy explores, in words."""
        return f"entropy {self._entropy:.2f}"


def _mark(observation: Observation) -> tuple[int, float]:
    """Steps and log of the largest sqrt(tr Σ) at a decision."""
    return observation.step, 0.5 * math.log(observation.belief.peak_trace)


def objective_changes(episode: Episode, marks: Sequence[tuple[int, float]], course: Course) -> np.ndarray:
    """Reward of each decision: −2 Δ steps / n_g − Δ log sqrt(max tr Σ)."""
    last = episode.last
    assert last is not None
    marks = [*marks, (last.step, 0.5 * math.log(last.peak_trace))]
    steps = np.diff([step for step, _ in marks])
    return -2.0 * steps / course.scenario_of(episode.number).cell_count - np.diff([peak for _, peak in marks])


def advantage_estimates(rewards: np.ndarray, values: Sequence[float], discount: float, trace: float) -> np.ndarray:
    """Generalized advantage estimates of an episode (Schulman et al. 2016), shape (D,)."""
    after = np.array([*values[1:], 0.0])
    errors = rewards + discount * after - np.array(values)
    estimates = np.zeros(len(rewards))
    total = 0.0
    for i in range(len(rewards) - 1, -1, -1):
        total = errors[i] + discount * trace * total
        estimates[i] = total
    return estimates
