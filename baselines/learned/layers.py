"""Building blocks of the networks (§3.3), on padded dense batches of exploration graphs.

Axes: B graphs, N nodes (the largest of the batch, the others padded), T trajectory nodes, C candidates, F channels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from baselines.learned.graph import ExplorationGraph


@dataclass(frozen=True, eq=False)
class GraphBatch:
    """Graphs padded to one size; what is padded changes no value of what is not.

    Attributes
    ----------
    features : shape (B, N, F), zero where padded.
    adjacency : shape (B, N, N), zero where padded.
    nodes : whether a row is a node, shape (B, N).
    trajectory : number of trajectory nodes of each graph, the first rows, shape (B,).
    candidates : row of each candidate, shape (B, C); 0 where padded.
    choices : whether a column of `candidates` is one, shape (B, C).
    """

    features: Tensor
    adjacency: Tensor
    nodes: Tensor
    trajectory: Tensor
    candidates: Tensor
    choices: Tensor

    @classmethod
    def of(cls, graphs: Sequence[ExplorationGraph]) -> GraphBatch:
        """Pad graphs with the same feature columns into a batch."""
        count = len(graphs)
        size = max(len(graph.features) for graph in graphs)
        width = max(graph.candidates for graph in graphs)
        features = np.zeros((count, size, graphs[0].features.shape[1]), dtype=np.float32)
        adjacency = np.zeros((count, size, size), dtype=np.float32)
        nodes = np.zeros((count, size), dtype=bool)
        candidates = np.zeros((count, width), dtype=np.int64)
        choices = np.zeros((count, width), dtype=bool)
        for i, graph in enumerate(graphs):
            own = len(graph.features)
            features[i, :own] = graph.features
            adjacency[i, :own, :own] = graph.adjacency
            nodes[i, :own] = True
            candidates[i, : graph.candidates] = np.arange(own - graph.candidates, own)
            choices[i, : graph.candidates] = True
        trajectory = np.array([graph.trajectory for graph in graphs])
        return cls(*map(torch.from_numpy, (features, adjacency, nodes, trajectory, candidates, choices)))

    def of_candidates(self, values: Tensor) -> Tensor:
        """Rows of the candidates among values of the nodes, (B, N, F) → (B, C, F)."""
        index = self.candidates.unsqueeze(-1).expand(-1, -1, values.shape[-1])
        return values.gather(1, index)

    def mean(self, values: Tensor) -> Tensor:
        """Mean over the nodes, (B, N, F) → (B, F)."""
        mask = self.nodes.unsqueeze(-1).to(values.dtype)
        return (values * mask).sum(dim=1) / mask.sum(dim=1)

    def masked(self, values: Tensor) -> Tensor:
        """Values of the candidates, shape (B, C), −∞ where there is none."""
        return values.masked_fill(~self.choices, -math.inf)


def normalized(adjacency: Tensor, loop: float = 1.0) -> Tensor:
    """D^−½ (A + loop · I) D^−½ with D the degrees of A + loop · I (Eq. 8; [8] gives the loop the weight 2)."""
    with_loops = adjacency + loop * torch.eye(adjacency.shape[-1])
    scale = with_loops.sum(dim=-1).rsqrt()
    return scale.unsqueeze(-1) * with_loops * scale.unsqueeze(-2)


class GraphConvolution(nn.Module):
    """σ_s(Â F W), Eq. 8 (Kipf and Welling 2017), with the normalized adjacency Â given; σ_s is the ReLU."""

    def __init__(self, inputs: int, outputs: int, bias: bool = False) -> None:
        super().__init__()
        self.linear = nn.Linear(inputs, outputs, bias=False)
        self.bias = nn.Parameter(torch.zeros(outputs)) if bias else None

    def forward(self, values: Tensor, adjacency: Tensor) -> Tensor:
        """(B, N, inputs), (B, N, N) → (B, N, outputs)."""
        mixed = adjacency @ self.linear(values)
        return torch.relu(mixed if self.bias is None else mixed + self.bias)


class LayerAttention(nn.Module):
    """Σ_l α^l f^l with α = softmax over layers of W f^l + b, a number a layer (Eq. 9–10 and 19–20)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.score = nn.Linear(channels, 1)

    def forward(self, layers: Tensor) -> Tensor:
        """(L, ..., F) → (..., F)."""
        return (torch.softmax(self.score(layers), dim=0) * layers).sum(dim=0)


