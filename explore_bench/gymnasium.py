"""The benchmark as Gymnasium environments; importing this module registers their ids (docs/gymnasium.md).

One action is one decision: the candidate, or the Target, to which the robot drives. The simulation is `rollout`, the
reward Eq. 24, the observation `explore_bench.trial.features`, and the worlds are those of the streams `train`: no world
of the evaluation.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from explore_bench.errors import RequestError, unknown
from explore_bench.robot.belief import Belief
from explore_bench.robot.planning.roads import Reachable, Roads
from explore_bench.runs.suites import MAX_ROOT
from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.decision_process import Course, DecisionProcess
from explore_bench.trial.explorer import ChoiceError
from explore_bench.trial.features import CANDIDATE_COLUMNS, STATE_COLUMNS, Features, candidate_limit, features
from explore_bench.trial.reward import REWARD_WEIGHTS, RewardWeights
from explore_bench.trial.snapshot import take_snapshot
from explore_bench.trial.spec import Status
from explore_bench.trial.steps import step_columns
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import load_scenario

try:
    import gymnasium
except ModuleNotFoundError:
    raise ModuleNotFoundError(
        "explore_bench.gymnasium needs Gymnasium; install it with pip install 'explore-bench[gym]'.", name="gymnasium"
    ) from None
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded

ENVIRONMENTS: dict[str, dict[str, Any]] = {
    **{f"ExploreBench-{size}m-v0": {"size": float(size)} for size in (20, 30, 40)},
    "ExploreBench-Stage-v0": {"scenario": "stage"},
}
"""Registered ids: the maps of §4.1 by their edge [m], and the lidar world of §4.2; and what `ExploreEnv` is given."""

MAX_TRIVIAL = 100
"""Worlds in a row that may end before the first decision; such worlds are passed over."""

TrainingPurpose = Literal["train", "validate"]

Seen = dict[str, Any]
"""Features by name: `candidates`, shape (W, F), and `state`, shape (G,)."""


class ExploreEnv(gymnasium.Env[Seen, np.int64]):
    """Explore an unknown map: each action names the candidate to drive to.

    Action i is the candidate with the i-th shortest path. One that is no candidate counts modulo their number, which
    `info["action_was_candidate"]` says; `action_masks` tells beforehand which are. An explored map terminates an
    episode; the step limit and a robot that is stuck truncate it.

    Parameters
    ----------
    size : edge of the map [m]; None: the scenario's.
    scenario : the physical constants: a name, a TOML file, or a Scenario.
    purpose : whose streams draw the worlds: `train`, or `validate` to choose among policies.
    weights : the constants of the reward (Eq. 24).
    render_mode : "rgb_array" to have `render` draw.

    Raises
    ------
    RequestError : for an unknown scenario, purpose or render mode, or constants out of range.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012

    def __init__(
        self,
        size: float | None = None,
        scenario: str | Scenario = "paper",
        purpose: TrainingPurpose = "train",
        weights: RewardWeights = REWARD_WEIGHTS,
        render_mode: str | None = None,
    ) -> None:
        if purpose not in get_args(TrainingPurpose):
            raise unknown("purpose", purpose, get_args(TrainingPurpose))
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise unknown("render_mode", str(render_mode), self.metadata["render_modes"])
        physics = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        self.scenario = physics if size is None else physics.replace(size=float(size))
        self.render_mode = render_mode
        self.width = candidate_limit(self.scenario)
        self.action_space = spaces.Discrete(self.width)
        self.observation_space = spaces.Dict(
            {
                "candidates": spaces.Box(-1.0, 1.0, (self.width, len(CANDIDATE_COLUMNS)), np.float32),
                "state": spaces.Box(0.0, 1.0, (len(STATE_COLUMNS),), np.float32),
            }
        )
        self._purpose, self._weights = purpose, weights
        self._course: Course | None = None
        self._trial = 0
        self._process: DecisionProcess | None = None
        self._features: Features | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """Begin an episode: with a seed in the first world of that root seed, without one in the next world.

        Raises
        ------
        RequestError : for a seed that is no root seed, or a scenario whose worlds ask for no decision.
        """
        if seed is not None and not 0 <= seed <= MAX_ROOT:
            raise RequestError(f"seed {seed} is no root seed; give one from 0 to {MAX_ROOT}.")
        super().reset(seed=seed)
        if seed is not None or self._course is None:
            root = int(self.np_random.integers(MAX_ROOT + 1)) if seed is None else int(seed)
            self._course, self._trial = Course(self.scenario, self._purpose, root, self._weights), -1
        self._process, self._trial = _begin(self._course, self._trial + 1)
        return self._look(), self._info()

    def step(self, action: np.int64 | int | Target) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Drive to a candidate, or to a Target of one's own (`reachable` says where), and on to the next decision.

        Raises
        ------
        InvalidAction : for what is neither in the action space nor a target that can be reached.
        ResetNeeded : before the first episode and after the end of one.
        """
        process = self._running()
        if not isinstance(action, Target) and not self.action_space.contains(action):
            raise InvalidAction(f"action {action!r} is not in {self.action_space}; give 0 to {self.width - 1}.")
        if process.observation is None or self._features is None:
            raise ResetNeeded("the episode has ended; call reset() to begin the next.")
        order = self._features.order
        try:
            earned = process.decide(action if isinstance(action, Target) else int(order[int(action) % len(order)]))
        except ChoiceError as error:
            raise InvalidAction(f"{error}.") from None
        seen, info = self._look(), self._info()
        info["action_was_candidate"] = not isinstance(action, Target) and bool(action < len(order))
        status = process.ending.status if process.ending else None
        return seen, earned, status is Status.EXPLORED, status in (Status.STEP_LIMIT, Status.STUCK), info

    def reachable(self) -> Reachable:
        """Cells that can be reached now and the length of the drive to each [m]: where a Target may lie.

        Raises
        ------
        ResetNeeded : before the first episode and after the end of one.
        """
        observation = self._running().observation
        if observation is None:
            raise ResetNeeded("the episode has ended; call reset() to begin the next.")
        return observation.reachable

    def action_masks(self) -> NDArray[np.bool_]:
        """Which actions are candidates now, shape (W,); none after the end of an episode.

        Raises
        ------
        ResetNeeded : before the first episode.
        """
        self._running()
        assert self._features is not None
        return np.arange(self.width) < len(self._features.order)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Picture of the moment, shape (H, W, 3); it shows the true world, too, and is for people only.

        Raises
        ------
        ResetNeeded : before the first episode.
        """
        process = self._running()
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'.")
            return None
        from explore_bench.report.moment import Scene
        from explore_bench.report.scene import scene_image

        observation = process.observation
        shown = (observation.candidates.tolist(), observation.positions) if observation else ()
        columns = {
            name: np.array([getattr(row, name) for row in process.rows]) for name in step_columns(self.scenario.kind)
        }
        return scene_image(Scene(self.scenario, process.world, columns, take_snapshot(self._belief(), *shown)))

    def _running(self) -> DecisionProcess:
        if self._process is None:
            raise ResetNeeded("there is no episode yet; call reset() first.")
        return self._process

    def _belief(self) -> Belief:
        process = self._running()
        if process.observation is not None:
            return process.observation.belief
        assert process.ending is not None
        return process.ending.belief

    def _look(self) -> Seen:
        """Features of what is seen now; at the end of an episode there is no candidate."""
        process = self._running()
        observation = process.observation
        if observation is None:
            last, grid = process.rows[-1], self.scenario.grid
            observation = Observation(
                belief=self._belief(),
                step=last.step,
                decision=last.decisions,
                candidates=np.empty(0, dtype=np.int64),
                positions=np.empty((0, 2)),
                paths=(),
                path_lengths=np.empty(0),
                roads=Roads(grid, np.zeros(grid.shape, dtype=bool), grid.cell_of(last.x, last.y)),
            )
        self._features = features(observation, self.width)
        return {"candidates": self._features.candidates, "state": self._features.state}

    def _info(self) -> dict[str, Any]:
        process = self._running()
        assert self._course is not None
        last = process.rows[-1]
        return {
            "root": self._course.root,
            "trial": self._trial,
            "status": process.ending.status.value if process.ending else "",
            "step": last.step,
            "explored": last.explored,
            "uncertainty": last.uncertainty,
            "action_mask": self.action_masks().astype(np.int8),
        }


def _begin(course: Course, first: int) -> tuple[DecisionProcess, int]:
    """Begin the first episode from this number on in which there is something to decide."""
    for number in range(first, first + MAX_TRIVIAL):
        process = course.begin(number)
        if process.observation is not None:
            return process, number
    raise RequestError(
        f"{MAX_TRIVIAL} worlds of size {course.scenario.size:g} m and sensor_range {course.scenario.sensor_range:g} m "
        "ask for no decision; give a larger size or a shorter range."
    )


def register() -> None:
    """Register the ids of ENVIRONMENTS; again changes nothing."""
    for name, options in ENVIRONMENTS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point="explore_bench.gymnasium:ExploreEnv", kwargs=options)


register()
