"""Training of one strategy with one seed: episodes, validation, checkpoints, the curve, and the card of the weights."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.learned.belief_attention import BeliefAttention
from baselines.learned.checkpoint import describe, load_state, load_weights, save_state, save_weights
from baselines.learned.gcn import GCN
from baselines.learned.graph_stnn import GraphSTNN
from baselines.learned.policy import evaluate
from baselines.training.episodes import Episode, play
from baselines.training.learner import DivergedError, Learner
from baselines.training.policy_gradient import PolicyGradientLearner, PolicyGradientSettings
from baselines.training.replay import ReplayLearner, ReplaySettings
from baselines.training.returns import ReturnsLearner, ReturnsSettings
from explore_bench import (
    CURVE_COLUMNS,
    CURVE_WINDOW,
    PAPER,
    REWARD_WEIGHTS,
    VALIDATION_COLUMNS,
    Course,
    Entry,
    Observation,
    RequestError,
    RewardWeights,
    curve_path,
    describe as describe_error,
    installed_version,
    load_scenario,
    parse_factory,
    scenario_digest,
    stream,
    validations_path,
    writing,
)

VALIDATION_WORLDS = 64
VALIDATE_EVERY = 500
"""Episodes between two validations."""

SAVE_SECONDS = 15.0
SAY_SECONDS = 10.0


@dataclass(frozen=True)
class Recipe:
    """How networks of a factory are made and learn.

    Attributes
    ----------
    network : makes an untrained one from the entry's parameters.
    learner, settings : how it learns.
    reward : weights of Eq. 24.
    scales : sides of the maps it trains and validates on, by turns, as multiples of the scenario's (the paper's 20 m).
    episodes : how many it takes unless told otherwise.
    """

    network: Callable[..., Any]
    learner: type[Learner]
    settings: ReturnsSettings | ReplaySettings | PolicyGradientSettings
    episodes: int
    reward: RewardWeights = REWARD_WEIGHTS
    scales: tuple[float, ...] = (1.0,)


RECIPES: dict[str, Recipe] = {
    "baselines.learned.graph_stnn": Recipe(GraphSTNN, ReturnsLearner, ReturnsSettings(), 4500),
    "baselines.learned.belief_attention": Recipe(
        BeliefAttention, PolicyGradientLearner, PolicyGradientSettings(), 6000, scales=(1.0, 1.5)
    ),
    "baselines.learned.gcn": Recipe(GCN, ReplayLearner, ReplaySettings(), 4500),
}
"""By the module of a strategy's factory."""


@dataclass
class Log:
    """What is known of a training so far; it is stored with every checkpoint.

    Attributes
    ----------
    episodes, decisions, steps, seconds : done so far.
    curve : rows of CURVE_COLUMNS, one for every CURVE_WINDOW steps.
    pending : sums of the row that is not full yet.
    validations : VALIDATION_COLUMNS of each validation.
    resumed : after how many episodes it went on from a checkpoint.
    """

    episodes: int = 0
    decisions: int = 0
    steps: int = 0
    seconds: float = 0.0
    curve: list[list[float]] = field(default_factory=list)
    pending: list[float] = field(default_factory=lambda: [0.0] * 9)
    validations: list[list[float]] = field(default_factory=list)
    resumed: list[int] = field(default_factory=list)

    def add(self, episodes: list[Episode], loss: float, course: Course) -> None:
        """Take in the episodes of one gradient step."""
        for episode in episodes:
            self.episodes += 1
            self.decisions += len(episode.rewards)
            self.steps += episode.steps
            own = course.scenario_of(episode.number)
            counts = own.size == course.scenario.size
            learned = math.isfinite(loss)
            shown = (1, len(episode.rewards), sum(episode.rewards), *episode.score(own)) if counts else (0,) * 6
            values = (episode.steps, *shown, loss if learned else 0.0, learned)
            self.pending = [a + b for a, b in zip(self.pending, values, strict=True)]
        if self.pending[0] >= CURVE_WINDOW and self.pending[1]:
            self.curve.append(self.row())
            self.pending = [0.0] * 9

    def row(self) -> list[float]:
        """CURVE_COLUMNS of what is pending: reward a decision; T, η, e and loss an episode.

        Maps of other sizes than the course's own do not count in the means of reward, T, η and e, so that curves
        compare.
        """
        _, count, decisions, reward, *sums, loss, learned = self.pending
        means = [value / max(count, 1) for value in sums]
        mean_loss = loss / learned if learned else math.nan
        return [self.steps, self.episodes, self.decisions, reward / max(decisions, 1), *means, mean_loss]


