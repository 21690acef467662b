"""What passes between the truth and the robot: commands one way, odometry and scans the other. Nothing else does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from explore_bench.geometry import Array, Pose

Command = tuple[float, float]
"""One motion command: turn in place by an angle [rad], or go straight by a length [m]; the other is 0."""

Velocity = tuple[float, float]
"""Speed along the heading [m/s] and turn rate [rad/s] that a robot on wheels is asked for until the next tick."""

FREE, OCCUPIED, HIDDEN = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Odometry:
    """What the wheels report of one step; not the command, which they may have carried out otherwise.

    Attributes
    ----------
    motion : pose after the step in the frame of the pose before, as measured.
    sigmas : square roots of its covariance, which is diagonal: standard deviations (along, across, heading)
        [m, m, rad].
    """

    motion: Pose
    sigmas: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Sightings:
    """Landmarks sighted from one pose.

    Attributes
    ----------
    landmarks : ids of the landmarks sighted, shape (K,).
    bearings : bearing of each in the robot's frame [rad], shape (K,).
    ranges : distance of each [m], shape (K,).
    """

    landmarks: NDArray[np.int64]
    bearings: Array
    ranges: Array


@dataclass(frozen=True, slots=True)
class Patch:
    """A robot-frame look-up of the cells around, cut out of the true grid.

    A point q of the robot's frame lies in it at `origin + R(heading) q`; SLAM places the robot's frame by its own
    estimate, so a patch reveals where things are relative to the robot.

    Attributes
    ----------
    cells : cells around the robot, FREE, OCCUPIED or HIDDEN, shape (P, P), rows along y.
    origin : the robot's place in the patch [m], (x, y).
    heading : angle from the patch's x axis to the robot's [rad].
    """

    cells: NDArray[np.uint8]
    origin: tuple[float, float]
    heading: float


@dataclass(frozen=True, slots=True)
class Scan:
    """All that is sensed at one step: landmarks, and a view of what is free and what is not.

    It never reaches a strategy: origin and heading of a patch are true.
    """

    sightings: Sightings
    view: Patch


@dataclass(frozen=True, slots=True)
class RangeScan:
    """What a lidar returns at one place: a range a beam, the beams evenly around and the first one straight ahead.

    Attributes
    ----------
    ranges : distance of what each beam met [m], shape (B,); infinite where it met nothing in range.
    """

    ranges: Array
