"""Every physical constant of a trial, with its source, and the named scenarios.

"§" is a section of Zhang et al. 2021; [8] is Chen et al. 2020; "calibrated" is explained in docs/calibration.md.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from explore_bench.errors import RequestError, unknown
from explore_bench.world.floor_plan import OBSTACLE, edge_of, site_of

Positive = Annotated[float, Field(ge=1e-9, le=1e6, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
Probability = Annotated[float, Field(gt=0, lt=1)]

MAX_CELLS = 40_000


class Scenario(BaseModel):
    """The world's statistics, the robot's body, noise and sensor, the map's and the protocol's constants.

    Lengths are metres; names that end in `_deg` are degrees. Instances are immutable and hashable by value.

    With a `map` of its own the world is not drawn: `size` follows from it, obstacle settings do not apply, and the
    number of landmarks is an upper bound (there may be less room).

    Raises
    ------
    RequestError : for an unknown key or a value out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    # Map (§4.1)
    size: Positive = Field(20.0, description="edge of the square map [m] (§4.1: 20, 30, 40)")
    cell_size: Positive = Field(2.0, description="edge of a cell [m] (§4.1)")
    landmark_density: NonNegative = Field(3.0, description="landmarks per 100 cells (§4.1)")
    landmark_count: int | None = Field(None, ge=0, description="landmarks, instead of the density")
    obstacle_density: NonNegative = Field(2.0, description="one-cell obstacles per cell of edge (calibrated)")
    obstacle_count: int | None = Field(None, ge=0, description="obstacles, instead of the density")
    map: tuple[str, ...] | None = Field(
        None, description="rows of a given map, north first: # obstacle, . free, ? or blank unknown, S start (ours)"
    )

    # Sensor
    sensor_range: Positive = Field(5.0, description="range of the 360° sensor [m] (§4.1)")
    min_landmark_range: NonNegative = Field(0.1, description="a nearer landmark is ignored [m] (ours)")
    bearing_sigma_deg: Positive = Field(0.5, description="noise of a bearing [°] (as [8])")
    range_sigma: Positive = Field(0.02, description="noise of a range [m] (as [8])")
    occlusion: bool = Field(False, description="whether obstacles hide what lies behind them (ours)")

    # Motion
    step_length: Positive = Field(0.7, description="longest straight step [m] (calibrated)")
    turn_threshold_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        15.0, description="bearing error that asks for a turn [°] (ours)"
    )
    arrival_radius: Positive = Field(0.25, description="distance at which a waypoint is reached [m] (ours)")
    odometry_sigma: Positive = Field(0.07, description="noise along and across, a straight step [m] (calibrated)")
    turn_sigma: Positive = Field(0.001, description="the same of a turn in place [m]: a factor needs some (ours)")
    heading_sigma_deg: Positive = Field(0.2, description="noise of the heading, every step [°] (as [8])")
    prior_sigma: Positive = Field(0.05, description="prior of the start, x and y [m] (as [8])")
    prior_heading_sigma_deg: Positive = Field(0.01, description="prior of the start's heading [°] (as [8])")

    # Virtual map and occupancy (§3.1, [25], [8])
    virtual_sigma: Positive = Field(1.0, description="prior σ₀ of a virtual landmark [m] ([8])")
    fusion: Literal["trace", "determinant"] = Field(
        "trace", description="what covariance intersection minimizes (trace: the paper's A-optimality)"
    )
    first_sight: Literal["fuse", "replace"] = Field(
        "fuse", description="whether a first sight is fused with the prior or replaces it (as [8])"
    )
    key_pose_spacing: NonNegative = Field(
        0.0, description="the virtual map uses poses at least this far apart along the way [m] (0: all)"
    )
    hit: Probability = Field(0.7, description="inverse sensor model of an occupied cell ([8])")
    miss: Probability = Field(0.3, description="inverse sensor model of a free cell ([8])")
    occupancy_clamp: Annotated[float, Field(gt=0, lt=0.5)] = Field(
        0.05, description="probabilities stay within [c, 1 − c] ([8])"
    )

    # Candidates and protocol (§4.1)
    candidates_per_robot: int = Field(5, ge=0, description="frontier cells nearest to the robot (§4.1)")
    candidates_per_landmark: int = Field(3, ge=0, description="frontier cells nearest to a landmark (§4.1)")
    path_tolerance: Positive = Field(
        1.0, description="distance off the path's segment that ends a decision [m] (ours: half a cell)"
    )
    coverage: Annotated[float, Field(gt=0, le=1)] = Field(0.9, description="known share that ends a trial (§4.1)")
    steps_per_cell: Positive = Field(10.0, description="step limit per cell of the map (ours)")
    stuck_decisions: int = Field(20, ge=1, description="decisions in one cell that end a trial (ours)")

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise _as_request_error(error) from None

    @model_validator(mode="before")
    @classmethod
    def _measure(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Take the rows of a map as a tuple, and the size that they give where none is set."""
        rows, cell_size = values.get("map"), values.get("cell_size", cls.model_fields["cell_size"].default)
        if isinstance(rows, str):
            raise ValueError(f"map {rows!r} is no list of rows; name a file in a scenario file or with --map")
        if not isinstance(rows, list | tuple):
            return values
        values = {**values, "map": tuple(rows)}
        if all(isinstance(row, str) for row in rows) and isinstance(cell_size, int | float):
            if not edge_of(values["map"]):
                raise ValueError("the map is empty; draw at least two free cells side by side")
            values.setdefault("size", float(edge_of(values["map"]) * cell_size))
        return values

    @model_validator(mode="after")
    def _check(self) -> Scenario:
        if self.map is not None and self.cells != edge_of(self.map):
            own = edge_of(self.map) * self.cell_size
            raise ValueError(f"size {self.size:g} m is not that of the map, {own:g} m; leave it out")
        if abs(self.size / self.cell_size - round(self.size / self.cell_size)) > 1e-9:
            raise ValueError(f"size {self.size:g} m is no multiple of cell_size {self.cell_size:g} m")
        if not 4 <= self.cell_count <= MAX_CELLS:
            raise ValueError(f"size {self.size:g} m gives {self.cell_count} cells; keep it from 4 to {MAX_CELLS}")
        if self.map is not None:
            site_of(self.map)
        elif self.obstacles + self.landmarks >= self.cell_count:
            raise ValueError(
                f"{self.obstacles} obstacles and {self.landmarks} landmarks leave no free cell among "
                f"{self.cell_count}; lower a density or a count"
            )
        if self.miss >= 0.5 or self.hit <= 0.5:
            raise ValueError(f"miss {self.miss:g} and hit {self.hit:g} must lie on either side of 0.5")
        if self.arrival_radius >= self.cell_size / 2:
            raise ValueError(
                f"arrival_radius {self.arrival_radius:g} m reaches out of a cell; keep it under half a cell"
            )
        if self.min_landmark_range >= self.sensor_range:
            raise ValueError(f"min_landmark_range {self.min_landmark_range:g} m hides all within sensor_range")
        if not self.candidates_per_robot + self.candidates_per_landmark:
            raise ValueError("candidates_per_robot 0 and candidates_per_landmark 0 leave nothing to choose from")
        return self

    @cached_property
    def cells(self) -> int:
        """Cells along an edge."""
        return round(self.size / self.cell_size)

    @property
    def cell_count(self) -> int:
        """Cells of the map, n_g of Eq. 3."""
        return self.cells**2

    @property
    def landmarks(self) -> int:
        """Landmarks of a world: the count, or the density times the cells that count, rounded half up.

        A given map may hold fewer: each takes a cell that can be reached, and two stay open.
        """
        area, room = self.cell_count, None
        if self.map is not None:
            site = site_of(self.map)
            area, room = int(site.counted.sum()), int(site.reachable.sum()) - 2
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
        return math.floor(self.obstacle_density * self.cells + 0.5)

    @property
    def step_limit(self) -> int:
        """Steps after which a trial ends unexplored."""
        return math.floor(self.steps_per_cell * self.cell_count + 0.5)

    @property
    def prior_uncertainty(self) -> float:
        """U₀ = 2 σ₀² n_g [m²], the uncertainty of a map never seen (Eq. 1)."""
        return 2.0 * self.virtual_sigma**2 * self.cell_count

    @property
    def blind(self) -> Scenario:
        """The constants that the robot may know: all but a given map."""
        if self.map is None:
            return self
        return self.replace(map=None, landmark_count=self.landmarks, obstacle_count=0)

    def replace(self, /, **changes: Any) -> Scenario:
        """Copy of the scenario with some constants changed, validated anew.

        A density takes the place of a count that was set before, and the other way round; the size follows the map.
        """
        kept = self.model_dump(exclude_unset=True)
        if changes.get("map", self.map) is not None:
            kept.pop("size", None)
        for kind in ("landmark", "obstacle"):
            for given, other in (("density", "count"), ("count", "density")):
                if f"{kind}_{given}" in changes:
                    kept.pop(f"{kind}_{other}", None)
        return Scenario(**{**kept, **changes})


PAPER = Scenario()

CHEN_2020 = Scenario(
    size=40.0,
    sensor_range=6.0,
    landmark_count=8,
    obstacle_count=0,
    candidates_per_robot=1,
    candidates_per_landmark=1,
    step_length=2.0,
    odometry_sigma=0.1,
    coverage=0.85,
    first_sight="replace",
    fusion="determinant",
)

SCENARIOS: dict[str, tuple[Scenario, str]] = {
    "paper": (PAPER, "Zhang et al. 2021, §4.1; what it leaves out is calibrated against its Table 2"),
    "chen2020": (
        CHEN_2020,
        "Chen et al. 2020 [8]: 40 m, 6 m range, 8 landmarks, no obstacles, 2 m steps, 85 %",
    ),
}


def _as_request_error(error: ValidationError) -> RequestError:
    first = error.errors()[0]
    key = str(first["loc"][0]) if first["loc"] else ""
    if first["type"] == "extra_forbidden":
        return unknown("scenario key", key, Scenario.model_fields)
    reason = first["msg"].removeprefix("Value error, ")
    if not key:
        return RequestError(f"scenario: {reason}.")
    fix = reason[0].lower() + reason[1:]
    return RequestError(f"scenario key '{key}' is {first['input']!r}; {fix}.")
