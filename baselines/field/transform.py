"""The exploration transform: the cheapest way to any frontier where being near an obstacle costs.

S. Wirth, J. Pellenz, "Exploration transform: a stable exploring algorithm for robots in rescue environments", 2007; as
hector_exploration_planner and MapEx compute it. The transform is spread from all frontiers at once, and the robot
descends it; the frontier at the end of the descent is the one whose way from the robot is the cheapest, and so it is
found by one search from the robot.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from baselines.field.believed import costs, finest_map, stands
from baselines.field.constants import above, at_least
from baselines.field.scores import best
from explore_bench import Observation


class ExplorationTransform:
    """Chooses the candidate with the cheapest way: a metre at d from an obstacle costs 1 + danger · (margin − d)^power.

    Hector (`cellDanger`, defaults of its configuration): 0.5 (1000 − 100 d)² a step of 100, d in cells, within 10
    cells; with cells of 5 cm that is danger 20,000 /m², margin 0.5 m, power 2. MapEx (explore.py): a step costs 5 · (15
    − d) more, d in cells of 0.1 m: danger 50 /m, margin 1.5 m, power 1.

    Converted: a step costs its length times the mean of both its cells; the whole drive is a decision, and the robot's
    own planner, which also keeps away from walls, drives it. On 2 m cells no cell lies within the margin of an
    obstacle, and the rule is the nearest frontier: lidar worlds only. Control: danger 0.

    Parameters
    ----------
    danger : [1/m^power].
    margin : distance from obstacles from which on there is no danger [m].
    power : of the missing distance.
    """

    def __init__(self, danger: float = 20_000.0, margin: float = 0.5, power: float = 2.0) -> None:
        self.danger = at_least(0.0, danger, "danger of the exploration transform")
        self.margin = above(0.0, margin, "margin of the exploration transform", "metres")
        self.power = above(0.0, power, "power of the exploration transform")

    def reset(self, rng: np.random.Generator) -> None:
        """Begin a trial; there is nothing to draw."""

    def choose(self, observation: Observation) -> int:
        """Return the index of the candidate at the cheapest way's end."""
        map_ = finest_map(observation)
        edge = map_.grid.resolution
        clearance = ndimage.distance_transform_edt(~map_.occupied) * edge if map_.occupied.any() else np.inf
        missing = np.maximum(self.margin - clearance, 0.0)
        price = np.full(map_.grid.shape, edge) * (1.0 + self.danger * missing**self.power)
        return best(-costs(observation, price, stands(observation)), observation.path_lengths)
