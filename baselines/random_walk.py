"""The random strategy: the paper's lower bound (§4.2, Table 2, "Random")."""

from __future__ import annotations

import numpy as np

from explore_bench import Observation


class Random:
    """Chooses any candidate with the same probability."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial."""
        self._rng = rng

    def choose(self, observation: Observation) -> int:
        """Return the index of a candidate drawn uniformly."""
        return int(self._rng.integers(len(observation.candidates)))
