"""Every physical constant of the lidar worlds, with its source.

"§" is a section of Zhang et al. 2021. "Stage" is the simulator of §4.2 (rtv/Stage), whose models of odometry and ranger
these are; "MRPB" its reference [38], the local-planning benchmark of Wen et al. 2021; docs/stage.md says why.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from explore_bench.world.scenario import NonNegative, Positive, Scenario

if TYPE_CHECKING:
    from explore_bench.geometry import Grid

Scene = Literal["dense", "office", "rooms", "maze", "hall"]

MAX_TICKS = 10_000_000
"""Most commands of a trial: a day of computing."""

MAX_MAP_CELLS = 4_200_000
"""Most cells of a fine map: 100 m at 5 cm, and the border of a given one."""


class LidarScenario(Scenario):
    """A room full of obstacles or a floor plan, a robot on two wheels, a 360° lidar, and SLAM by scan matching (§4.2).

    Decisions, U, n_g and the learned strategies' features live on the square grid of `cell_size`; what is true lies on
    a grid of `resolution`, and what the robot maps on one of `map_resolution`. All three have the same lower left
    corner. With a `map` of its own nothing is drawn but the start where the map names none; its cells are of
    `resolution`, and half a metre of wall lies around it: a wall at the very edge would soon be believed beyond it, and
    be on no map.
    """

    plan_cell: ClassVar[str] = "resolution"
    plan_border: ClassVar[float] = 0.5
    most_plan_cells: ClassVar[int] = 4_000_000

    kind: Literal["lidar"] = "lidar"

    # World
    scene: Scene = Field("dense", description="what is drawn: dense (Fig. 16a), or a floor plan of a kind (ours)")
    resolution: Positive = Field(0.05, description="edge of a cell of the true map [m] (ours)")
    passage: Positive = Field(
        0.4, description="clearance [m] that the robot finds all the way to every place that counts (ours)"
    )

    # Robot: a Pioneer 3-DX, 0.455 m long and 0.381 m wide
    robot_radius: Positive = Field(0.22, description="radius of the robot [m] (half a Pioneer's length)")
    max_speed: Positive = Field(0.55, description="most metres a second (MRPB)")
    max_turn_rate: Positive = Field(1.0, description="most radians a second (MRPB)")
    acceleration: Positive = Field(2.5, description="most m/s² (MRPB)")
    turn_acceleration: Positive = Field(3.2, description="most rad/s² (MRPB)")
    tick: Positive = Field(0.1, description="seconds between two commands (Stage)")
    odometry_bias: NonNegative = Field(
        0.03, description="odometry's scale error, drawn once a trial from ± half of it, along and across (Stage)"
    )
    heading_bias: NonNegative = Field(0.05, description="the same of turns (Stage)")
    odometry_noise: NonNegative = Field(0.02, description="white noise along and across a drive [m/√m] (ours)")
    heading_noise: NonNegative = Field(
        0.02, description="white noise of the heading [rad/√m of a drive and rad/√rad of a turn] (ours)"
    )

    # Lidar
    sensor_range: Positive = Field(10.0, description="range of the 360° lidar [m] (§4.2)")
    beams: int = Field(360, ge=8, le=4096, description="beams of a scan, evenly around (ours)")
    range_sigma: NonNegative = Field(0.01, description="noise of a range [m] (ours; Stage's default is 0)")
    bearing_sigma_deg: Positive = Field(
        0.5, description="what a beam's width leaves open of a bearing [°], for the virtual map (half of 1°)"
    )

    # The robot's map
    map_resolution: Positive = Field(0.1, description="edge of a cell of the robot's map [m] (ours)")
    known_after: int = Field(1, ge=1, description="beams through or into a cell that make it known (ours; Karto: 3)")
    no_return_clears: bool = Field(
        True, description="whether a beam that returns nothing clears what it passed (ours; Karto: no)"
    )

    # Driving
    local_planner: Literal["pursuit", "dwa"] = Field(
        "pursuit", description="regulated pure pursuit, or the dynamic window with MRPB's constants (§4.2)"
    )

    # Candidates and limits: frontiers are clusters, and there is no landmark to be near to
    candidates_per_robot: int = Field(20, ge=1, description="frontier clusters nearest along the way (ours)")
    candidates_per_landmark: int = Field(0, ge=0, le=0, description="none: there are no landmarks")
    coverage: Annotated[float, Field(gt=0, le=1)] = Field(0.98, description="known share that ends a trial (ours)")
    steps_per_cell: Positive = Field(30.0, description="step limit per cell of the decision grid (ours)")
    time_limit: Positive = Field(3600.0, description="simulated seconds after which a trial ends unexplored (ours)")

    def _check_physics(self) -> None:
        for name in ("resolution", "map_resolution"):
            edge = getattr(self, name)
            if abs(self.cell_size / edge - round(self.cell_size / edge)) > 1e-9:
                raise ValueError(
                    f"cell_size {self.cell_size:g} m is no multiple of {name} {edge:g} m; take 0.05 or 0.1"
                )
            if (self.size / edge) ** 2 > MAX_MAP_CELLS:
                raise ValueError(f"{name} {edge:g} m gives more than {MAX_MAP_CELLS:,} cells; take a coarser one")
        parts = self.map_resolution / self.resolution
        if parts < 1 - 1e-9 or abs(parts - round(parts)) > 1e-9:
            raise ValueError(
                f"map_resolution {self.map_resolution:g} m is no multiple of resolution {self.resolution:g} m; "
                "take the same, or twice as much"
            )
        if self.passage < self.lethal_radius:
            raise ValueError(
                f"passage {self.passage:g} m is less than the {self.lethal_radius:.3g} m that a robot of "
                f"{self.robot_radius:g} m keeps on a map of {self.map_resolution:g} m; widen it"
            )
        if self.max_speed * self.tick > self.robot_radius or self.max_turn_rate * self.tick > 1.0:
            raise ValueError(
                f"in a tick of {self.tick:g} s the robot drives {self.max_speed * self.tick:g} m and turns by "
                f"{self.max_turn_rate * self.tick:g} rad; keep that to its radius, {self.robot_radius:g} m, and 1 rad"
            )
        if self.time_limit / self.tick > MAX_TICKS:
            raise ValueError(
                f"time_limit {self.time_limit:g} s has more than {MAX_TICKS:,} ticks of {self.tick:g} s; lengthen the "
                "tick"
            )
        if self.sensor_range < self.cell_size:
            raise ValueError(
                f"sensor_range {self.sensor_range:g} m does not leave a cell of {self.cell_size:g} m; widen it"
            )

    @cached_property
    def truth_grid(self) -> Grid:
        """Grid of the true obstacles."""
        return self._fine(self.resolution)

    @cached_property
    def map_grid(self) -> Grid:
        """Grid of the robot's map."""
        return self._fine(self.map_resolution)

    def _fine(self, resolution: float) -> Grid:
        from explore_bench.geometry import Grid  # by need: see kinds

        edge = round(self.size / resolution)
        return Grid(edge, edge, resolution)

    @property
    def lethal_radius(self) -> float:
        """Least believed clearance [m] of a cell that a path enters: the robot, 0.7 of a map's cell, and 2 cm."""
        return self.robot_radius + 0.7 * self.map_resolution + 0.02

    @property
    def sight_sigmas(self) -> tuple[float, float]:
        """Noise (bearing [rad], range [m]) with which a point in view is observed, for the virtual map."""
        return math.radians(self.bearing_sigma_deg), max(self.range_sigma, 1e-3)

    def for_pixels(self, resolution: float) -> dict[str, float]:
        """Constants that give the true map the pixels' own resolution [m], while the robot maps in 10 cm or in pixels.

        None where a cell of the decision grid is no whole number of these.
        """
        parts = self.cell_size / resolution
        if abs(parts - round(parts)) > 1e-6:
            return {}
        edges = [resolution * share for share in range(1, round(parts) + 1) if round(parts) % share == 0]
        mapped = next((edge for edge in edges if edge >= self.map_resolution - 1e-9), self.map_resolution)
        return {"resolution": resolution, "map_resolution": mapped}

    @property
    def sight_in_words(self) -> str:
        """What the robot sees of a world, to follow "Within … m of itself it sees"."""
        return "how far away walls are, in all directions and a little wrong"

    @property
    def step_in_words(self) -> str:
        """What a step is, to follow "A step is"."""
        return "one key pose, a place where a scan was taken in: after half a metre, half a radian or at a goal"

    @property
    def blind(self) -> LidarScenario:
        """The constants that the robot may know: all but a given map."""
        return self if self.map is None else self.replace(map=None)

    @property
    def tiny(self) -> LidarScenario:
        """A scenario of this kind whose trial takes no time and runs all that its trials run."""
        return self.replace(map=None, scene="dense", size=4 * self.cell_size, sensor_range=2 * self.cell_size)
