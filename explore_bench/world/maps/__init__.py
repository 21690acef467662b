"""Maps of others as rows of text for `Scenario.map`: ROS map_server pairs, images, arrays, text, and a gallery.

Every reader gives a `Raster` of free, occupied and unknown pixels; `raster.cells_of` brings it to the cell size.
"""

from __future__ import annotations

from pathlib import Path

from explore_bench.errors import RequestError, one_line
from explore_bench.world.floor_plan import FREE, START
from explore_bench.world.maps.arrays import read_array
from explore_bench.world.maps.images import read_image
from explore_bench.world.maps.raster import RESOLUTIONS, Raster, cells_of
from explore_bench.world.maps.ros import read_ros
from explore_bench.world.maps.text import read_text
from explore_bench.world.scenario import Scenario

GALLERY = Path(__file__).parent / "gallery"

_READERS = {".png": read_image, ".pgm": read_image, ".npy": read_array, ".txt": read_text}
_ROS = (".yaml", ".yml")


def gallery() -> dict[str, tuple[str, ...]]:
    """Rows of the maps that come with the benchmark, by name."""
    return {path.stem: tuple(path.read_text(encoding="utf-8").splitlines()) for path in sorted(GALLERY.glob("*.txt"))}


def with_map(scenario: Scenario, name_or_file: str | Path, resolution: float | None = None) -> Scenario:
    """Scenario in the world of a map instead of drawn ones.

    Parameters
    ----------
    name_or_file : a map of the gallery, or a file: .yaml of map_server, .png or .pgm, .npy, .txt.
    resolution : edge of a pixel [m] where the file does not say; a pixel is a cell if it is not given.

    Raises
    ------
    RequestError : for a file that is no map, or a map in which nothing can be explored.
    """
    try:
        return _mapped(scenario, str(name_or_file), resolution)
    except ValueError as error:
        reason = str(error).removeprefix("scenario: ").removesuffix(".")
        raise RequestError(f"map '{name_or_file}': {reason}.") from None


def _mapped(scenario: Scenario, name: str, resolution: float | None) -> Scenario:
    low, high = RESOLUTIONS
    if resolution is not None and not low <= resolution <= high:
        raise ValueError(f"resolution is {resolution:g}; give the metres that a pixel is wide, {low:g} to {high:g}")
    own = gallery()
    if name in own:
        if resolution is not None:
            raise ValueError(
                f"resolution {resolution:g} is given, but a map of the gallery is made of cells; leave it out"
            )
        return scenario.replace(map=_magnified(own[name], round(scenario.cell_size / _plan_cell(scenario))))
    raster = _raster(Path(name), _plan_cell(scenario), resolution)
    constants = scenario.for_pixels(raster.resolution)
    plan_cell = constants.get(scenario.plan_cell, _plan_cell(scenario))
    return scenario.replace(map=cells_of(raster, plan_cell, scenario.most_plan_cells), **constants)


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
        return _READERS[suffix](path, cell_size if resolution is None else resolution)
    except OSError as error:
        other = error.filename is not None and Path(error.filename) != path
        where = f" '{one_line(str(error.filename), 200)}'" if other else ""
        raise ValueError(f"it cannot be read ({error.strerror or error}{where}); look at the name") from None
