"""Rules that give every candidate a number and take the largest: each says what of which original it is.

A constant of 0 turns its term off; so the controls are lines of the catalogue.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from baselines.field import terms
from baselines.field.believed import frontiers
from baselines.field.constants import above, at_least, between, count
from explore_bench import Array, Observation


class Score:
    """Chooses the candidate of most worth, the shorter drive among equals, then the lowest cell."""

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw and nothing to forget."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate of most worth."""
        return best(self.worth(observation), observation.path_lengths)

    def worth(self, observation: Observation) -> Array:
        """Worth of each candidate, shape (C,); −∞ for one that is out of the question."""
        raise NotImplementedError


def best(worth: Array, lengths: Array) -> int:
    """Index of the largest worth, the shorter drive among equals; differences by rounding are none."""
    return int(np.lexsort((lengths, -np.round(worth, 9)))[0])


def limited(worth: Array, admitted: NDArray[np.bool_]) -> Array:
    """Worth where it is admitted, −∞ elsewhere; as it is where nothing would be admitted."""
    return np.where(admitted, worth, -np.inf) if admitted.any() else worth


class DistanceAdvantage(Score):
    """Goes first to what is near now and far from the rest: mean over v of d(f, v) − d(r, f), largest first.

    Ericson, Pedro, Jensfelt 2025, "Information gain is not all you need" (arXiv 2504.01980), as their reproduction
    computes it: v are the free cells within 61 cells of the robot (Chebyshev's distance) at 4 cells a metre; of the
    frontiers the 500 nearest count that are at most 61 cells of driving away, and one more. Their reproduction asks a
    predicted map by default; this one the believed map, their variant without predictions.

    Converted: 61 cells are 15.25 m; f are the candidates; a decision ends where a drive does, not at every change of
    the map.

    Parameters
    ----------
    reach : of v and of the frontiers [m].
    most : nearest frontiers that count.
    distance : weight of d(r, f); 0 is the control, remoteness alone. `nearest` is the control without the mean.
    """

    def __init__(self, reach: float = 15.25, most: int = 500, distance: float = 1.0) -> None:
        self.reach = above(0.0, reach, "reach of the distance advantage", "metres")
        self.most = count(1, most, "most of the distance advantage")
        self.distance = at_least(0.0, distance, "distance of the distance advantage")

    def worth(self, observation: Observation) -> Array:
        """Difference of both lengths [m]."""
        lengths = terms.drive(observation)
        order = np.argsort(lengths, kind="stable")
        within = int((lengths <= self.reach).sum())
        admitted = np.zeros(len(lengths), dtype=bool)
        admitted[order[: min(within + 1, self.most)]] = True
        return limited(terms.remoteness(observation, self.reach) - self.distance * lengths, admitted)


class CostUtility(Score):
    """The frontier that is near and long: the least of 3 · d_min − 1 · length.

    m-explore's explore_lite (`frontierCost` in frontier_search.cpp, constants of its launch file): d_min is the
    straight distance from the robot to the frontier's nearest cell, the length its number of cells times their edge;
    shorter ones than 0.75 m do not count. Its code multiplies d_min, which is in metres already, by the resolution once
    more.

    Converted: f are the candidates, each with the frontier that it is a part of; a drive is given up by the robot, not
    after 30 s. Where no candidate's frontier is long enough all count.

    Parameters
    ----------
    distance, size : weights of d_min and of the length; 0 is a control.
    resolution : what the code multiplies d_min by [m], 0.05 for a map of 5 cm; 1 as it is meant.
    least : length of the shortest frontier that counts [m].
    """

    def __init__(self, distance: float = 3.0, size: float = 1.0, resolution: float = 1.0, least: float = 0.75) -> None:
        self.distance = at_least(0.0, distance, "distance of the cost–utility rule")
        self.size = at_least(0.0, size, "size of the cost–utility rule")
        self.resolution = above(0.0, resolution, "resolution of the cost–utility rule", "metres")
        self.least = at_least(0.0, least, "least of the cost–utility rule", "metres")

    def worth(self, observation: Observation) -> Array:
        """Length less distance, weighted [m]."""
        found = frontiers(observation)
        worth = self.size * found.length - self.distance * self.resolution * found.nearest
        return limited(worth, found.length >= self.least - 1e-9)


