"""SLAM by scan matching: key poses, the factors between them, loop closures, and the map that follows from them.

Of every key pose the graph holds what odometry says of the motion from the one before, and where its scan was matched
against the window of the last key poses. That match is one factor, from the *anchor*: about the key pose that first saw
the surfaces on which the scan lies. Scans that were matched with the same surfaces share their errors; tied one to the
next they would add up to an uncertainty that is not there, while a tie to a pose that saw none of these surfaces would
hide one that is (docs/stage.md measures it).
"""

from __future__ import annotations

import math

import numpy as np

from explore_bench.geometry import Array, Pose, between, compose, wrap_angle
from explore_bench.robot.lidar.closures import chains_due, due
from explore_bench.robot.lidar.filtering import TailFilter, adjoint_of_inverse, rotated
from explore_bench.robot.lidar.grid_map import GridMap
from explore_bench.robot.lidar.matcher import LOOP, SEQUENTIAL, Match, Matcher, Surfaces, Window, surfaces_of
from explore_bench.robot.lidar.odometry import OdometryModel
from explore_bench.robot.lidar.pose_graph import Link, PoseGraph, joins_of
from explore_bench.robot.timing import Lap, no_lap
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import RangeScan

KEY_DISTANCE, KEY_TURN = 0.5, 0.5
"""Motion after which a scan is taken in [m, rad] (slam_toolbox)."""

WINDOW = 70
"""Key poses against which a scan is matched: those before it (Karto). Shorter windows drift: docs/stage.md."""

ANCHOR_SPACING = 5
"""Every so many key poses one is an anchor, from which matches are measured."""

LEAST_RESPONSE = 0.3
"""A match of less tells nothing, and odometry stands alone."""

LINK_RESPONSE, LOOP_RESPONSE = 0.65, 0.65
"""Least responses of a match with a linked chain, and of one that closes a loop."""

LOOP_SIGMA, LOOP_CORRECTION = 0.1, 0.5
"""A loop is closed only where the match is sure to this [m], and moves the robot by no more than that [m]."""

LOOP_SIGMAS = 5.0
"""Nor is it closed where the match is more standard deviations from where the graph has the pose: a corridor looks the
same half a metre on (individual compatibility: Neira and Tardós 2001)."""

PRIOR_SIGMAS = 0.01, 0.01, 0.01
"""What a search adds to the noise of odometry [m, rad]: its bias is the same at every step, and would pull for ever."""

MATCH_COVARIANCE = np.diag(np.square((0.003, 0.003, 0.0008)))
"""Covariance of a match [m, rad]: about the median of those that are made."""

WINDOW_SIGMAS, WIDEST_TURN = 3.0, math.radians(45.0)
"""A match searches at least so many standard deviations of odometry's noise, and at most so far a turn [rad]."""

CHAIN_SIGMAS = 0.01, 0.01, 0.003
"""What a match with a chain leaves open of where its closest pose is: the chain bends, and others tell of it, too."""

SETTLE_SHARE = 0.03
"""Links to the past move the graph at once where they disagree with it by more than half a cell of the map; others when
so many key poses as a share of all have been added since: where the robot comes again and again, most tell little."""

REFRESH, REFRESH_SHARE = 10, 0.1
"""All marginals are computed anew after so many key poses, or when so many more as a share of all have been added: what
later ones tell of a pose is little, and computing it costs a tenth of a millisecond a pose."""


