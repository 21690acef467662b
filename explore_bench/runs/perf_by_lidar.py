"""Where the time of a trial in a lidar world goes, and how much faster than the robot it is simulated."""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass

from explore_bench.runs.stopwatch import Stopwatch
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import STAGE

SCENES = ("dense", "office")
TRIALS = 2


@dataclass(frozen=True)
class ScenePart:
    """Mean cost [ms] of a part per key pose, and its share of all of them; parts that are rare are spread over all."""

    name: str
    mean_ms: float
    share: float


@dataclass(frozen=True)
class SceneTimes:
    """What trials in a scene cost.

    Attributes
    ----------
    key_poses : in all trials.
    times_real_time : simulated seconds to CPU seconds of a whole trial, from drawing its world to its last replay and
        without its strategy; median over trials.
    """

    scene: str
    key_poses: int
    times_real_time: float
    parts: list[ScenePart]


def measure_scene(scene: str) -> SceneTimes:
    """Run calibration trials of `stage` in a scene, each decision for the shortest path, which takes no time."""
    scenario = STAGE.replace(scene=scene)
    _timed(scenario.tiny, 0)  # imports and compiled code
    trials = [_timed(scenario, trial) for trial in range(TRIALS)]
    steps = [step for own, _ in trials for step in own]
    return SceneTimes(scene, len(steps), statistics.median(factor for _, factor in trials), _parts(steps))


def scene_table(scenes: Sequence[SceneTimes]) -> list[str]:
    """Return the measurements of some scenes side by side, as lines."""
    lines = ["lidar worlds: mean ms of each part per key pose (share)"]
    lines.append(f"{'part':<18}" + "".join(f"{times.scene:>18}" for times in scenes))
    for name in dict.fromkeys(part.name for times in scenes for part in times.parts):
        own = [next((part for part in times.parts if part.name == name), None) for times in scenes]
        cells = (f"{part.mean_ms:8.2f} ({part.share:4.0%})" if part else "" for part in own)
        lines.append(f"{name:<18}" + "".join(f"{cell:>18}" for cell in cells))
    lines.append(f"{'key poses':<18}" + "".join(f"{times.key_poses:>18}" for times in scenes))
    lines.append(f"{'times real time':<18}" + "".join(f"{times.times_real_time:>18.0f}" for times in scenes))
    return lines


def _timed(scenario: Scenario, trial: int) -> tuple[list[dict[str, float]], float]:
    """Times of the parts of every key pose of a trial, and simulated seconds to CPU seconds of all of it."""
    watch = Stopwatch()
    choice, parameters = "explore_bench.runs.stopwatch:FreeChoice", {"shortest": True}
    spec = TrialSpec("perf", choice, scenario, trial, parameters, purpose="calibrate")
    begin = time.process_time()
    result = run_trial(spec, lap=watch.lap)
    spent = time.process_time() - begin - sum(result.decision_seconds)
    return watch.steps[1:-1], result.steps[-1].seconds / spent  # type: ignore[attr-defined]


def _parts(steps: Sequence[dict[str, float]]) -> list[ScenePart]:
    """Means over key poses, the whole of them last."""
    names = dict.fromkeys(name for step in steps for name in step)
    totals = {name: sum(step.get(name, 0.0) for step in steps) for name in names}
    totals["whole key pose"] = whole = sum(totals.values())
    return [ScenePart(name, 1e3 * total / len(steps), total / whole) for name, total in totals.items()]
