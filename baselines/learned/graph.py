"""The exploration graph of an observation (§3.2, Table 1, Eq. 4): what the learned strategies see.

Nodes come in the order trajectory, landmarks, obstacles, candidates. A trajectory node is a visited cell: the latest
pose there, cells in the order of their latest visit, so that the last one is the robot's present position.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from explore_bench import (
    OCCUPIED_ABOVE,
    Array,
    Grid,
    Observation,
    cell_of,
    cells_of,
    jit,
    renyi_entropy,
    shannon_entropy,
    unknown,
)

FRONTIER, LANDMARK, CURRENT, TRAJECTORY, OBSTACLE = 2, 1, 0, -1, -2
"""Flags ϕ of Table 1."""


@dataclass(frozen=True, eq=False)
class ExplorationGraph:
    """Nodes with features, and edges.

    Attributes
    ----------
    features : value of each node in the named columns, in multiples of their scale, shape (N, F).
    adjacency : weight of the edge between two nodes, 0 where there is none, symmetric, zero diagonal, shape (N, N).
    trajectory : number of trajectory nodes, the first rows.
    candidates : number of candidates, the last rows in the order of the observation.
    """

    features: NDArray[np.float32]
    adjacency: NDArray[np.float32]
    trajectory: int
    candidates: int


@dataclass(frozen=True, eq=False)
class Nodes:
    """Where the nodes are, before any feature is computed.

    Attributes
    ----------
    observation : what they come from.
    positions : place of each [m], shape (N, 2).
    flags : ϕ of Table 1, shape (N,).
    cells : cell that holds each, shape (N,).
    poses : row of the belief's trajectory that each trajectory node stands for, shape (T,).
    """

    observation: Observation
    positions: Array
    flags: NDArray[np.int64]
    cells: NDArray[np.int64]
    poses: NDArray[np.int64]


@dataclass(frozen=True)
class Feature:
    """A column of node features: its values in `unit`, divided by `scale` so that they are of order one."""

    symbol: str
    unit: str
    scale: float
    meaning: str
    values: Callable[[Nodes], Array]


def exploration_graph(
    observation: Observation, columns: Sequence[str], obstacles: bool = True, weighted: bool = False
) -> ExplorationGraph:
    """Build the exploration graph of an observation.

    Edges, each in both directions: (i) cells that follow each other in the trajectory; (ii) each trajectory node and
    the landmark nearest to it; (iii) each candidate and the nearest landmark or the present position, whichever is
    nearer; (iv) all pairs of landmarks; (v) each obstacle and the trajectory node nearest to it.

    Parameters
    ----------
    columns : names of FEATURES, in the order in which they are wanted.
    obstacles : whether cells believed occupied are nodes.
    weighted : whether an edge weighs its length [m], as in [8], instead of 1.

    Raises
    ------
    RequestError : for a column that is not one of FEATURES.
    """
    nodes = _nodes(observation, obstacles)
    features = np.empty((len(nodes.flags), len(columns)), dtype=np.float32)
    for i, name in enumerate(columns):
        if name not in FEATURES:
            raise unknown("feature column", name, FEATURES)
        features[:, i] = FEATURES[name].values(nodes) / FEATURES[name].scale
    adjacency = _edges(observation.belief.poses, nodes.positions, nodes.flags, observation.scenario.grid, weighted)
    return ExplorationGraph(features, adjacency, len(nodes.poses), len(observation.candidates))


def _nodes(observation: Observation, obstacles: bool) -> Nodes:
    belief, grid = observation.belief, observation.scenario.grid
    poses = _latest_visits(belief.poses, grid)
    blocks = np.empty(0, dtype=np.int64)
    if obstacles:
        blocks = np.flatnonzero(belief.known & (belief.occupancy > OCCUPIED_ABOVE))
    groups = (
        (TRAJECTORY, belief.poses[poses, :2]),
        (LANDMARK, belief.landmarks),
        (OBSTACLE, grid.centres(blocks)),
        (FRONTIER, observation.positions),
    )
    flags = np.concatenate([np.full(len(places), flag) for flag, places in groups])
    flags[len(poses) - 1] = CURRENT
    positions = np.concatenate([places for _, places in groups])
    return Nodes(observation, positions, flags, cells_of(grid, positions), poses)


@jit
def _latest_visits(poses: Array, grid: Grid) -> NDArray[np.int64]:
    """Rows of the last pose in every visited cell, ascending."""
    cells = grid.rows * grid.columns
    visited = np.zeros(cells, dtype=np.bool_)
    rows = np.empty(min(poses.shape[0], cells), dtype=np.int64)
    count = 0
    for i in range(poses.shape[0] - 1, -1, -1):
        cell = cell_of(grid, poses[i, 0], poses[i, 1])
        if not visited[cell]:
            visited[cell] = True
            rows[count] = i
            count += 1
    return rows[:count][::-1].copy()


@jit
def _edges(poses: Array, positions: Array, flags: NDArray[np.int64], grid: Grid, weighted: bool) -> NDArray[np.float32]:
    """Adjacency of nodes at these positions, shape (N, N); `poses` is the whole trajectory."""
    count = flags.shape[0]
    adjacency = np.zeros((count, count), dtype=np.float32)
    node_of = np.full(grid.rows * grid.columns, -1, dtype=np.int64)
    current, first_landmark, last_landmark = 0, 0, 0
    for i in range(count):
        if flags[i] == TRAJECTORY or flags[i] == CURRENT:
            node_of[cell_of(grid, positions[i, 0], positions[i, 1])] = i
            current = i
            first_landmark = i + 1
            last_landmark = i + 1
        elif flags[i] == LANDMARK:
            last_landmark = i + 1
    previous = cell_of(grid, poses[0, 0], poses[0, 1])
    for i in range(1, poses.shape[0]):
        cell = cell_of(grid, poses[i, 0], poses[i, 1])
        if cell != previous:
            _join(adjacency, positions, node_of[previous], node_of[cell], weighted)
        previous = cell
    for i in range(count):
        if flags[i] == TRAJECTORY or flags[i] == CURRENT:
            to = _nearest(positions, i, first_landmark, last_landmark)
        elif flags[i] == FRONTIER:
            to = _nearest(positions, i, first_landmark, last_landmark)
            if to < 0 or _distance(positions, i, current) <= _distance(positions, i, to):
                to = current
        elif flags[i] == OBSTACLE:
            to = _nearest(positions, i, 0, current + 1)
        else:
            for j in range(first_landmark, i):
                _join(adjacency, positions, i, j, weighted)
            to = -1
        if to >= 0:
            _join(adjacency, positions, i, to, weighted)
    return adjacency


@jit
def _join(adjacency: NDArray[np.float32], positions: Array, i: int, j: int, weighted: bool) -> None:
    weight = _distance(positions, i, j) if weighted else 1.0
    adjacency[i, j] = weight
    adjacency[j, i] = weight


@jit
def _distance(positions: Array, i: int, j: int) -> float:
    return np.hypot(positions[i, 0] - positions[j, 0], positions[i, 1] - positions[j, 1])


@jit
def _nearest(positions: Array, i: int, first: int, last: int) -> int:
    """The node from first to last − 1 that is nearest to node i, the first of equals; −1 where there is none."""
    best, nearest = np.inf, -1
    for j in range(first, last):
        distance = _distance(positions, i, j)
        if distance < best:
            best, nearest = distance, j
    return nearest


def _offsets(nodes: Nodes) -> Array:
    return nodes.positions - nodes.positions[len(nodes.poses) - 1]


def _distances(nodes: Nodes) -> Array:
    return np.asarray(np.hypot(*_offsets(nodes).T))


def _path_lengths(nodes: Nodes) -> Array:
    """Length of the planned path to each candidate [m], the straight distance of all other nodes."""
    lengths = nodes.observation.path_lengths
    return np.concatenate((_distances(nodes)[: len(nodes.flags) - len(lengths)], lengths))


def _bearings(nodes: Nodes) -> Array:
    """Angle from the heading to each node [rad], in (−π, π]; 0 for the present position itself."""
    offsets = _offsets(nodes)
    angles = np.arctan2(offsets[:, 1], offsets[:, 0]) - nodes.observation.pose[2]
    angles = -((-angles + np.pi) % (2 * np.pi) - np.pi)
    angles[len(nodes.poses) - 1] = 0.0
    return np.asarray(angles)


def _shannon_in_view(nodes: Nodes) -> Array:
    belief = nodes.observation.belief
    return sums_in_view(belief.view(nodes.positions), shannon_entropy(belief.occupancy).reshape(-1))


@jit
def sums_in_view(view: NDArray[np.bool_], values: Array) -> Array:
    """Sum of the cells' values, shape (n_g,), over those in each view, shape (K, n_g), in ascending order; (K,)."""
    sums = np.zeros(view.shape[0])
    for i in range(view.shape[0]):
        for cell in range(view.shape[1]):
            if view[i, cell]:
                sums[i] += values[cell]
    return sums


