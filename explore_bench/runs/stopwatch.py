"""How `perf` times the parts of a trial, and a strategy that takes no time."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable

from explore_bench.strategies.contract import Observation

DECISION = "decision"


class Stopwatch:
    """Collects the time of each part of each step [s], by a clock; give `lap` to `run_trial` or `rollout`.

    Attributes
    ----------
    steps : part → time, for each step; the first entry is what comes before any step.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self.steps: list[dict[str, float]] = [defaultdict(float)]
        self._clock = clock
        self._last = clock()

    def lap(self, part: str) -> None:
        """Note the time since the last lap; the part `row` ends a step."""
        now = self._clock()
        if part != DECISION:
            self.steps[-1][part] += now - self._last
        if part == "row":
            self.steps.append(defaultdict(float))
        self._last = self._clock()


class FreeChoice:
    """Chooses at no cost, so that a step's time is the harness's own: any candidate, or that of the shortest path."""

    def __init__(self, shortest: bool = False) -> None:
        self._shortest = shortest

    def reset(self, rng: object) -> None:
        """Begin a trial, drawing from its stream."""
        self._rng = rng

    def choose(self, observation: Observation) -> int:
        """Return the index of a candidate."""
        if self._shortest:
            return int(observation.path_lengths.argmin())
        return int(self._rng.integers(len(observation.candidates)))  # type: ignore[attr-defined]
