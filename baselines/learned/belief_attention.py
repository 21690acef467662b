"""`belief-attention`, our own extension: what the exploration graph does not tell, and a policy over the candidates.

A candidate is described by the path to it, by what it would reveal and by the belief propagated along that path
(`candidate_features.CANDIDATE_COLUMNS`); attention compares all candidates with each other and with what is still
unknown elsewhere. It learns by policy gradient on the two metrics themselves; see `baselines.training.policy_gradient`
and docs/learning.md.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from baselines.learned.candidate_features import (
    BLOCK_COLUMNS,
    CANDIDATE_COLUMNS,
    STATE_COLUMNS,
    CandidateBatch,
    CandidateSet,
    candidate_set,
)
from baselines.learned.policy import Policy
from explore_bench import Observation

CHANNELS, HEADS, LAYERS = 64, 4, 2


class Attention(nn.Module):
    """Each token looks at all others, near and far ones differently: scores plus a learned function of the distance."""

    def __init__(self) -> None:
        super().__init__()
        self.project = nn.Linear(CHANNELS, 3 * CHANNELS)
        self.bias = nn.Linear(2, HEADS)
        self.join = nn.Linear(CHANNELS, CHANNELS)
        self.norm, self.norm_after = nn.LayerNorm(CHANNELS), nn.LayerNorm(CHANNELS)
        self.mix = nn.Sequential(nn.Linear(CHANNELS, 2 * CHANNELS), nn.ReLU(), nn.Linear(2 * CHANNELS, CHANNELS))

    def forward(self, tokens: Tensor, near: Tensor, present: Tensor) -> Tensor:
        """Tokens (B, N, F), pairwise features (B, N, N, 2) and which tokens there are (B, N) → tokens (B, N, F)."""
        count, size, _ = tokens.shape
        parts = self.project(self.norm(tokens)).view(count, size, 3, HEADS, -1).permute(2, 0, 3, 1, 4)
        bias = self.bias(near).permute(0, 3, 1, 2).masked_fill(~present[:, None, None, :], -math.inf)
        seen = nn.functional.scaled_dot_product_attention(parts[0], parts[1], parts[2], attn_mask=bias)
        tokens = tokens + self.join(seen.transpose(1, 2).reshape(count, size, CHANNELS))
        return tokens + self.mix(self.norm_after(tokens))


class BeliefAttention(nn.Module):
    """Preferences of the candidates (softmax: the policy) and, for learning, the value of the state.

    Candidates and the blocks of the map that are still unknown are the tokens of two attention layers.
    """

    columns = (*CANDIDATE_COLUMNS, *STATE_COLUMNS, *BLOCK_COLUMNS)
    collate = staticmethod(CandidateBatch.of)

    def __init__(self) -> None:
        super().__init__()
        self.switches: dict[str, bool] = {}
        own = len(CANDIDATE_COLUMNS) + len(STATE_COLUMNS)
        self.embed = nn.Sequential(nn.Linear(own, CHANNELS), nn.ReLU(), nn.Linear(CHANNELS, CHANNELS))
        self.embed_block = nn.Sequential(
            nn.Linear(len(BLOCK_COLUMNS), CHANNELS), nn.ReLU(), nn.Linear(CHANNELS, CHANNELS)
        )
        self.layers = nn.ModuleList(Attention() for _ in range(LAYERS))
        self.preference = nn.Sequential(nn.Linear(CHANNELS, CHANNELS), nn.ReLU(), nn.Linear(CHANNELS, 1))
        self.value = nn.Sequential(
            nn.Linear(CHANNELS + len(STATE_COLUMNS), CHANNELS), nn.ReLU(), nn.Linear(CHANNELS, 1)
        )

    def read(self, observation: Observation) -> CandidateSet:
        """Build what the network reads of an observation."""
        return candidate_set(observation)

    def start(self, count: int) -> Tensor:
        """Return an empty hidden state, shape (0, B): this network has none."""
        return torch.zeros(0, count)

    def forward(self, batch: CandidateBatch, hidden: Tensor, noise: None = None) -> tuple[Tensor, Tensor]:
        """Preferences of the candidates (B, C), −∞ where padded, and the hidden state as given."""
        return self.preferences_and_value(batch)[0], hidden

    def preferences_and_value(self, batch: CandidateBatch) -> tuple[Tensor, Tensor]:
        """Preferences of the candidates (B, C), −∞ where padded, and the value of the state (B,)."""
        shown = self.encode(batch)
        preferences = self.preference(shown).squeeze(-1)
        there = batch.choices.unsqueeze(-1).to(shown.dtype)
        mean = (shown * there).sum(dim=1) / there.sum(dim=1)
        value = self.value(torch.cat((mean, batch.state), dim=-1)).squeeze(-1)
        return batch.masked(preferences), value

    def encode(self, batch: CandidateBatch) -> Tensor:
        """Candidates after the attention layers, shape (B, C, F)."""
        width = batch.candidates.shape[1]
        state = batch.state.unsqueeze(1).expand(-1, width, -1)
        own = self.embed(torch.cat((batch.candidates, state), dim=-1))
        tokens = torch.cat((own, self.embed_block(batch.blocks)), dim=1)
        offsets = batch.places.unsqueeze(2) - batch.places.unsqueeze(1)
        distances = torch.sqrt(offsets.square().sum(dim=-1) + 1e-6)
        near = torch.stack((distances, torch.exp(-2.0 * distances)), dim=-1)
        for layer in self.layers:
            tokens = layer(tokens, near, batch.present)
        return tokens[:, :width]


def strategy(weights: str) -> Policy:
    """Our extension with trained weights."""
    return Policy(BeliefAttention(), weights)
