"""Stored trials run again: whether they come out the same, and what differs where they do not."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from explore_bench.analysis.rounding import ROUNDING
from explore_bench.errors import RequestError
from explore_bench.records.encoding import Replay, TrialRecord
from explore_bench.records.provenance import trial_key
from explore_bench.records.store import Store
from explore_bench.runs.runner import DEFAULT_TIMEOUT, execute
from explore_bench.trial.spec import Outcome, TrialSpec


@dataclass(frozen=True)
class Verified:
    """What came of trials that ran again.

    Attributes
    ----------
    same : number of those with the same bytes.
    close : number of others in which everything was decided alike, and numbers differ by less than the last digit that
        is shown: the arithmetic of another machine.
    different : trials that came out otherwise, and in what, in a few words.
    undone : trials that could not be run to the end, and why.
    stale, damaged : number of records of older code or libraries, and of damaged ones; nothing can be said of them.
    """

    same: int
    close: int
    different: tuple[tuple[TrialSpec, str], ...]
    undone: tuple[tuple[TrialSpec, str], ...]
    stale: int
    damaged: int


def verify(
    folder: Path,
    sample: int | None = None,
    workers: int = 1,
    backend: str = "processes",
    timeout: float = DEFAULT_TIMEOUT,
    progress: Callable[[Outcome], None] | None = None,
    salt: str = "",
) -> Verified:
    """Run stored trials again, all or a sample of so many that has the same share of everything, and compare them.

    The sample is the same each time; with a `salt` it is one that follows from that, and that nobody can know before.
    The folder stays as it is. Trials that had failed for want of time or memory are left out.

    Raises
    ------
    RequestError : where the folder holds no current trial.
    """
    store = Store(folder)
    found, stale = store.records(lambda record: (record.spec, record.transient))
    records = {trial_key(spec): spec for spec, transient in found if not transient}
    if not records:
        raise RequestError(
            f"results folder '{folder}' holds no trial of the present code; run some with 'explore-bench run SUITE'."
        )
    keys = sorted(records, key=lambda key: hashlib.sha256(f"{salt}{key}".encode()).digest())[:sample]
    same, close = 0, 0
    different: list[tuple[TrialSpec, str]] = []
    undone: list[tuple[TrialSpec, str]] = []
    with tempfile.TemporaryDirectory(prefix="explore-bench-") as place:
        again = Store(Path(place))
        again.adopt(store.protocol())
        for outcome in execute([records[key] for key in keys], again, workers, backend, timeout):
            if progress:
                progress(outcome)
            key = trial_key(outcome.spec)
            if key not in records:
                undone.append((outcome.spec, "its code changed meanwhile"))
                continue
            record = again.find(outcome.spec)
            if record.transient:
                undone.append((outcome.spec, record.reason))
            elif again.path(key).read_bytes() == store.path(key).read_bytes():
                same += 1
            elif what := difference(_stored(store, outcome.spec), _stored(again, outcome.spec)):
                different.append((outcome.spec, what))
            else:
                close += 1
    return Verified(same, close, tuple(different), tuple(undone), stale, len(store.damaged))


def _stored(store: Store, spec: TrialSpec) -> tuple[TrialRecord, Replay]:
    return store.find(spec), store.replay(spec)


def difference(before: tuple[TrialRecord, Replay], after: tuple[TrialRecord, Replay]) -> str:
    """Say in what two runs of a trial differ first, beyond the rounding of numbers; empty where they do not."""
    (was, chose), (now, chooses) = before, after
    if was.world.digest != now.world.digest:
        return f"its world is {now.world.digest}, and was {was.world.digest}"
    for decision, pair in enumerate(zip(_choices(chose), _choices(chooses), strict=False)):
        if pair[0] != pair[1]:
            return f"decision {decision} is {pair[1]}, and was {pair[0]}"
    if (was.status, was.reason) != (now.status, now.reason):
        return f"it ended as {now.status} ({now.reason or 'no reason'}), and as {was.status} ({was.reason or 'none'})"
    columns = {**was.steps, **was.final}, {**now.steps, **now.final}
    found = [_first(name, columns[0][name], columns[1].get(name, np.empty(0))) for name in columns[0]]
    rows = [place for place in found if place is not None]
    return min(rows)[1] if rows else ""


def _choices(replay: Replay) -> Sequence[object]:
    return [
        choice if target is None else tuple(target)
        for choice, target in zip(replay.choices, replay.targets, strict=True)
    ]


def _first(name: str, was: np.ndarray, now: np.ndarray) -> tuple[int, str] | None:
    """First row in which a column differs beyond rounding, and what it says there."""
    if len(was) != len(now):
        return min(len(was), len(now)), f"it has {len(now)} rows, and had {len(was)}"
    alike = np.isclose(was.astype(float), now.astype(float), rtol=ROUNDING, atol=ROUNDING, equal_nan=True)
    if alike.all():
        return None
    row = int(np.argmin(alike))
    return row, f"{name} is {now[row]:.9g} at row {row}, and was {was[row]:.9g}"