class Training:
    """A training that can stop and go on; see `train`."""

    def __init__(
        self, name: str, entry: Entry, seed: int, out: Path, scenario: str | None = None, start: Path | None = None
    ) -> None:
        torch.set_num_threads(1)
        module, _ = parse_factory(entry.factory)
        self.recipe = RECIPES[module]
        self.name, self.entry, self.seed = name, entry, seed
        self.best_path = out / f"{name}-{seed}.safetensors"
        self.last_path = out / f"{name}-{seed}.last"
        base = PAPER if scenario is None else load_scenario(scenario)
        try:
            own = base.replace(**entry.training)
        except RequestError as error:
            raise RequestError(f"strategy '{name}' cannot be trained in the scenario '{scenario}': {error}") from None
        scales = self.recipe.scales if base.map is None else (1.0,)
        self.course = Course(own, "train", seed, self.recipe.reward, scales)
        self.validation = Course(base, "validate", 0, scales=scales)
        torch.manual_seed(int(stream("train", seed, base.size, 0, "strategy").integers(2**62)))
        try:
            self.network = self.recipe.network(**entry.parameters)
        except (TypeError, ValueError) as error:
            raise RequestError(f"strategy '{name}' cannot be made ({describe_error(error)}).") from None
        self.origin: dict[str, Any] = {}
        if start is not None:
            self.origin = {"start": {"weights": start.name, "sha256": load_weights(self.network, start)["sha256"]}}
        if start is not None and start.is_relative_to(Path.cwd()):  # the card is read on other machines
            start = start.relative_to(Path.cwd())
        told = {"--scenario": scenario, "--from": start}
        self._options = "".join(f" {option} {value}" for option, value in told.items() if value is not None)
        self.learner = self.recipe.learner(self.network, self.course, self.recipe.settings)
        self.log = Log()

    def restore(self) -> bool:
        """Go on from the last checkpoint; False where there is none.

        Raises
        ------
        RequestError : where it is damaged or that of another network, or its best weights are missing.
        """
        if not self.last_path.exists():
            return False
        tensors, facts = load_state(self.last_path)
        if facts.get("design") != self._design():
            raise RequestError(
                f"checkpoint '{self.last_path}' is of another network or other settings; train without --resume."
            )
        try:
            self.log = Log(**facts["log"])
            self.learner.restore(tensors, facts["counters"])
        except (KeyError, TypeError, ValueError, RuntimeError) as error:
            raise RequestError(
                f"checkpoint '{self.last_path}' is damaged ({describe_error(error)}); remove it and train without "
                "--resume."
            ) from None
        if self.log.validations and not self.best_path.exists():
            raise RequestError(
                f"'{self.last_path}' goes on from the best weights '{self.best_path}', which are missing; restore "
                "them, or remove the checkpoint and train anew."
            )
        return True

    def save(self) -> None:
        """Write the checkpoint from which `restore` goes on."""
        facts = {"design": self._design(), "counters": self.learner.counters(), "log": asdict(self.log)}
        save_state(self.last_path, self.learner.tensors(), facts)

    def _design(self) -> dict[str, Any]:
        made = {**describe(self.network), **self._how()}
        return json.loads(json.dumps(made))

    def _how(self) -> dict[str, Any]:
        """Everything beside the network and the seed that a training depends on."""
        return {
            "settings": asdict(self.recipe.settings),
            "reward_weights": asdict(self.recipe.reward),
            "scales": self.course.scales,
            "scenario": {"kind": self.course.scenario.kind, **self.course.scenario.model_dump(exclude_unset=True)},
            "scenario_digest": scenario_digest(self.course.scenario),
            **self.origin,
        }

    def validate(self) -> None:
        """Play the validation worlds without noise; keep the weights where none before were better."""
        log = self.log
        played = greedy(self.network, self.validation, VALIDATION_WORLDS)
        scores = np.array([episode.score(self.validation.scenario_of(episode.number)) for episode in played])
        objective = float((np.log(scores[:, 2]) - np.log(scores[:, 1])).mean())
        log.validations.append([log.episodes, objective, *scores.mean(axis=0).tolist()])
        if objective <= min(row[1] for row in log.validations):
            save_weights(self.network, self.best_path, self.facts())
            self.write_curve()

    def facts(self) -> dict[str, Any]:
        """What the card says beside the network: how the weights were made and what validation measured."""
        log, (episodes, objective, time_, efficiency, error) = self.log, self.log.validations[-1]
        count = max(log.episodes, 1)  # none where the weights that it started from are the best
        command = f"explore-bench train {self.name} --seed {self.seed} --episodes {count}{self._options}"
        return {
            "strategy": self.name,
            "training_seed": self.seed,
            "command": command,
            "episodes": int(episodes),
            "steps": log.steps,
            "decisions": log.decisions,
            "wall_seconds": round(log.seconds, 1),
            "validation": {
                "worlds": VALIDATION_WORLDS,
                "objective": objective,
                "time": time_,
                "exploration_efficiency": efficiency,
                "trajectory_error": error,
            },
            "resumed": log.resumed,
            **self._how(),
            "versions": {library: installed_version(library) for library in ("gtsam", "numpy", "torch")},
        }

    def write_curve(self) -> None:
        """Write the training curve and the validations beside the best weights."""
        write_csv(curve_path(self.best_path), tuple(CURVE_COLUMNS), self.log.curve)
        write_csv(validations_path(self.best_path), tuple(VALIDATION_COLUMNS), self.log.validations)


