"""Every physical constant of the landmark worlds, with its source.

"§" is a section of Zhang et al. 2021; [8] is Chen et al. 2020; "calibrated" is explained in docs/calibration.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from explore_bench.world.floor_plan import OBSTACLE, floor_plan
from explore_bench.world.scenario import NonNegative, Positive, Scenario
from explore_bench.world.signals import Command, Odometry

if TYPE_CHECKING:
    from explore_bench.geometry import Array


MOST_STEPS_A_CELL = 1000
"""Steps that may lead from one cell to the next: predictions along a way take all of them at once."""

MOST_LANDMARKS = 40_000


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Standard deviations [m, rad]: of the start's prior, of a straight step, of a turn in place, and of a sighting."""

    prior: float
    prior_heading: float
    straight: float
    turn: float
    heading: float
    bearing: float
    range: float

    def odometry(self, command: Command) -> Odometry:
        """Odometry of a command: the command itself is read, as in [8], with the noise of a turn or a straight step."""
        turn, forward = command
        sigma = self.straight if forward else self.turn
        return Odometry((forward, 0.0, turn), (sigma, sigma, self.heading))

    @property
    def start_move(self) -> Odometry:
        """Odometry of an uncounted move at the start ([8]): 1 m ahead, 1 m to the left, then a turn by 90°."""
        return Odometry((1.0, 1.0, math.pi / 2), (self.straight, self.straight, self.heading))

    def odometries(self, commands: Array) -> tuple[Array, Array]:
        """Motions and standard deviations of many commands at once: rows (turn, forward), shape (K, 2), give (K, 3)."""
        motions, sigmas = np.zeros((len(commands), 3)), np.empty((len(commands), 3))
        motions[:, 0], motions[:, 2] = commands[:, 1], commands[:, 0]
        sigmas[:, :2] = np.where(commands[:, 1:] != 0.0, self.straight, self.turn)
        sigmas[:, 2] = self.heading
        return motions, sigmas


