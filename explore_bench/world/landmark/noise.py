"""The noise of the landmark worlds: what disturbs truth and sensor, and what the factors of the graph assume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from explore_bench.geometry import Array
from explore_bench.world.signals import Command, Odometry


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """Standard deviations [m, rad]: of the start's prior, of a straight step, of a turn in place, and of a sighting."""

    prior: float
    prior_heading: float
    straight: float
    turn: float
    heading: float
    bearing: float
    range: float

    def odometry(self, command: Command) -> Odometry:
        """Odometry of a command: the command itself is read, as in [8], with the noise of a turn or a straight step."""
        turn, forward = command
        sigma = self.straight if forward else self.turn
        return Odometry((forward, 0.0, turn), (sigma, sigma, self.heading))

    def odometries(self, commands: Array) -> tuple[Array, Array]:
        """Motions and standard deviations of many commands at once: rows (turn, forward), shape (K, 2), give (K, 3)."""
        motions, sigmas = np.zeros((len(commands), 3)), np.empty((len(commands), 3))
        motions[:, 0], motions[:, 2] = commands[:, 1], commands[:, 0]
        sigmas[:, :2] = np.where(commands[:, 1:] != 0.0, self.straight, self.turn)
        sigmas[:, 2] = self.heading
        return motions, sigmas
