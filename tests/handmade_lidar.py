"""Records of lidar trials that several test modules share; nothing here is a test."""

from __future__ import annotations

import dataclasses

import numpy as np
from handmade import record, with_spec
from lidar_worlds import SMALL, drawn

from explore_bench.trial.snapshot import FREE, OCCUPIED, UNKNOWN


def lidar_record(status="explored", scenario=SMALL, world=None, fine_map=None, name="stage", **columns):
    """Return a record of a lidar trial as `handmade.record` makes them, in a world drawn by hand."""
    made = record(status, scenario, **columns)
    world = world or drawn(scenario.size, start=(1.0, 1.0, 0.0))
    return with_spec(dataclasses.replace(made, world=world, fine_map=fine_map), scenario_name=name)


def perfect_map(world, scenario=SMALL, right=True):
    """Return the map of a robot that knows all that counts and the walls around it; all unknown where not `right`."""
    share = round(scenario.map_resolution / scenario.resolution)
    grid = scenario.map_grid

    def any_of(cells):
        return cells.reshape(grid.rows, share, grid.columns, share).any(axis=(1, 3))

    cells = np.full(grid.shape, UNKNOWN, dtype=np.uint8)
    if right:
        cells[any_of(world.counted)] = FREE
        cells[any_of(world.walls)] = OCCUPIED
    return cells
