"""Information gain under pose uncertainty: Carrillo et al. 2015, 2018 ([15]).

H. Carrillo, P. Dames, V. Kumar, J. A. Castellanos, "Autonomous robotic exploration using occupancy grid maps and
graph SLAM based on Shannon and Rényi entropy", ICRA 2015; the same authors with a "utility function based on
Rényi's general theory of entropy", Autonomous Robots 42, 2018.
"""

from __future__ import annotations

import numpy as np

from explore_bench import Array, Observation, RequestError, Scenario, renyi_entropy, shannon_entropy


class Entropy:
    """Chooses the candidate from which the map is expected to gain most, less w times the length of the path there.

    The gain of a candidate is the sum, over the cells in view from it, of Shannon's entropy of the cell as it is
    (Eq. 5) minus the Rényi entropy (Eq. 6) of the cell after one predicted observation. The order of the latter,
    α = 1 + 1/δ, follows the trace δ of the pose covariance predicted at the candidate: with a certain pose α → ∞
    and an observation is worth most; with an uncertain one α → 1.

    It is not [15] to the letter. [15] takes both entropies of the map as it is, and a scalar of the covariance of the
    robot's position; then an unknown cell promises nothing, both being 1 bit at p = 1/2, and a candidate in unknown
    land least of all. Here Rényi's is of the map after one observation, and δ is of the 3 × 3 covariance [m² + rad²].

    Parameters
    ----------
    alpha : a fixed order α > 0 instead.
    weight : w ≥ 0 [bit per m], what a metre of the path takes from the gain; [15] has none.
    """

    def __init__(self, alpha: float | None = None, weight: float = 0.0) -> None:
        if alpha is not None and not alpha > 0:
            raise RequestError(f"alpha of the entropy strategy is {alpha}; give a number above 0.")
        if not weight >= 0:
            raise RequestError(f"weight of the entropy strategy is {weight}; give bits per metre, 0 or more.")
        self.alpha, self.weight = alpha, weight

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate with the largest gain, the shorter path among equals."""
        belief = observation.belief
        scenario = observation.scenario
        views = belief.view(observation.positions)
        gains = np.empty(len(observation.candidates))
        for i, path in enumerate(observation.paths):
            delta = float(np.trace(belief.predict(path).pose_covariances[-1]))
            order = 1.0 + 1.0 / delta if self.alpha is None else self.alpha
            gains[i] = information_gain(belief.occupancy.reshape(-1)[views[i]], order, scenario)
        worth = gains - self.weight * observation.path_lengths
        return int(np.lexsort((observation.path_lengths, -np.round(worth, 9)))[0])


def information_gain(occupancy: Array, order: float, scenario: Scenario) -> float:
    """Σ H(p) − H_α(p′) over cells of these occupancies [bit], p′ after the likelier outcome of one observation.

    `order` is α.
    """
    free = occupancy <= 0.5
    odds = occupancy / (1.0 - occupancy)
    model = np.where(free, scenario.miss, scenario.hit)
    updated = odds * model / (1.0 - model)
    after = np.clip(updated / (1.0 + updated), scenario.occupancy_clamp, 1.0 - scenario.occupancy_clamp)
    return float(np.sum(shannon_entropy(occupancy) - renyi_entropy(after, order)))
