"""Scenarios by name and from TOML files."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from explore_bench.errors import RequestError, unknown
from explore_bench.files import parse_toml, read_text
from explore_bench.world.landmark.constants import LandmarkScenario
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.maps import GivenMap, drawn_map, gallery, read_map
from explore_bench.world.scenario import Scenario

PAPER = LandmarkScenario()

CHEN_2020 = LandmarkScenario(
    size=40.0,
    margin=20.0,
    sensor_range=math.nextafter(6.0, 0.0),  # [8] sees what is nearer than 6 m
    landmark_density=2.0,
    landmark_clearance=2.0,
    landmarks_occupy=True,
    obstacle_count=0,
    candidates_per_robot=1,
    candidates_per_landmark=1,
    frontier_neighbours=2,
    withhold=False,
    planner="straight",
    start_moves=4,
    step_length=2.0,
    odometry_sigma=0.1,
    turn_sigma=0.1,
    coverage=math.nextafter(0.85, 1.0),  # and ends when more than 85 % are known
    relinearize_threshold=0.1,
    relinearize_interval=10,
    first_sight="replace",
    fusion="determinant",
)
"""The protocol of [8]'s public code; docs/chen2020.md compares what it gives."""

STAGE = LidarScenario()

SCENARIOS: dict[str, tuple[Scenario, str]] = {
    "paper": (PAPER, "Zhang et al. 2021, §4.1; what it leaves out is calibrated against its Table 2"),
    "chen2020": (
        CHEN_2020,
        "Chen et al. 2020 [8]: 40 m, 6 m range, 8 landmarks, no obstacles, 2 m steps straight on, 85 %",
    ),
    "stage": (STAGE, "Zhang et al. 2021, §4.2 end: 20 m of dense obstacles, wheels, a lidar of 10 m, SLAM by scans"),
}


def load_scenario(name_or_file: str) -> Scenario:
    """Scenario of a registered name or of a TOML file.

    `read_scenario` says what a file may hold, and raises where it does not.
    """
    return read_scenario(name_or_file)[0]


def read_scenario(name_or_file: str) -> tuple[Scenario, GivenMap | None]:
    """Scenario of a registered name or of a TOML file, and the map that it gives.

    A file holds constants by name, and may start from a named scenario, `extends = "chen2020"` (default: paper), or
    from the usual constants of a kind of world, `kind = "landmark"`. Its `map` is a list of rows, or a map of the
    gallery or a file for `maps.read_map`, found from where the TOML file lies, with `resolution` [m] beside it.

    Raises
    ------
    RequestError : for an unknown name, an unreadable or foreign file, an unknown key or a value out of range.
    """
    if name_or_file in SCENARIOS:
        return SCENARIOS[name_or_file][0], None
    path = Path(name_or_file)
    if path.suffix.lower() != ".toml":
        raise unknown("scenario", name_or_file, SCENARIOS)
    values = _values(path)
    extended = values.pop("extends", None if "kind" in values else "paper")
    if extended is not None and (not isinstance(extended, str) or extended not in SCENARIOS):
        raise unknown(f"scenario file '{path}': extends", str(extended), SCENARIOS)
    for kind in ("landmark", "obstacle"):
        if {f"{kind}_density", f"{kind}_count"} <= values.keys():
            raise RequestError(f"scenario file '{path}' gives {kind}_density and {kind}_count; give one of them.")
    try:
        base = Scenario(kind=values["kind"]) if extended is None else SCENARIOS[extended][0]
        return _built(base, values, path.parent)
    except RequestError as error:
        raise RequestError(f"scenario file '{path}': {error}") from None


def _values(path: Path) -> dict[str, Any]:
    try:
        return parse_toml(read_text(path))
    except OSError as error:
        raise RequestError(f"scenario file '{path}' cannot be read ({error.strerror}); give a TOML file.") from None
    except ValueError as error:
        raise RequestError(f"scenario file '{path}': {error}.") from None


def _built(base: Scenario, values: dict[str, Any], folder: Path) -> tuple[Scenario, GivenMap | None]:
    """Scenario of a file's values, and its map; `map` as text names one."""
    file = values.get("map")
    if not isinstance(file, str):
        made = base.replace(**values)
        return made, None if made.map is None else drawn_map(made)
    resolution = values.pop("resolution", None)
    if resolution is not None and (isinstance(resolution, bool) or not isinstance(resolution, int | float)):
        raise RequestError(f"scenario key 'resolution' is {resolution!r}; give the metres that a pixel is wide.")
    del values["map"]
    given = read_map(base.replace(**values), file if file in gallery() else folder / file, resolution)
    return given.scenario.replace(size=values["size"]) if "size" in values else given.scenario, given
