"""A learned strategy in one file: a small network scores every candidate, the best is taken.

    explore-bench run smoke -s 'examples/learned.py:Learned[weights=examples/learned.safetensors]' -s nearest

The weights belong to the request, so that their bytes are part of the digest of every trial: trained anew, the trials
run again. `train_learned.py` made them.
"""

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from explore_bench import Observation, RequestError

COLUMNS = ("path length / 10 m", "unknown cells in view", "uncertainty of the map in view", "landmark distance / 10 m")


class Network(torch.nn.Sequential):
    """Scores of candidates, shape (C,), from their features, shape (C, 4)."""

    def __init__(self) -> None:
        super().__init__(
            torch.nn.Linear(len(COLUMNS), 16), torch.nn.Tanh(), torch.nn.Linear(16, 1), torch.nn.Flatten(0)
        )


class Learned:
    """Takes the candidate with the highest score."""

    def __init__(self, weights: str) -> None:
        self.network = Network().eval()
        try:
            self.network.load_state_dict(load_file(weights))
        except (OSError, SafetensorError, RuntimeError) as error:
            raise RequestError(
                f"'{weights}' holds no weights of this network ({type(error).__name__}); make them with "
                "train_learned.py."
            ) from None

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; nothing is kept from the last one, nothing drawn."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the best candidate."""
        with torch.no_grad():
            return int(self.network(features(observation)).argmax())


def features(observation: Observation) -> torch.Tensor:
    """Columns COLUMNS of every candidate, shape (C, 4)."""
    belief, scenario = observation.belief, observation.scenario
    apart = np.linalg.norm(observation.positions[:, None] - scenario.grid.centres(), axis=2)
    view = (apart <= scenario.sensor_range).astype(float)
    in_view = view.sum(axis=1)
    unknown = view @ ~belief.known.reshape(-1)
    unsure = view @ belief.virtual_traces.reshape(-1) / (2.0 * scenario.virtual_sigma**2)
    to_landmark = np.linalg.norm(observation.positions[:, None] - belief.landmarks, axis=2).min(axis=1, initial=10.0)
    columns = (observation.path_lengths / 10.0, unknown / in_view, unsure / in_view, to_landmark / 10.0)
    return torch.as_tensor(np.column_stack(columns), dtype=torch.float32)
