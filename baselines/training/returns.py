"""Learning from returns to the end of the episode (§3.4): how Graph-STNN learns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from baselines.learned.policy import evaluate
from baselines.training.episodes import Episode, play
from baselines.training.learner import OneNetwork, descend, set_rate
from explore_bench import Course, Observation


@dataclass(frozen=True)
class ReturnsSettings:
    """Hyper-parameters of learning from returns (Eq. 21–23).

    Attributes
    ----------
    episodes_per_update : episodes whose losses are averaged for one gradient step; the paper has 1.
    rate : α of Eq. 22, the step size of Adam; it falls linearly to `final_rate` over `decay` episodes.
    restart : then it falls again and again, each time from this share of the height and over this share of the
        episodes (warm restarts, after Loshchilov and Hutter 2017), so that a training can go on.
    discount : γ.
    reach : m of Eq. 21, after how many decisions the sum is cut off and the network's own value takes its place;
        None: at the end of the episode, as in Eq. 23.
    dropout, final_dropout : share of channels dropped, falling linearly over the first `decay` episodes.
    decay : episodes over which the rates fall.
    clip : largest norm of a gradient.
    """

    episodes_per_update: int = 8
    rate: float = 4e-3
    final_rate: float = 1e-4
    restart: float = 0.5
    discount: float = 0.9
    reach: int | None = None
    dropout: float = 0.2
    final_dropout: float = 0.0
    decay: int = 3_000
    clip: float = 5.0

    def rate_at(self, episode: int) -> float:
        """α at an episode."""
        height, length, begin = self.rate, float(self.decay), 0.0
        while episode >= begin + length and height > self.final_rate:
            begin += length
            height, length = height * self.restart, length * self.restart
        height = max(height, self.final_rate)
        progress = min((episode - begin) / length, 1.0) if length else 1.0
        return height + progress * (self.final_rate - height)


class ReturnsLearner(OneNetwork):
    """NoisyNet deep Q learning with returns to the end of the episode (Eq. 23): nothing is bootstrapped.

    The noise ζ and the dropout masks are drawn once an episode. The values that chose the actions are those that
    the loss compares with the returns: one pass of the network serves both.
    """

    def __init__(self, network: Any, course: Course, settings: ReturnsSettings) -> None:
        self.network, self.course, self.settings = network, course, settings
        self.optimizer = torch.optim.Adam(network.parameters(), lr=settings.rate)
        self.episodes_at_once = settings.episodes_per_update
        self._dropout = settings.dropout

    def exploration(self) -> str:
        """How much the network explores, in words."""
        sigma = float(self.network.noisy.sigma_weight.detach().abs().mean())
        return f"noise σ {sigma:.4f}, dropout {self._dropout:.2f}"

    def improve(self, numbers: Sequence[int]) -> tuple[list[Episode], float]:
        """Play these episodes, take one gradient step and return them with the loss.

        Raises
        ------
        DivergedError : when the loss is not finite; the weights are as before.
        """
        settings, network = self.settings, self.network
        progress = min(numbers[0] / settings.decay, 1.0)
        self._dropout = settings.dropout + progress * (settings.final_dropout - settings.dropout)
        rngs = [self.course.generator(number, "learning") for number in numbers]
        noise = network.noise(rngs, self._dropout)
        hidden = network.start(len(numbers))
        chosen: list[list[Tensor]] = [[] for _ in numbers]

        def act(waiting: list[int], observations: list[Observation]) -> list[int]:
            nonlocal hidden
            values, after = evaluate(network, observations, hidden[:, waiting], noise[waiting])
            hidden = hidden.index_copy(1, torch.tensor(waiting), after)
            best = values.max(dim=1)
            for row, i in enumerate(waiting):
                chosen[i].append(best.values[row])
            return best.indices.tolist()

        network.train()
        episodes = play(self.course, numbers, act)
        losses = []
        for values, episode in zip(chosen, episodes, strict=True):
            if values:
                own = torch.stack(values)
                wanted = returns(episode.rewards, settings.discount)
                if settings.reach:
                    wanted = cut_returns(wanted, own.detach().numpy(), settings.discount, settings.reach)
                losses.append(0.5 * (own - torch.tensor(wanted, dtype=torch.float32)).square().mean())
        if not losses:
            return episodes, math.nan
        loss = torch.stack(losses).mean()
        set_rate(self.optimizer, settings.rate_at(numbers[0]))
        descend(loss, network, self.optimizer, settings.clip)
        return episodes, float(loss.detach())


def returns(rewards: Sequence[float], discount: float) -> np.ndarray:
    """Discounted sum of the rewards from each decision to the end of the episode, Σ_j γ^(j−i) r_j (Eq. 23)."""
    sums = np.zeros(len(rewards))
    total = 0.0
    for i in range(len(rewards) - 1, -1, -1):
        total = rewards[i] + discount * total
        sums[i] = total
    return sums


def cut_returns(sums: np.ndarray, values: np.ndarray, discount: float, reach: int) -> np.ndarray:
    """Σ_{k<m} γ^k r_{i+k} + γ^m max Q(s_{i+m}) with m = `reach` (Eq. 21), from whole `returns` and the choices' values.

    Where the episode ends within m decisions nothing takes the place of what follows.
    """
    after, best = np.zeros((2, len(sums)))
    kept = max(len(sums) - reach, 0)
    after[:kept], best[:kept] = sums[reach:], values[reach:]
    return sums + discount**reach * (best - after)
