"""SLAM by scan matching: key poses, the factors between them, loop closures, and the map that follows from them.

Of every key pose the graph holds what odometry says of the motion from the one before, and where its scan was matched:
against the window of the last key poses, as one factor from the window's anchor. Scans of one window share its
surfaces, so their errors are not independent; tied one to the next they would add up to an uncertainty that is not
there, while tied to a common anchor they are what they are: errors within one window (docs/stage.md measures it).
"""

from __future__ import annotations

import math

import numpy as np

from explore_bench.geometry import Array, Pose, between, compose
from explore_bench.robot.lidar.closures import chains
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.robot.lidar.matcher import LOOP, SEQUENTIAL, Match, Matcher, Surfaces, surfaces_of
from explore_bench.robot.lidar.pose_graph import Link, PoseGraph
from explore_bench.robot.timing import Lap, no_lap
from explore_bench.world.lidar.scenario import LidarScenario
from explore_bench.world.signals import RangeScan

KEY_DISTANCE, KEY_TURN = 0.5, 0.5
"""Motion after which a scan is taken in [m, rad] (slam_toolbox)."""

WINDOW = 20
"""Key poses against which a scan is matched: those before it."""

ANCHOR_SPACING = 10
"""Key poses between two anchors: that of a pose is 10 to 19 before it, always in its window."""

LEAST_RESPONSE = 0.3
"""A match of less tells nothing, and odometry stands alone."""

LINK_RESPONSE, LOOP_RESPONSE = 0.65, 0.65
"""Least responses of a match with a linked chain, and of one that closes a loop."""

LOOP_SIGMA, LOOP_CORRECTION = 0.1, 0.5
"""A loop is closed only where the match is sure to this [m], and moves the robot by no more than that [m]."""

LINK_SPACING = 4
"""Key poses between two links to earlier chains: the next one would say the same."""


