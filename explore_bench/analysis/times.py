"""`times.csv`: what trials took, the only file of a results folder that differs between two runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
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

USUAL_SECONDS = {"landmark": 0.15, "lidar": 3.0}
"""What a trial of 100 cells takes in each kind of world [s], of a strategy that predicts along every path: for what was
never timed."""


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


def expected_seconds(folder: Path, specs: Sequence[TrialSpec]) -> float:
    """Processor time [s] that trials will need, from `times.csv` where it knows the like, else from their size."""
    times = read_times(folder)
    known: Any = {} if times is None else times.groupby(["strategy", "size"])["seconds"].mean()
    return sum(float(known.get((spec.strategy, spec.scenario.size), _usual_seconds(spec.scenario))) for spec in specs)


def _usual_seconds(scenario: Scenario) -> float:
    # it grows with the square of the cells: there are more steps, and each costs more
    return USUAL_SECONDS.get(scenario.kind, 1.0) * (scenario.cell_count / 100) ** 2
