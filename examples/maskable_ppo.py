"""A policy that `train_maskable_ppo.py` has trained, as a strategy: numpy alone runs it.

explore-bench run smoke -s 'maskable_ppo.py:MaskablePPO[weights=maskable_ppo.safetensors]' -s random
"""

import numpy as np
from safetensors import SafetensorError, safe_open

from explore_bench import CANDIDATE_COLUMNS, STATE_COLUMNS, Observation, RequestError, features

COLUMNS = {"candidates": " ".join(CANDIDATE_COLUMNS), "state": " ".join(STATE_COLUMNS)}
"""What the network reads, kept beside its weights."""


class MaskablePPO:
    """Takes the candidate with the largest logit."""

    def __init__(self, weights: str) -> None:
        try:
            with safe_open(weights, framework="numpy") as file:
                columns = file.metadata()
                tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (OSError, SafetensorError) as error:
            raise RequestError(f"'{weights}' cannot be read ({error}); make it with train_maskable_ppo.py.") from None
        if columns != COLUMNS:
            raise RequestError(f"'{weights}' reads other features than there are now; train it anew.")
        self.layers = [(tensors[f"{i}.weight"], tensors[f"{i}.bias"]) for i in range(len(tensors) // 2)]
        self.width = len(self.layers[-1][1])

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; nothing is drawn, nothing is kept."""

    def choose(self, observation: Observation) -> int:
        """Return the likeliest of the candidates, of those with the shortest paths where there are too many."""
        seen = features(observation, self.width)
        values = np.concatenate((seen.candidates.ravel(), seen.state))
        for i, (weight, bias) in enumerate(self.layers):
            values = weight @ (values if i == 0 else np.tanh(values)) + bias
        return int(seen.order[values[: len(seen.order)].argmax()])
