"""From a trained network to a strategy: the candidate of the largest value, without noise or dropout."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from baselines.learned.checkpoint import load_weights
from explore_bench import Observation


class Network(Protocol):
    """What learners and the policy ask of a network (a torch module)."""

    columns: tuple[str, ...]
    switches: dict[str, Any]

    def read(self, observation: Observation) -> Any:
        """Build what the network reads of an observation."""

    def collate(self, items: Sequence[Any]) -> Any:
        """Pad what was read of several observations into a batch."""

    def start(self, count: int) -> Tensor:
        """Hidden state at the beginning of `count` episodes; its second axis is the episodes."""

    def __call__(self, batch: Any, hidden: Tensor, noise: Any = None) -> tuple[Tensor, Tensor]:
        """Values of the candidates (B, C), −∞ where padded, and the next hidden state."""


class Policy:
    """A strategy that follows a network.

    Raises
    ------
    RequestError : for weights that are missing, damaged or those of another network.
    """

    def __init__(self, network: Any, weights: str) -> None:
        torch.set_num_threads(1)
        load_weights(network, weights)
        self.network = network.eval()
        self._hidden = network.start(1)

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial with an empty hidden state; there is nothing to draw."""
        self._hidden = self.network.start(1)

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate with the largest value, the first among equals."""
        with torch.inference_mode():
            values, self._hidden = evaluate(self.network, [observation], self._hidden)
        return int(values[0].argmax())


def evaluate(
    network: Network, observations: Sequence[Observation], hidden: Tensor, noise: Any = None
) -> tuple[Tensor, Tensor]:
    """Values of the candidates of several episodes' observations, shape (B, C), and the next hidden state."""
    batch = network.collate([network.read(observation) for observation in observations])
    return network(batch, hidden, noise)
