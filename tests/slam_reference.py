"""What the tests of SLAM share: gtsam as the oracle, random graphs, and small simulated drives.

Nothing here uses the code under test except `small_drive`, which runs it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from explore_bench.robot.landmark.driver import Driver
from explore_bench.robot.landmark.smoother import Smoother
from explore_bench.world.kinds import draw_world
from explore_bench.world.landmark.motion import Robot
from explore_bench.world.landmark.sensor import Sensor
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.scenario import Scenario
from explore_bench.world.signals import Patch, Scan, Sightings

EMPTY = np.empty((0, 2))

PINNED = {"step_length": 0.5, "odometry_sigma": 0.07}
"""Calibrated constants, held fast: worked numbers and drives must not change with a calibration."""


def diagonal(*sigmas):
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(sigmas))


def odometry_factor(scenario, k, command):
    """Factor that joins poses k and k + 1."""
    turn, forward = command
    sigma = scenario.odometry_sigma if forward else scenario.turn_sigma
    noise = diagonal(sigma, sigma, math.radians(scenario.heading_sigma_deg))
    return gtsam.BetweenFactorPose2(X(k), X(k + 1), gtsam.Pose2(forward, 0.0, turn), noise)


def sighting_factor(scenario, pose, landmark, bearing, distance):
    noise = diagonal(math.radians(scenario.bearing_sigma_deg), scenario.range_sigma)
    return gtsam.BearingRangeFactor2D(X(pose), L(landmark), gtsam.Rot2(bearing), distance, noise)


def batch_graph(scenario, start, commands, sightings):
    """Graph of a whole drive; `sightings` are rows (pose, landmark, bearing, range)."""
    graph = gtsam.NonlinearFactorGraph()
    heading = math.radians(scenario.prior_heading_sigma_deg)
    prior = diagonal(scenario.prior_sigma, scenario.prior_sigma, heading)
    graph.add(gtsam.PriorFactorPose2(X(0), gtsam.Pose2(*start), prior))
    for k, command in enumerate(commands):
        graph.add(odometry_factor(scenario, k, command))
    for sighting in sightings:
        graph.add(sighting_factor(scenario, *sighting))
    return graph


def values_of(poses, landmarks):
    values = gtsam.Values()
    for k, pose in enumerate(poses):
        values.insert(X(k), gtsam.Pose2(*pose))
    for m, landmark in enumerate(landmarks):
        values.insert(L(m), np.array(landmark))
    return values


def batch_marginals(graph, poses, landmarks):
    """Covariances of all poses in the world frame, (N, 3, 3), and landmarks, (M, 2, 2), by gtsam alone.

    At odometry residuals between 1e-5 and 1e-3 rad gtsam's own derivative of the logarithm cancels, which may cost
    about 1e-6 of a block's largest entry; `precise_marginals` has no such loss.
    """
    return _in_the_world(gtsam.Marginals(graph, values_of(poses, landmarks)), poses, landmarks)


def precise_marginals(graph, poses, landmarks):
    """Covariances as by `batch_marginals`, but the derivative of the logarithm is summed as a series."""
    values = values_of(poses, landmarks)
    linear, precise, motions = graph.linearize(values), gtsam.GaussianFactorGraph(), []
    for i in range(graph.size()):
        factor = graph.at(i)
        if isinstance(factor, gtsam.BetweenFactorPose2):
            k = gtsam.Symbol(factor.keys()[0]).index()
            motion = gtsam.Pose2(*poses[k]).between(gtsam.Pose2(*poses[k + 1]))
            motions.append((k, factor.measured(), motion, factor.noiseModel().sigmas()))
        else:
            precise.push_back(linear.at(i))
    errors = [measured.between(motion) for _, measured, motion, _ in motions]
    for (k, _, motion, sigmas), block in zip(motions, derivative_of_logarithm(errors), strict=True):
        of_to = block / sigmas[:, None]
        of_from = -of_to @ motion.inverse().AdjointMap()
        unit = gtsam.noiseModel.Unit.Create(3)
        precise.push_back(gtsam.JacobianFactor(X(k), of_from, X(k + 1), of_to, np.zeros(3), unit))
    return _in_the_world(gtsam.Marginals(precise, values), poses, landmarks)


def derivative_of_logarithm(errors):
    """(∫₀¹ exp(−s ad ξ) ds)⁻¹ = (Σ (−ad ξ)ᵏ / (k + 1)!)⁻¹ at ξ = Log(error), shape (K, 3, 3)."""
    if not errors:
        return np.empty((0, 3, 3))
    x, y, w = np.array([(error.x(), error.y(), error.theta()) for error in errors]).T
    half = np.sinc(0.5 * w / np.pi)
    a, b = np.sinc(w / np.pi), np.sin(0.5 * w) * half  # the translation is [a −b; b a] (u, v)
    u, v = (a * x + b * y) / (a * a + b * b), (a * y - b * x) / (a * a + b * b)
    minus_ad = np.zeros((len(errors), 3, 3))
    minus_ad[:, 0, 1], minus_ad[:, 0, 2], minus_ad[:, 1, 0], minus_ad[:, 1, 2] = w, -v, -w, u
    term = total = np.tile(np.eye(3), (len(errors), 1, 1))
    for k in range(1, 40):
        term = term @ minus_ad / (k + 1)
        total = total + term
    return np.linalg.inv(total)


def _in_the_world(marginals, poses, landmarks):
    of_poses = np.empty((len(poses), 3, 3))
    for k, (_, _, heading) in enumerate(poses):
        turn = np.eye(3)
        turn[:2, :2] = [[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]]
        of_poses[k] = turn @ marginals.marginalCovariance(X(k)) @ turn.T
    of_landmarks = [marginals.marginalCovariance(L(m)) for m in range(len(landmarks))]
    return of_poses, np.array(of_landmarks).reshape(-1, 2, 2)


def worst_difference(found, expected):
    """Largest difference of two stacks of blocks, relative to the largest entry of its block."""
    assert found.shape == expected.shape
    if not len(expected):
        return 0.0
    return float((np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))).max())


@dataclass
class RandomGraph:
    """A random drive: estimates that need not be near what was measured."""

    scenario: Scenario
    commands: list[tuple[float, float]]
    seen: list[list[int]]
    poses: np.ndarray
    landmarks: np.ndarray
    graph: gtsam.NonlinearFactorGraph

    def marginals(self):
        return batch_marginals(self.graph, self.poses, self.landmarks)


def moved(pose, command):
    """Pose after a command carried out without noise."""
    turn, forward = command
    x, y, heading = pose
    return (x + forward * math.cos(heading), y + forward * math.sin(heading), heading + turn)


def random_commands(rng, count, turn_share):
    turns = rng.uniform(size=count) < turn_share
    return [
        (float(rng.uniform(-np.pi, np.pi)), 0.0) if turn else (0.0, float(rng.uniform(0.05, 0.5))) for turn in turns
    ]


def perturbations(rng, count, spread):
    """Random (x, y, heading) of size `spread`, shape (count, 3), the first zero.

    Consecutive headings differ by 0.02 rad or more: at residuals between 1e-5 and 1e-3 rad gtsam's own derivative
    of the logarithm loses its digits.
    """
    rows = np.zeros((count, 3))
    for k in range(1, count if spread else 0):
        rows[k] = rng.normal(0.0, spread, 3)
        while abs(rows[k, 2] - rows[k - 1, 2]) < 0.02:
            rows[k, 2] = rng.normal(0.0, spread)
    return rows


def random_graph(seed, poses, landmarks, *, turn_share=0.3, sight_share=0.3, spread=0.2, **constants):
    """Random commands and sightings, with estimates `spread` [m, rad] off what the commands say."""
    rng = np.random.default_rng(seed)
    scenario = Scenario(**{"landmark_count": landmarks, **PINNED, **constants})
    commands = random_commands(rng, poses - 1, turn_share)
    trajectory = [tuple(rng.uniform((5.0, 5.0, -np.pi), (15.0, 15.0, np.pi)))]
    for command in commands:
        trajectory.append(moved(trajectory[-1], command))
    estimates = np.array(trajectory) + perturbations(rng, poses, spread)
    estimates[:, 2] = np.arctan2(np.sin(estimates[:, 2]), np.cos(estimates[:, 2]))
    points = rng.uniform(4.0, 16.0, (landmarks, 2))
    numbers, seen, sightings = {}, [], []
    for k in range(poses):
        seen.append([])
        for m in rng.permutation(landmarks).tolist():
            dx, dy = points[m] - estimates[k, :2]
            if rng.uniform() < sight_share and math.hypot(dx, dy) > 0.5:
                number = numbers.setdefault(m, len(numbers))
                bearing = math.atan2(dy, dx) - estimates[k, 2] + rng.normal(0.0, spread)
                seen[-1].append(number)
                sightings.append((k, number, bearing, math.hypot(dx, dy) * (1.0 + 0.5 * spread)))
    return RandomGraph(
        scenario=scenario,
        commands=commands,
        seen=seen,
        poses=estimates,
        landmarks=np.ascontiguousarray(points[list(numbers)]).reshape(-1, 2),
        graph=batch_graph(scenario, trajectory[0], commands, sightings),
    )


def no_sighting(patch_side=7):
    """Scan of open ground without a landmark, taken in the middle of its patch."""
    middle = float(patch_side)  # cells are 2 m
    return scan_of([], patch=np.zeros((patch_side, patch_side), dtype=np.uint8), origin=(middle, middle))


def scan_of(sightings, patch=None, origin=(7.0, 7.0), heading=0.0):
    """Scan with sightings (id, bearing, range)."""
    cells = np.zeros((7, 7), dtype=np.uint8) if patch is None else patch
    return Scan(sightings_of(sightings), Patch(cells, origin, heading))


def sightings_of(rows):
    """Sightings (id, bearing, range)."""
    table = np.array(rows, dtype=float).reshape(-1, 3)
    return Sightings(table[:, 0].astype(np.int64), table[:, 1].copy(), table[:, 2].copy())


@dataclass
class SmallDrive:
    """A simulated drive through random waypoints, with all that went into the smoother."""

    scenario: Scenario
    world: LandmarkWorld
    smoother: Smoother
    robot: Robot
    sensor: Sensor
    rng: np.random.Generator
    commands: list[tuple[float, float]] = field(default_factory=list)
    scans: list[Scan] = field(default_factory=list)
    waypoint: tuple[float, float] | None = None

    def start(self):
        self.scans.append(self.sensor.scan(self.robot.pose))
        self.smoother.update(None, self.scans[-1])

    def step(self):
        """Drive one step towards the present waypoint, drawing a new one when it is reached."""
        driver = Driver.of(self.scenario)
        command = driver.command(self.smoother.pose, self.waypoint) if self.waypoint else None
        while command is None:
            x, y = self.rng.uniform(1.0, self.scenario.size - 1.0, 2).tolist()
            self.waypoint = (x, y)
            command = driver.command(self.smoother.pose, self.waypoint)
        self.carry_out(command)

    def carry_out(self, command):
        odometry = self.robot.move(command)
        self.commands.append(command)
        self.scans.append(self.sensor.scan(self.robot.pose))
        self.smoother.update(odometry, self.scans[-1])

    def sightings(self):
        """Rows (pose, landmark, bearing, range) of all scans, landmarks numbered by first sighting."""
        numbers, rows = {}, []
        for k, seen in enumerate(scan.sightings for scan in self.scans):
            for name, bearing, distance in zip(
                *(column.tolist() for column in (seen.landmarks, seen.bearings, seen.ranges)), strict=True
            ):
                rows.append((k, numbers.setdefault(name, len(numbers)), bearing, distance))
        return rows

    def graph(self):
        return batch_graph(self.scenario, self.world.start, self.commands, self.sightings())

    def patches(self):
        """Patches and origins of all scans, as the maps take them."""
        return (
            np.array([scan.view.cells for scan in self.scans]),
            np.array([(*scan.view.origin, scan.view.heading) for scan in self.scans]),
        )


def small_drive(seed, steps=0, *, world=None, **constants):
    """Start a drive in a random world (or a given one) and take some steps."""
    scenario = Scenario(**{**PINNED, **constants})
    rng = np.random.default_rng(seed)
    world = draw_world(scenario, rng) if world is None else world
    drive = SmallDrive(
        scenario=scenario,
        world=world,
        smoother=Smoother(scenario, world.start),
        robot=Robot(scenario, world, rng),
        sensor=Sensor(scenario, world, rng),
        rng=rng,
    )
    drive.start()
    for _ in range(steps):
        drive.step()
    return drive


def snapshot(value):
    """Copies of every array of a frozen dataclass by its name, those of nested ones too."""
    arrays = {}
    for name in value.__dataclass_fields__:
        part = getattr(value, name)
        if isinstance(part, np.ndarray):
            arrays[name] = part.copy()
        elif hasattr(part, "__dataclass_fields__"):
            arrays.update({f"{name}.{inner}": array for inner, array in snapshot(part).items()})
    return arrays


def arrays_of(value):
    """Every array of a frozen dataclass itself, by its name."""
    arrays = {}
    for name in value.__dataclass_fields__:
        part = getattr(value, name)
        if isinstance(part, np.ndarray):
            arrays[name] = part
        elif hasattr(part, "__dataclass_fields__"):
            arrays.update({f"{name}.{inner}": array for inner, array in arrays_of(part).items()})
    return arrays