class Slam:
    """The robot's SLAM: one `update` a key pose.

    Attributes
    ----------
    poses : estimates of the key poses, shape (N, 3).
    covariances : marginal of each in the world frame, shape (N, 3, 3); between two refreshes a pose keeps what it had.
    links : all that is known of one key pose in the frame of another.
    closures : those of them that closed a loop.
    odometry : what is known of it.
    map : of all scans, each placed by the estimate of its pose.
    unmatched : scans in a row that matched nothing.
    refreshed : how often the marginals of all key poses were computed anew.
    """

    def __init__(self, scenario: LidarScenario, start: Pose, scan: RangeScan, lap: Lap = no_lap) -> None:
        self.scenario, self._lap = scenario, lap
        self._graph = PoseGraph(start)
        self._matcher = Matcher(scenario.sensor_range)
        self.odometry = OdometryModel.of(scenario)
        self.map = GridMap(scenario)
        self.poses: Array = np.array([start])
        self.covariances: Array
        self.links: list[Link] = []
        self.closures: list[Link] = []
        self.unmatched = self.refreshed = 0
        self._ranges: list[Array] = []
        self._placed: list[Pose] = []
        self._unsettled = False
        self._keep(scan, start, surfaces_of(scan.ranges, scenario.sensor_range))
        self._last_match: Array | None = np.zeros(3)  # variances along, across and of the heading
        self.refresh()

    @property
    def pose(self) -> Pose:
        """Newest estimated key pose."""
        x, y, heading = self.poses[-1].tolist()
        return x, y, heading

    def update(self, motion: Pose, length: float, turned: float, scan: RangeScan) -> float:
        """Take in a key pose; returns how far links to the past moved the key pose that they moved farthest [m].

        Parameters
        ----------
        motion : from the last key pose, as odometry measured it.
        length, turned : metres driven and radians turned in between.
        """
        newest = len(self.poses)
        last = self.pose
        noise = self.odometry.covariance(motion, length, turned)
        surfaces = surfaces_of(scan.ranges, self.scenario.sensor_range)
        prediction = compose(last, self.odometry.corrected(motion))
        doubt = rotated(noise + np.diag(np.square(PRIOR_SIGMAS)), prediction[2])
        first = max(newest - WINDOW, 0)
        match = self._matcher.match(
            surfaces.hits,
            prediction,
            np.asarray(np.linalg.inv(doubt), dtype=float),
            first,
            self.poses[first:],
            search_window(noise),
        )
        self._lap("match")
        found = match.response >= LEAST_RESPONSE
        self.unmatched = 0 if found else self.unmatched + 1
        pose = match.pose if found else prediction
        self._graph.add_pose(pose)
        self.poses = np.vstack((self.poses, pose))
        # odometry has had its say in the match; what it errs by every time would bend the whole graph a little
        step = noise + MATCH_COVARIANCE if found else noise
        self._link(Link(newest - 1, newest, between(last, pose), step))
        if found:
            self._link_match(anchor_at(match.frame, newest), match)
        self._keep(scan, pose, surfaces)
        self._tail.advance(between(last, pose), step)
        if found:
            self._learn(motion, between(last, pose), match, length, turned)
        else:
            self._last_match = None
        if found:
            self._tail.measure(self.links[-1].earlier, self.links[-1].motion, self.links[-1].covariance)
        disagreement = self._look_back(first) if found else 0.0
        since, shift = newest - self._refreshed_at, 0.0
        if self._unsettled and (disagreement > 0.5 * self.map.grid.resolution or since >= SETTLE_SHARE * newest):
            shift = self._settle()
        elif since >= max(REFRESH, REFRESH_SHARE * newest):
            self.refresh()
        else:
            self._tail.keep(_ties(newest + 1))
            self.covariances = np.concatenate((self.covariances, [self._tail.newest(pose[2])]))
        self._lap("covariances")
        return shift

    def refresh(self) -> None:
        """Compute the marginals of all key poses anew, and begin the filter from them."""
        newest = len(self.poses) - 1
        ties = sorted({*_ties(newest + 1), newest})
        self.covariances, joint = self._graph.covariances(ties)
        self._tail = TailFilter(ties, joint)
        self.refreshed += 1
        self._refreshed_at = newest

    def _keep(self, scan: RangeScan, pose: Pose, surfaces: Surfaces) -> None:
        self._matcher.keep(surfaces)
        self._hits = surfaces.hits
        self._ranges.append(scan.ranges)
        self._placed.append(pose)
        self.map.insert(pose, scan.ranges)
        self.map.watch(pose, scan.ranges)
        self._lap("map")

    def _link(self, link: Link) -> None:
        self._graph.add_link(link)
        self.links.append(link)

    def _link_match(self, earlier: int, match: Match, robust: bool = False) -> Link:
        """Link the newest pose to one of those with which it was matched."""
        x, y, heading = self.poses[earlier].tolist()
        motion = between((x, y, heading), match.pose)
        newest = len(self.poses) - 1
        link = Link(earlier, newest, motion, rotated(match.covariance, -match.pose[2]), robust)
        self._link(link)
        return link

    def _learn(self, motion: Pose, made: Pose, match: Match, length: float, turned: float) -> None:
        """Learn odometry's scale errors from a motion between two matches."""
        own = np.diag(rotated(match.covariance, -match.pose[2]))
        if self._last_match is not None:
            self.odometry = self.odometry.learned(motion, made, self._last_match + own, length, turned)
        self._last_match = own

    def _look_back(self, window_start: int) -> float:
        """Match the newest scan with what earlier key poses saw near by; returns the largest disagreement [m]."""
        disagreement = 0.0
        if not any(due(len(self.poses) - 1)):
            return disagreement
        for chain in chains_due(self.poses, joins_of(self.links), window_start):
            pose = self.pose
            match = self._matcher.match(
                self._hits,
                pose,
                np.zeros((3, 3)),
                chain.first,
                self.poses[chain.first : chain.end],
                SEQUENTIAL if chain.linked else LOOP,
            )
            if match.response < (LINK_RESPONSE if chain.linked else LOOP_RESPONSE):
                continue
            if max(match.covariance[0, 0], match.covariance[1, 1]) > LOOP_SIGMA**2:
                continue
            if math.hypot(match.pose[0] - pose[0], match.pose[1] - pose[1]) > LOOP_CORRECTION:
                continue
            match = match._replace(covariance=match.covariance + np.diag(np.square(CHAIN_SIGMAS)))
            if not (chain.linked or self._compatible(match)):
                continue
            link = self._link_match(match.frame, match, robust=not chain.linked)
            if not chain.linked:
                self.closures.append(link)
            self._unsettled = True
            disagreement = max(disagreement, self._apart(match.pose, pose))
        self._lap("loops")
        return disagreement

    def _compatible(self, match: Match) -> bool:
        """Whether a match is near to where the graph has the newest pose, seen from the pose it was matched with."""
        newest = len(self.poses) - 1
        joint = self._graph.posterior().joint([match.frame, newest])
        earlier: Pose = tuple(self.poses[match.frame].tolist())
        carry = np.hstack((-adjoint_of_inverse(between(earlier, self.pose)), np.eye(3)))
        spread = carry @ joint @ carry.T + rotated(match.covariance, -match.pose[2])
        error = np.array(between(self.pose, match.pose))
        return bool(error @ np.linalg.solve(spread, error) <= LOOP_SIGMAS**2)

    def _settle(self) -> float:
        """Move all key poses to where the links have them; returns the largest move [m]."""
        before, self.poses = self.poses, self._graph.optimize()
        self._unsettled = False
        self._lap("loops")
        self.refresh()
        self._lap("covariances")
        self._replace()
        self._lap("map")
        return float(np.hypot(*(self.poses - before)[:, :2].T).max())

    def _replace(self) -> None:
        """Trace the scans anew whose pose moved by more than half a cell of the map."""
        limit = 0.5 * self.map.grid.resolution
        for number, (x, y, heading) in enumerate(self.poses.tolist()):
            was = self._placed[number]
            if self._apart((x, y, heading), was) > limit:
                self.map.remove(was, self._ranges[number])
                self.map.insert((x, y, heading), self._ranges[number])
                self._placed[number] = (x, y, heading)

    def _apart(self, one: Pose, other: Pose) -> float:
        """How far the middles of the longest beams lie apart, seen from two poses [m]."""
        turn = abs(wrap_angle(one[2] - other[2]))
        return math.hypot(one[0] - other[0], one[1] - other[1]) + 0.5 * self.scenario.sensor_range * turn


def anchor_at(number: int, newest: int) -> int:
    """Anchor from which a match of the newest key pose is measured, when its surfaces are those of another."""
    return min(-(-number // ANCHOR_SPACING) * ANCHOR_SPACING, newest - 1)


def _ties(number: int) -> list[int]:
    """Anchors to which key pose `number`, and those after it, may be linked."""
    first = -(-max(number - WINDOW, 0) // ANCHOR_SPACING) * ANCHOR_SPACING
    return list(range(first, number, ANCHOR_SPACING))


def search_window(noise: Array) -> Window:
    """Search of a scan after a motion of this covariance, shape (3, 3): as far as odometry may have erred."""
    reach, _, turn = (WINDOW_SIGMAS * np.sqrt(np.diag(noise))).tolist()
    return SEQUENTIAL._replace(
        reach=min(max(reach, SEQUENTIAL.reach), LOOP.reach), turn=min(max(turn, SEQUENTIAL.turn), WIDEST_TURN)
    )
