"""`times.csv`: what trials took, the only file of a results folder that differs between two runs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import KEYS, read_csv
from explore_bench.errors import RequestError
from explore_bench.files import write_whole
from explore_bench.trial.spec import Outcome, TrialSpec
from explore_bench.world.scenario import Scenario

TIME_COLUMNS = (*KEYS, "seconds", "steps", "decisions", "decision_ms", "decision_ms_max")
EVERY_DECISION = "decisions_ms"
"""Column with what each decision of a trial took [ms], apart by spaces; files of earlier versions lack it."""

USUAL_SECONDS = {"landmark": 0.05, "lidar": 3.5}
"""What a trial of 20 m in cells of 2 m takes in each kind of world on an idle core [s], the mean of the compared
strategies: for what was never timed. Lidar worlds take 1 s to 5 s, floor plans more."""


def write_times(folder: Path, outcomes: Iterable[Outcome]) -> None:
    """Add the times of trials that have just run to `times.csv`, the only file that differs between two runs."""
    rows = [
        {
            "strategy": outcome.spec.strategy,
            "training_seed": outcome.spec.training_seed,
            "size": outcome.spec.scenario.size,
            "trial": outcome.spec.trial,
            "scenario": outcome.spec.scenario_name,
            "seconds": outcome.seconds,
            "steps": outcome.steps,
            "decisions": len(outcome.decision_seconds),
            "decision_ms": 1e3 * float(np.median(outcome.decision_seconds)) if outcome.decision_seconds else math.nan,
            "decision_ms_max": 1e3 * max(outcome.decision_seconds, default=math.nan),
            EVERY_DECISION: " ".join(f"{1e3 * seconds:.3g}" for seconds in outcome.decision_seconds),
        }
        for outcome in outcomes
    ]
    if rows:
        write_time_rows(folder, [read_times(folder), pd.DataFrame(rows).astype({"training_seed": "Int64"})])


def every_decision_ms(times: pd.DataFrame) -> np.ndarray:
    """What each decision of some trials, rows of `times.csv`, took [ms]; empty where they do not tell of all."""
    texts = times.get(EVERY_DECISION, pd.Series("", index=times.index)).fillna("").astype(str)
    values = np.array(" ".join(texts).split(), dtype=float)
    return values if len(values) == times["decisions"].sum() else np.empty(0)


def read_times(folder: Path) -> pd.DataFrame | None:
    """Rows of `times.csv`; None where there is no such file, or it is no such table: no trial depends on it."""
    try:
        return read_csv(folder / "times.csv", TIME_COLUMNS)
    except RequestError:
        return None


def write_time_rows(folder: Path, tables: Iterable[pd.DataFrame | None]) -> None:
    """Write the rows of several tables to `times.csv`, of those of one trial the last; nothing without any table."""
    found = [table for table in tables if table is not None]
    if not found:
        return
    table = pd.concat(found).drop_duplicates(KEYS, keep="last").sort_values(KEYS)
    write_whole(folder / "times.csv", table.to_csv(index=False, float_format="%.6g", lineterminator="\n"))


class Expectation:
    """Processor time [s] that trials will need, from `times.csv` where it knows the like, else from their size."""

    def __init__(self, folder: Path) -> None:
        times = read_times(folder)
        self._known: Any = {} if times is None else times.groupby(["strategy", "size"])["seconds"].mean()

    def of(self, spec: TrialSpec) -> float:
        """Time of a trial [s]."""
        return float(self._known.get((spec.strategy, spec.scenario.size), _usual_seconds(spec.scenario)))


def seconds_left(elapsed: float, done: float, expected: float) -> float:
    """Time that is still needed [s], where trials expected to take `done` of all the `expected` seconds took `elapsed`.

    So it follows how fast the machine is, and how busy.
    """
    return elapsed * max(expected - done, 0.0) / done if done > 0 else expected


def _usual_seconds(scenario: Scenario) -> float:
    # steps grow with the area, and the cost of one with the cells; of 2 m where nobody says otherwise
    return USUAL_SECONDS.get(scenario.kind, 1.0) * (scenario.cell_count / 100) * (scenario.size / 20) ** 2