class LandmarkScenario(Scenario):
    """Landmarks and one-cell obstacles, a robot that turns in place or goes straight, a sensor for both (§4.1).

    With a `map` of its own, margin, clearance and obstacle settings do not apply, and the number of landmarks is an
    upper bound (there may be less room).
    """

    later: ClassVar[tuple[str, ...]] = (
        *("kind", "landmark_clearance", "margin", "landmarks_occupy", "start_moves", "planner"),
        *("frontier_neighbours", "withhold", "relinearize_threshold", "relinearize_interval"),
    )

    kind: Literal["landmark"] = "landmark"

    # World (§4.1)
    landmark_density: NonNegative = Field(3.0, description="landmarks per 100 cells (§4.1)")
    landmark_count: int | None = Field(None, ge=0, description="landmarks, instead of the density")
    landmark_clearance: NonNegative | None = Field(
        None, description="landmarks uniform on the map, this far from the start [m] (as [8]; else one a free cell)"
    )
    obstacle_density: NonNegative = Field(2.0, description="one-cell obstacles per cell of edge (calibrated)")
    obstacle_count: int | None = Field(None, ge=0, description="obstacles, instead of the density")
    margin: NonNegative = Field(
        0.0, description="open ground beyond the border, whose cells do not count [m] (as [8]; else a wall)"
    )

    # Sensor
    sensor_range: Positive = Field(5.0, description="range of the 360° sensor [m] (§4.1)")
    min_landmark_range: NonNegative = Field(0.1, description="a nearer landmark is ignored [m] (ours)")
    bearing_sigma_deg: Positive = Field(0.5, description="noise of a bearing [°] (as [8])")
    range_sigma: Positive = Field(0.02, description="noise of a range [m] (as [8])")
    occlusion: bool = Field(False, description="whether obstacles hide what lies behind them (ours)")
    landmarks_occupy: bool = Field(False, description="whether a sighted landmark makes its cell occupied (as [8])")

    # Motion
    step_length: Positive = Field(0.7, description="longest straight step [m] (calibrated)")
    turn_threshold_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        15.0, description="bearing error that asks for a turn [°] (ours)"
    )
    arrival_radius: Positive = Field(0.25, description="distance at which a waypoint is reached [m] (ours)")
    path_tolerance: Positive = Field(
        1.0, description="distance off the path's segment that ends a decision [m] (ours: half a cell)"
    )
    odometry_sigma: Positive = Field(0.07, description="noise along and across, a straight step [m] (calibrated)")
    turn_sigma: Positive = Field(0.001, description="the same of a turn in place [m]: a factor needs some (ours)")
    heading_sigma_deg: Positive = Field(0.2, description="noise of the heading, every step [°] (as [8])")
    prior_sigma: Positive = Field(0.05, description="prior of the start, x and y [m] (as [8])")
    prior_heading_sigma_deg: Positive = Field(0.01, description="prior of the start's heading [°] (as [8])")
    start_moves: int = Field(
        0,
        ge=0,
        le=1000,
        description="uncounted moves at the start: 1 m ahead, 1 m to the left and a turn by 90° (as [8])",
    )

    # Decisions
    planner: Literal["grid", "straight"] = Field(
        "grid", description="shortest paths on the grid, watched on the way, or one turn and straight on (as [8])"
    )
    frontier_neighbours: Annotated[int, Field(ge=1, le=8)] = Field(
        1, description="unknown neighbours that make a known free cell a frontier ([8]: 2)"
    )
    withhold: bool = Field(
        True, description="whether a frontier at which a decision ended waits until something changes there (ours)"
    )

    # SLAM
    relinearize_threshold: Positive = Field(
        0.01, description="change [m, rad] beyond which iSAM2 linearizes anew ([8]: 0.1)"
    )
    relinearize_interval: int = Field(1, ge=1, description="steps between two looks for such a change ([8]: 10)")

    def _check_physics(self) -> None:
        cells = round(self.size / self.cell_size) ** 2
        if self.map is None and self.obstacles + self.landmarks >= cells:
            raise ValueError(
                f"{self.obstacles} obstacles and {self.landmarks} landmarks leave no free cell among "
                f"{cells}; lower a density or a count"
            )
        if self.landmarks > MOST_LANDMARKS:
            raise ValueError(
                f"{self.landmarks:,} landmarks are more than {MOST_LANDMARKS:,}; lower landmark_density or "
                "landmark_count"
            )
        if self.step_length * MOST_STEPS_A_CELL < self.cell_size:
            raise ValueError(
                f"step_length {self.step_length:g} m makes more than {MOST_STEPS_A_CELL} steps of a cell of "
                f"{self.cell_size:g} m; lengthen it"
            )
        if abs(self.margin / self.cell_size - round(self.margin / self.cell_size)) > 1e-9:
            raise ValueError(f"margin {self.margin:g} m is no multiple of cell_size {self.cell_size:g} m")
        clearance = 0.0 if self.map is not None else self.landmark_clearance or 0.0
        if clearance >= self.size / 2:
            raise ValueError(f"landmark_clearance {clearance:g} m leaves no room around the start")
        if self.planner == "straight" and self.obstacles:
            raise ValueError(f"planner 'straight' goes round none of {self.obstacles} obstacles; set planner 'grid'")
        if self.arrival_radius >= self.cell_size / 2:
            raise ValueError(
                f"arrival_radius {self.arrival_radius:g} m reaches out of a cell; keep it under half a cell"
            )
        if self.min_landmark_range >= self.sensor_range:
            raise ValueError(f"min_landmark_range {self.min_landmark_range:g} m hides all within sensor_range")

    @property
    def extent(self) -> float:
        """Edge of the grid [m]: of the map with its margin."""
        return self.size + (2 * self.margin if self.map is None else 0.0)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Cells of the map itself, shape (rows, columns): all but the margin's."""
        margin = round((self.extent - self.size) / 2 / self.cell_size)
        inside = np.zeros(self.grid.shape, dtype=bool)
        inside[margin : self.edge - margin, margin : self.edge - margin] = True
        return inside

    @property
    def landmarks(self) -> int:
        """Landmarks of a world: the count, or the density times the cells that count, rounded half up.

        A given map may hold fewer: each takes a cell that can be reached, and two stay open.
        """
        area, room = round(self.size / self.cell_size) ** 2, None
        if self.map is not None:
            plan = floor_plan(self.map)
            area, room = int(plan.counted.sum()), int(plan.reachable.sum()) - 2
        wanted = self.landmark_count
        if wanted is None:
            wanted = math.floor(self.landmark_density * area / 100 + 0.5)
        return wanted if room is None else min(wanted, room)

    @property
    def obstacles(self) -> int:
        """Obstacle cells of a world: the map's; else the count, or the density times the edge, rounded half up."""
        if self.map is not None:
            return sum(row.count(OBSTACLE) for row in self.map)
        if self.obstacle_count is not None:
            return self.obstacle_count
        return math.floor(self.obstacle_density * self.size / self.cell_size + 0.5)

    @cached_property
    def noise(self) -> NoiseModel:
        """Standard deviations of all that is measured."""
        return NoiseModel(
            prior=self.prior_sigma,
            prior_heading=math.radians(self.prior_heading_sigma_deg),
            straight=self.odometry_sigma,
            turn=self.turn_sigma,
            heading=math.radians(self.heading_sigma_deg),
            bearing=math.radians(self.bearing_sigma_deg),
            range=self.range_sigma,
        )

    @property
    def sight_sigmas(self) -> tuple[float, float]:
        """Those of a sighted landmark (bearing [rad], range [m])."""
        return self.noise.bearing, self.noise.range

    @property
    def sight_in_words(self) -> str:
        """What the robot sees of a world, to follow "Within … m of itself it sees"."""
        return "free ground, obstacles and landmarks, each a little wrong"

    @property
    def step_in_words(self) -> str:
        """What a step is, to follow "A step is"."""
        return f"one turn on the spot or one straight move of at most {self.step_length:g} m"

    @property
    def blind(self) -> LandmarkScenario:
        """The constants that the robot may know: all but a given map."""
        if self.map is None:
            return self
        return self.replace(map=None, landmark_count=self.landmarks, obstacle_count=0)

    @property
    def tiny(self) -> LandmarkScenario:
        """A scenario with the same constants and two landmarks, and an obstacle where one may be; it takes no time."""
        size = 5 * self.cell_size
        obstacles = 0 if self.planner == "straight" else 1
        return self.replace(map=None, size=size, landmark_count=2, obstacle_count=obstacles, coverage=1.0)

    def _kept(self, changes: dict[str, Any]) -> dict[str, Any]:
        """A density takes the place of a count that was set before, and the other way round."""
        kept = super()._kept(changes)
        for thing in ("landmark", "obstacle"):
            for given, other in (("density", "count"), ("count", "density")):
                if f"{thing}_{given}" in changes:
                    kept.pop(f"{thing}_{other}", None)
        return kept
