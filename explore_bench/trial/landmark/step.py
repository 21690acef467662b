"""The row that a trial in a landmark world keeps of every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from explore_bench.trial.steps import Column, Step


@dataclass(frozen=True, slots=True)
class LandmarkStep(Step):
    """Primitives after one step, with those of this kind of world last."""

    landmarks: Annotated[int, Column("int32", "1", "landmarks seen so far")]
