"""The two ways of learning: returns to the end of the episode (§3.4) and DQN with replay ([8])."""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from baselines.learned.graph import ExplorationGraph
from baselines.learned.layers import GraphBatch
from baselines.learned.policy import evaluate
from baselines.training.episodes import Course, Episode, play
from explore_bench import Observation


@dataclass(frozen=True)
class Returns:
    """Hyper-parameters of learning from returns (Eq. 21–23).

    Attributes
    ----------
    episodes_per_update : episodes whose losses are averaged for one gradient step; the paper has 1.
    rate : α of Eq. 22, the step size of Adam; it falls linearly to `final_rate` over `decay` episodes.
    discount : γ.
    dropout, final_dropout : share of channels dropped, falling linearly over `decay` episodes.
    decay : episodes over which the rates fall.
    clip : largest norm of a gradient.
    """

    episodes_per_update: int = 8
    rate: float = 1e-3
    final_rate: float = 1e-4
    discount: float = 0.9
    dropout: float = 0.2
    final_dropout: float = 0.0
    decay: int = 10_000
    clip: float = 5.0


class DivergedError(ArithmeticError):
    """A loss is not a finite number; says where."""


class ReturnsLearner:
    """NoisyNet deep Q learning with returns to the end of the episode (Eq. 23): nothing is bootstrapped.

    The noise ζ and the dropout masks are drawn once an episode. The values that chose the actions are those that
    the loss compares with the returns: one pass of the network serves both.
    """

    def __init__(self, network: nn.Module, course: Course, settings: Returns) -> None:
        self.network, self.course, self.settings = network, course, settings
        self.optimizer = torch.optim.Adam(network.parameters(), lr=settings.rate)
        self.episodes_at_once = settings.episodes_per_update
        self._rate = settings.dropout

    def tensors(self) -> dict[str, Tensor]:
        """All that learning goes on from, but for `counters`."""
        return with_prefix("network.", self.network.state_dict()) | optimizer_tensors(self.optimizer)

    def counters(self) -> dict[str, int]:
        """Return nothing: what changes with time follows from the number of the episode."""
        return {}

    def restore(self, tensors: dict[str, Tensor], counters: dict[str, int]) -> None:
        """Go on from what `tensors` and `counters` gave."""
        self.network.load_state_dict(part(tensors, "network."))
        restore_optimizer(self.optimizer, tensors)

    def exploration(self) -> str:
        """How much the network explores, in words."""
        sigma = float(self.network.noisy.sigma_weight.detach().abs().mean())
        return f"noise σ {sigma:.4f}, dropout {self._rate:.2f}"

    def improve(self, numbers: Sequence[int]) -> tuple[list[Episode], float]:
        """Play these episodes, take one gradient step and return them with the loss.

        Raises
        ------
        DivergedError : when the loss is not finite; the weights are as before.
        """
        settings, network = self.settings, self.network
        progress = min(numbers[0] / settings.decay, 1.0)
        rate = settings.dropout + progress * (settings.final_dropout - settings.dropout)
        self._rate = rate
        rngs = [self.course.generator(number, "learning") for number in numbers]
        noise = network.noise(rngs, rate)
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
                wanted = torch.tensor(returns(episode.rewards, settings.discount), dtype=torch.float32)
                losses.append(0.5 * (torch.stack(values) - wanted).square().mean())
        loss = torch.stack(losses).mean()
        set_rate(self.optimizer, settings.rate + progress * (settings.final_rate - settings.rate))
        descend(loss, network, self.optimizer, settings.clip)
        return episodes, float(loss.detach())


def optimizer_tensors(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """State of an optimizer as named tensors."""
    state = optimizer.state_dict()["state"]
    return {f"optimizer.{index}.{name}": value for index, own in state.items() for name, value in own.items()}


def restore_optimizer(optimizer: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    """Put back what `optimizer_tensors` gave."""
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        if key.startswith("optimizer."):
            _, index, name = key.split(".", 2)
            state.setdefault(int(index), {})[name] = value
    optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})


def part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """Tensors whose name begins with a prefix, without it."""
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def with_prefix(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Tensors with a prefix put before their names."""
    return {prefix + name: value for name, value in tensors.items()}


def returns(rewards: Sequence[float], discount: float) -> np.ndarray:
    """Discounted sum of the rewards from each decision to the end of the episode, Σ_j γ^(j−i) r_j (Eq. 23)."""
    sums = np.zeros(len(rewards))
    total = 0.0
    for i in range(len(rewards) - 1, -1, -1):
        total = rewards[i] + discount * total
        sums[i] = total
    return sums


def set_rate(optimizer: torch.optim.Optimizer, rate: float) -> None:
    """Set the step size of an optimizer."""
    for group in optimizer.param_groups:
        group["lr"] = rate


def descend(loss: Tensor, network: nn.Module, optimizer: torch.optim.Optimizer, clip: float) -> None:
    """Take one gradient step.

    Raises
    ------
    DivergedError : when the loss or a gradient is not finite; the weights are as before.
    """
    optimizer.zero_grad()
    loss.backward()
    norm = nn.utils.clip_grad_norm_(network.parameters(), clip)
    if not (torch.isfinite(loss) and torch.isfinite(norm)):
        raise DivergedError(f"the loss is {float(loss.detach())} and its gradient {float(norm)}")
    optimizer.step()


@dataclass(frozen=True)
class Replay:
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
    decay: int = 60_000
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

    def __init__(self, network: nn.Module, course: Course, settings: Replay) -> None:
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
            seen = [self.network.graph(observation) for observation in observations]
            with torch.no_grad():
                batch = GraphBatch.of(seen)
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
            then = GraphBatch.of([graph for transition in drawn if (graph := transition.then) is not None])
            with torch.no_grad():
                values, _ = self.target(then, self.target.start(len(going_on)))
            wanted[going_on] += settings.discount * values.max(dim=1).values
        batch = GraphBatch.of([transition.graph for transition in drawn])
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
