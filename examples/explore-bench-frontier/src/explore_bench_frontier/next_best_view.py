"""Next-best view: H. H. González-Baños, J.-C. Latombe, "Navigation strategies for exploring indoor environments".

International Journal of Robotics Research 21(10–11), 2002.
"""

import numpy as np

from explore_bench import Observation, RequestError

DECAY = 0.2
"""λ [1/m], as in the paper."""


class NextBestView:
    """Chooses the candidate q with the largest g(q) = A(q) exp(−λ L(q)).

    A is the unknown area within sensor range of q [m²], L the length of the path to it [m].

    Parameters
    ----------
    decay : λ ≥ 0 [1/m].
    """

    def __init__(self, decay: float = DECAY) -> None:
        if not decay >= 0:
            raise RequestError(f"decay of the next-best view is {decay}; give a number of at least 0.")
        self.decay = decay

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw and nothing to forget."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the best candidate, the shorter path among equals."""
        gains = unknown_area(observation) * np.exp(-self.decay * observation.path_lengths)
        return int(np.lexsort((observation.path_lengths, -np.round(gains, 9)))[0])


def unknown_area(observation: Observation) -> np.ndarray:
    """Area of the unknown cells in view from each candidate [m²], shape (C,)."""
    unknown = ~observation.belief.known.reshape(-1)
    view = observation.belief.view(observation.positions)
    return (view & unknown).sum(axis=1) * observation.scenario.grid.resolution**2
