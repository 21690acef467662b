"""What the robot senses at one step: the only thing that passes from the simulator to SLAM."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FREE, OCCUPIED, HIDDEN = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Scan:
    """Landmark sightings and a robot-frame look-up of the cells around, taken at one pose.

    The look-up is a patch of the true grid. A point q of the robot's frame lies in it at
    `origin + R(heading) q`; SLAM places the robot's frame by its own estimate, so the scan reveals where things
    are relative to the robot. It never reaches a strategy: its origin and heading are true.

    Attributes
    ----------
    landmarks : ids of the landmarks sighted, shape (K,).
    bearings : bearing of each in the robot's frame [rad], shape (K,).
    ranges : distance of each [m], shape (K,).
    patch : cells around the robot, FREE, OCCUPIED or HIDDEN, shape (P, P), rows along y.
    origin : the robot's place in the patch [m], (x, y).
    heading : angle from the patch's x axis to the robot's [rad].
    """

    landmarks: NDArray[np.int64]
    bearings: NDArray[np.float64]
    ranges: NDArray[np.float64]
    patch: NDArray[np.uint8]
    origin: tuple[float, float]
    heading: float
