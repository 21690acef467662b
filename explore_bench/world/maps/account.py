"""What was understood of a map, in sentences for the person whose map it is."""

from __future__ import annotations

import math

import numpy as np
from scipy import ndimage

from explore_bench.world.kinds import World
from explore_bench.world.maps import GivenMap
from explore_bench.world.maps.passages import ENOUGH, finer, kept_by, narrow_for, outdoors, within_reach
from explore_bench.world.maps.raster import FREE_PIXEL, OCCUPIED_PIXEL
from explore_bench.world.scenario import Scenario

MANY_OUTDOORS = 0.1
"""Share of the open floor without walls around from which on it is told."""

MUCH_AT_ONCE = 0.5
"""Share of what counts that is in range of the start from which on it is told."""


def account(given: GivenMap, world: World) -> list[str]:
    """Sentences on a map: its pixels, what the robot can reach of it, and what a person may want to change.

    Parameters
    ----------
    world : any world of the scenario in that map; all of them have its walls.
    """
    scenario, raster = given.scenario, given.raster
    height, width = raster.pixels.shape
    shares = [np.mean(raster.pixels == kind) for kind in (FREE_PIXEL, OCCUPIED_PIXEL)]
    free, occupied, unknown = map(_percent, (*shares, 1.0 - sum(shares)))
    told = [
        f"{width} × {height} pixels of {raster.resolution:g} m, {width * raster.resolution:g} × "
        f"{height * raster.resolution:g} m: {free} free, {occupied} occupied, {unknown} unknown",
        *raster.notes,
    ]
    told += _in_cells(given, world) if scenario.plan_cell == "cell_size" else _in_pixels(given, world)
    if outdoors(raster) >= MANY_OUTDOORS:
        told.append(
            f"{_percent(outdoors(raster))} of its open floor is outdoors, with no wall in one of the four "
            "directions, and is explored, too, where a door leads there; paint it grey (205) to leave it out"
        )
    return told


def _in_cells(given: GivenMap, world: World) -> list[str]:
    """Sentences on a map whose cells are those of the decisions."""
    scenario, raster = given.scenario, given.raster
    size, rows, most = scenario.cell_size, scenario.map or (), scenario.most_plan_cells
    share = within_reach(raster, rows, size)
    usual = float(type(scenario).model_fields["cell_size"].default)
    coarse = ""
    if size < usual and raster.resolution < usual:
        coarse = f" (cells of {usual:g} m would leave {_percent(kept_by(raster, usual, most))})"
    walls = "" if getattr(scenario, "occlusion", True) else ", through walls (occlusion = false)"
    told = [
        f"cells of {size:g} m, {max(map(len, rows))} × {len(rows)} of them: {_percent(share)} of its open floor "
        f"can be reached{coarse}",
        f"the robot sees {scenario.sensor_range:g} m far{walls}",
    ]
    seen = _seen_at_once(scenario, world)
    if walls and seen >= MUCH_AT_ONCE:
        told.append(
            f"that is {_percent(seen)} of it at once, from the start of world 0; a smaller sensor_range or occlusion = "
            "true in a scenario file leaves more to explore"
        )
    better = next((one for one in finer(raster, size) if kept_by(raster, one, most) >= ENOUGH), None)
    if share < ENOUGH and better is not None:
        told.append(f"cells of {size:g} m close passages; --cell-size {better:g} keeps them open")
    if raster.resolution < size and narrow_for(raster, size):
        told.append(
            "its passages are narrower than two cells; add --scenario stage for a robot with a lidar that takes the "
            "map in pixels"
        )
    return told


def _in_pixels(given: GivenMap, world: World) -> list[str]:
    """Sentences on a map that keeps its pixels, in which a robot needs room."""
    scenario, raster = given.scenario, given.raster
    free = float(np.count_nonzero(raster.pixels == FREE_PIXEL)) * raster.resolution**2
    radius, passage = (float(getattr(scenario, name)) for name in ("robot_radius", "passage"))
    steps = math.ceil(passage / world.grid.resolution)  # corners of a room belong to it, though they do not count
    reached = ndimage.binary_dilation(world.counted & ~world.obstacles, iterations=steps, mask=~world.obstacles)
    share = min(float(np.count_nonzero(reached)) * world.grid.resolution**2 / free, 1.0)
    told = [
        f"a robot of {radius:g} m that wants {passage:g} m to either side reaches {_percent(share)} of the "
        f"free {free:.0f} m²",
        f"its lidar sees {scenario.sensor_range:g} m far",
    ]
    if share < ENOUGH:
        told.append(
            f"what lies behind a passage of less than {2 * passage:g} m does not count; with a smaller "
            "robot_radius and passage in a scenario file it does"
        )
    return told


def _seen_at_once(scenario: Scenario, world: World) -> float:
    """Share of what counts in range of a world's start, as if nothing hid it."""
    away = np.hypot(*(world.grid.centres(np.flatnonzero(world.counted)) - world.start[:2]).T)
    return float(np.mean(away <= scenario.sensor_range))


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"
