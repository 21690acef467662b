"""EM exploration on a virtual map: Wang and Englot 2017 ([25]).

J. Wang, B. Englot, "Autonomous exploration with expectation-maximization", ISRR 2017.
"""

from __future__ import annotations

import numpy as np

from explore_bench import Observation

WEIGHT = 3.2
"""w [m² per m of path], tuned on calibration worlds: docs/path-weights.md."""


class Uncertainty:
    """Chooses the candidate after whose path the map would be least uncertain, U + w · length.

    The belief is propagated exactly along every path with maximum-likelihood measurements: past poses, landmarks
    and with them every virtual landmark (Eq. 1) change as they would if the path were driven.
    """

    def __init__(self, weight: float = WEIGHT) -> None:
        self.weight = weight

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate with the least cost, the lowest cell among equals."""
        predicted = np.array([observation.belief.predict(path).uncertainty for path in observation.paths])
        return int(np.round(predicted + self.weight * observation.path_lengths, 9).argmin())
