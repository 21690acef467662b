"""A second kind of world, as small as one can be: no landmark, no noise, a step a cell.

It shows that what is shared knows no kind. `registered(monkeypatch)` makes it a kind of world named "chess"; a robot
moves like a king.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import Array, Grid, Pose
from explore_bench.robot.belief import Belief
from explore_bench.robot.planning.candidates import Ground, Withheld, find_candidates
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.explorer import Patience, StuckError, checked
from explore_bench.trial.spec import Status
from explore_bench.trial.steps import Column, Step, step_columns
from explore_bench.world.kinds import KINDS, Kind
from explore_bench.world.scenario import Positive, Scenario

KIND = "chess"
SURE = 1e-4 * np.eye(3)
CHESS = Kind(
    scenario="second_kind:ChessScenario",
    world="second_kind:ChessWorld",
    step="second_kind:ChessStep",
    explorer="second_kind:ChessExplorer",
)


def registered(monkeypatch) -> None:
    """Add the kind to the known ones until the test ends."""
    monkeypatch.setitem(KINDS, KIND, CHESS)
    step_columns.cache_clear()


class ChessScenario(Scenario):
    """A board with pawns in the way."""

    kind: Literal["chess"] = "chess"
    size: Positive = 16.0
    sensor_range: Positive = 5.0
    pawns: int = 4

    @property
    def sight_sigmas(self) -> tuple[float, float]:
        return 0.01, 0.02

    @property
    def sight_in_words(self) -> str:
        return "pawns"

    @property
    def step_in_words(self) -> str:
        return "a king's move"

    @property
    def tiny(self) -> ChessScenario:
        return self.replace(size=5 * self.cell_size, pawns=1)


@dataclass(frozen=True, eq=False)
class ChessWorld:
    """A board."""

    grid: Grid
    obstacles: NDArray[np.bool_]
    start: Pose

    landmarks = np.empty((0, 2))

    @property
    def walls(self) -> NDArray[np.bool_]:
        return self.obstacles

    @property
    def counted(self) -> NDArray[np.bool_]:
        return np.ones(self.grid.shape, dtype=bool)

    @property
    def digest(self) -> str:
        return "".join(map(str, np.flatnonzero(self.obstacles)))[:12]

    @classmethod
    def draw(cls, scenario: ChessScenario, rng: np.random.Generator) -> ChessWorld:
        obstacles = np.zeros(scenario.grid.shape, dtype=bool)
        obstacles[2::3, 2::3] = True  # apart from one another, so that everything can be reached
        taken = rng.permutation(np.flatnonzero(obstacles))[scenario.pawns :]
        obstacles.reshape(-1)[taken] = False
        return cls(scenario.grid, obstacles, (*scenario.grid.centre_of(0), 0.0))

    def facts(self) -> dict[str, Any]:
        return {"pawns": np.flatnonzero(self.obstacles).tolist(), "start": list(self.start)}

    @classmethod
    def from_facts(cls, facts: dict[str, Any], scenario: ChessScenario) -> ChessWorld:
        obstacles = np.zeros(scenario.cell_count, dtype=bool)
        obstacles[facts["pawns"]] = True
        return cls(scenario.grid, obstacles.reshape(scenario.grid.shape), tuple(facts["start"]))


@dataclass(frozen=True, slots=True)
class ChessStep(Step):
    """Primitives after one step, with the one that only this kind has."""

    diagonal: Annotated[int, Column("int32", "1", "whether the step was a diagonal one")]


@dataclass(frozen=True)
class ChessPrediction:
    """Nothing becomes uncertain."""

    poses: Array
    pose_covariances: Array
    virtual_map: Array
    uncertainty: float
    sightings: int = 0
    peak_trace: float = 3e-4

    @property
    def landmark_covariances(self) -> Array:
        return np.empty((0, 2, 2))


@dataclass(frozen=True)
class ChessGraph:
    """No graph at all."""

    moves: int

    closures = np.empty((0, 2), dtype=np.int64)

    def view(self, scenario: Scenario, places: Array) -> NDArray[np.bool_]:
        return scenario.grid.in_reach(places, scenario.sensor_range)

    def predict(self, belief: Belief, places: Array) -> ChessPrediction:
        poses = np.column_stack((places, np.zeros(len(places))))
        covariances = np.tile(SURE, (len(belief.poses) + len(poses), 1, 1))
        return ChessPrediction(poses, covariances, belief.virtual_map, belief.uncertainty)


class ChessExplorer:
    """A king who knows where he is."""

    def __init__(self, scenario: ChessScenario, world: ChessWorld, motion, sensing, lap) -> None:
        self.scenario, self._world, self._lap = scenario, world, lap
        self._path = [world.start]
        self._decisions = self._diagonal = 0
        self._known = np.zeros(scenario.grid.shape, dtype=bool)
        self._withheld, self._patience = Withheld(), Patience(scenario)
        self._look()

    @property
    def _cell(self) -> int:
        return self.scenario.grid.cell_of(*self._path[-1][:2])

    def _look(self) -> None:
        here = np.array([self._path[-1][:2]])
        self._known |= self.scenario.grid.in_reach(here, self.scenario.sensor_range).reshape(self._known.shape)

    def status(self) -> Status | None:
        if self._known.mean() >= self.scenario.coverage:
            return Status.EXPLORED
        return Status.STEP_LIMIT if len(self._path) > self.scenario.step_limit else None

    def row(self) -> ChessStep:
        pose, steps = self._path[-1], len(self._path) - 1
        values = (
            steps,
            self._decisions,
            0,
            *pose,
            *pose,
            *SURE[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]],
            self._uncertainty,
            3e-4,
            2e-4,
        )
        self._lap("row")
        return ChessStep(*values, float(self._known.mean()), 2.0 * steps, 0.0, 0, 0, 0.0, 0.0, 0, self._diagonal)

    @property
    def _uncertainty(self) -> float:
        return 2.0 * self.scenario.virtual_sigma**2 * float((~self._known).sum())

    def belief(self) -> Belief:
        poses, shape = np.array(self._path), self.scenario.grid.shape
        prior = np.array([1.0, 0.0, 1.0]) * self.scenario.virtual_sigma**2
        virtual = np.where(self._known[..., None], 0.0, prior)
        occupancy = np.where(self._known, np.where(self._world.obstacles, 0.9, 0.1), 0.5)
        none = np.empty(0, dtype=np.int64)
        return Belief(
            *(self.scenario, poses, np.tile(SURE, (len(poses), 1, 1)), np.empty((0, 2)), np.empty((0, 2, 2)), none),
            *(occupancy.reshape(shape), self._known.copy(), virtual, self._uncertainty, 3e-4, ChessGraph(len(poses))),
        )

    def observe(self) -> Observation:
        blocked = self._known & self._world.obstacles
        found = find_candidates(
            Ground(self.scenario, self._path[-1], self._known, blocked, np.empty((0, 2))), self._withheld
        )
        if found is None:
            raise StuckError("check mate")
        self._patience.decide(self._cell)
        self._found = found
        positions = self.scenario.grid.centres(found.cells)
        return Observation(
            *(self.belief(), len(self._path) - 1, self._decisions, found.cells, positions),
            *(found.paths, found.lengths, found.roads),
        )

    def drive(self, choice: object) -> Iterator[ChessStep]:
        grid = self.scenario.grid
        answer = checked(choice, len(self._found.cells), self._found.roads)
        path = self._found.paths[answer] if isinstance(answer, int) else None
        if isinstance(answer, Target):
            path = self._found.roads.path_to(grid.cell_of(*answer.position))
        self._decisions += 1
        for before, cell in zip(path[:-1].tolist(), path[1:].tolist(), strict=True):
            if self._world.obstacles.reshape(-1)[cell]:
                return
            self._diagonal = int(abs(cell - before) not in (1, grid.columns))
            self._path.append((*grid.centre_of(cell), 0.0))
            self._look()
            self._patience.visit(self._cell)
            yield self.row()
            if self.status() is not None:
                return
        self._withheld.add(int(path[-1]), self._known)
