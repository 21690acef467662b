"""A policy on a graph of free cells, of the form of ARiADNE (Cao et al. 2023), as a strategy that answers a Target.

    explore-bench run smoke -s 'examples/graph_policy.py:GraphPolicy[weights=examples/graph_policy.safetensors]'

It shows how somebody else's learned planner is adapted: the observation becomes the planner's own input, its output a
place to drive to. Nodes are free cells of the grid of decisions that can be reached, with their place, utility (how
many frontier cells are in view from there) and whether the robot has been there; edges join neighbours that nothing
stands between. A network attends along the edges and points to the node to drive to. Where no node promises anything,
the nearest candidate is taken. ARiADNE moves from neighbour to neighbour; here a decision is a drive, so that it points
to any node. The weights are of this project's own making, by `train_graph_policy.py`; none of ARiADNE's are used.
"""

from typing import NamedTuple

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from scipy import ndimage

from explore_bench import OCCUPIED_ABOVE, Array, Observation, RequestError, Target

COLUMNS = ("x / 20 m", "y / 20 m", "utility / 10", "visited")
"""Columns of a node; its place is seen from the robot's."""

WIDTH, HEADS, LAYERS = 32, 4, 2
CLIP = 10.0
"""Largest magnitude of a logit, as in pointer networks."""

AROUND = np.ones((3, 3), dtype=bool)


class Graph(NamedTuple):
    """What the planner sees of K nodes.

    Attributes
    ----------
    places : of the nodes [m], shape (K, 2).
    lengths : of the drives to them [m], shape (K,); 0 where the robot is.
    nodes : columns COLUMNS, shape (K, 4).
    edges : whether two are joined, each with itself, shape (K, K).
    own : number of the node where the robot is.
    promising : nodes that may be pointed to: of some utility, and not visited before.
    """

    places: Array
    lengths: Array
    nodes: Array
    edges: np.ndarray
    own: int
    promising: np.ndarray


def graph_of(observation: Observation) -> Graph:
    """Graph of the free cells of the grid of decisions, each at its drivable place nearest to its centre."""
    belief, grid, roads = observation.belief, observation.scenario.grid, observation.roads
    reached, drives = observation.reachable
    places = np.vstack((roads.grid.centres(reached), [observation.pose[:2]]))
    lengths = np.append(drives, 0.0)
    cells = np.array([grid.cell_of(x, y) for x, y in places.tolist()])
    here = cells[-1]
    off = np.hypot(*(places - grid.centres(cells)).T)
    off[-1] = -1.0  # the robot's own cell is where the robot is
    order = np.lexsort((off, cells))
    chosen = order[np.unique(cells[order], return_index=True)[1]]
    places, lengths, cells = places[chosen], lengths[chosen], cells[chosen]
    free = belief.known & (belief.occupancy <= OCCUPIED_ABOVE)
    frontier = free & ndimage.binary_dilation(~belief.known, AROUND)
    utility = belief.view(places)[:, frontier.reshape(-1)].sum(axis=1)
    visited = np.isin(cells, [grid.cell_of(x, y) for x, y, _ in belief.poses.tolist()])
    own = int(np.flatnonzero(cells == here)[0])
    relative = (places - places[own]) / 20.0
    nodes = np.column_stack((relative, utility / 10.0, visited))
    return Graph(places, lengths, nodes, _edges(places, cells, observation), own, (utility > 0) & ~visited)


def _edges(places: Array, cells: np.ndarray, observation: Observation) -> np.ndarray:
    """Whether each two nodes are neighbours with nothing on the straight line between them, shape (K, K)."""
    columns, roads = observation.scenario.grid.columns, observation.roads
    row, column = cells // columns, cells % columns
    near = (abs(row[:, None] - row) <= 1) & (abs(column[:, None] - column) <= 1)
    one, other = np.nonzero(near)
    steps = np.linspace(0.0, 1.0, 2 + int(3.0 * observation.scenario.cell_size / roads.grid.resolution))
    along = places[one, None] + steps[:, None] * (places[other] - places[one])[:, None]
    origin = np.array([roads.grid.x0, roads.grid.y0])
    across = np.clip(((along - origin) / roads.grid.resolution).astype(int), 0, np.array(roads.free.shape)[::-1] - 1)
    passed = across[..., 1] * roads.grid.columns + across[..., 0]
    open_ = (roads.free.reshape(-1)[passed] | (passed == roads.start)).all(axis=1)
    edges = np.eye(len(cells), dtype=bool)
    edges[one[open_], other[open_]] = True
    return edges


class Network(torch.nn.Module):
    """Logits of the nodes, shape (K,), from their columns (K, 4), the edges (K, K) and the robot's node."""

    def __init__(self) -> None:
        super().__init__()
        self.embed = torch.nn.Linear(len(COLUMNS), WIDTH)
        layer = torch.nn.TransformerEncoderLayer(WIDTH, HEADS, WIDTH, dropout=0.0, batch_first=True, norm_first=True)
        self.encode = torch.nn.TransformerEncoder(layer, LAYERS, enable_nested_tensor=False)
        self.query, self.key = torch.nn.Linear(2 * WIDTH, WIDTH), torch.nn.Linear(WIDTH, WIDTH)

    def forward(self, nodes: torch.Tensor, edges: torch.Tensor, own: int) -> torch.Tensor:
        """Attend along the edges, then point from the robot's node and the mean of all."""
        seen = self.encode(self.embed(nodes)[None], mask=~edges)[0]
        query = self.query(torch.cat((seen[own], seen.mean(dim=0))))
        return CLIP * torch.tanh(self.key(seen) @ query / WIDTH**0.5)

    def of(self, graph: Graph) -> torch.Tensor:
        """Logits of a graph's nodes; −∞ for those that may not be pointed to."""
        logits = self(torch.as_tensor(graph.nodes, dtype=torch.float32), torch.as_tensor(graph.edges), graph.own)
        return logits.masked_fill(~torch.as_tensor(graph.promising), -torch.inf)


class GraphPolicy:
    """Drives to the node that the network points to."""

    def __init__(self, weights: str) -> None:
        self.network = Network().eval()
        try:
            self.network.load_state_dict(load_file(weights))
        except (OSError, SafetensorError, RuntimeError) as error:
            raise RequestError(
                f"'{weights}' holds no weights of this network ({type(error).__name__}); make them with "
                "train_graph_policy.py."
            ) from None

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; nothing is kept from the last one, nothing drawn."""

    def choose(self, observation: Observation) -> int | Target:
        """Return the place of the best node, or the nearest candidate where no node promises anything."""
        graph = graph_of(observation)
        if not graph.promising.any():
            return int(observation.path_lengths.argmin())
        with torch.no_grad():
            x, y = graph.places[int(self.network.of(graph).argmax())].tolist()
        return Target((x, y))
