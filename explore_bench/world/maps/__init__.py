"""Maps of others as rows of text for `Scenario.map`: ROS map_server pairs, images, arrays, text, and a gallery.

Every reader gives a `Raster` of free, occupied and unknown pixels; `raster.cells_of` brings it to the cell size, and
`passages` looks what is left of it then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from explore_bench.errors import RequestError, one_line
from explore_bench.world.floor_plan import FREE, START, floor_plan
from explore_bench.world.maps.arrays import read_array
from explore_bench.world.maps.images import SUFFIXES as IMAGES, read_image
from explore_bench.world.maps.passages import ENOUGH, finer, kept_by
from explore_bench.world.maps.raster import FREE_PIXEL, RESOLUTIONS, Raster, cells_of
from explore_bench.world.maps.ros import read_ros
from explore_bench.world.maps.text import raster_of, read_text
from explore_bench.world.scenario import Scenario

GALLERY = Path(__file__).parent / "gallery"

_READERS = dict.fromkeys(IMAGES, read_image) | {".npy": read_array, ".txt": read_text}
_ROS = (".yaml", ".yml")

_WITH_CELLS = {"path_tolerance": 0.5, "arrival_radius": 0.4}
"""Most cells that constants of landmark worlds are: a tolerance of half a cell, and waypoints that lie in their own."""


@dataclass(frozen=True)
class GivenMap:
    """A map as it was read, and the scenario in its world.

    Attributes
    ----------
    name : as it was asked for.
    raster : its pixels.
    scenario : whose map is that.
    """

    name: str
    raster: Raster
    scenario: Scenario


def gallery() -> dict[str, tuple[str, ...]]:
    """Rows of the maps that come with the benchmark, by name."""
    return {path.stem: tuple(path.read_text(encoding="utf-8").splitlines()) for path in sorted(GALLERY.glob("*.txt"))}


def with_map(
    scenario: Scenario, name_or_file: str | Path, resolution: float | None = None, cell_size: float | None = None
) -> Scenario:
    """Scenario in the world of a map instead of drawn ones; see `read_map`."""
    return read_map(scenario, name_or_file, resolution, cell_size).scenario


def read_map(
    scenario: Scenario, name_or_file: str | Path, resolution: float | None = None, cell_size: float | None = None
) -> GivenMap:
    """Read a map, and take it for the world of a scenario instead of drawn ones.

    In a kind of world whose map has the cells of the decisions, a scenario that sets no cell size gets the largest of
    its usual one, a half and a quarter of it that keeps the passages of the map open (`passages.within_reach`).

    Parameters
    ----------
    name_or_file : a map of the gallery, or a file: .yaml of map_server, an image, .npy, .txt.
    resolution : edge of a pixel [m] where the file does not say; a pixel is a cell if it is not given.
    cell_size : edge of a cell [m] instead of the scenario's.

    Raises
    ------
    RequestError : for a file that is no map, a map in which nothing can be explored, or that no cell size keeps whole.
    """
    try:
        return _mapped(scenario, str(name_or_file), resolution, cell_size)
    except ValueError as error:
        reason = str(error).removeprefix("scenario: ").removesuffix(".")
        raise RequestError(f"map '{name_or_file}': {reason}.") from None


def drawn_map(scenario: Scenario) -> GivenMap:
    """Map that a scenario holds as rows, as if it had been read."""
    return GivenMap("of the scenario", raster_of(scenario.map or (), _plan_cell(scenario)), scenario)


def _mapped(scenario: Scenario, name: str, resolution: float | None, cell_size: float | None) -> GivenMap:
    low, high = RESOLUTIONS
    if resolution is not None and not low <= resolution <= high:
        raise ValueError(f"resolution is {resolution:g}; give the metres that a pixel is wide, {low:g} to {high:g}")
    own = gallery()
    if name in own:
        if resolution is not None:
            raise ValueError(
                f"resolution {resolution:g} is given, but a map of the gallery is made of cells; leave it out"
            )
        scenario = scenario if cell_size is None else _in_cells(scenario, cell_size)
        rows = _magnified(own[name], round(scenario.cell_size / _plan_cell(scenario)))
        return GivenMap(name, raster_of(rows, _plan_cell(scenario)), scenario.replace(map=rows))
    if cell_size is not None:
        scenario = _in_cells(scenario, cell_size)
    raster = _raster(Path(name), _plan_cell(scenario), resolution)
    try:
        return GivenMap(name, raster, _in_world_of(raster, scenario))
    except ValueError as error:
        if (raster.pixels == FREE_PIXEL).any():
            raise
        raise ValueError("; ".join((str(error).removesuffix("."), *raster.notes))) from None


def _in_world_of(raster: Raster, scenario: Scenario) -> Scenario:
    """Scenario whose map these pixels are."""
    if scenario.plan_cell == "cell_size" and raster.resolution < scenario.cell_size * (1 - 1e-9):
        scenario = _keeping_passages(scenario, raster)
    constants = scenario.for_pixels(raster.resolution)
    plan_cell = constants.get(scenario.plan_cell, _plan_cell(scenario))
    return scenario.replace(map=cells_of(raster, plan_cell, scenario.most_plan_cells), **constants)


def _in_cells(scenario: Scenario, cell_size: float) -> Scenario:
    """Scenario in cells of another edge [m], with what goes with them where it is not set."""
    if not 0 < cell_size < math.inf:
        raise ValueError(f"cell_size is {cell_size:g}; give the metres that a cell is wide")
    usual = {name: field.default for name, field in type(scenario).model_fields.items()}
    fitting = {
        name: min(usual[name], share * cell_size)
        for name, share in _WITH_CELLS.items()
        if name in usual and name not in scenario.model_fields_set
    }
    return scenario.replace(size=20 * cell_size, cell_size=cell_size, **fitting)


def _keeping_passages(scenario: Scenario, raster: Raster) -> Scenario:
    """Scenario with the largest cells that keep the passages of a map open, or with those that were set.

    Raises
    ------
    ValueError : where those that were set leave nothing to explore, or none keeps the passages open.
    """
    usual, most, chosen = scenario.cell_size, scenario.most_plan_cells, "cell_size" in scenario.model_fields_set
    own = kept_by(raster, usual, most)
    if own >= ENOUGH or (chosen and own > 0.0):
        return scenario
    shares = {size: kept_by(raster, size, most) for size in finer(raster, usual)}
    fit = next((size for size, share in shares.items() if share >= ENOUGH), None)
    if fit is not None and not chosen:
        return _in_cells(scenario, fit)
    rows = cells_of(raster, usual, most)  # what is wrong whatever the size is said first
    if not (raster.pixels == FREE_PIXEL).any():
        floor_plan(rows)
    lidar = "add --scenario stage, whose robot with a lidar takes it in pixels"
    if chosen:
        fix = f"set a cell size of {fit:g} m" if fit is not None else lidar
        raise ValueError(f"cells of {usual:g} m leave nothing of it to explore; {fix}")
    words = ", ".join(f"of {size:g} m {100 * share:.0f} %" for size, share in ({usual: own} | shares).items())
    raise ValueError(
        f"its passages close: in cells {words} of its open floor can be reached; {lidar}, or choose one of these with "
        "--cell-size"
    )


def _plan_cell(scenario: Scenario) -> float:
    return float(getattr(scenario, scenario.plan_cell))


def _magnified(rows: tuple[str, ...], times: int) -> tuple[str, ...]:
    """Rows of which each cell became a square of cells; the start stays one, the square's middle."""
    if times == 1:
        return rows
    wide = ["".join(character * times for character in row) for row in rows]
    tall = [row.replace(START, FREE) for row in wide for _ in range(times)]
    for number, row in enumerate(rows):
        if START in row:
            line, place = number * times + times // 2, row.index(START) * times + times // 2
            tall[line] = tall[line][:place] + START + tall[line][place + 1 :]
    return tuple(tall)


def _raster(path: Path, cell_size: float, resolution: float | None) -> Raster:
    suffix = path.suffix.lower()
    try:
        if suffix in _ROS:
            if resolution is not None:
                raise ValueError(f"resolution {resolution:g} is given, but the file has its own; leave it out")
            return read_ros(path)
        if suffix not in _READERS:
            known = ", ".join((*_ROS, *_READERS))
            raise ValueError(f"it is neither a file in {known} nor one of the gallery ({', '.join(gallery())})")
        raster = _READERS[suffix](path, cell_size if resolution is None else resolution)
        if resolution is not None or suffix == ".txt":
            return raster
        assumed = f"nothing says how wide a pixel is, and {cell_size:g} m is taken; else add --resolution METRES"
        return replace(raster, notes=(assumed, *raster.notes))
    except OSError as error:
        other = error.filename is not None and Path(error.filename) != path
        where = f" '{one_line(str(error.filename), 200)}'" if other else ""
        raise ValueError(f"it cannot be read ({error.strerror or error}{where}); look at the name") from None
