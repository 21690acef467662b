"""Rules that look for a place of their own instead of choosing a candidate: next best view, Bayesian optimization.

González-Baños and Latombe 2002 ([17]); Bai, Wang, Chen, Englot 2016 ([16]). Both draw places that can be reached and
from which a frontier is in view, and answer a `Target`. Where none is worth the drive they take the nearest candidate.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from baselines.field import terms
from baselines.field.constants import above, at_least, between, count, flag
from baselines.field.views import in_view
from explore_bench import Array, Observation, Target

APART = 1.0
"""A place nearer than this to one that was chosen before is no place of its own [m] (ours): what was not seen from
there will not be seen from here."""


class Sampled(ABC):
    """Draws places, and drives to the one that it finds best.

    Parameters
    ----------
    samples : most places that are drawn at a decision.
    """

    def __init__(self, samples: int) -> None:
        self.samples = samples

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial: no place was chosen yet."""
        self._rng = rng
        self._chosen: list[tuple[float, float]] = []

    def choose(self, observation: Observation) -> int | Target:
        """Return the best place of those drawn; the nearest candidate's index where none is worth anything."""
        cells = self._draw(observation)
        best = self.best(observation, cells) if len(cells) else -1
        if best < 0:
            return int(observation.path_lengths.argmin())
        place = observation.roads.grid.centre_of(int(cells[best]))
        self._chosen.append(place)
        return Target(place)

    @abstractmethod
    def best(self, observation: Observation, cells: NDArray[np.int64]) -> int:
        """Which of some cells of the roads, shape (K,), is best; −1 for none."""

    def _draw(self, observation: Observation) -> NDArray[np.int64]:
        """Cells that can be reached and from which a candidate is in view, at most `samples`, ascending."""
        grid, reachable = observation.roads.grid, observation.reachable.cells
        wanted = np.zeros(grid.shape, dtype=bool)
        wanted.reshape(-1)[reachable] = True
        places = grid.centres(reachable)
        for chosen in self._chosen:
            wanted.reshape(-1)[reachable[np.hypot(*(places - chosen).T) < APART]] = False
        pool = np.flatnonzero(in_view(observation, observation.positions, wanted).any(axis=0))
        if len(pool) <= self.samples:
            return pool
        return np.sort(self._rng.choice(pool, self.samples, replace=False))


class NextBestView(Sampled):
    """Drives to the place q with the largest A(q) · exp(−λ L(q)), A the unknown area in view, L the drive.

    [17] draws places near the free edges, the frontiers, from which these are visible, and casts rays for A. λ is
    0.2 1/m; it and the form of the rule are from memory. 100 places a decision are ours.

    Converted: in a landmark world the places are centres of cells, in a lidar world of the map's cells.

    Parameters
    ----------
    decay : λ [1/m]; 0 is the control.
    samples : most places drawn at a decision.
    """

    def __init__(self, decay: float = 0.2, samples: int = 100) -> None:
        self.decay = at_least(0.0, decay, "decay of the next best view", "a number a metre")
        super().__init__(count(1, samples, "samples of the next best view"))

    def best(self, observation: Observation, cells: NDArray[np.int64]) -> int:
        """Which place has the largest product; −1 where none sees anything unknown."""
        area = terms.unknown_area(observation, observation.roads.grid.centres(cells))
        lengths = observation.roads.lengths_to(cells)
        worth = area * np.exp(-self.decay * lengths)
        return int(np.lexsort((lengths, -np.round(worth, 9)))[0]) if area.any() else -1


class BayesianOptimization(Sampled):
    """Drives to the place of most mutual information, of which a Gaussian process says where to compute it next.

    [16]: actions are drawn, mutual information (`terms.entropy_reduction`) is computed for some, and a Gaussian process
    over the place with Matérn's kernel (3/2) predicts the others; again and again the one with the largest mean + β · σ
    is computed, then the best computed one is taken. Constants are of its code (turtlebot_exploration_3d): length scale
    3 m, noise 0.01, β = 2.4, 15 at first. There 3 more are computed and β multiplies the variance; 15 more, some 30 in
    all, are from memory of the paper. With `per_metre` all that is computed is divided by the straight distance; the
    code so divides what is computed at first, and not what the process proposes.

    Converted: its variance of 100 is of its own unit; here values are brought to mean 0 and variance 1, and so is the
    kernel. A sensor that looks all around needs no heading.

    Parameters
    ----------
    per_metre : whether information is divided by the straight distance.
    scale : length scale of the kernel [m].
    noise : variance of the noise, of a variance of 1.
    beta : β.
    first, more : how many places are computed at first and afterwards.
    prior : see `EntropyReduction`.
    samples : most places drawn at a decision.
    """

    def __init__(
        self,
        per_metre: bool = False,
        scale: float = 3.0,
        noise: float = 0.01,
        beta: float = 2.4,
        first: int = 15,
        more: int = 15,
        prior: float = 0.5,
        samples: int = 200,
    ) -> None:
        self.per_metre = flag(per_metre, "per_metre of the Bayesian optimization")
        self.scale = above(0.0, scale, "scale of the Bayesian optimization", "metres")
        self.noise = above(0.0, noise, "noise of the Bayesian optimization")
        self.beta = at_least(0.0, beta, "beta of the Bayesian optimization")
        self.first = count(1, first, "first of the Bayesian optimization")
        self.more = count(0, more, "more of the Bayesian optimization")
        self.prior = between(0.0, 1.0, prior, "prior of the Bayesian optimization")
        super().__init__(count(1, samples, "samples of the Bayesian optimization"))

    def best(self, observation: Observation, cells: NDArray[np.int64]) -> int:
        """Which of the places that were computed has the most information; −1 where none has any."""
        places = observation.roads.grid.centres(cells)
        away = np.maximum(np.hypot(*(places - observation.pose[:2]).T), 1e-3)

        def information(which: NDArray[np.int64]) -> Array:
            values = terms.entropy_reduction(observation, places[which], self.prior)
            return values / away[which] if self.per_metre else values

        computed = self._rng.permutation(len(cells))[: self.first]
        values = information(computed)
        for _ in range(min(self.more, len(cells) - len(computed))):
            left = np.setdiff1d(np.arange(len(cells)), computed)
            mean, sigma = self._predict(places[computed], values, places[left])
            following = left[[int(np.round(mean + self.beta * sigma, 9).argmax())]]
            computed, values = np.append(computed, following), np.append(values, information(following))
        lengths = observation.roads.lengths_to(cells[computed])
        found = int(np.lexsort((cells[computed], lengths, -np.round(values, 9)))[0])
        return int(computed[found]) if values[found] > 1e-9 else -1

    def _predict(self, at: Array, values: Array, places: Array) -> tuple[Array, Array]:
        """Mean and standard deviation of the process at some places given its values at others."""
        spread = values.std()
        standard = (values - values.mean()) / spread if spread > 0 else np.zeros(len(values))
        factor = cho_factor(self._kernel(at, at) + self.noise * np.eye(len(at)))
        across = self._kernel(at, places)
        variance = 1.0 - (across * cho_solve(factor, across)).sum(axis=0)
        return np.asarray(across.T @ cho_solve(factor, standard)), np.sqrt(np.maximum(variance, 0.0))

    def _kernel(self, one: Array, other: Array) -> Array:
        scaled = np.sqrt(3.0) * cdist(one, other) / self.scale
        return np.asarray((1.0 + scaled) * np.exp(-scaled))
