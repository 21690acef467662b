"""Lidar worlds drawn by hand, scans taken in them, and rollouts played there; nothing here is a test."""

import itertools
import math

import numpy as np

from explore_bench.geometry import Grid, between, compose
from explore_bench.geometry.rays import cast, leaps
from explore_bench.robot.lidar.matcher import surfaces_of
from explore_bench.robot.lidar.odometry import OdometryModel
from explore_bench.robot.lidar.slam import KEY_DISTANCE, Slam
from explore_bench.strategies.contract import Observation
from explore_bench.trial.loop import rollout
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.lidar.world import LidarWorld
from explore_bench.world.signals import RangeScan

RESOLUTION = 0.05
SMALL = LidarScenario(size=8.0, sensor_range=4.0)
"""A scenario whose trials take a tenth of a second."""


def drawn(size, *boxes, free=None, start=(1.0, 1.0, 0.0), counted=None):
    """World of `size` m with walls (x0, x1, y0, y1) [m] in it and a wall of 0.1 m around.

    Where `free` is given, everything is wall but these boxes. What is free counts, unless boxes are given that do.
    """
    edge = round(size / RESOLUTION)
    solid = _filled(edge, free) if free is None else ~_filled(edge, free)
    solid |= _filled(edge, boxes)
    solid[:2] = solid[-2:] = solid[:, :2] = solid[:, -2:] = True
    return LidarWorld(
        Grid(edge, edge, RESOLUTION), solid, ~solid if counted is None else _filled(edge, counted) & ~solid, start
    )


def _filled(edge, boxes):
    cells = np.zeros((edge, edge), dtype=bool)
    for x0, x1, y0, y1 in boxes or ():
        cells[round(y0 / RESOLUTION) : round(y1 / RESOLUTION), round(x0 / RESOLUTION) : round(x1 / RESOLUTION)] = True
    return cells


def cluttered(size=10.0, blocks=10, seed=0, clear=()):
    """World with blocks at random places, none within 0.7 m of the places that are to stay clear, shape (K, 2)."""
    rng = np.random.default_rng(seed)
    boxes = []
    while len(boxes) < blocks:
        (x, y), (w, h) = rng.uniform(0.3, size - 1.3, 2), rng.uniform(0.2, 1.0, 2)
        aside = [math.hypot(max(x - a, 0.0, a - x - w), max(y - b, 0.0, b - y - h)) for a, b in clear]
        if min(aside, default=1.0) > 0.7:
            boxes.append((x, x + w, y, y + h))
    return drawn(size, *boxes)


def ranges_at(world, pose, beams=360, reach=10.0, sigma=0.0, rng=None):
    """Ranges that a lidar in a world returns, shape (beams,)."""
    exact = cast(pose, beams, reach, world.obstacles, leaps(world.obstacles, world.grid), world.grid)
    return exact if rng is None else exact + sigma * rng.standard_normal(beams)


def surfaces_at(world, pose, reach=10.0, sigma=0.0, rng=None):
    return surfaces_of(ranges_at(world, pose, 360, reach, sigma, rng), reach)


def way_through(*places):
    """Poses half a metre apart on straight lines through places, heading along them; turned in place at each."""
    poses = []
    for (x0, y0), (x1, y1) in itertools.pairwise(places):
        heading = math.atan2(y1 - y0, x1 - x0)
        pieces = max(round(math.hypot(x1 - x0, y1 - y0) / KEY_DISTANCE), 1)
        poses += [(x0 + (x1 - x0) * k / pieces, y0 + (y1 - y0) * k / pieces, heading) for k in range(pieces)]
    return [*poses, (*places[-1], poses[-1][2])]


def driven(world, poses, scenario, seed=0, bias=0.0):
    """SLAM of a robot that was at these true poses; and each step's shift.

    Odometry errs as the scenario has it, or by this scale error alone.
    """
    rng = np.random.default_rng(seed)
    drawn_scales = rng.uniform(-0.5, 0.5, 3) * (scenario.odometry_bias, scenario.odometry_bias, scenario.heading_bias)
    scales = 1.0 + (drawn_scales if bias == 0.0 else bias)
    sense = (scenario.beams, scenario.sensor_range, scenario.range_sigma, rng)
    slam = Slam(scenario, poses[0], RangeScan(ranges_at(world, poses[0], *sense)))
    shifts = []
    for last, pose in itertools.pairwise(poses):
        true = between(last, pose)
        length, turned = math.hypot(*true[:2]), abs(true[2])
        white = np.sqrt(OdometryModel.of(scenario).white_noise(length, turned)) if bias == 0.0 else np.zeros(3)
        x, y, turn = np.array(true) * scales + white * rng.standard_normal(3)
        motion = (float(x), float(y), float(turn))
        shifts.append(slam.update(motion, length, turned, RangeScan(ranges_at(world, pose, *sense))))
    return slam, shifts


def errors_of(slam, poses):
    """Distance of each estimated key pose from the true one [m], shape (N,)."""
    return np.hypot(*(slam.poses - np.array(poses))[:, :2].T)


def followed(start, motions):
    """Poses that motions lead to, shape (K + 1, 3)."""
    poses = [start]
    for motion in motions:
        poses.append(compose(poses[-1], motion))
    return np.array(poses)


def nearest(observation):
    return int(observation.path_lengths.argmin())


def begin(scenario, trial=0, world=None, purpose="calibrate"):
    spec = TrialSpec("none", "none:none", scenario, trial, purpose=purpose)
    world = world or draw_world(scenario, spec.generator("world"))
    return rollout(scenario, world, spec.generator("motion"), spec.generator("sensor"))


def play(scenario, choose=nearest, trial=0, world=None, purpose="calibrate"):
    """Play to the end; returns the rows, the observations and the Ending."""
    events, rows, seen, choice = begin(scenario, trial, world, purpose), [], [], None
    while True:
        try:
            event = events.send(choice)
        except StopIteration as stop:
            return rows, seen, stop.value
        choice = None
        if isinstance(event, Step):
            rows.append(event)
        else:
            assert isinstance(event, Observation)
            seen.append(event)
            choice = choose(event)


LOOPING, LOOPING_TRIAL = SMALL.replace(size=12.0, sensor_range=3.0), 1
"""A range so short that walls come into sight anew after a while; of its calibration worlds this closes a loop."""
