"""Deep Q learning with replay: how the network of Chen et al. 2020 ([8]) learns."""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from baselines.learned.graph import ExplorationGraph
from baselines.training.episodes import Episode, play
from baselines.training.learner import descend, optimizer_tensors, part, restore_optimizer, set_rate, with_prefix
from explore_bench import Course, Observation


@dataclass(frozen=True)
class ReplaySettings:
    """Hyper-parameters of DQN with replay, in brackets those of [8].

    Attributes
    ----------
    episodes_at_once : episodes played in lockstep (1).
    decisions_per_update : decisions between two gradient steps (1).
    batch : transitions in a gradient step (64).
    memory : transitions kept (10,000).
    warm_up : decisions before the first gradient step (5,000).
    rate : step size of Adam (1e-5).
    discount : γ (0.99).
    dropout : rate in the loss (0.5).
    exploration : dropout rate of the acting network at the start (0.9), falling linearly to 0 ...
    decay : ... over as many decisions (1,000,000).
    target_every : gradient steps between two copies to the target network (15,000).
    clip : largest norm of a gradient (each element within 0.5).
    """

    episodes_at_once: int = 8
    decisions_per_update: int = 8
    batch: int = 64
    memory: int = 10_000
    warm_up: int = 1_000
    rate: float = 5e-4
    final_rate: float = 1e-4
    discount: float = 0.9
    dropout: float = 0.1
    exploration: float = 0.9
    decay: int = 25_000
    target_every: int = 200
    clip: float = 5.0


@dataclass(frozen=True, eq=False, slots=True)
class Transition:
    """A decision: the graph it was made on, the choice, its reward, and the next graph (None at the end)."""

    graph: ExplorationGraph
    choice: int
    reward: float
    then: ExplorationGraph | None


class ReplayLearner:
    """Deep Q learning with replay as in [8]: explores by dropout in the acting network, bootstraps from a target."""

    def __init__(self, network: Any, course: Course, settings: ReplaySettings) -> None:
        self.network, self.course, self.settings = network, course, settings
        self.optimizer = torch.optim.Adam(network.parameters(), lr=settings.rate)
        self.target = copy.deepcopy(network).requires_grad_(False)
        self.decisions = self.updates = 0
        self.episodes_at_once = settings.episodes_at_once
        self._memory: deque[Transition] = deque(maxlen=settings.memory)

    def tensors(self) -> dict[str, Tensor]:
        """All that learning goes on from, but for `counters` and the memory, which fills anew."""
        networks = with_prefix("network.", self.network.state_dict()) | with_prefix("target.", self.target.state_dict())
        return networks | optimizer_tensors(self.optimizer)

    def counters(self) -> dict[str, int]:
        """Decisions and gradient steps so far."""
        return {"decisions": self.decisions, "updates": self.updates}

    def restore(self, tensors: dict[str, Tensor], counters: dict[str, int]) -> None:
        """Go on from what `tensors` and `counters` gave."""
        self.network.load_state_dict(part(tensors, "network."))
        self.target.load_state_dict(part(tensors, "target."))
        restore_optimizer(self.optimizer, tensors)
        self.decisions, self.updates = counters["decisions"], counters["updates"]

    def exploration(self) -> str:
        """How much the network explores, in words."""
        return f"dropout {self._left() * self.settings.exploration:.2f}"

    def _left(self) -> float:
        return max(1.0 - self.decisions / self.settings.decay, 0.0)

    def improve(self, numbers: Sequence[int]) -> tuple[list[Episode], float]:
        """Play these episodes with a gradient step every few decisions; return them with the mean loss.

        Raises
        ------
        DivergedError : when a loss is not finite.
        """
        rng = self.course.generator(numbers[0], "learning")
        torch.manual_seed(int(rng.integers(2**63)))
        graphs: list[list[ExplorationGraph]] = [[] for _ in numbers]
        choices: list[list[int]] = [[] for _ in numbers]
        losses: list[float] = []
        due = 0

        def act(waiting: list[int], observations: list[Observation]) -> list[int]:
            nonlocal due
            seen = [self.network.read(observation) for observation in observations]
            with torch.no_grad():
                batch = self.network.collate(seen)
                values, _ = self.network(batch, self.network.start(len(seen)), self._left() * self.settings.exploration)
            best: list[int] = values.argmax(dim=1).tolist()
            for i, graph, choice in zip(waiting, seen, best, strict=True):
                graphs[i].append(graph)
                choices[i].append(choice)
            self.decisions += len(waiting)
            due += len(waiting)
            while due >= self.settings.decisions_per_update:
                due -= self.settings.decisions_per_update
                if len(self._memory) >= self.settings.warm_up:
                    losses.append(self._update(rng))
            return best

        episodes = play(self.course, numbers, act)
        for own, taken, episode in zip(graphs, choices, episodes, strict=True):
            following = [*own[1:], None]
            self._memory.extend(map(Transition, own, taken, episode.rewards, following))
        return episodes, float(np.mean(losses)) if losses else math.nan

    def _update(self, rng: np.random.Generator) -> float:
        """One gradient step on a random batch: [r + γ max Q_target − Q(s, a)]²."""
        settings = self.settings
        drawn = [self._memory[i] for i in rng.integers(len(self._memory), size=settings.batch)]
        wanted = torch.tensor([transition.reward for transition in drawn], dtype=torch.float32)
        going_on = [i for i, transition in enumerate(drawn) if transition.then is not None]
        if going_on:
            then = self.network.collate([graph for transition in drawn if (graph := transition.then) is not None])
            with torch.no_grad():
                values, _ = self.target(then, self.target.start(len(going_on)))
            wanted[going_on] += settings.discount * values.max(dim=1).values
        batch = self.network.collate([transition.graph for transition in drawn])
        values, _ = self.network(batch, self.network.start(len(drawn)), settings.dropout)
        taken = torch.tensor([transition.choice for transition in drawn])
        loss = (values.gather(1, taken.unsqueeze(1)).squeeze(1) - wanted).square().mean()
        progress = min(self.decisions / settings.decay, 1.0)
        set_rate(self.optimizer, settings.rate + progress * (settings.final_rate - settings.rate))
        descend(loss, self.network, self.optimizer, settings.clip)
        self.updates += 1
        if self.updates % settings.target_every == 0:
            self.target.load_state_dict(self.network.state_dict())
        return float(loss.detach())
