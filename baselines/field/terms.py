"""The terms of which rules make what a candidate is worth: each a number a candidate, shape (C,), written once.

Lengths are metres and areas m², whatever the edge of a cell, so that constants of the originals carry over.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from baselines.field.believed import costs, finest_map, lengths_from, stands
from baselines.field.views import expected_reach, unknown_in_view
from explore_bench import Array, Observation, cells_within, room_within, shannon_entropy

BLUR = 0.2
"""Standard deviation [m] of the Gaussian that spreads walls over the map of `traversal` (ours)."""


def drive(observation: Observation) -> Array:
    """Length of the drive to it [m]."""
    return observation.path_lengths


def straight(observation: Observation) -> Array:
    """Straight distance from the robot [m]."""
    return np.asarray(np.hypot(*(observation.positions - observation.pose[:2]).T))


def turn(observation: Observation) -> Array:
    """(1 − cos Δθ) / 2, Δθ the angle between the robot's heading and the straight line there: 0 ahead, 1 behind."""
    x, y, heading = observation.pose
    angles = np.arctan2(observation.positions[:, 1] - y, observation.positions[:, 0] - x)
    return np.asarray((1.0 - np.cos(angles - heading)) / 2.0)


def area(observation: Observation) -> Array:
    """Unknown area in view from it on the believed map [m²]; walls hide, unknown cells do not."""
    return unknown_area(observation, observation.positions)


def unknown_area(observation: Observation, places: Array) -> Array:
    """The same from any places [m], shape (K, 2); gives (K,)."""
    edge = finest_map(observation).grid.resolution
    return np.asarray(unknown_in_view(observation, places).sum(axis=1) * edge**2)


def area_within(observation: Observation, radius: float) -> Array:
    """Unknown area within a radius [m] of it, walls or not [m²]."""
    map_ = finest_map(observation)
    unknown = ~map_.known.reshape(-1)
    cells, ways = room_within(map_.grid, radius)
    found = np.empty(len(observation.positions))
    for i, (x, y) in enumerate(observation.positions.tolist()):
        count = cells_within(map_.grid, x, y, radius, cells, ways)
        found[i] = unknown[cells[:count]].sum() * map_.grid.resolution**2
    return found


def entropy_reduction(observation: Observation, places: Array, prior: float) -> Array:
    """Expected reduction of the map's entropy by one scan from each of some places [m], shape (K, 2) [bit]; (K,).

    On a map of scans, whose known cells are certain, it is Σ P(a ray reaches the cell) · H(`prior`) over unknown cells.
    On the grid of decisions each cell in range is observed on its own, through the sensor model of the occupancy (hit
    and miss), so it is the sum of the exact mutual informations of cell and observation.
    """
    scenario = observation.scenario
    if observation.belief.fine is not None:
        chances = expected_reach(observation, places, prior)
        return np.asarray(chances.sum(axis=1) * float(shannon_entropy(np.array([prior]))[0]))
    occupancy = observation.belief.occupancy.reshape(-1)
    each = mutual_information(occupancy, scenario.hit, scenario.miss)
    return np.asarray(observation.belief.view(places) @ each)


def mutual_information(occupancy: Array, hit: float, miss: float) -> Array:
    """Mutual information of a cell's state and one observation of it [bit], shape as given.

    `hit` and `miss` are the inverse model's: P(occupied) after an observation that says so, or that says free, from
    1/2. They fix the forward model: its likelihood ratios are hit / (1 − hit) and miss / (1 − miss).
    """
    says, denies = hit / (1.0 - hit), miss / (1.0 - miss)
    of_free = (1.0 - denies) / (says - denies)
    of_occupied = says * of_free
    seen = occupancy * of_occupied + (1.0 - occupancy) * of_free
    noise = occupancy * shannon_entropy(np.array([of_occupied])) + (1.0 - occupancy) * shannon_entropy(
        np.array([of_free])
    )
    return np.asarray(shannon_entropy(seen) - noise)


def remoteness(observation: Observation, reach: float) -> Array:
    """Mean length of the drives from it to the free cells within `reach` [m] of the robot (Chebyshev's distance) [m].

    Cells that cannot be reached from the robot do not count.
    """
    roads, reachable = observation.roads, observation.reachable
    centres = roads.grid.centres(reachable.cells)
    near = reachable.cells[np.abs(centres - observation.pose[:2]).max(axis=1) < reach]
    if not len(near):
        return np.zeros(len(observation.candidates))
    return np.asarray(lengths_from(observation, stands(observation))[:, near].mean(axis=1))


def traversal(observation: Observation) -> Array:
    """Cost of the cheapest drive to it where a step costs its length [m] times the probability of an obstacle.

    On a map of scans, whose cells are free, unknown or walls, a Gaussian of `BLUR` spreads the walls first.
    """
    belief, grid = observation.belief, observation.roads.grid
    occupancy = belief.occupancy
    if belief.fine is not None:
        clamp = belief.scenario.occupancy_clamp
        certain = np.where(belief.fine.occupied, 1.0 - clamp, clamp)
        occupancy = ndimage.gaussian_filter(np.where(belief.fine.known, certain, 0.5), BLUR / grid.resolution)
    return costs(observation, occupancy * grid.resolution, stands(observation))


def localizability(observation: Observation) -> Array:
    """Trace of the robot's pose covariance that is predicted there [m² + rad²]; less is better."""
    predict = observation.belief.predict
    return np.array([np.trace(predict(path).pose_covariances[-1]) for path in observation.paths])


def pose_entropy(covariances: Array) -> float:
    """Differential entropy of Gaussian poses, the mean over them [nat], of covariances of shape (N, 3, 3)."""
    _, logarithms = np.linalg.slogdet(covariances)
    return float(1.5 * math.log(2.0 * math.pi * math.e) + 0.5 * logarithms.mean())
