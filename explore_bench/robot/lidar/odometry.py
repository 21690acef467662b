"""What the robot knows of its odometry: white noise, and scale errors that stay the same all trial long (Stage).

A scale error is drawn once, so every motion that a match measures well tells of it. In a corridor, where no match says
how far the robot drove, what was learned before is all there is: without it a robot errs there by the whole bias.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from explore_bench.geometry import Array, Pose, wrap_angle
from explore_bench.world.lidar.constants import LidarScenario

LEAST_SIGMA = 0.001
"""Least noise of odometry [m or rad]: with a thousandth of that a long drive without a match is no longer solvable."""


@dataclass(frozen=True, slots=True)
class OdometryModel:
    """Scales by which measured motions are to be multiplied, as estimated so far.

    Attributes
    ----------
    white, heading_white : of the scenario's noise.
    scales, variances : estimate of the scale along, across and of turns, and its variance; shapes (3,).
    """

    white: float
    heading_white: float
    scales: Array
    variances: Array

    @classmethod
    def of(cls, scenario: LidarScenario) -> Self:
        """What is known before the first motion: scale errors are uniform in ± half of the scenario's."""
        biases = np.array((scenario.odometry_bias, scenario.odometry_bias, scenario.heading_bias))
        return cls(scenario.odometry_noise, scenario.heading_noise, np.ones(3), biases**2 / 12.0)

    def corrected(self, motion: Pose) -> Pose:
        """Motion that was most likely made where this one was measured."""
        x, y, turn = (self.scales * motion).tolist()
        return x, y, turn

    def white_noise(self, length: Array | float, turned: Array | float) -> Array:
        """Variances along, across and of the heading that white noise adds over metres and radians, shape (..., 3)."""
        along = self.white**2 * length + LEAST_SIGMA**2
        return np.stack((along, along, self.heading_white**2 * (length + turned) + LEAST_SIGMA**2), axis=-1)

    def covariance(self, motion: Array | Pose, length: Array | float, turned: Array | float) -> Array:
        """Covariance of corrected motions, shape (..., 3), in the frame after each, shape (..., 3, 3)."""
        return np.asarray(
            (self.variances * np.square(motion) + self.white_noise(length, turned))[..., None] * np.eye(3)
        )

    def learned(self, motion: Pose, made: Pose, variances: Array, length: float, turned: float) -> Self:
        """Model after a motion that was measured, and then found by matches to be `made`.

        Parameters
        ----------
        variances : of what the matches say of the motion, along, across and of the turn, shape (3,).
        """
        measured = np.array(motion)
        noise = variances + self.white_noise(length, turned)
        surprise = np.array(made) - self.scales * measured
        surprise[2] = wrap_angle(surprise[2])  # half a turn to the left is one to the right
        gain = self.variances * measured / (self.variances * measured**2 + noise)
        return replace(
            self,
            scales=self.scales + gain * surprise,
            variances=self.variances * (1.0 - gain * measured),
        )
