"""The most unknown for the way: a rule in one line, of ours, as a yardstick for what learning adds."""

from __future__ import annotations

import numpy as np

from explore_bench import Observation, RequestError, shannon_entropy

OFFSET = 5.0
"""c [m], tuned on calibration worlds: docs/path-weights.md."""


class EntropyPerMetre:
    """Chooses the candidate with the most entropy in view (Eq. 5) for each metre of the path to it and `offset` more.

    Parameters
    ----------
    offset : c [m] of H_γ / (length + c).
    """

    def __init__(self, offset: float = OFFSET) -> None:
        if not offset > 0:
            raise RequestError(f"offset of the strategy entropy-per-metre is {offset}; give metres above 0.")
        self.offset = offset

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate with the largest quotient, the lowest cell among equals."""
        entropy = shannon_entropy(observation.belief.occupancy).reshape(-1)
        in_view = np.array([entropy[view].sum() for view in observation.belief.view(observation.positions)])
        return int(np.round(in_view / (observation.path_lengths + self.offset), 9).argmax())
