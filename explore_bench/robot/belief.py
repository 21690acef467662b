"""What the robot believes at one moment, frozen: all that a strategy of any kind of world may read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, Pose
from explore_bench.world.scenario import Scenario


class Prediction(Protocol):
    """What the belief would become at the end of a way, if every measurement came out as expected."""

    @property
    def poses(self) -> Array:
        """Predicted steps, shape (K, 3)."""

    @property
    def sightings(self) -> int:
        """Number of landmark sightings along the way."""

    @property
    def pose_covariances(self) -> Array:
        """Marginals of the past poses and the predicted ones in the world frame, shape (N + K, 3, 3)."""

    @property
    def landmark_covariances(self) -> Array:
        """Marginal of each landmark at the end [m²], shape (M, 2, 2)."""

    @property
    def peak_trace(self) -> float:
        """Largest tr Σ (3 × 3) of the trajectory at the end [m² + rad²]."""

    @property
    def virtual_map(self) -> Array:
        """Covariance (xx, xy, yy) of every virtual landmark at the end [m²], shape (rows, columns, 3)."""

    @property
    def uncertainty(self) -> float:
        """U of Eq. 1 at the end of the way [m²]."""


class Graph(Protocol):
    """The graph behind a belief, each kind of world's own: it knows how the belief goes on."""

    @property
    def closures(self) -> NDArray[np.int64]:
        """Numbers of the two poses (earlier, later) that each loop closure so far joined, shape (L, 2)."""

    def predict(self, belief: Belief, places: Array) -> Prediction:
        """Propagate the belief along places [m] to drive through in order, shape (P, 2)."""

    def view(self, scenario: Scenario, places: Array) -> NDArray[np.bool_]:
        """Cells that are in view from places [m], shape (K, 2), as `Belief.view` gives them: shape (K, n_g)."""


@dataclass(frozen=True, slots=True)
class FineMap:
    """A map finer than the grid of decisions, where the kind of world has one. Arrays are of the grid's shape.

    Attributes
    ----------
    grid : of its cells; it covers the same square as the grid of decisions.
    known : whether a cell was observed.
    occupied : known cells believed occupied.
    """

    grid: Grid
    known: NDArray[np.bool_]
    occupied: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Belief:
    """Estimates, covariances and maps after a step, as read-only arrays. Nothing in it leads to the truth.

    Attributes
    ----------
    scenario : the constants, which the robot knows.
    poses : estimated trajectory (x, y, heading) [m, m, rad], shape (N, 3), the newest last.
    pose_covariances : marginal of each in the world frame, shape (N, 3, 3).
    landmarks : estimates [m] in the order of first sighting, shape (M, 2); none in a kind of world without landmarks.
    landmark_covariances : marginal of each [m²], shape (M, 2, 2).
    landmark_ids : the sensor's id of each, shape (M,).
    occupancy : probability that a cell is occupied, shape (rows, columns), rows along y.
    known : whether a cell was observed, shape (rows, columns).
    virtual_map : covariance (xx, xy, yy) of each cell's virtual landmark [m²], shape (rows, columns, 3).
    uncertainty : U of Eq. 1 [m²].
    peak_trace : largest tr Σ (3 × 3) of the trajectory [m² + rad²], for Eq. 3.
    graph : from which `predict` goes on.
    fine : a finer map, None in a kind of world without one.
    """

    scenario: Scenario
    poses: Array
    pose_covariances: Array
    landmarks: Array
    landmark_covariances: Array
    landmark_ids: NDArray[np.int64]
    occupancy: Array
    known: NDArray[np.bool_]
    virtual_map: Array
    uncertainty: float
    peak_trace: float
    graph: Graph
    fine: FineMap | None = None

    @property
    def pose(self) -> Pose:
        """Newest estimated pose."""
        x, y, heading = self.poses[-1].tolist()
        return x, y, heading

    @property
    def explored(self) -> float:
        """Known share of all cells; which of them count in a given map, the robot does not know."""
        return float(self.known.mean())

    @property
    def virtual_traces(self) -> Array:
        """Trace of each virtual landmark's covariance [m²], shape (rows, columns)."""
        return np.asarray(self.virtual_map[..., 0] + self.virtual_map[..., 2])

    def view(self, places: ArrayLike) -> NDArray[np.bool_]:
        """Whether each cell of the grid of decisions is expected to be in view from places [m], shape (K, 2).

        Its centre lies within the sensor's range, and where walls hide what is behind them no wall that is believed in
        stands between. Gives (K, n_g).

        Raises
        ------
        ValueError : where the places are not of that shape, or one of them is not finite.
        """
        points = np.ascontiguousarray(places, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
            raise ValueError(f"places of shape {points.shape} are no finite points [m] of shape (K, 2); give such")
        return self.graph.view(self.scenario, points)

    def predict(self, path: ArrayLike) -> Prediction:
        """Propagate the belief along a path that was not driven yet, with measurements as expected ([25]).

        Parameters
        ----------
        path : cells to drive through, shape (P,), as in `Observation.paths`, the first of several being where the
            robot is; or places [m] to drive through in order, shape (P, 2).

        Raises
        ------
        ValueError : where it is neither, or leaves the map.
        """
        way, grid = np.asarray(path), self.scenario.grid
        if way.ndim == 1 and len(way) and way.dtype.kind in "iu":
            if way.min() < 0 or way.max() >= grid.cells:
                raise ValueError(f"the path {way.tolist()} leaves the map; its cells are 0 to {grid.cells - 1}")
            places = grid.centres(way)
            return self.graph.predict(self, places[1:] if len(places) > 1 else places)
        if way.ndim != 2 or way.shape[1] != 2 or not len(way) or way.dtype.kind not in "iuf":
            raise ValueError(
                f"a path of shape {way.shape} and type {way.dtype} is neither cells, integers of shape (P,), nor "
                "places [m] of shape (P, 2); give one of them"
            )
        for x, y in way.tolist():
            if not grid.holds(x, y):
                raise ValueError(f"the path leaves the map at ({x:g}, {y:g}) m; give places on it")
        return self.graph.predict(self, np.ascontiguousarray(way, dtype=float))


@jit
def peak_traces(covariances: Array, full: float = 0.0, position: float = 0.0) -> tuple[float, float]:
    """Largest trace of poses' covariances, shape (N, 3, 3), and of their position blocks; at least those given."""
    for i in range(covariances.shape[0]):
        block = covariances[i, 0, 0] + covariances[i, 1, 1]
        position = max(position, block)
        full = max(full, block + covariances[i, 2, 2])
    return full, position


def freeze(value: object) -> None:
    """Make every array of a frozen dataclass read-only, those of nested ones too."""
    for name in getattr(value, "__dataclass_fields__", ()):
        part = getattr(value, name)
        if isinstance(part, np.ndarray):
            part.setflags(write=False)
            if isinstance(part.base, np.ndarray):
                part.base.setflags(write=False)
        else:
            freeze(part)
