"""Where a step's time goes, as ratios to iSAM2's own update measured in the same run; and that of the lidar worlds.

Whole trials give what a step costs in the benchmark; trajectories of short steps on the same maps give 1000 poses and
more, and with them the growth of the cost with the length of the trajectory.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from explore_bench.analysis.csv_files import plain
from explore_bench.files import write_whole
from explore_bench.runs.perf_by_lidar import SCENES, ScenePart, SceneTimes, measure_scene, scene_table
from explore_bench.runs.stopwatch import Stopwatch
from explore_bench.strategies.entry import Entry
from explore_bench.strategies.registry import lookup_ready, strategies
from explore_bench.trial.run import TrialResult, run_trial
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER

SIZES = (20.0, 40.0)
LENGTHS = (100, 300, 1000)
WINDOW = 0.2
"""A length stands for the steps within ± 10 % of it."""

LONGEST = int(LENGTHS[-1] * (1 + WINDOW / 2))
"""Steps after which a long trajectory is cut off."""

SHORT_STEPS = {20.0: 0.06, 40.0: 0.15}
"""Step length [m] that makes trajectories of more than 1100 steps on a map of this size."""

TRIALS = 5
DECISION_TRIALS = 2
"""Whole trials of a strategy at a size; of a reference, which plans for seconds what its decisions then follow, one."""

ISAM2 = "isam2"


@dataclass(frozen=True)
class Part:
    """Median cost [µs] of a part of a step at a size [m] and a length of the trajectory (None: whole trials)."""

    name: str
    size: float
    length: int | None
    median_us: float
    to_isam2: float


@dataclass(frozen=True)
class Perf:
    """What `explore-bench perf` measures; keys of the mappings are sizes [m] as text.

    Attributes
    ----------
    step_to_isam2_ratio : all that the steps of a whole trial cost over what iSAM2's updates cost, median over trials.
    median_step_to_isam2_ratio : median step over median update, at each length.
    step_growth_1000_over_100 : median step at 1000 poses over that at 100.
    decision_ms : strategy → size → median time of a choice; NaN for a strategy that made none (null in JSON).
    trial_cpu_s : strategy → size → CPU seconds of a whole trial, its decisions included; median over trials.
    scenes : what trials in lidar worlds cost, by scene.
    """

    step_to_isam2_ratio: dict[str, float]
    median_step_to_isam2_ratio: dict[str, dict[str, float]]
    step_growth_1000_over_100: dict[str, float]
    decision_ms: dict[str, dict[str, float]]
    parts: list[Part]
    trial_cpu_s: dict[str, dict[str, float]] = field(default_factory=dict)
    scenes: list[SceneTimes] = field(default_factory=list)


def measure(say: Callable[[str], None] = lambda line: None, names: Sequence[str] = ()) -> Perf:
    """Run the trials and take the times; about two minutes, after a first run that compiles.

    Decisions and whole trials are those of all strategies, or of `names`, as `lookup` takes them.

    Raises
    ------
    RequestError : where there is no such strategy, or it is not trained.
    """
    measured = dict(map(lookup_ready, names)) if names else {n: own for n, own in strategies().items() if own.ready}
    ratios: dict[str, float] = {}
    medians: dict[str, dict[str, float]] = {}
    growth: dict[str, float] = {}
    parts: list[Part] = []
    _steps(20.0, 0, PAPER.step_length)
    for size in SIZES:
        key = f"{size:g}"
        say(f"whole trials at {key} m")
        trials = [_steps(size, trial, PAPER.step_length) for trial in range(TRIALS)]
        ratios[key] = statistics.median(
            sum(sum(step.values()) for step in steps) / sum(step[ISAM2] for step in steps) for steps in trials
        )
        parts += _parts([step for steps in trials for step in steps], size, None)
        say(f"long trajectories at {key} m")
        long = [
            steps
            for trial in range(TRIALS)
            if len(steps := _steps(size, trial, SHORT_STEPS[size], LONGEST)) > LENGTHS[-1]
        ]
        totals = {}
        medians[key] = {}
        for length in LENGTHS:
            low, high = int(length * (1 - WINDOW / 2)), int(length * (1 + WINDOW / 2))
            window = [step for steps in long for step in steps[low:high]]
            totals[length] = statistics.median(sum(step.values()) for step in window)
            medians[key][f"{length}"] = totals[length] / statistics.median(step[ISAM2] for step in window)
            parts += _parts(window, size, length)
        growth[key] = totals[1000] / totals[100]
    decisions: dict[str, dict[str, float]] = {}
    trial_cpu: dict[str, dict[str, float]] = {}
    for name, entry in measured.items():
        say(f"whole trials of {name}")
        times = {f"{size:g}": _whole_trials(name, entry, size) for size in SIZES}
        decisions[name] = {key: decision for key, (decision, _) in times.items()}
        trial_cpu[name] = {key: seconds for key, (_, seconds) in times.items()}
    scenes = []
    for scene in SCENES:
        say(f"whole trials by lidar, {scene}")
        scenes.append(measure_scene(scene))
    return Perf(ratios, medians, growth, decisions, parts, trial_cpu, scenes)


def text(perf: Perf) -> str:
    """Return the measurement as tables."""
    lines = []
    for size in SIZES:
        key = f"{size:g}"
        own = [part for part in perf.parts if part.size == size]
        columns: list[int | None] = [None, *LENGTHS]
        lines += ["", f"{key} m: median µs of each part of a step (ratio to iSAM2's update)"]
        lines.append(f"{'part':<14}" + "".join(f"{'whole trials' if c is None else f'{c} poses':>18}" for c in columns))
        for name in dict.fromkeys(part.name for part in own):
            cells = {part.length: f"{part.median_us:8.0f} ({part.to_isam2:5.2f})" for part in own if part.name == name}
            lines.append(f"{name:<14}" + "".join(f"{cells.get(c, ''):>18}" for c in columns))
        lines.append(f"whole step to iSAM2's update over whole trials: {perf.step_to_isam2_ratio[key]:.2f}")
        lines.append(f"whole step at 1000 poses to that at 100: {perf.step_growth_1000_over_100[key]:.2f}")
    for title, times in (("median decision [ms]", perf.decision_ms), ("CPU s a whole trial", perf.trial_cpu_s)):
        width = max(map(len, (title, *times)))
        if times:
            lines += ["", f"{title:<{width}}" + "".join(f"{f'{size:g} m':>10}" for size in SIZES)]
        for name, by_size in times.items():
            lines.append(f"{name:<{width}}" + "".join(f"{by_size[f'{size:g}']:>10.3f}" for size in SIZES))
    if perf.scenes:
        lines += ["", *scene_table(perf.scenes)]
    return "\n".join(lines[1:])


def write_json(perf: Perf, path: Path) -> None:
    """Write the measurement as JSON.

    Raises
    ------
    RequestError : where the file cannot be written.
    """
    write_whole(path, json.dumps(plain(asdict(perf)), indent=1) + "\n")


def read_json(path: Path) -> Perf:
    """Read what `write_json` wrote."""
    values = json.loads(path.read_text(encoding="utf-8"))
    scenes = [
        SceneTimes(**{**scene, "parts": [ScenePart(**part) for part in scene["parts"]]})
        for scene in values.get("scenes", ())
    ]
    return Perf(**{**values, "parts": [Part(**part) for part in values["parts"]], "scenes": scenes})


def _steps(size: float, trial: int, step_length: float, most: int | None = None) -> list[dict[str, float]]:
    """Times of the parts of every step of a trial, of the first so many where there is a limit."""
    scale = step_length / PAPER.step_length
    scenario = PAPER.replace(
        size=size,
        step_length=step_length,
        odometry_sigma=PAPER.odometry_sigma * scale**0.5,
        heading_sigma_deg=PAPER.heading_sigma_deg * scale**0.5,
        steps_per_cell=PAPER.steps_per_cell / scale,
    )
    if most is not None:
        scenario = scenario.replace(steps_per_cell=most / scenario.cell_count)
    watch = Stopwatch()
    spec = TrialSpec("perf", "explore_bench.runs.stopwatch:FreeChoice", scenario, trial, purpose="calibrate")
    run_trial(spec, lap=watch.lap)
    return watch.steps[1:-1]


def _parts(steps: list[dict[str, float]], size: float, length: int | None) -> list[Part]:
    unit = statistics.median(step[ISAM2] for step in steps)
    names = [*dict.fromkeys(name for step in steps for name in step), "whole step"]
    values = {name: [sum(step.values()) if name == "whole step" else step[name] for step in steps] for name in names}
    medians = {name: statistics.median(values[name]) for name in names}
    return [Part(name, size, length, 1e6 * medians[name], medians[name] / unit) for name in names]


def _whole_trials(name: str, entry: Entry, size: float) -> tuple[float, float]:
    """Median time of a decision [ms], NaN for a strategy that made none, a broken plugin; and CPU time of a trial [s].

    A tiny trial comes first, for imports, weights and compiled code.
    """
    scenario = PAPER.replace(size=size)
    _whole_trial(name, entry, scenario.tiny, 0)
    results = [_whole_trial(name, entry, scenario, trial) for trial in range(1 if entry.reference else DECISION_TRIALS)]
    seconds = [second for result, _ in results for second in result.decision_seconds]
    decision = 1e3 * statistics.median(seconds) if seconds else math.nan
    return decision, statistics.median(spent for _, spent in results)


def _whole_trial(name: str, entry: Entry, scenario: Scenario, trial: int) -> tuple[TrialResult, float]:
    """Run a trial; its CPU time [s] beside it."""
    spec = TrialSpec(
        name,
        entry.factory,
        scenario,
        trial,
        dict(entry.parameters),
        entry.reference,
        purpose="calibrate",
        weights=next(iter(entry.weights.values()), None),
        broken=entry.broken,
    )
    begin = time.process_time()
    result = run_trial(spec)
    return result, time.process_time() - begin