class InformationGain(Score):
    """The most information less the drive: λ · log(1 + g) − d.

    The classical rule as the reproduction of arXiv 2504.01980 has it, λ = 3: g are cells that a scan from f would newly
    determine, d the drive, both in cells of 0.25 m. There g is the true number; here what is in view.

    Converted: g is the unknown area in view over (0.25 m)², and the score is in metres: 0.25 λ log(1 + 16 A) − d. There
    frontiers within 15.25 m and one more are asked, here all candidates.
    Controls: `nearest` without the gain, `visible-unknown` without the drive.

    Parameters
    ----------
    gain : λ, cells of driving for a unit of log g.
    cell : edge of the original's cell [m].
    """

    def __init__(self, gain: float = 3.0, cell: float = 0.25) -> None:
        self.gain = at_least(0.0, gain, "gain of the information-gain rule")
        self.cell = above(0.0, cell, "cell of the information-gain rule", "metres")

    def worth(self, observation: Observation) -> Array:
        """Gain less drive [m]."""
        gain = np.log1p(terms.area(observation) / self.cell**2)
        return np.asarray(self.gain * self.cell * gain - terms.drive(observation))


class VisiblePerMetre(Score):
    """The most unknown in view for the distance: A / d_E.

    MapEx's baseline "obsunk" (`FrontierPlanner` in sim_utils.py, Ho et al. 2024): unknown cells in view on the observed
    map, walls hiding and unknown cells not, over the straight distance; frontiers of 10 cells of 0.1 m or fewer do not
    count.

    Converted: the shortest frontier is a length, 1 m; on 2 m cells every frontier passes. Controls: `visible-unknown`
    without the distance, `cost-utility-no-size` without what is in view.

    Parameters
    ----------
    least : length that a frontier has to exceed [m].
    """

    def __init__(self, least: float = 1.0) -> None:
        self.least = at_least(0.0, least, "least of the visible unknown per metre", "metres")

    def worth(self, observation: Observation) -> Array:
        """Area a metre [m]."""
        worth = terms.area(observation) / np.maximum(terms.straight(observation), 1e-3)
        return limited(worth, frontiers(observation).length > self.least + 1e-9)


class HeadingAware(Score):
    """Much in view, near, and ahead: A · exp(−0.07 d) · exp(−0.3 (1 − cos Δθ) / 2).

    The ratio of GBPlanner's local planner (Dang et al. 2020; rrg.cpp and the configuration "smb", its others have 0.04
    and 0.1). There the first two factors are summed over the vertices of a path, and the third punishes how far the
    path runs from the exploring direction, by dynamic time warping.

    Converted: what is in view at the end of the drive alone; the angle to the straight line there. Controls: without
    the heading, without the distance, and with neither (`visible-unknown`).

    Parameters
    ----------
    decay : of the drive [1/m].
    turning : of the turn.
    """

    def __init__(self, decay: float = 0.07, turning: float = 0.3) -> None:
        self.decay = at_least(0.0, decay, "decay of the heading-aware rule", "a number a metre")
        self.turning = at_least(0.0, turning, "turning of the heading-aware rule")

    def worth(self, observation: Observation) -> Array:
        """Area, discounted [m²]."""
        decay = self.decay * terms.drive(observation) + self.turning * terms.turn(observation)
        return np.asarray(terms.area(observation) * np.exp(-decay))


class Burgard(Score):
    """Utility less cost, U(f) − β V(f), for one robot: U = 1 everywhere, so the least V.

    Burgard et al. 2000, 2005 ("Coordinated multi-robot exploration"), from memory: V by value iteration, a step costing
    its length times the probability that its cell is occupied; U is what the other robots leave of a frontier. With one
    robot β changes nothing: a nearest frontier by risk, a control.

    Converted: value iteration is Dijkstra's search; see `terms.traversal` for the map of scans.

    Parameters
    ----------
    beta : β.
    """

    def __init__(self, beta: float = 1.0) -> None:
        self.beta = above(0.0, beta, "beta of Burgard's rule")

    def worth(self, observation: Observation) -> Array:
        """Utility less cost."""
        return 1.0 - self.beta * terms.traversal(observation)


