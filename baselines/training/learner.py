"""What all learners share: the gradient step, and their state as tensors for a checkpoint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from baselines.training.episodes import Episode
from explore_bench import Course


class Learner(Protocol):
    """What a training asks of a way of learning."""

    episodes_at_once: int

    def __init__(self, network: Any, course: Course, settings: Any) -> None: ...

    def improve(self, numbers: Sequence[int]) -> tuple[list[Episode], float]:
        """Play these episodes, learn from them and return them with the loss."""

    def tensors(self) -> dict[str, Tensor]:
        """All tensors that learning goes on from."""

    def counters(self) -> dict[str, int]:
        """All numbers that learning goes on from."""

    def restore(self, tensors: dict[str, Tensor], counters: dict[str, int]) -> None:
        """Go on from what `tensors` and `counters` gave."""

    def exploration(self) -> str:
        """How much it explores now, in words."""


class DivergedError(ArithmeticError):
    """A loss is not a finite number; says where."""


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


class OneNetwork:
    """State of a learner that goes on from one network and its optimizer alone.

    Whatever else changes with time follows from the number of the episode.
    """

    network: Any
    optimizer: torch.optim.Optimizer

    def tensors(self) -> dict[str, Tensor]:
        """All tensors that learning goes on from."""
        return with_prefix("network.", self.network.state_dict()) | optimizer_tensors(self.optimizer)

    def counters(self) -> dict[str, int]:
        """Return nothing: there are no counters."""
        return {}

    def restore(self, tensors: dict[str, Tensor], counters: dict[str, int]) -> None:
        """Go on from what `tensors` gave."""
        self.network.load_state_dict(part(tensors, "network."))
        restore_optimizer(self.optimizer, tensors)


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
