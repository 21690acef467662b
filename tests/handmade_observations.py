"""Observations drawn by hand, in both kinds of world; nothing here is a test.

A drawing is rows of characters, north first: `.` known free, `#` known and occupied, `?` unknown, `R` the robot, and a
letter for each candidate, which lies on known free ground.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from explore_bench.geometry import Grid
from explore_bench.robot.belief import Belief, FineMap
from explore_bench.robot.planning.roads import Roads
from explore_bench.strategies.contract import Observation
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.lidar.constants import LidarScenario


class Expected:
    """A graph behind a belief: what is in range is in view, and a drive leads through the middles of its cells.

    `variances` are those of the pose at the end of a drive, by the cell where it ends.
    """

    def __init__(self, variances=None, closures=()):
        self.variances = variances or {}
        self.closures = np.array(closures, dtype=np.int64).reshape(-1, 2)

    def view(self, scenario, places):
        return scenario.grid.in_reach(places, scenario.sensor_range)

    def predict(self, belief, places):
        grid = belief.scenario.grid
        variance = self.variances.get(grid.cell_of(*places[-1]), 0.01)
        poses = np.column_stack((places, np.zeros(len(places))))
        new = np.tile(variance * np.eye(3), (len(poses), 1, 1))
        return SimpleNamespace(poses=poses, pose_covariances=np.concatenate((belief.pose_covariances, new)))


def letters_of(rows):
    """Candidates by letter in the ascending order of their cells."""
    drawn = np.array([list(row) for row in rows[::-1]])
    return [letter for letter in drawn.reshape(-1).tolist() if letter.islower()]


def in_landmark_world(rows, heading=0.0, reach=5.0, occupancy=None, variances=None, landmarks=(), poses=None):
    """Return an observation on cells of 2 m.

    `occupancy` is that of some places by the drawing's characters, `variances` of predicted poses by letters.
    """
    drawn = np.array([list(row) for row in rows[::-1]])
    scenario = LandmarkScenario(size=2.0 * len(drawn), landmark_count=0, obstacle_count=0, sensor_range=reach)
    known, occupied = drawn != "?", drawn == "#"
    values = np.where(known, np.where(occupied, 0.95, 0.05), 0.5)
    for character, probability in (occupancy or {}).items():
        values[drawn == character] = probability
    cells = np.flatnonzero(np.char.islower(drawn).reshape(-1))
    by_letter = dict(zip(letters_of(rows), cells.tolist(), strict=True))
    graph = Expected({by_letter[letter]: value for letter, value in (variances or {}).items()})
    belief = belief_of(scenario, drawn, scenario.grid, heading, values, known, graph, poses, landmarks)
    roads = Roads(scenario.grid, known & ~occupied, int(np.flatnonzero(drawn.reshape(-1) == "R")[0]))
    return observation_of(belief, roads, cells, scenario.grid.centres(cells), [roads.path_to(c) for c in cells])


def in_lidar_world(rows, heading=0.0, reach=4.0, edge=0.5, poses=None, closures=()):
    """Return an observation on a map whose cells have this edge [m]; four of 0.5 m make a cell of the decision grid."""
    drawn = np.array([list(row) for row in rows[::-1]])
    scenario = LidarScenario(
        size=edge * len(drawn), sensor_range=reach, resolution=edge, map_resolution=edge, passage=0.7
    )
    fine = FineMap(scenario.map_grid, drawn != "?", drawn == "#")
    share = round(scenario.cell_size / edge)
    known = fine.known.reshape(scenario.edge, share, scenario.edge, share).mean(axis=(1, 3)) >= 0.5
    values = np.where(known, 0.05, 0.5)
    belief = belief_of(scenario, drawn, fine.grid, heading, values, known, Expected(closures=closures), poses, (), fine)
    roads = Roads(fine.grid, fine.known & ~fine.occupied, int(np.flatnonzero(drawn.reshape(-1) == "R")[0]))
    cells = np.flatnonzero(np.char.islower(drawn).reshape(-1))
    places = fine.grid.centres(cells)
    own = np.array([scenario.grid.cell_of(x, y) for x, y in places.tolist()])
    start = scenario.grid.cell_of(*belief.pose[:2])
    return observation_of(belief, roads, own, places, [np.array([start, cell]) for cell in own], cells)


def belief_of(scenario, drawn, grid: Grid, heading, values, known, graph, poses, landmarks, fine=None):
    x, y = grid.centre_of(int(np.flatnonzero(drawn.reshape(-1) == "R")[0]))
    trajectory = np.array([*(poses or ()), (x, y, heading)])
    places = np.array(landmarks, dtype=float).reshape(-1, 2)
    return Belief(
        scenario=scenario,
        poses=trajectory,
        pose_covariances=np.tile(0.01 * np.eye(3), (len(trajectory), 1, 1)),
        landmarks=places,
        landmark_covariances=np.tile(0.01 * np.eye(2), (len(places), 1, 1)),
        landmark_ids=np.arange(len(places)),
        occupancy=values,
        known=known,
        virtual_map=np.zeros((*scenario.grid.shape, 3)),
        uncertainty=1.0,
        peak_trace=1.0,
        graph=graph,
        fine=fine,
    )


def observation_of(belief, roads, candidates, positions, paths, ends=None):
    return Observation(
        belief=belief,
        step=len(belief.poses) - 1,
        decision=0,
        candidates=candidates,
        positions=positions,
        paths=tuple(paths),
        path_lengths=roads.lengths_to(candidates if ends is None else ends),
        roads=roads,
    )
