"""`graph-stnn-plus`, our own extension: what the exploration graph does not tell, and a policy over the candidates.

A candidate is described by the path to it, by what it would reveal and by the belief propagated along that path
(`candidates.CANDIDATE_COLUMNS`); all candidates are compared with each other by attention. It learns by policy
gradient on the two metrics themselves; see `baselines.training.policy_gradient` and docs/learning.md.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from baselines.learned.candidates import CANDIDATE_COLUMNS, STATE_COLUMNS, CandidateBatch, CandidateSet, candidate_set
from baselines.learned.policy import Policy
from explore_bench import Observation

CHANNELS = 64


class GraphSTNNPlus(nn.Module):
    """Preferences of the candidates (softmax: the policy) and, for learning, the value of the state."""

    columns = (*CANDIDATE_COLUMNS, *STATE_COLUMNS)
    collate = staticmethod(CandidateBatch.of)

    def __init__(self) -> None:
        super().__init__()
        self.switches: dict[str, bool] = {}
        self.embed = nn.Sequential(
            nn.Linear(len(self.columns), CHANNELS), nn.ReLU(), nn.Linear(CHANNELS, CHANNELS), nn.ReLU()
        )
        self.query, self.key, self.content = (nn.Linear(CHANNELS, CHANNELS) for _ in range(3))
        self.preference = nn.Sequential(nn.Linear(3 * CHANNELS, CHANNELS), nn.ReLU(), nn.Linear(CHANNELS, 1))
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
        width = batch.candidates.shape[1]
        state = batch.state.unsqueeze(1).expand(-1, width, -1)
        own = self.embed(torch.cat((batch.candidates, state), dim=-1))
        mask = batch.choices.unsqueeze(1)
        scores = self.query(own) @ self.key(own).transpose(1, 2) / math.sqrt(CHANNELS)
        others = torch.softmax(scores.masked_fill(~mask, -math.inf), dim=-1) @ self.content(own)
        present = batch.choices.unsqueeze(-1).to(own.dtype)
        mean = (own * present).sum(dim=1) / present.sum(dim=1)
        everyone = mean.unsqueeze(1).expand(-1, width, -1)
        preferences = self.preference(torch.cat((own, others, everyone), dim=-1)).squeeze(-1)
        value = self.value(torch.cat((mean, batch.state), dim=-1)).squeeze(-1)
        return preferences.masked_fill(~batch.choices, -math.inf), value


def strategy(weights: str) -> Policy:
    """Our extension with trained weights."""
    return Policy(GraphSTNNPlus(), weights)
