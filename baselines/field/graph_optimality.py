"""D-optimality of the graph that a drive would leave, by its spanning trees.

K. Khosoussi, S. Huang, G. Dissanayake, "Tree-connectivity: evaluating the graphical structure of SLAM", ICRA 2016;
J. A. Placed, J. A. Castellanos, "A general relationship between optimality criteria and connectivity indices for active
graph-SLAM", RA-L 2022; the rule as ExplORB-SLAM computes it (Controller.py, WeightedPoseGraph.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array
from scipy.sparse.linalg import splu

from baselines.field.constants import above
from baselines.field.scores import Score
from explore_bench import Array, LandmarkScenario, Observation

LINKED = 1.0
"""Weight of an edge between key poses in a lidar world: every match counts alike, so any number does."""


class Edges(NamedTuple):
    """Edges of a graph.

    Attributes
    ----------
    ends : numbers of the two nodes of each, shape (E, 2).
    weights : of each, shape (E,).
    """

    ends: NDArray[np.int64]
    weights: Array


class GraphOptimality(Score):
    """Chooses the candidate after whose drive the weighted number of spanning trees t is largest: (n t)^(1 / n).

    n counts the nodes of the graph with those that the drive adds, t is the determinant of its Laplacian without the
    node of the start. An edge weighs det(Φ)^(1 / dimension) of its factor's information Φ (D-optimality).

    In a landmark world nodes are poses and landmarks, and edges odometry and sightings; a landmark was and will be
    sighted where its estimate is in range. In a lidar world nodes are key poses; an edge of weight 1 joins each to the
    next, and one the ends of each closed loop. A loop is expected where a key pose of the drive comes within `near` of
    one that lies `far` back along the trajectory.

    Converted: the original adds some random points of the planned path and weighs them by the share of cells that are
    seen; here these are all predicted poses.

    Parameters
    ----------
    near, far : of an expected loop in a lidar world [m] (ours; 4 m is how far its SLAM looks).
    """

    def __init__(self, near: float = 4.0, far: float = 20.0) -> None:
        self.near = above(0.0, near, "near of the graph's optimality", "metres")
        self.far = above(0.0, far, "far of the graph's optimality", "metres")

    def worth(self, observation: Observation) -> Array:
        """log(n t) / n."""
        belief = observation.belief
        poses, landmarks = belief.poses, belief.landmarks
        past, count = len(poses), len(poses) + len(landmarks)
        predicted = [belief.predict(path).poses for path in observation.paths]
        if isinstance(belief.scenario, LandmarkScenario):
            now = _landmark_edges(belief.scenario, poses, np.arange(past), landmarks, past)
            added = [
                _landmark_edges(
                    belief.scenario,
                    np.concatenate((poses[-1:], way)),
                    np.r_[past - 1, count : count + len(way)],
                    landmarks,
                    past,
                    sighting=1,
                )
                for way in predicted
            ]
        else:
            now = _key_pose_edges(past, belief.graph.closures)
            added = [self._loops(poses, way) for way in predicted]
        sizes = np.array([count + len(way) for way in predicted])
        return np.asarray((spanning_trees(count, now, added, sizes - count) + np.log(sizes)) / sizes)

    def _loops(self, poses: Array, way: Array) -> Edges:
        """Edges that a drive through key poses adds."""
        past = len(poses)
        trajectory = np.concatenate((poses, way))
        driven = np.concatenate(([0.0], np.hypot(*np.diff(trajectory[:, :2], axis=0).T).cumsum()))
        ends = [(k - 1, k) for k in range(past, len(trajectory))]
        for k in range(past, len(trajectory)):
            away = np.hypot(*(poses[:, :2] - trajectory[k, :2]).T)
            away[driven[k] - driven[:past] < self.far] = np.inf
            if away.min() <= self.near:
                ends.append((int(away.argmin()), k))
        return Edges(np.array(ends, dtype=np.int64).reshape(-1, 2), np.full(len(ends), LINKED))


def _key_pose_edges(count: int, closures: NDArray[np.int64]) -> Edges:
    chain = np.stack((np.arange(count - 1), np.arange(1, count)), axis=1)
    ends = np.concatenate((chain, closures.reshape(-1, 2)))
    return Edges(ends, np.full(len(ends), LINKED))


def _landmark_edges(
    scenario: LandmarkScenario, poses: Array, numbers: NDArray[np.int64], landmarks: Array, base: int, sighting: int = 0
) -> Edges:
    """Odometry between poses of some numbers, and sightings of landmarks, numbered from `base` on, in their range.

    Poses from `sighting` on sight: the first pose of a drive has done so before.
    """
    noise = scenario.noise
    moved = np.hypot(*np.diff(poses[:, :2], axis=0).T) > 0.5 * scenario.arrival_radius
    along = np.where(moved, noise.straight, noise.turn)
    odometry = (along**2 * noise.heading) ** (-2.0 / 3.0)
    away = np.hypot(*(poses[:, None, :2] - landmarks[None]).transpose(2, 0, 1))
    row, column = np.nonzero((away >= scenario.min_landmark_range) & (away <= scenario.sensor_range))
    row, column = row[row >= sighting], column[row >= sighting]
    sightings = 1.0 / (away[row, column] * noise.bearing * noise.range)
    chain = np.stack((numbers[:-1], numbers[1:]), axis=1)
    ends = np.concatenate((chain, np.stack((numbers[row], base + column), axis=1)))
    return Edges(ends, np.concatenate((odometry, sightings)))


def spanning_trees(count: int, now: Edges, added: list[Edges], more: NDArray[np.int64]) -> Array:
    """Logarithm of the weighted number of spanning trees of a graph with each of some sets of edges added, shape (C,).

    It is log det of the Laplacian without node 0 (Kirchhoff). The graph of `count` nodes is factored once: of it, a set
    sees no more than the inverse between the nodes that it touches. Every set adds `more` nodes, shape (C,), with
    numbers from `count` on. A landmark that no pose sights any more is held by a weight of 1e-9.
    """
    size = count - 1
    if size == 0:
        grounded, inverse, position = 0.0, np.zeros((0, 0)), np.zeros(1, dtype=np.int64)
    else:
        laplacian = _laplacian(count, now)
        factor = splu(csc_array(laplacian), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        grounded = float(np.log(np.abs(factor.U.diagonal())).sum())
        touched = np.unique(np.concatenate([edges.ends.reshape(-1) for edges in added]))
        touched = touched[(touched > 0) & (touched < count)]
        ones = np.zeros((size, len(touched)))
        ones[touched - 1, np.arange(len(touched))] = 1.0
        inverse = factor.solve(ones)[touched - 1] if len(touched) else np.zeros((0, 0))
        position = np.full(count, -1, dtype=np.int64)
        position[touched] = np.arange(len(touched))
    found = np.empty(len(added))
    for i, edges in enumerate(added):
        old = np.unique(edges.ends[(edges.ends > 0) & (edges.ends < count)])
        own = position[old]
        between = np.linalg.inv(inverse[np.ix_(own, own)]) if len(own) else np.zeros((0, 0))
        index = np.full(count + int(more[i]), -1, dtype=np.int64)
        index[old] = np.arange(len(old))
        index[count:] = len(old) + np.arange(int(more[i]))
        extended = np.zeros((len(old) + int(more[i]),) * 2)
        extended[: len(old), : len(old)] = between
        one, other = index[edges.ends].T
        for row, column, sign in ((one, one, 1.0), (other, other, 1.0), (one, other, -1.0), (other, one, -1.0)):
            kept = (row >= 0) & (column >= 0)
            np.add.at(extended, (row[kept], column[kept]), sign * edges.weights[kept])
        found[i] = grounded + np.linalg.slogdet(extended)[1]
        found[i] -= np.linalg.slogdet(between)[1] if len(own) else 0.0
    return found


def _laplacian(count: int, edges: Edges) -> coo_array:
    """Laplacian without node 0, shape (count − 1, count − 1)."""
    one, other, weight = edges.ends[:, 0], edges.ends[:, 1], edges.weights
    rows = np.concatenate((one, other, one, other, np.arange(count)))
    columns = np.concatenate((one, other, other, one, np.arange(count)))
    values = np.concatenate((weight, weight, -weight, -weight, np.full(count, 1e-9)))
    kept = (rows > 0) & (columns > 0)
    return coo_array((values[kept], (rows[kept] - 1, columns[kept] - 1)), shape=(count - 1, count - 1))
