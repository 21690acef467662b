"""Replays for the page's player: which trials it offers, and each packed into a few kilobytes.

A packed replay is columns of integers, as `packing` writes them; `assets/player.js` reads it.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from explore_bench.analysis.metrics import curve, exploration_efficiency
from explore_bench.records.encoding import Replay, TrialRecord
from explore_bench.records.store import Store
from explore_bench.report.fine_replays import add_fine
from explore_bench.report.packing import AXIS_LEVELS, SCALES, Columns, pack
from explore_bench.trial.snapshot import FREE, OCCUPIED, UNKNOWN, unpack_ellipses, unpack_map
from explore_bench.world.scenario import Scenario

EXAMPLE_TRIAL = 0
"""World of the common example: the first, not a chosen one."""

EXAMPLE, BEST, MEDIAN, WORST = "example", "best", "median", "worst"


@dataclass(frozen=True)
class Choice:
    """A trial that the player offers, and what it is among its strategy's trials of its size: roles."""

    record: TrialRecord
    roles: tuple[str, ...]


def choose_trials(records: Sequence[TrialRecord]) -> list[Choice]:
    """Trials to replay of every strategy, scenario and size: the common example and the best, median and worst by η.

    Of several training seeds the first counts; a trial without any step cannot be replayed. The median of an even
    number is the worse of the two in the middle; of equals the lower world comes first.
    """
    cells: dict[tuple[str, str, float], list[TrialRecord]] = {}
    for record in records:
        if len(record.steps["step"]):
            spec = record.spec
            cells.setdefault((spec.strategy, spec.scenario_name, spec.scenario.size), []).append(record)
    return [choice for own in cells.values() for choice in _of_cell(own)]


