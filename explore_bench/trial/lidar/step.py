"""The row that a trial in a lidar world keeps of every step, which is a key pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from explore_bench.trial.steps import Column, Step


@dataclass(frozen=True, slots=True)
class LidarStep(Step):
    """Primitives after one key pose, with those of this kind of world last."""

    seconds: Annotated[float, Column("float64", "s", "simulated time so far")]
    closures: Annotated[int, Column("int32", "1", "loops closed so far")]
    false_closures: Annotated[int, Column("int32", "1", "those whose relative pose is not the true one")]
    missed_closures: Annotated[int, Column("int32", "1", "revisits so far at which no loop was closed")]
    in_vain: Annotated[int, Column("int32", "1", "drives ended before this step that did not resolve their frontier")]
    clearance: Annotated[float, Column("float64", "m", "least distance so far of the robot's hull from an obstacle")]
    unsafe_seconds: Annotated[float, Column("float64", "s", "time so far nearer to an obstacle than is safe")]
    speed_change: Annotated[float, Column("float64", "m/s", "sum of the magnitudes of the changes of speed so far")]