class Slam:
    """The robot's SLAM: one `update` a key pose.

    Attributes
    ----------
    poses : estimates of the key poses, shape (N, 3).
    covariances : marginal of each in the world frame, shape (N, 3, 3).
    links : all that is known of one key pose in the frame of another.
    closures : those of them that closed a loop.
    map : of all scans, each placed by the estimate of its pose.
    unmatched : scans in a row that matched nothing.
    rewritten : how often the past was moved, by a closure or a link.
    """

    def __init__(self, scenario: LidarScenario, start: Pose, scan: RangeScan, lap: Lap = no_lap) -> None:
        self.scenario, self._lap = scenario, lap
        self._graph = PoseGraph(start)
        self._matcher = Matcher(scenario.sensor_range)
        self.map = GridMap(scenario)
        self.poses: Array = np.array([start])
        self.covariances: Array = self._graph.covariances()
        self.links: list[Link] = []
        self._joined: list[list[int]] = [[]]
        self._linked_at = self._closed_at = 0
        self.closures: list[Link] = []
        self.unmatched = self.rewritten = 0
        self._frames: list[Surfaces] = []
        self._ranges: list[Array] = []
        self._placed: list[Pose] = []
        self._keep(scan, start)

    @property
    def pose(self) -> Pose:
        """Newest estimated key pose."""
        x, y, heading = self.poses[-1].tolist()
        return x, y, heading

    def update(self, motion: Pose, length: float, turned: float, scan: RangeScan) -> bool:
        """Take in a key pose; returns whether earlier poses moved.

        Parameters
        ----------
        motion : from the last key pose, as odometry measured it.
        length, turned : metres driven and radians turned in between.
        """
        newest = len(self.poses)
        last = self.pose
        noise = odometry_covariance(self.scenario, motion, length, turned)
        surfaces = surfaces_of(scan.ranges, self.scenario.sensor_range)
        prediction = compose(last, motion)
        first = max(newest - WINDOW, 0)
        match = self._matcher.match(
            surfaces.hits,
            prediction,
            np.asarray(np.linalg.inv(turned_back(noise, -prediction[2])), dtype=float),
            self._frames[first:],
            self.poses[first:],
        )
        self._lap("match")
        found = match.response >= LEAST_RESPONSE
        self.unmatched = 0 if found else self.unmatched + 1
        pose = match.pose if found else prediction
        self._graph.add_pose(pose)
        self.poses = np.vstack((self.poses, pose))
        self._joined.append([])
        self._link(Link(newest - 1, newest, motion, noise))
        if found:
            self._link_match(anchor_of(newest), match)
        self._keep(scan, pose, surfaces)
        moved = found and self._look_back(first)
        self.covariances = (
            self._graph.covariances() if moved else np.concatenate((self.covariances, self._graph.covariances(newest)))
        )
        self._lap("covariances")
        if moved:
            self._replace()
            self._lap("map")
        return moved

    def refresh(self) -> None:
        """Compute the marginals of all key poses anew: those of the past grow a little smaller with every step."""
        self.covariances = self._graph.covariances()
        self._lap("covariances")

    def _keep(self, scan: RangeScan, pose: Pose, surfaces: Surfaces | None = None) -> None:
        self._frames.append(surfaces or surfaces_of(scan.ranges, self.scenario.sensor_range))
        self._ranges.append(scan.ranges)
        self._placed.append(pose)
        self.map.insert(pose, scan.ranges)
        self._lap("map")

    def _link(self, link: Link) -> None:
        self._graph.add_link(link)
        self.links.append(link)
        self._joined[link.earlier].append(link.later)
        self._joined[link.later].append(link.earlier)

    def _link_match(self, earlier: int, match: Match, robust: bool = False) -> Link:
        """Link the newest pose to one of those with which it was matched."""
        x, y, heading = self.poses[earlier].tolist()
        motion = between((x, y, heading), match.pose)
        newest = len(self.poses) - 1
        link = Link(earlier, newest, motion, turned_back(match.covariance, match.pose[2]), robust)
        self._link(link)
        return link

    def _look_back(self, window_start: int) -> bool:
        """Match the newest scan with what earlier key poses saw near by; returns whether the past was moved."""
        newest = len(self.poses) - 1
        moved = False
        for chain in chains(self.poses, self._joined, window_start):
            if newest - (self._linked_at if chain.linked else self._closed_at) < LINK_SPACING:
                continue
            pose = self.pose
            match = self._matcher.match(
                self._frames[newest].hits,
                pose,
                np.zeros((3, 3)),
                self._frames[chain.first : chain.end],
                self.poses[chain.first : chain.end],
                SEQUENTIAL if chain.linked else LOOP,
            )
            if match.response < (LINK_RESPONSE if chain.linked else LOOP_RESPONSE):
                continue
            if max(match.covariance[0, 0], match.covariance[1, 1]) > LOOP_SIGMA**2:
                continue
            if math.hypot(match.pose[0] - pose[0], match.pose[1] - pose[1]) > LOOP_CORRECTION:
                continue
            link = self._link_match(chain.closest, match, robust=not chain.linked)
            if chain.linked:
                self._linked_at = newest
            else:
                self._closed_at = newest
                self.closures.append(link)
            self.poses = self._graph.optimize()
            moved = True
        self._lap("loops")
        self.rewritten += moved
        return moved

    def _replace(self) -> None:
        """Trace the scans anew whose pose moved by more than half a cell of the map."""
        limit = 0.5 * self.map.grid.resolution
        reach = 0.5 * self.scenario.sensor_range  # where a turn moves the middle of a beam
        for number, (x, y, heading) in enumerate(self.poses.tolist()):
            was = self._placed[number]
            if math.hypot(x - was[0], y - was[1]) + reach * abs(heading - was[2]) > limit:
                self.map.remove(was, self._ranges[number])
                self.map.insert((x, y, heading), self._ranges[number])
                self._placed[number] = (x, y, heading)


def anchor_of(number: int) -> int:
    """Anchor of a key pose, from which its match is measured."""
    return max((number // ANCHOR_SPACING - 1) * ANCHOR_SPACING, 0)


def odometry_covariance(scenario: LidarScenario, motion: Pose, length: float, turned: float) -> Array:
    """Covariance of a motion that odometry measured, in the frame after it, shape (3, 3): its bias and white noise."""
    bias, heading_bias = scenario.odometry_bias / math.sqrt(12.0), scenario.heading_bias / math.sqrt(12.0)
    white = scenario.odometry_noise**2 * length + 1e-8
    return np.diag(
        (
            (bias * motion[0]) ** 2 + white,
            (bias * motion[1]) ** 2 + white,
            (heading_bias * motion[2]) ** 2 + scenario.heading_noise**2 * (length + turned) + 1e-8,
        )
    )


def turned_back(covariance: Array, angle: float) -> Array:
    """Covariance of a pose's error, shape (3, 3), in axes that are turned by an angle [rad]."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turn @ covariance @ turn.T)