def _at_cells(grid: Array, nodes: Nodes) -> Array:
    return np.asarray(grid.reshape(-1)[nodes.cells])


def _renyi(nodes: Nodes) -> Array:
    belief = nodes.observation.belief
    orders = 1.0 + 1.0 / _at_cells(belief.virtual_traces, nodes)
    return renyi_entropy(_at_cells(belief.occupancy, nodes), orders)


def _traces(nodes: Nodes) -> Array:
    """Trace of the position covariance of poses and landmarks; of the virtual landmark of other nodes."""
    belief = nodes.observation.belief
    traces = _at_cells(belief.virtual_traces, nodes)
    positions = belief.pose_covariances[nodes.poses]
    traces[: len(nodes.poses)] = positions[:, 0, 0] + positions[:, 1, 1]
    traces[nodes.flags == LANDMARK] = np.trace(belief.landmark_covariances, axis1=1, axis2=2)
    return traces


FEATURES: dict[str, Feature] = {
    "distance": Feature("d", "m", 10.0, "straight distance from the robot (Eq. 4)", _distances),
    "path_length": Feature("d", "m", 10.0, "the same, of a candidate along the planned path", _path_lengths),
    "bearing": Feature("φ", "rad", np.pi, "angle from the heading (Eq. 4)", _bearings),
    "shannon": Feature("H_γ", "bit", 10.0, "Shannon entropy summed over the cells in view (Eq. 5)", _shannon_in_view),
    "cell_shannon": Feature(
        "H_γ",
        "bit",
        1.0,
        "the same of the node's own cell",
        lambda x: shannon_entropy(_at_cells(x.observation.belief.occupancy, x)),
    ),
    "renyi": Feature("H_β", "bit", 1.0, "Rényi entropy of the node's cell, β = 1 + 1 / tr Σ (Eq. 6)", _renyi),
    "flag": Feature("ϕ", "", 1.0, "kind of node (Table 1)", lambda x: x.flags.astype(float)),
    "trace": Feature("tr Σ", "m²", 1.0, "trace of the node's position covariance ([8])", _traces),
    "occupancy": Feature(
        "p",
        "",
        1.0,
        "probability that the node's cell is occupied ([8])",
        lambda x: _at_cells(x.observation.belief.occupancy, x),
    ),
}

EQUATION_4 = ("distance", "bearing", "shannon", "renyi", "flag")
"""Columns of Eq. 4."""


def equation_4(along_paths: bool = False, of_cells: bool = False) -> tuple[str, ...]:
    """Columns of Eq. 4 under other readings: d of a candidate along its planned path, H_γ of a node's own cell."""
    other = {"distance": "path_length"} if along_paths else {}
    if of_cells:
        other["shannon"] = "cell_shannon"
    return tuple(other.get(name, name) for name in EQUATION_4)


CHEN_2020 = ("trace", "distance", "bearing", "occupancy", "flag")
"""Columns of [8]."""