def _of_cell(records: Sequence[TrialRecord]) -> list[Choice]:
    seed = min((-1 if r.spec.training_seed is None else r.spec.training_seed) for r in records)
    own = [r for r in records if seed == (-1 if r.spec.training_seed is None else r.spec.training_seed)]
    ranked = sorted(
        (record for record in own if math.isfinite(exploration_efficiency(record))),
        key=lambda record: (exploration_efficiency(record), record.spec.trial),
    )
    named = {EXAMPLE: next((record for record in own if record.spec.trial == EXAMPLE_TRIAL), None)}
    if ranked:
        named |= {BEST: ranked[-1], MEDIAN: ranked[(len(ranked) - 1) // 2], WORST: ranked[0]}
    roles: dict[int, list[str]] = {}
    for role, record in named.items():
        if record is not None:
            roles.setdefault(record.spec.trial, []).append(role)
    trials = {record.spec.trial: record for record in own}
    return [Choice(trials[trial], tuple(names)) for trial, names in sorted(roles.items())]


def packed(store: Store, record: TrialRecord) -> str:
    """Replay of a stored trial, given in brief, for the page, in base64; empty where the trial holds no decision."""
    replay = store.replay(record.spec)
    return base64.b64encode(pack_replay(store.find(record.spec), replay)).decode() if replay.steps else ""


def pack_replay(record: TrialRecord, replay: Replay) -> bytes:
    """Pack a replay; see the module for the format. The same records give the same bytes."""
    scenario = record.spec.scenario
    columns = Columns()
    _add_steps(columns, record)
    _add_decisions(columns, replay, scenario)
    header = {
        "cells": scenario.grid.columns,
        "cellSize": scenario.cell_size,
        "range": scenario.sensor_range,
        "wallCells": record.world.grid.columns,
        "obstacles": np.flatnonzero(record.world.walls).tolist(),
        "landmarks": [[round(float(x), 2), round(float(y), 2)] for x, y in record.world.landmarks - _corner(scenario)],
    }
    if replay.fine_maps:
        assert record.fine_map is not None
        add_fine(columns, replay, record.fine_map.shape)
        header["fineCells"] = record.fine_map.shape[1]
    return pack(header, columns)


def _corner(scenario: Scenario) -> np.ndarray:
    """Lower left corner of the grid [m], shape (2,): the player's origin."""
    return np.array([scenario.grid.x0, scenario.grid.y0])


def _add_steps(columns: Columns, record: TrialRecord) -> None:
    """Add what changes with every step: poses, their 1-σ ellipses and the three curves."""
    steps = record.steps
    corner = dict(zip("xy", _corner(record.spec.scenario).tolist(), strict=True))
    for name in ("x", "y", "true_x", "true_y"):
        columns.add(name, steps[name] - corner[name[-1]], lag=1)
    columns.add("heading", steps["heading"] % math.tau, lag=1)
    _add_ellipses(columns, "pose_", steps["cov_xx"], steps["cov_xy"], steps["cov_yy"], lag=1)
    length = len(steps["step"])
    columns.add("explored", curve(record, "explored", length) * record.spec.scenario.cell_count, lag=1)
    for name in ("trajectory_error", "exploration_efficiency"):
        columns.add(name, curve(record, name, length), lag=1)


def _add_decisions(columns: Columns, replay: Replay, scenario: Scenario) -> None:
    """Add what changes with every decision: candidates, the choice, the map, its ellipses and the landmarks."""
    count = scenario.cell_count
    candidates = [own or [] for own in replay.candidates]
    columns.add("decided_at", replay.steps, lag=1)
    columns.add("choice", [-1 if choice is None else choice for choice in replay.choices])
    corner_x, corner_y = _corner(scenario).tolist()
    columns.add("target_x", [target[0] - corner_x if target else -1.0 for target in replay.targets])
    columns.add("target_y", [target[1] - corner_y if target else -1.0 for target in replay.targets])
    columns.add("candidate_count", [len(own) for own in candidates])
    columns.add("candidates", [cell for own in candidates for cell in own], lag=1)
    columns.add("map", [_classes(one, scenario) for one in replay.maps], lag=count)
    ellipses = np.array([unpack_ellipses(one, scenario.grid.shape, 1.0).reshape(count, 3) for one in replay.ellipses])
    ellipses = ellipses.reshape(-1, count, 3)
    columns.add("major", ellipses[..., 0], lag=count)
    columns.add("minor", ellipses[..., 1], lag=count)
    round_ = ellipses[..., 0] - ellipses[..., 1] < 1.5 / AXIS_LEVELS  # whose angle would be noise
    columns.add("angle", np.where(round_, 0.0, ellipses[..., 2]), lag=count)
    landmarks = np.concatenate([*replay.landmarks, np.zeros((0, 5))])
    columns.add("landmark_count", [len(own) for own in replay.landmarks])
    columns.add("landmark_x", landmarks[:, 0] - corner_x)
    columns.add("landmark_y", landmarks[:, 1] - corner_y)
    _add_ellipses(columns, "landmark_", *landmarks[:, 2:].T)


def _add_ellipses(columns: Columns, prefix: str, xx: Any, xy: Any, yy: Any, lag: int = 0) -> None:
    """Add half axes and angles of the 1-σ ellipses of covariances."""
    mean, radius = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    major, minor = np.sqrt(np.maximum(mean + radius, 0.0)), np.sqrt(np.maximum(mean - radius, 0.0))
    round_ = major - minor < SCALES[f"{prefix}major"]  # whose angle would be noise
    columns.add(f"{prefix}major", major, lag)
    columns.add(f"{prefix}minor", minor, lag)
    columns.add(f"{prefix}angle", np.where(round_, 0.0, 0.5 * np.arctan2(2 * xy, xx - yy) % np.pi), lag)


def _classes(one: bytes, scenario: Scenario) -> np.ndarray:
    """Class of every cell: unknown, free or occupied."""
    belief = unpack_map(one, scenario.grid.shape).ravel()
    return np.where(np.isnan(belief), UNKNOWN, np.where(belief > 0.5, OCCUPIED, FREE))
