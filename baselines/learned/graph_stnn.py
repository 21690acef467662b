"""Graph-STNN, the network of Zhang et al. 2021 (§3.3), with a switch for each of its encoders."""

from __future__ import annotations

from typing import Any, Literal

import torch
from torch import Tensor, nn

from baselines.learned.graph import ExplorationGraph, equation_4, exploration_graph
from baselines.learned.layers import (
    GraphBatch,
    Noise,
    NoisyLinear,
    SpatialEncoder,
    StateEncoder,
    TemporalEncoder,
    normalized,
)
from baselines.learned.policy import Policy
from explore_bench import Observation

CHANNELS = 64
TCN_LAYERS, TCN_KERNEL = 3, 3
LAYERS = (1, 2, 3)
HEADS = ("caption", "text")
DISTANCES = ("straight", "path")
ENTROPIES = ("view", "cell")


class GraphSTNN(nn.Module):
    """Values of the candidates of an exploration graph, with a hidden state that runs through the episode.

    Parameters
    ----------
    spatial, temporal, state : which encoders it has; what one of them would give is left out. Without the state
        encoder its input, the pooled features, goes to the head.
    layers : graph convolutions of the spatial encoder, 1 to 3.
    head : what the head sees of a candidate beside the state: its original and spatial features as in the caption
        of Fig. 3, or spatial and temporal ones as in the text of §3.3.3.
    distance : what d of Eq. 4 is for a candidate: the straight distance, or the length of the planned path.
    entropy : what H_γ of Eq. 5 is: summed over the cells in view of a node, or that of its own cell.
    channels : width of every encoder and of the head.

    Raises
    ------
    ValueError : for another number of layers, another head, distance or entropy, or a head that tells no candidates
        apart.
    """

    def __init__(
        self,
        spatial: bool = True,
        temporal: bool = True,
        state: bool = True,
        layers: int = 2,
        head: Literal["caption", "text"] = "caption",
        distance: Literal["straight", "path"] = "straight",
        entropy: Literal["view", "cell"] = "view",
        channels: int = CHANNELS,
    ) -> None:
        super().__init__()
        switches = (
            ("layers", layers, LAYERS),
            ("head", head, HEADS),
            ("distance", distance, DISTANCES),
            ("entropy", entropy, ENTROPIES),
        )
        for key, value, known in switches:
            if value not in known:
                raise ValueError(f"there is no {key} {value!r}; choose one of {', '.join(map(repr, known))}")
        self.columns = equation_4(along_paths=distance == "path", of_cells=entropy == "cell")
        if head == "text" and not spatial:
            raise ValueError("head 'text' tells candidates apart by their spatial features alone; set spatial=True")
        self.switches = {"spatial": spatial, "temporal": temporal, "state": state, "layers": layers, "head": head}
        self.channels = channels
        self.embed = nn.Linear(len(self.columns), channels)
        self.spatial = SpatialEncoder(channels, layers) if spatial else None
        of_node = channels * (1 + spatial)
        self.temporal = TemporalEncoder(of_node, channels, TCN_LAYERS, TCN_KERNEL) if temporal else None
        pooled = of_node + channels * temporal
        self.state = StateEncoder(pooled, channels) if state else None
        of_candidate = of_node if head == "caption" else channels * (spatial + temporal)
        self.inputs = (channels if state else pooled) + of_candidate
        self.noisy = NoisyLinear(self.inputs, channels)
        self.value = nn.Linear(channels, 1)

    collate = staticmethod(GraphBatch.of)

    def read(self, observation: Observation) -> ExplorationGraph:
        """Build what the network reads of an observation."""
        return exploration_graph(observation, self.columns)

    def start(self, count: int) -> Tensor:
        """Hidden state at the beginning of some episodes, shape (2, B, F)."""
        return torch.zeros(2, count, self.channels)

    def forward(self, batch: GraphBatch, hidden: Tensor, noise: Noise | None = None) -> tuple[Tensor, Tensor]:
        """Values of the candidates (B, C), −∞ where padded, and the next hidden state (2, B, F)."""
        shown, state = self.encode(batch)
        if self.state is not None:
            state, hidden = self.state(state, hidden)
        return self.judge(batch, shown, state, noise), hidden

    def encode(self, batch: GraphBatch) -> tuple[Tensor, Tensor]:
        """What the head sees of each candidate, shape (B, C, F), and the pooled features, (B, P)."""
        original = torch.relu(self.embed(batch.features))
        features = [original]
        if self.spatial is not None:
            features.append(self.spatial(original, normalized(batch.adjacency)))
        of_node = torch.cat(features, dim=-1)
        pooled = [batch.mean(values) for values in features]
        if self.temporal is not None:
            pooled.append(self.temporal(of_node, batch.trajectory))
        caption = self.switches["head"] == "caption"
        shown = batch.of_candidates(of_node) if caption else self._text(batch, features, pooled)
        return shown, torch.cat(pooled, dim=-1)

    def judge(self, batch: GraphBatch, shown: Tensor, state: Tensor, noise: Noise | None) -> Tensor:
        """Values of the candidates (B, C), −∞ where padded, from what the head sees of them and the state (B, F)."""
        entered = torch.cat((state.unsqueeze(1).expand(-1, shown.shape[1], -1), shown), dim=-1)
        if noise is not None:
            entered = entered * noise.kept.unsqueeze(1)
        return batch.masked(self.value(torch.relu(self.noisy(entered, noise))).squeeze(-1))

    def _text(self, batch: GraphBatch, features: list[Tensor], pooled: list[Tensor]) -> Tensor:
        """Spatial features of the candidates and the temporal feature, which all of them share."""
        shown = [batch.of_candidates(values) for values in features[1:]]
        if self.temporal is not None:
            shown.append(pooled[-1].unsqueeze(1).expand(-1, batch.candidates.shape[1], -1))
        return torch.cat(shown, dim=-1)

    def noise(self, rngs: list, rate: float) -> Noise:
        """Exploration noise for one episode of each generator."""
        return Noise.draw(rngs, self.inputs, self.channels, rate)


def strategy(weights: str, **switches: Any) -> Policy:
    """Graph-STNN with trained weights; the switches are those of `GraphSTNN`."""
    return Policy(GraphSTNN(**switches), weights)