class Makarenko(Score):
    """Information, cost and localizability, weighted: w₁ I + w₂ N + w₃ L.

    Makarenko, Williams, Bourgault, Durrant-Whyte 2002 ([12]), from memory; their weights could not be read, these are
    ours. I is the unknown area in view, N the drive and L the trace of the pose covariance that is reachable at f; each
    is brought to [0, 1] over the candidates of a decision, 1 being best.

    Converted: L by the belief propagated along the path, in both kinds of world.

    Parameters
    ----------
    information, navigation, localizability : w₁, w₂, w₃; 0 is a control.
    """

    def __init__(self, information: float = 1.0, navigation: float = 1.0, localizability: float = 1.0) -> None:
        self.information = at_least(0.0, information, "information of Makarenko's rule")
        self.navigation = at_least(0.0, navigation, "navigation of Makarenko's rule")
        self.localizability = at_least(0.0, localizability, "localizability of Makarenko's rule")

    def worth(self, observation: Observation) -> Array:
        """Sum of the weighted utilities."""
        worth = np.zeros(len(observation.candidates))
        if self.information:
            worth += self.information * _share(terms.area(observation))
        if self.navigation:
            worth += self.navigation * _share(-terms.drive(observation))
        if self.localizability:
            worth += self.localizability * _share(-terms.localizability(observation))
        return worth


def _share(values: Array) -> Array:
    """Values brought to [0, 1], the least to 0; 1 for all where they are the same."""
    low, high = values.min(), values.max()
    return np.asarray((values - low) / (high - low)) if high > low else np.ones(len(values))


class EntropyReduction(Score):
    """The largest expected reduction of the map's entropy by a scan there, computed exactly.

    Kaufman, Ai, Lee 2016 ([13]) and Kaufman, Takami, Ai, Lee 2018 ([14]), from memory: along a ray the first wall ends
    what is seen, and the expectation over where that is has a closed form. See `terms.entropy_reduction`.

    Converted: a landmark world's sensor sees each cell in range on its own, which makes the sum exact without rays. On
    a map of scans several rays into one cell count once, by the likeliest.

    Parameters
    ----------
    prior : probability that an unknown cell is a wall; the map's own is 1/2.
    """

    def __init__(self, prior: float = 0.5) -> None:
        self.prior = between(0.0, 1.0, prior, "prior of the entropy reduction")

    def worth(self, observation: Observation) -> Array:
        """Expected reduction [bit]."""
        return terms.entropy_reduction(observation, observation.positions, self.prior)


class RrtRevenue(Score):
    """Unknown area close to a frontier less the straight distance, more for what is close: 3 · h · A₁ − d_E.

    rrt_exploration's assigner.py (Umari, Mukhopadhyay 2017): A₁ is the unknown area within 1 m of f, walls or not, and
    h is 2 within 3 m of the robot. Its frontiers come from trees; here f are the candidates. For one robot without a
    goal; its `discount` around the last goal is left out: it takes 1 instead of a cell's area, as a comment there says.

    On 2 m cells a radius of 1 m holds the candidate's own, known cell alone: lidar worlds only.

    Parameters
    ----------
    multiplier : of the area [1/m].
    radius : around f [m].
    hysteresis : h; 1 is the control.
    close : within which h counts [m].
    """

    def __init__(
        self, multiplier: float = 3.0, radius: float = 1.0, hysteresis: float = 2.0, close: float = 3.0
    ) -> None:
        self.multiplier = at_least(0.0, multiplier, "multiplier of the RRT revenue")
        self.radius = above(0.0, radius, "radius of the RRT revenue", "metres")
        self.hysteresis = above(0.0, hysteresis, "hysteresis of the RRT revenue")
        self.close = at_least(0.0, close, "close of the RRT revenue", "metres")

    def worth(self, observation: Observation) -> Array:
        """Revenue [m]."""
        away = terms.straight(observation)
        factor = np.where(away <= self.close, self.hysteresis, 1.0)
        return np.asarray(self.multiplier * factor * terms.area_within(observation, self.radius) - away)