class SpatialEncoder(nn.Module):
    """Graph convolutions whose layers are joined by attention (Eq. 8–10)."""

    def __init__(self, channels: int, layers: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(GraphConvolution(channels, channels) for _ in range(layers))
        self.attention = LayerAttention(channels)

    def forward(self, values: Tensor, adjacency: Tensor) -> Tensor:
        """(B, N, F), normalized (B, N, N) → (B, N, F)."""
        outputs = []
        for layer in self.layers:
            values = layer(values, adjacency)
            outputs.append(values)
        return self.attention(torch.stack(outputs))


class CausalConvolution(nn.Module):
    """Dilated causal convolutions (Eq. 12, [30]): layer l looks back (K − 1) 2^l nodes; ReLU between layers.

    Only the output at the last node is computed, and of every layer no more than it takes: of layer l the outputs that
    are 2^(l + 1) nodes apart.

    Attributes
    ----------
    reach : number of nodes that an output depends on, itself included.
    """

    def __init__(self, inputs: int, channels: int, layers: int, kernel: int) -> None:
        super().__init__()
        self.kernel = kernel
        self.reach = 1 + (kernel - 1) * (2**layers - 1)
        self.layers = nn.ModuleList(
            nn.Conv1d(inputs if i == 0 else channels, channels, kernel, dilation=2**i) for i in range(layers)
        )

    def forward(self, values: Tensor, present: Tensor) -> Tensor:
        """Last nodes in time order, (B, reach, inputs), and which of them there are, (B, reach, 1) → (B, channels).

        Where a series is shorter, what is missing at its beginning must be zero.
        """
        for i, layer in enumerate(self.layers):
            if i > 0:  # at nodes that there are not a layer's outputs are zero, too
                present = present[:, self.kernel - 1 :: 2]
                values = torch.relu(values) * present
            seen = values.unfold(1, self.kernel, 2).flatten(2)
            values = nn.functional.linear(seen, layer.get_parameter("weight").flatten(1), layer.get_parameter("bias"))
        return values.squeeze(1)


class TemporalEncoder(nn.Module):
    """Gated TCN tanh(P₁) ⊙ sigmoid(P₂) over the trajectory nodes in time order (Eq. 11–13)."""

    def __init__(self, inputs: int, channels: int, layers: int, kernel: int) -> None:
        super().__init__()
        self.content = CausalConvolution(inputs, channels, layers, kernel)
        self.gate = CausalConvolution(inputs, channels, layers, kernel)

    def forward(self, values: Tensor, trajectory: Tensor) -> Tensor:
        """Last output: (B, N, inputs) whose first `trajectory` rows are the trajectory's, (B,) → (B, channels)."""
        rows = trajectory.unsqueeze(1) - torch.arange(self.content.reach, 0, -1)
        present = (rows >= 0).unsqueeze(2)
        index = rows.clamp(min=0).unsqueeze(2).expand(-1, -1, values.shape[2])
        last = values.gather(1, index) * present
        return torch.tanh(self.content(last, present)) * torch.sigmoid(self.gate(last, present))


class StateEncoder(nn.Module):
    """Two-layer GRU (Eq. 15–18, without biases) whose layers are joined by attention (Eq. 19–20)."""

    def __init__(self, inputs: int, channels: int, layers: int = 2) -> None:
        super().__init__()
        self.gru = nn.GRU(inputs, channels, num_layers=layers, bias=False)
        self.attention = LayerAttention(channels)

    def forward(self, pooled: Tensor, hidden: Tensor) -> tuple[Tensor, Tensor]:
        """(B, inputs), (L, B, F) → state (B, F) and the next hidden vectors (L, B, F)."""
        _, hidden = self.gru(pooled.unsqueeze(0), hidden)
        return self.attention(hidden), hidden


@dataclass(frozen=True)
class Noise:
    """What makes a network explore in an episode: drawn once and kept until its end.

    Attributes
    ----------
    inputs, outputs : factors of the noisy layer's Gaussian noise ζ, shapes (B, inputs) and (B, outputs).
    kept : dropout masks of the head's channels, already divided by the share kept, shape (B, inputs).
    """

    inputs: Tensor
    outputs: Tensor
    kept: Tensor

    @classmethod
    def draw(cls, rngs: Sequence[np.random.Generator], inputs: int, outputs: int, rate: float) -> Noise:
        """Noise for one episode of each generator; `rate` is the share of channels dropped."""
        rows = []
        for rng in rngs:
            normals = rng.standard_normal(inputs + outputs)
            mask = (rng.random(inputs) >= rate) / (1.0 - rate)
            rows.append((np.sign(normals) * np.sqrt(np.abs(normals)), mask))
        factors = torch.tensor(np.array([factor for factor, _ in rows]), dtype=torch.float32)
        kept = torch.tensor(np.array([mask for _, mask in rows]), dtype=torch.float32)
        return cls(factors[:, :inputs], factors[:, inputs:], kept)

    def __getitem__(self, rows: Sequence[int]) -> Noise:
        """The noise of some of the episodes."""
        index = list(rows)
        return Noise(self.inputs[index], self.outputs[index], self.kept[index])


class NoisyLinear(nn.Module):
    """Linear layer with factorized Gaussian noise on its weights (Fortunato et al. 2018 [33]).

    W = μ + σ ⊙ (ε_out ε_inᵀ) and b = μ_b + σ_b ⊙ ε_out; without noise it is the layer of the means.
    """

    def __init__(self, inputs: int, outputs: int, sigma: float = 0.5) -> None:
        super().__init__()
        self.mean = nn.Linear(inputs, outputs)
        self.sigma_weight = nn.Parameter(torch.full((outputs, inputs), sigma / math.sqrt(inputs)))
        self.sigma_bias = nn.Parameter(torch.full((outputs,), sigma / math.sqrt(inputs)))

    def forward(self, values: Tensor, noise: Noise | None = None) -> Tensor:
        """(B, C, inputs) → (B, C, outputs), each graph with noise of its own."""
        result = self.mean(values)
        if noise is None:
            return result
        swayed = nn.functional.linear(values * noise.inputs.unsqueeze(1), self.sigma_weight, self.sigma_bias)
        return result + swayed * noise.outputs.unsqueeze(1)
