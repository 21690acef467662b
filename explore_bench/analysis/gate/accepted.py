"""The results that a gate compares with: a folder with `thresholds.toml`, `trials.csv` and why they were accepted.

People write `thresholds.toml`; `accept` writes `trials.csv`, with the trials of the declared family alone, and
`accepted.json`, with the version of the protocol that they are of and the reason.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from explore_bench.analysis.csv_files import KEYS, read_csv, write_table
from explore_bench.analysis.gate.pairs import belongs
from explore_bench.analysis.gate.thresholds import Threshold, load_thresholds
from explore_bench.analysis.tables import measured, read_trials
from explore_bench.errors import RequestError, unknown
from explore_bench.files import parse_json, read_text, write_whole
from explore_bench.records.store import Store
from explore_bench.trial.steps import SCHEMA_VERSION

THRESHOLDS_FILE, TRIALS_FILE, NOTE_FILE = "thresholds.toml", "trials.csv", "accepted.json"
LEAST_WORLDS = 20
"""Of every pair: Student's bounds ask for means that are about normal, and of fewer worlds they need not be."""

HOW = "run the trials and 'explore-bench gate --accept --reason TEXT'"


@dataclass(frozen=True, eq=False)
class Accepted:
    """A declared family, the trials that it is compared with, and why these were accepted."""

    family: tuple[Threshold, ...]
    trials: pd.DataFrame
    reason: str


def read_accepted(folder: Path) -> Accepted:
    """Read a reference folder.

    Raises
    ------
    RequestError : where a file is missing or wrong, the trials are of another version of the protocol, or they lack a
        pair of the family.
    """
    family = load_thresholds(folder / THRESHOLDS_FILE)
    reason = _read_note(folder / NOTE_FILE)
    path = folder / TRIALS_FILE
    trials = _read_trials(path, family)
    _check(trials, family, f"'{path}'")
    return Accepted(family, trials, reason)


def accept(folder: Path, results: Path, reason: str) -> int:
    """Make the trials of the declared family the new reference and return their number.

    Raises
    ------
    RequestError : without a reason, or where the results lack a pair of the family or worlds that the reference has.
    """
    if not reason.strip():
        raise RequestError("the reason is empty; say with --reason why these results are to be the reference.")
    family = load_thresholds(folder / THRESHOLDS_FILE)
    trials, path = read_results(results, family), folder / TRIALS_FILE
    _check(trials, family, f"'{results}'")
    if path.is_file():
        _check_as_many(trials, _read_trials(path, family), family, path)
    rows = trials[np.logical_or.reduce([belongs(trials, one) for one in family])]
    rows = rows.sort_values(KEYS, kind="stable", na_position="first")
    note = {"schema": SCHEMA_VERSION, "reason": reason.strip()}
    write_table(rows, path)
    write_whole(folder / NOTE_FILE, json.dumps(note, indent=1, ensure_ascii=False) + "\n")
    return len(rows)


def read_results(folder: Path, family: Sequence[Threshold]) -> pd.DataFrame:
    """Trials of a results folder: its records, those of older code left out; of one without records, its `trials.csv`.

    Raises
    ------
    RequestError : where neither can be read, or the records are of another version.
    """
    store = Store(folder)
    return measured(read_trials(store)[0]) if store.exists() else _read_trials(folder / TRIALS_FILE, family)


def _read_trials(path: Path, family: Sequence[Threshold]) -> pd.DataFrame:
    """Read a `trials.csv` with the columns that a family needs; one with a trial twice is none."""
    metrics = list(dict.fromkeys(one.metric for one in family))
    trials = read_csv(path, (*KEYS, "world", "status", *metrics))
    if trials.duplicated(KEYS).any():
        twice = trials[trials.duplicated(KEYS)].iloc[0]
        raise RequestError(
            f"'{path}' has trial {twice['trial']} of '{twice['strategy']}' twice; delete it and run again."
        )
    return measured(trials)


def _read_note(path: Path) -> str:
    try:
        note = parse_json(read_text(path))
        version, reason = note["schema"], str(note["reason"])
    except OSError as error:
        raise RequestError(f"'{path}' cannot be read ({error.strerror}); {HOW} to make a reference.") from None
    except (ValueError, KeyError, TypeError):
        raise RequestError(f"'{path}' is damaged; {HOW} to make it anew.") from None
    if version != SCHEMA_VERSION:
        raise RequestError(
            f"'{path.parent}' is a reference of protocol version {version}, not {SCHEMA_VERSION}; {HOW} to renew it."
        )
    return reason


def _check(trials: pd.DataFrame, family: Sequence[Threshold], where: str) -> None:
    """Check that trials have every pair of a family, each metric defined and not 0, so that a loss is a share of it."""
    if not len(trials):
        raise RequestError(f"{where} holds no trial; {HOW}.")
    for one in family:
        if one.strategy not in set(trials["strategy"]):
            raise RequestError(f"{where}: {unknown('strategy', one.strategy, set(trials['strategy']))}")
        own = trials[belongs(trials, one)]
        count = own["trial"].nunique()
        if count < LEAST_WORLDS:
            raise RequestError(
                f"{where} has {count} world{'s' * (count != 1)} of {one.place}, and a gate needs {LEAST_WORLDS} for "
                "bounds that hold; run more, or drop it from the thresholds."
            )
        if not np.isfinite(own[one.metric]).all():
            raise RequestError(f"{where}: {one.metric} of {one.place} is not defined in every trial; gate another.")
        if not own[one.metric].mean():
            raise RequestError(f"{where}: {one.metric} of {one.place} is 0, so a loss is no share of it; gate another.")


def _check_as_many(now: pd.DataFrame, before: pd.DataFrame, family: Sequence[Threshold], path: Path) -> None:
    for one in family:
        counts = [trials[belongs(trials, one)]["trial"].nunique() for trials in (now, before)]
        if counts[0] < counts[1]:
            raise RequestError(
                f"the results have {counts[0]} worlds of {one.place}, the reference {counts[1]}; run the others, or "
                f"delete '{path}' if fewer are meant."
            )
