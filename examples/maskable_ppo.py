"""A policy that `train_maskable_ppo.py` has trained, as a strategy: numpy alone runs it."""

from pathlib import Path

import numpy as np
from safetensors import safe_open

from explore_bench import Observation
from explore_bench.features import CANDIDATE_COLUMNS, STATE_COLUMNS, features


class MaskablePPO:
    """Takes the candidate with the largest logit; `weights` names the file that the training exported."""

    def __init__(self, weights: str = str(Path(__file__).with_name("maskable_ppo.safetensors"))) -> None:
        if not Path(weights).is_file():
            raise FileNotFoundError(f"there is no file {weights}; make it with train_maskable_ppo.py")
        with safe_open(weights, framework="numpy") as file:
            if file.metadata() != {"candidates": " ".join(CANDIDATE_COLUMNS), "state": " ".join(STATE_COLUMNS)}:
                raise ValueError(f"{weights} reads other features than explore_bench now gives; train anew")
            count = len(file.keys()) // 2
            self.layers = [(file.get_tensor(f"{i}.weight"), file.get_tensor(f"{i}.bias")) for i in range(count)]
        self.width = len(self.layers[-1][1])

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the likeliest of the `width` candidates with the shortest paths."""
        seen = features(observation, self.width)
        values = np.concatenate((seen.candidates.ravel(), seen.state))
        for weight, bias in self.layers[:-1]:
            values = np.tanh(weight @ values + bias)
        logits = self.layers[-1][0] @ values + self.layers[-1][1]
        return int(seen.order[logits[: len(seen.order)].argmax()])
