"""What passes between the truth and the robot: the values of a patch."""

import numpy as np
import pytest

from explore_bench.robot.occupancy import look_up
from explore_bench.world.signals import Odometry


def test_an_odometry_is_frozen():
    with pytest.raises(AttributeError):
        Odometry((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)).motion = (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("u", "v", "value"), [(0.0, 0.0, 0), (0.49, 0.51, 3), (1.2, 0.4, 2), (1.5, 0.0, 2), (1.5, 1.5, 8), (0.6, 1.5, 7)]
)
def test_a_point_looks_up_its_cell_and_the_far_edge_the_last_one(u, v, value):
    """Cells of half a metre, 3 × 3 of them, rows along v."""
    assert look_up(np.arange(9, dtype=np.uint8).reshape(3, 3), u, v, 0.5) == value
