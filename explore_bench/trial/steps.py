"""The row that a trial keeps of every step: what all kinds of world have in common.

Rows hold primitives only; metrics are functions of them, so that a changed metric never asks for a new simulation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, get_type_hints

from explore_bench.world.kinds import kind_of

SCHEMA_VERSION = 2
"""Raised whenever a column's meaning changes; records of another version are refused, never mixed in.

1 knew one kind of world and one robot.
"""


@dataclass(frozen=True)
class Column:
    """Storage type (as pyarrow names it), unit and meaning of a column."""

    dtype: str
    unit: str
    meaning: str


@dataclass(frozen=True, slots=True)
class Step:
    """Primitives after one step; row 0 follows the scan at the start. Each kind of world adds its own."""

    step: Annotated[int, Column("int32", "1", "steps taken")]
    decisions: Annotated[int, Column("int32", "1", "decisions made")]
    robot: Annotated[int, Column("int32", "1", "number of the robot")]
    true_x: Annotated[float, Column("float64", "m", "true pose")]
    true_y: Annotated[float, Column("float64", "m", "true pose")]
    true_heading: Annotated[float, Column("float64", "rad", "true pose")]
    x: Annotated[float, Column("float64", "m", "estimated pose")]
    y: Annotated[float, Column("float64", "m", "estimated pose")]
    heading: Annotated[float, Column("float64", "rad", "estimated pose")]
    cov_xx: Annotated[float, Column("float64", "m²", "covariance of the estimated pose, world frame")]
    cov_xy: Annotated[float, Column("float64", "m²", "")]
    cov_yy: Annotated[float, Column("float64", "m²", "")]
    cov_xh: Annotated[float, Column("float64", "m rad", "")]
    cov_yh: Annotated[float, Column("float64", "m rad", "")]
    cov_hh: Annotated[float, Column("float64", "rad²", "")]
    uncertainty: Annotated[float, Column("float64", "m²", "U of Eq. 1")]
    peak_trace: Annotated[float, Column("float64", "m² + rad²", "largest tr Σ (3 × 3) of the trajectory, for Eq. 3")]
    peak_position_trace: Annotated[float, Column("float64", "m²", "the same of the position block (2 × 2)")]
    explored: Annotated[float, Column("float64", "1", "known share of the cells that count towards coverage")]
    path_length: Annotated[float, Column("float64", "m", "length of the straight commands so far")]
    turned: Annotated[float, Column("float64", "rad", "sum of the magnitudes of the turns so far")]
    collisions: Annotated[int, Column("int32", "1", "entries of the true robot into obstacles or off the map")]
    mislabelled: Annotated[int, Column("int32", "1", "known cells believed to be what they are not")]
    nearest_drive: Annotated[float, Column("float64", "m", "planned drive to the last decision's nearest candidate")]
    chosen_drive: Annotated[float, Column("float64", "m", "planned drive to the candidate or target that it chose")]
    nearest_waits: Annotated[int, Column("int32", "1", "whether that nearest candidate is a frontier still: 0 or 1")]


@cache
def step_columns(kind: str) -> dict[str, Column]:
    """Columns of the rows of a kind of world, the common ones first."""
    hints = get_type_hints(kind_of(kind).load("step"), include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items()}


FINAL_COLUMNS: dict[str, Column] = {
    "final_x": Column("float32", "m", "estimate of this step's pose at the end of the trial"),
    "final_y": Column("float32", "m", ""),
    "final_heading": Column("float32", "rad", ""),
    "final_cov_xx": Column("float32", "m²", "its covariance then, world frame"),
    "final_cov_xy": Column("float32", "m²", ""),
    "final_cov_yy": Column("float32", "m²", ""),
}
