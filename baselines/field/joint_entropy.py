"""The least joint entropy of trajectory and map, with revisits where the robot becomes unsure of its place.

C. Stachniss, G. Grisetti, W. Burgard, "Information gain-based exploration using Rao-Blackwellized particle filters",
RSS 2005; the revisits as in C. Stachniss, D. Hähnel, W. Burgard, "Exploration with active loop-closing for FastSLAM",
IROS 2004. Both from memory.
"""

from __future__ import annotations

import numpy as np

from baselines.field import terms
from baselines.field.believed import finest_map
from baselines.field.constants import above, at_least, between, finite, flag
from baselines.field.scores import best
from explore_bench import Array, Observation, Target

BIT = float(np.log(2.0))
"""A bit [nat]."""

BOUNDS = {"landmark": -12.0, "lidar": -31.0}
"""log det of the pose's covariance beyond which it is unsure, by kind of world: 0.3 m and 1.6°, and 1 cm and 0.1°."""


class JointEntropy:
    """Chooses what leaves the least expected entropy of trajectory and map; closes a loop where the pose is unsure.

    The entropy of the trajectory is the mean over its poses of that of a Gaussian, that of the map the sum over its
    cells times their area, so that it does not depend on their size; both [nat]. Of a candidate: the poses predicted
    along the path, and the map less `terms.entropy_reduction` there; and `weight` for every metre of the drive.

    A loop is closed on purpose where log det of the pose's covariance exceeds `bound` and a place of the past is near
    on the map and far along the trajectory; the robot drives to the nearest such place, and to none twice.

    Converted: 2004's conditions are distances on the grid and on a topological map, and its robot stays in the loop
    while the filter is unsure; a particle filter's entropies are a Gaussian's here, and one scan is expected, at the
    path's end. 2005's abstract trades the cost of the way against information; how it weighs the two could not be read:
    `weight` is 0 unless it is tuned, and all constants are ours.

    Parameters
    ----------
    weight : of the drive [nat/m].
    closing : whether loops are closed on purpose.
    bound : of log det of the 3 × 3 covariance [m⁴ rad²]; None for that of `BOUNDS`.
    near : length of the drive to a place of the past, at most [m].
    far : length of the trajectory since it was there, at least [m].
    prior : see `EntropyReduction`.
    """

    def __init__(
        self,
        weight: float = 0.0,
        closing: bool = True,
        bound: float | None = None,
        near: float = 6.0,
        far: float = 20.0,
        prior: float = 0.5,
    ) -> None:
        self.weight = at_least(0.0, weight, "weight of the joint entropy")
        self.closing = flag(closing, "closing of the joint entropy")
        self.bound = None if bound is None else finite(bound, "bound of the joint entropy")
        self.near = above(0.0, near, "near of the joint entropy", "metres")
        self.far = above(0.0, far, "far of the joint entropy", "metres")
        self.prior = between(0.0, 1.0, prior, "prior of the joint entropy")

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial: no loop was closed yet."""
        self._closed: list[tuple[float, float]] = []

    def choose(self, observation: Observation) -> int | Target:
        """Return the place of the loop that is due, else the index of the best candidate."""
        if self.closing and (place := self._loop_due(observation)) is not None:
            self._closed.append(place)
            return Target(place)
        return best(-self.expected(observation), observation.path_lengths)

    def expected(self, observation: Observation) -> Array:
        """Expected entropy after each candidate's drive, less the map's now, and the drive's cost [nat], shape (C,)."""
        edge = finest_map(observation).grid.resolution
        gains = terms.entropy_reduction(observation, observation.positions, self.prior) * BIT * edge**2
        covariances = [observation.belief.predict(path).pose_covariances for path in observation.paths]
        trajectory = np.array([terms.pose_entropy(one) for one in covariances])
        return np.asarray(trajectory - gains + self.weight * observation.path_lengths)

    def _loop_due(self, observation: Observation) -> tuple[float, float] | None:
        """Centre of the cell to revisit; None where no loop is due."""
        belief, roads = observation.belief, observation.roads
        bound = BOUNDS[observation.scenario.kind] if self.bound is None else self.bound
        if np.linalg.slogdet(belief.pose_covariances[-1])[1] <= bound:
            return None
        places = belief.poses[:, :2]
        since = np.hypot(*np.diff(places, axis=0).T)[::-1].cumsum()[::-1]
        old = places[:-1][since >= self.far]
        cells = np.unique([roads.grid.cell_of(x, y) for x, y in old.tolist()]).astype(np.int64)
        cells = cells[cells != roads.start]
        for place in self._closed:
            cells = cells[np.hypot(*(roads.grid.centres(cells) - place).T) >= self.near]
        lengths = roads.lengths_to(cells)
        if not len(cells) or not lengths.min() <= self.near:
            return None
        return roads.grid.centre_of(int(cells[lengths.argmin()]))
