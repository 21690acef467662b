"""One moment of a trial: what there is to draw of it."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field, replace

import numpy as np

from explore_bench.records.encoding import Replay, TrialRecord
from explore_bench.trial.snapshot import Snapshot
from explore_bench.world.kinds import World
from explore_bench.world.scenario import Scenario


@dataclass(frozen=True)
class Scene:
    """What there is to draw of one moment.

    Attributes
    ----------
    steps : columns of the step rows by name up to the moment, each of shape (T + 1,).
    snapshot : what the replay keeps of it.
    way : places [m] on the way from here to the next decision, as estimated on it, shape (P, 2).
    """

    scenario: Scenario
    world: World
    steps: dict[str, np.ndarray]
    snapshot: Snapshot
    way: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))


def scene_of(record: TrialRecord, replay: Replay, index: int) -> Scene:
    """Return the moment of decision `index` of a replay (−1: the end of the trial)."""
    last = replay.steps[index]
    steps = {name: values[: last + 1] for name, values in record.steps.items()}
    decided = replay.candidates[index] is not None
    until = next((step for step in replay.steps if step > last), len(record.steps["step"]) - 1) if decided else last
    way = np.stack([record.steps[name][last : until + 1] for name in ("x", "y")], axis=1)
    return Scene(record.spec.scenario, record.world, steps, _snapshot(replay, index), way)


def scene_at(record: TrialRecord, replay: Replay, step: int) -> Scene:
    """Return the moment of a step: the map is that of the last decision before it, the robot has driven on."""
    index = max(bisect_right(replay.steps, step) - 1, 0)
    scene, since = scene_of(record, replay, index), replay.steps[index]
    steps = {name: values[: step + 1] for name, values in record.steps.items()}
    driven = np.stack([steps["x"][since + 1 :], steps["y"][since + 1 :]], axis=1)
    snapshot = scene.snapshot
    if snapshot.trajectory is not None:
        snapshot = snapshot._replace(trajectory=[*snapshot.trajectory, *driven.ravel().tolist()])
    return replace(scene, steps=steps, snapshot=snapshot, way=scene.way[len(driven) :])


def _snapshot(replay: Replay, index: int) -> Snapshot:
    target = replay.targets[index]
    snapshot = Snapshot(
        candidates=replay.candidates[index],
        choice=replay.choices[index],
        target=target and list(target),
        map=replay.maps[index],
        ellipses=replay.ellipses[index],
        landmark_estimates=replay.landmarks[index].ravel().tolist(),
    )
    if not replay.fine_maps:
        return snapshot
    return snapshot._replace(
        fine=replay.fine_maps[index],
        positions=replay.positions[index].ravel().tolist(),
        trajectory=replay.trajectories[index].ravel().tolist(),
        loops=replay.loops[index].ravel().tolist(),
    )
