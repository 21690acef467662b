"""The nearest frontier: B. Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997 ([11])."""

from __future__ import annotations

import numpy as np

from explore_bench import Observation


class Nearest:
    """Drives to the candidate with the shortest path."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate with the shortest path, the lowest cell among equals."""
        return int(observation.path_lengths.argmin())
