"""Loop closures beside the truth: which are false, and where one was due and was not made."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from explore_bench.geometry import TAU, Array, Pose, between
from explore_bench.geometry.rays import cast, leaps
from explore_bench.robot.lidar.pose_graph import Link
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.world import LidarWorld

CLOSURE_DISTANCE, CLOSURE_TURN = 0.3, math.radians(3.0)
"""A closure is true where its relative pose is this near to the true one [m, rad]."""

PLACE_DISTANCE, PLACE_OVERLAP = 3.0, 0.5
"""A key pose is at a place again where it is this near to an earlier one [m], and sees so much of the same (ours)."""

PLACE_LINKS, PATIENCE = 10, 5
"""It is a revisit where so many links of the graph lie between the two; a closure is missed when as many still do so
many key poses later (ours)."""

SIGHT_BEAMS, SIGHT_SLACK = 1440, 0.2
"""Beams that tell what is in sight of a place, and what a surface may lie behind where the nearest of them ends [m]:
beams are 4 cm apart at 10 m, and a wall seen at 10° goes 0.12 m on between the beam and the point."""


class Loops:
    """The true trajectory of one trial, and what it says of the graph's loops.

    A *revisit* begins at a key pose from which half of what is seen can also be seen from an earlier one within 3 m,
    while the shortest way between the two in the graph has ten links or more. It ends when a link shortens that way, or
    five key poses later as a missed closure; a next one begins only once no such earlier pose is left, so a visit
    that goes on counts once.

    Attributes
    ----------
    false : closures whose relative pose is not the true one.
    missed : revisits at which no loop was closed.
    """

    def __init__(self, scenario: LidarScenario, world: LidarWorld) -> None:
        self._scenario, self._world = scenario, world
        self._poses: list[Pose] = [world.start]
        self._places: Array = np.array([world.start[:2]])
        self._joined: list[list[int]] = [[]]
        self._links = self._closures = 0
        self._revisit: tuple[int, int] | None = None
        self._counted = False
        self.false = self.missed = 0

    def visit(self, pose: Pose, links: Sequence[Link]) -> None:
        """Note the true pose of a new key pose, and all links of the graph that SLAM has now taken it into."""
        newest = len(self._poses)
        self._poses.append(pose)
        self._places = np.vstack((self._places, pose[:2]))
        self._joined.append([])
        for link in links[self._links :]:
            self._joined[link.earlier].append(link.later)
            self._joined[link.later].append(link.earlier)
        self._links = len(links)
        if self._revisit is not None:
            begin, place = self._revisit
            if self._far(begin, {place}):
                if newest - begin < PATIENCE:
                    return
                self.missed += 1
                self._counted = True
            self._revisit = None
        place_again = self._place(newest)
        if place_again is None:
            self._counted = False
        elif not self._counted:
            self._revisit = newest, place_again

    def compare(self, closures: Sequence[Link]) -> None:
        """Judge those of all closures so far that are new."""
        for closure in closures[self._closures :]:
            true = between(self._poses[closure.earlier], self._poses[closure.later])
            x, y, turn = between(true, closure.motion)
            self.false += math.hypot(x, y) > CLOSURE_DISTANCE or abs(turn) > CLOSURE_TURN
        self._closures = len(closures)

    def _place(self, newest: int) -> int | None:
        """An earlier key pose that saw what the newest sees, many links away; None where there is none."""
        earlier = self._places[: max(newest - PLACE_LINKS + 1, 0)]  # the others are few links of odometry away
        distances = np.hypot(*(earlier - self._places[newest]).T)
        near = np.flatnonzero(distances <= PLACE_DISTANCE)
        far = np.array(sorted(self._far(newest, set(near.tolist()))), dtype=np.int64)
        if not len(far):
            return None
        visits = np.split(far, np.flatnonzero(np.diff(far) > 1) + 1)
        closest = [int(visit[distances[visit].argmin()]) for visit in visits]
        for place in sorted(closest, key=lambda place: (distances[place], place)):
            if self._overlap(newest, place) >= PLACE_OVERLAP:
                return place
        return None

    def _far(self, start: int, wanted: set[int]) -> set[int]:
        """Those of some key poses to which no way of fewer than PLACE_LINKS links leads."""
        left, seen, edge = wanted - {start}, {start}, [start]
        for _ in range(PLACE_LINKS - 1):
            if not left:
                break
            edge = list({other for pose in edge for other in self._joined[pose]} - seen)
            seen.update(edge)
            left.difference_update(edge)
        return left

    def _overlap(self, one: int, other: int) -> float:
        """Share of the surface points in sight of one key pose that are in sight of another; 0 where it sees none."""
        reach = self._scenario.sensor_range
        x, y, heading = self._poses[one]
        ranges = self._sight(self._poses[one], self._scenario.beams)
        met = np.isfinite(ranges)
        if not met.any():
            return 0.0
        angles = heading + TAU * np.arange(len(ranges))[met] / len(ranges)
        dx = x + ranges[met] * np.cos(angles) - self._poses[other][0]
        dy = y + ranges[met] * np.sin(angles) - self._poses[other][1]
        away = np.hypot(dx, dy)
        sight = self._sight((*self._poses[other][:2], 0.0), SIGHT_BEAMS)
        beam = np.round(np.arctan2(dy, dx) / TAU * SIGHT_BEAMS).astype(np.int64) % SIGHT_BEAMS
        return float(np.mean((away <= reach) & (away <= sight[beam] + SIGHT_SLACK)))

    def _sight(self, pose: Pose, beams: int) -> Array:
        """Distance of what lies in sight of a true pose in range, beam by beam [m]."""
        world = self._world
        return cast(pose, beams, self._scenario.sensor_range, world.obstacles, self._leaps, world.grid)

    @cached_property
    def _leaps(self) -> NDArray[np.float32]:
        return leaps(self._world.obstacles, self._world.grid)
