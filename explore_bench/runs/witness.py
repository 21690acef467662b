"""A trial with a witness, who tells where in its own source its strategy raised.

The place is told and never stored: a comment moves lines, and leaves a trial the one that it was.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from explore_bench.strategies.loading import check_methods, make_strategy
from explore_bench.strategies.tracing import place_of, with_place
from explore_bench.trial.run import TrialResult, run_trial
from explore_bench.trial.spec import Status, TrialSpec

_places: list[str] = []
"""Where the strategy of the trial that runs in this process raised, each time; a trial has one strategy."""


def run_witnessed(spec: TrialSpec, timeout: float | None = None) -> tuple[TrialResult, str]:
    """Run a trial as `run_trial` does.

    Returns
    -------
    The same result, and the reason to be told: that of the result with the place, where its strategy raised.
    """
    arguments = {"factory": spec.factory, "arguments": spec.arguments, "reference": spec.reference}
    _places.clear()
    result = run_trial(replace(spec, factory=f"{__name__}:Witness", parameters=arguments, weights=None), timeout)
    failed = result.status in (Status.FAILED, Status.BROKEN)
    return replace(result, spec=spec), with_place(result.reason, _places[-1] if failed and _places else "")


class Witness:
    """Stands between a trial and its strategy, changes nothing, and notes where the strategy raises.

    Raises
    ------
    RequestError : as `make_strategy` and `check_methods` do.
    """

    def __init__(self, factory: str, arguments: Mapping[str, Any], reference: bool) -> None:
        self._factory = factory
        with self._watched():
            self._strategy = make_strategy(factory, arguments)
            check_methods(self._strategy, reference)

    def reset(self, rng: Any) -> None:
        """Begin a trial."""
        with self._watched():
            self._strategy.reset(rng)

    def reset_with_world(self, rng: Any, world: Any) -> None:
        """Begin a trial of a reference."""
        with self._watched():
            self._strategy.reset_with_world(rng, world)

    def choose(self, observation: Any) -> Any:
        """Answer what the strategy answers."""
        with self._watched():
            return self._strategy.choose(observation)

    @property
    def notes(self) -> Any:
        """What a reference says of the world."""
        return getattr(self._strategy, "notes", {})

    @contextmanager
    def _watched(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            _places.append(place_of(error, self._factory))
            raise
