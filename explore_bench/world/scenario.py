"""A scenario: the protocol that every kind of world shares. The physics are those of its kind.

"§" is a section of Zhang et al. 2021; [8] is Chen et al. 2020.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from explore_bench.errors import RequestError, one_line, unknown
from explore_bench.world.floor_plan import edge_of, floor_plan
from explore_bench.world.kinds import DEFAULT_KIND, kind_of

if TYPE_CHECKING:
    from explore_bench.geometry import Grid

Positive = Annotated[float, Field(ge=1e-9, le=1e6, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, le=1e6, allow_inf_nan=False)]
Probability = Annotated[float, Field(gt=0, lt=1)]

MAX_CELLS = 40_000
"""Most cells of the grid on which decisions are made and U is summed; other grids have no such bound."""

MAX_STEPS = 10_000_000
"""Most steps of a trial: a month of computing."""

MAX_RANGE_CELLS = 200
"""Most cells that the sensor reaches: every scan keeps what it saw of a square so wide to either side."""


class Scenario(BaseModel):
    """The protocol of a trial, on a grid of square cells: map, virtual map, candidates, coverage and limits.

    A scenario is always one of a kind of world: `Scenario(kind="landmark", …)` makes that kind's own, which adds its
    physics; "landmark" is the default. Lengths are metres; names that end in `_deg` are degrees. Instances are
    immutable and hashable by value.

    With a `map` of its own the world is not drawn, and `size` follows from it.

    Attributes
    ----------
    kind : of world, one of `kinds.KINDS`.
    sensor_range : range of the sensor [m].

    Raises
    ------
    RequestError : for an unknown key or a value out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    plan_cell: ClassVar[str] = "cell_size"
    """Constant that is the edge of a cell of a given map."""

    plan_border: ClassVar[float] = 0.0
    """Width of the wall around a given map [m]."""

    most_plan_cells: ClassVar[int] = MAX_CELLS
    """Most cells of a given map."""

    later: ClassVar[tuple[str, ...]] = ()
    """Constants that came after weights of this kind were trained; see `scenario_digest`."""

    kind: str
    sensor_range: Positive

    # Map (§4.1)
    size: Positive = Field(20.0, description="edge of the square map [m] (§4.1: 20, 30, 40)")
    cell_size: Positive = Field(2.0, description="edge of a cell [m] (§4.1)")
    map: tuple[str, ...] | None = Field(
        None, description="rows of a given map, north first: # obstacle, . free, ? or blank unknown, S start (ours)"
    )

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

    # Candidates and limits (§4.1)
    candidates_per_robot: int = Field(5, ge=0, description="frontier cells nearest to the robot (§4.1)")
    candidates_per_landmark: int = Field(3, ge=0, description="frontier cells nearest to a landmark (§4.1)")
    coverage: Annotated[float, Field(gt=0, le=1)] = Field(0.9, description="known share that ends a trial (§4.1)")
    steps_per_cell: Positive = Field(10.0, description="step limit per cell of the map (ours)")
    stuck_decisions: int = Field(20, ge=1, description="decisions in one cell that end a trial (ours)")

    def __new__(cls, /, **values: Any) -> Self:
        """Take the class of the kind that is asked for."""
        return super().__new__(kind_of(values.get("kind", DEFAULT_KIND)).load("scenario") if cls is Scenario else cls)

    def __init__(self, /, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            raise self._as_request_error(error) from None

    @model_validator(mode="before")
    @classmethod
    def _measure(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Take the rows of a map as a tuple, and the size that they give where none is set."""
        rows = values.get("map")
        cell_size, plan_cell = (
            values.get(name, cls.model_fields[name].default) for name in ("cell_size", cls.plan_cell)
        )
        if isinstance(rows, str):
            raise ValueError(f"map {rows!r} is no list of rows; name a file in a scenario file or with --map")
        if not isinstance(rows, list | tuple):
            return values
        values = {**values, "map": tuple(rows)}
        numbers = isinstance(cell_size, int | float) and isinstance(plan_cell, int | float)
        if all(isinstance(row, str) for row in rows) and numbers:
            if not edge_of(values["map"]):
                raise ValueError("the map is empty; draw at least two free cells side by side")
            values.setdefault("size", _size_of(values["map"], plan_cell, cell_size, cls.plan_border))
        return values

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.map is not None:
            own = _size_of(self.map, getattr(self, self.plan_cell), self.cell_size, self.plan_border)
            if abs(self.size - own) > 1e-9:
                raise ValueError(f"size {self.size:g} m is not that of the map, {own:g} m; leave it out")
        if abs(self.extent / self.cell_size - self.edge) > 1e-9:
            raise ValueError(f"size {self.size:g} m is no multiple of cell_size {self.cell_size:g} m")
        if not 4 <= self.cell_count <= MAX_CELLS:
            what, also = f"size {self.size:g} m", ""
            if self.map is not None:
                what, also = f"a map in a square of {self.size:g} m", ", or set another cell_size"
            raise ValueError(
                f"{what} gives {self.edge} × {self.edge} cells of {self.cell_size:g} m; "
                f"keep it from 4 to {MAX_CELLS} in all{also}"
            )
        if self.step_limit > MAX_STEPS:
            raise ValueError(
                f"steps_per_cell {self.steps_per_cell:g} lets a trial take {self.step_limit:,} steps, and "
                f"{MAX_STEPS:,} are the most; lower it"
            )
        if self.sensor_range > MAX_RANGE_CELLS * self.cell_size:
            raise ValueError(
                f"sensor_range {self.sensor_range:g} m is more than {MAX_RANGE_CELLS} cells of {self.cell_size:g} m; "
                "shorten it"
            )
        if self.map is not None:
            floor_plan(self.map)
        self._check_physics()
        if self.miss >= 0.5 or self.hit <= 0.5:
            raise ValueError(f"miss {self.miss:g} and hit {self.hit:g} must lie on either side of 0.5")
        if not self.candidates_per_robot + self.candidates_per_landmark:
            raise ValueError("candidates_per_robot 0 and candidates_per_landmark 0 leave nothing to choose from")
        return self

    def _check_physics(self) -> None:
        """Raise a ValueError where the constants of this kind do not fit together."""

    @property
    def extent(self) -> float:
        """Edge [m] of the grid; it may reach beyond the map."""
        return self.size

    @property
    def edge(self) -> int:
        """Cells along an edge of the grid."""
        return round(self.extent / self.cell_size)

    @cached_property
    def grid(self) -> Grid:
        """Grid of the decisions, of U and of coverage; the lower left corner of the map is the origin."""
        from explore_bench.geometry import Grid  # by need: see kinds

        corner = (self.size - self.extent) / 2
        return Grid(self.edge, self.edge, self.cell_size, corner, corner)

    @property
    def cell_count(self) -> int:
        """Cells of the grid, n_g of Eq. 3."""
        return self.edge**2

    @property
    def landmarks(self) -> int:
        """Landmarks of a world; none in a kind without."""
        return 0

    @property
    def sight_sigmas(self) -> tuple[float, float]:
        """Noise (bearing [rad], range [m]) with which a point in view is observed, for the virtual map."""
        raise NotImplementedError

    @property
    def sight_in_words(self) -> str:
        """What the robot sees of a world, to follow "Within … m of itself it sees"."""
        raise NotImplementedError

    @property
    def step_in_words(self) -> str:
        """What a step is, to follow "A step is"."""
        raise NotImplementedError

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
        return self if self.map is None else self.replace(map=None)

    @property
    def twin(self) -> Self:
        """An equal scenario that shares nothing with this one: whoever gets it can only change his own."""
        values = {name: self.__dict__[name] for name in type(self).model_fields}
        return cast("Self", type(self).model_construct(set(self.model_fields_set), **values))

    @property
    def tiny(self) -> Scenario:
        """A scenario of this kind whose trial takes no time and runs all that its trials run."""
        return self.replace(map=None, size=5 * self.cell_size, coverage=1.0)

    def for_pixels(self, resolution: float) -> dict[str, float]:
        """Constants to change for a given map with pixels of this edge [m], where a kind can take them as they are."""
        return {}

    def replace(self, /, **changes: Any) -> Self:
        """Copy of the scenario with some constants changed, validated anew; the size follows the map."""
        return type(self)(**self._kept(changes), **changes)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy as `replace` makes it: pydantic's own would not validate, and keep the grid of another size."""
        return self.replace(**(update or {}))

    def _kept(self, changes: dict[str, Any]) -> dict[str, Any]:
        """Constants that were set and stay when others change."""
        kept = self.model_dump(exclude_unset=True)
        if changes.get("map", self.map) is not None:
            kept.pop("size", None)
        return {name: value for name, value in kept.items() if name not in changes}

    @classmethod
    def _as_request_error(cls, error: ValidationError) -> RequestError:
        first = error.errors()[0]
        key = str(first["loc"][0]) if first["loc"] else ""
        if first["type"] == "extra_forbidden":
            return unknown("scenario key", key, cls.model_fields)
        reason = first["msg"].removeprefix("Value error, ")
        if not key:
            return RequestError(f"scenario: {reason}.")
        fix = reason[0].lower() + reason[1:]
        return RequestError(f"scenario key '{key}' is {one_line(repr(first['input']), 200)}; {fix}.")


def _size_of(rows: tuple[str, ...], plan_cell: float, cell_size: float, border: float) -> float:
    """Edge [m] of the square of whole cells that holds a given map and a border around it."""
    cells = edge_of(rows) + 2 * border_cells(border, plan_cell)
    return float(math.ceil(cells * plan_cell / cell_size - 1e-9) * cell_size)


def border_cells(border: float, plan_cell: float) -> int:
    """Cells of a given map, of this edge [m], that are a border of at least this width [m]."""
    return math.ceil(border / plan_cell - 1e-9)
