"""A rollout as learners meet it: one advance a decision, each rewarded by Eq. 24, in worlds of named streams."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from explore_bench.strategies.contract import Observation, Target
from explore_bench.trial.explorer import checked
from explore_bench.trial.loop import Ending, rollout
from explore_bench.trial.reward import REWARD_WEIGHTS, RewardWeights, reward
from explore_bench.trial.seeding import Purpose, Role, stream
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import World, draw_world
from explore_bench.world.scenario import Scenario


class DecisionProcess:
    """A rollout that has run up to its first decision and is advanced by one decision at a time.

    Attributes
    ----------
    scenario, world : the physical constants, the true map.
    rows : row of every step so far, the first before any step.
    observation : what the decision that is due may use; None at the end.
    ending : how it ended; None while a decision is due.
    """

    def __init__(
        self,
        scenario: Scenario,
        world: World,
        motion: np.random.Generator,
        sensing: np.random.Generator,
        weights: RewardWeights = REWARD_WEIGHTS,
    ) -> None:
        self.scenario, self.world = scenario, world
        self.rows: list[Step] = []
        self.observation: Observation | None = None
        self.ending: Ending | None = None
        self._weights = weights
        self._events = rollout(scenario, world, motion, sensing)
        self._advance(None)

    def decide(self, choice: int | Target) -> float:
        """Drive to the candidate of this index, or to a Target, and on to the next decision or the end.

        Returns the reward (Eq. 24).

        Raises
        ------
        ChoiceError : where there is no such candidate, or no way to the target.
        """
        before, observation = self.rows[-1], self.observation
        if observation is not None:  # before the loop meets it, which such an answer would end
            choice = checked(choice, len(observation.candidates), observation.roads)
        self._advance(choice)
        return reward(before, self.rows[-1], self.scenario, self._weights)

    def _advance(self, choice: int | Target | None) -> None:
        self.observation = None
        try:
            event = self._events.send(choice)
            while isinstance(event, Step):
                self.rows.append(event)
                event = next(self._events)
            self.observation = event
        except StopIteration as stop:
            self.ending = stop.value


@dataclass(frozen=True)
class Course:
    """Where episodes come from, their physics and their random streams, numbered from 0, and what they earn.

    Attributes
    ----------
    root : root seed; for training the training seed.
    weights : of the reward of a decision (Eq. 24).
    scales : sides of the maps as multiples of the scenario's, by turns.
    """

    scenario: Scenario
    purpose: Purpose
    root: int
    weights: RewardWeights = REWARD_WEIGHTS
    scales: tuple[float, ...] = (1.0,)

    def scenario_of(self, episode: int) -> Scenario:
        """Physics of an episode, its map of the size whose turn it is."""
        scale = self.scales[episode % len(self.scales)]
        return self.scenario if scale == 1.0 else self.scenario.replace(size=scale * self.scenario.size)

    def generator(self, episode: int, role: Role) -> np.random.Generator:
        """Return the stream of a role in an episode."""
        return stream(self.purpose, self.root, self.scenario_of(episode).size, episode, role)

    def begin(self, episode: int) -> DecisionProcess:
        """Draw the world of an episode and run up to its first decision."""
        scenario = self.scenario_of(episode)
        world = draw_world(scenario, self.generator(episode, "world"))
        motion, sensing = self.generator(episode, "motion"), self.generator(episode, "sensor")
        return DecisionProcess(scenario, world, motion, sensing, self.weights)