def write_csv(path: Path, header: tuple[str, ...], rows: list[list[float]]) -> None:
    """Write numbers with a header, atomically."""
    lines = [",".join(header), *(",".join(f"{value:.6g}" for value in row) for row in rows)]
    half = path.with_name(f"{path.name}.{os.getpid()}.part")
    with writing(path):
        try:
            half.write_text("\n".join(lines) + "\n", encoding="utf-8")
            half.replace(path)
        finally:
            half.unlink(missing_ok=True)


def greedy(network: Any, course: Course, count: int) -> list[Episode]:
    """Play episodes with the mean weights and no dropout."""
    network.eval()
    hidden = network.start(count)

    def act(waiting: list[int], observations: list[Observation]) -> list[int]:
        nonlocal hidden
        with torch.inference_mode():
            values, after = evaluate(network, observations, hidden[:, waiting])
            hidden = hidden.index_copy(1, torch.tensor(waiting), after)
        chosen: list[int] = values.argmax(dim=1).tolist()
        return chosen

    return play(course, range(count), act)


def train(
    name: str,
    entry: Entry,
    seed: int,
    episodes: int | None,
    resume: bool,
    out: Path,
    say: Callable[[str], None],
    scenario: str | None = None,
    start: Path | None = None,
) -> Path:
    """Train a strategy with one seed and return the path of its best weights.

    It trains and validates in worlds of `scenario`, a name or a TOML file (None: the paper's). The weights `start`, of
    a network of the same kind, are validated before it goes on from them, so that what it leaves is no worse.

    The best weights by validation, their card, the curve and the validations are `NAME-SEED.safetensors`, `.json`,
    `.curve.csv` and `.validations.csv` in `out`; `NAME-SEED.last` is the checkpoint from which `resume` goes on,
    written every 15 s or so. Worlds come from the streams `train` (root: the seed) and `validate`, never from those of
    the benchmark.

    Raises
    ------
    RequestError : when `out` cannot be written, holds a training that was not to be resumed or weights without their
        checkpoint, the scenario or the weights to start from are not for this strategy, or the loss diverged.
    """
    run = Training(name, entry, seed, out, scenario, start)
    wanted = episodes or run.recipe.episodes
    resumed = resume and run.restore()
    if not resume and run.last_path.exists():
        raise RequestError(f"'{run.last_path}' holds a training already; add --resume to go on, or remove it.")
    if not resumed and run.best_path.exists():
        raise RequestError(
            f"'{run.best_path}' holds weights but no checkpoint lies beside it; train with another --out, or remove it."
        )
    if resumed:
        say(f"{name}, seed {seed}: going on after {run.log.episodes} episodes")
        if run.log.episodes < wanted and run.log.episodes not in run.log.resumed:
            run.log.resumed.append(run.log.episodes)
    run.save()
    if start is not None and not run.log.validations:
        run.validate()
        say(_validation_line(run))
    begin = saved = said = time.perf_counter()
    before, first = run.log.seconds, run.log.episodes
    while run.log.episodes < wanted:
        count = min(run.learner.episodes_at_once, wanted - run.log.episodes)
        numbers = range(run.log.episodes, run.log.episodes + count)
        try:
            played, loss = run.learner.improve(numbers)
        except DivergedError as error:
            best = f"the best weights so far are in '{run.best_path}'"
            kept = best if run.log.validations else "there are no weights yet"
            raise RequestError(
                f"training of '{name}' diverged at episode {numbers[0]} ({error}); {kept}, try another --seed."
            ) from None
        run.log.add(played, loss, run.course)
        now = time.perf_counter()
        run.log.seconds = before + now - begin
        validated = numbers[0] // VALIDATE_EVERY != run.log.episodes // VALIDATE_EVERY
        if validated or run.log.episodes >= wanted:
            run.validate()
            say(_validation_line(run))
        if validated or now - saved > SAVE_SECONDS:
            run.save()
            saved = now
        if now - said > SAY_SECONDS:
            left = (now - begin) / (run.log.episodes - first) * (wanted - run.log.episodes)
            say(_progress_line(run, left))
            said = now
    if not run.log.validations or run.log.validations[-1][0] < run.log.episodes:  # stopped before it could
        run.validate()
        say(_validation_line(run))
    run.save()
    run.write_curve()
    return run.best_path


def _progress_line(run: Training, left: float) -> str:
    log = run.log
    row = log.row() if log.pending[1] or not log.curve else log.curve[-1]
    _, _, _, reward, time_, efficiency, error, _ = row
    return (
        f"{run.name} seed {run.seed}: episode {log.episodes}, reward {reward:.3f}, T {time_:.0f}, η {efficiency:.3f}, "
        f"e {error:.3f}, {run.learner.exploration()}, {log.steps / max(log.seconds, 1e-9):.0f} steps/s, "
        f"{left / 60:.1f} min left"
    )


def _validation_line(run: Training) -> str:
    episodes, objective, time_, efficiency, error = run.log.validations[-1]
    best = min(row[1] for row in run.log.validations)
    mark = " (best)" if math.isclose(best, objective) else ""
    return (
        f"{run.name} seed {run.seed}: validation after {episodes:.0f} episodes: T {time_:.1f}, η {efficiency:.3f}, "
        f"e {error:.3f}, mean log e − log η {objective:.3f}{mark}"
    )
