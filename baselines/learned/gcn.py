"""The graph convolutional network of Chen et al. 2020 ([8]).

F. Chen, J. D. Martin, Y. Huang, J. Wang, B. Englot, "Autonomous exploration under uncertainty via deep reinforcement
learning on graphs", IROS 2020.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from baselines.learned.graph import CHEN_2020, ExplorationGraph, exploration_graph
from baselines.learned.layers import GraphBatch, GraphConvolution, normalized
from baselines.learned.policy import Policy
from explore_bench import Observation

CHANNELS = 128  # [8] has 1000, which takes a GPU to train
LOOP = 2.0


class GCN(nn.Module):
    """Two graph convolutions with edges weighed by their length, dropout, and a linear layer.

    Parameters
    ----------
    obstacles : whether obstacles are nodes of the graph (GCN-obs) or not (GCN-no_obs).
    channels : width of the convolutions.
    """

    columns = CHEN_2020

    def __init__(self, obstacles: bool = True, channels: int = CHANNELS) -> None:
        super().__init__()
        self.switches = {"obstacles": obstacles}
        self.first = GraphConvolution(len(self.columns), channels, bias=True)
        self.second = GraphConvolution(channels, channels, bias=True)
        self.value = nn.Linear(channels, 1)

    collate = staticmethod(GraphBatch.of)

    def read(self, observation: Observation) -> ExplorationGraph:
        """Build what the network reads of an observation."""
        return exploration_graph(observation, self.columns, self.switches["obstacles"], weighted=True)

    def start(self, count: int) -> Tensor:
        """Return an empty hidden state, shape (0, B): this network has none."""
        return torch.zeros(0, count)

    def forward(self, batch: GraphBatch, hidden: Tensor, noise: float | None = None) -> tuple[Tensor, Tensor]:
        """Values of the candidates (B, C), −∞ where padded, and the hidden state as given; `noise`: dropout rate."""
        adjacency = normalized(batch.adjacency, LOOP)
        values = batch.of_candidates(self.second(self.first(batch.features, adjacency), adjacency))
        values = nn.functional.dropout(values, noise or 0.0)
        return batch.masked(self.value(values).squeeze(-1)), hidden


def strategy(weights: str, obstacles: bool = True, channels: int = CHANNELS) -> Policy:
    """[8]'s network with trained weights."""
    return Policy(GCN(obstacles, channels), weights)
