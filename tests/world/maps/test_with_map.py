"""Scenarios in the world of a map: the gallery, files of all kinds, and what is refused in one sentence."""

import numpy as np
import pytest
from PIL import Image

from explore_bench.errors import RequestError
from explore_bench.trial.seeding import stream
from explore_bench.world.floor_plan import floor_plan
from explore_bench.world.kinds import draw_world
from explore_bench.world.maps import gallery, with_map
from explore_bench.world.scenarios import PAPER, STAGE

ROWS = ("####", "#..#", "#S.#", "####")


@pytest.fixture
def files(tmp_path):
    """Write one map in every format that is understood; a pixel is 0.5 m where the file can say so."""
    wall = np.array([[one == "#" for one in row] for row in ROWS])
    fine = np.repeat(np.repeat(wall, 4, axis=0), 4, axis=1)
    Image.fromarray(np.where(fine, 0, 254).astype(np.uint8)).save(tmp_path / "rooms.pgm")
    (tmp_path / "rooms.yaml").write_text(
        "image: rooms.pgm\nresolution: 0.5\norigin: [-4.0, 6.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    colors = np.repeat(np.where(wall, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
    colors[2, 1] = (255, 0, 0)
    Image.fromarray(colors).save(tmp_path / "rooms.png")
    np.save(tmp_path / "rooms.npy", wall)
    (tmp_path / "rooms.txt").write_text("\n".join(ROWS))
    return tmp_path


@pytest.mark.parametrize(
    ("name", "resolution", "has_start"),
    [
        ("rooms.yaml", None, False),
        ("rooms.pgm", 0.5, False),
        ("rooms.png", None, True),
        ("rooms.png", 2.0, True),
        ("rooms.npy", None, False),
        ("rooms.txt", None, True),
    ],
)
def test_one_map_in_every_format_gives_the_same_rows(files, name, resolution, has_start):
    scenario = with_map(PAPER, files / name, resolution)
    assert scenario.map == (ROWS if has_start else tuple(row.replace("S", ".") for row in ROWS))
    assert (scenario.size, scenario.cell_size) == (8.0, 2.0)
    assert scenario == PAPER.replace(map=scenario.map)


def test_the_cell_size_is_the_scenario_s(files):
    assert with_map(PAPER.replace(cell_size=1.0), files / "rooms.yaml").size == 8.0
    assert with_map(PAPER.replace(cell_size=1.0), files / "rooms.yaml").grid.columns == 8
    assert with_map(PAPER.replace(cell_size=1.0), files / "rooms.txt").size == 4.0


def test_upper_case_endings_and_yml_are_understood(files):
    (files / "rooms.txt").rename(files / "ROOMS.TXT")
    (files / "rooms.yaml").rename(files / "rooms.yml")
    assert with_map(PAPER, str(files / "ROOMS.TXT")).map == ROWS
    assert with_map(PAPER, files / "rooms.yml").size == 8.0


def test_a_map_takes_the_place_of_the_size_and_of_another_map(files):
    first = with_map(PAPER.replace(size=30.0, obstacle_count=5), files / "rooms.txt")
    assert (first.size, first.obstacles) == (8.0, 12)
    assert with_map(first, "loop").map == gallery()["loop"]


@pytest.mark.parametrize(
    ("name", "resolution", "named"),
    [
        ("gone.png", None, "cannot be read (No such file or directory)"),
        ("rooms.dwg", None, "neither a file in .yaml, .yml, .png, .pgm, .pbm, "),
        ("rooms.dwg", None, ".npy, .txt nor one of the gallery (cave, "),
        ("rooms.yaml", 0.1, "resolution 0.1 is given, but the file has its own"),
        ("rooms.png", -1.0, "resolution is -1; give the metres"),
        ("rooms.png", float("nan"), "resolution is nan"),
        ("rooms.png", 0.001, "0.004 × 0.004 m, less than a cell of 2 m"),
        ("rooms.png", 1000.0, "2000 cells of 2 m a side"),
        ("black.png", None, "the map has no free cell"),
        ("grey.png", None, "all is unknown"),
        ("dots.png", None, "no two free cells of the map share a side"),
        ("cut.png", None, "no whole image"),
        ("orphan.yaml", None, "cannot be read (No such file or directory"),
        ("folder.txt", None, "no regular file"),
    ],
)
def test_what_gives_no_map_is_refused_in_one_sentence_with_the_file_and_the_fix(files, name, resolution, named):
    for file, level in (("black.png", 0), ("grey.png", 150)):
        Image.fromarray(np.full((9, 9), level, dtype=np.uint8)).save(files / file)
    Image.fromarray(np.where(np.eye(5), 255, 0).astype(np.uint8)).save(files / "dots.png")
    (files / "cut.png").write_bytes((files / "rooms.png").read_bytes()[:50])
    (files / "orphan.yaml").write_text((files / "rooms.yaml").read_text().replace("rooms.pgm", "gone.pgm"))
    (files / "folder.txt").mkdir()
    with pytest.raises(RequestError) as error:
        with_map(PAPER, files / name, resolution)
    message = str(error.value)
    assert message.startswith(f"map '{files / name}': ")
    assert named in message
    assert "\n" not in message
    assert message.endswith(".")
    assert not message.endswith("..")


def test_a_missing_image_is_named(files):
    (files / "orphan.yaml").write_text((files / "rooms.yaml").read_text().replace("rooms.pgm", "gone.pgm"))
    with pytest.raises(RequestError, match=r"gone\.pgm"):
        with_map(PAPER, files / "orphan.yaml")


def test_an_image_with_a_name_of_5000_letters_is_named_in_short(files):
    (files / "orphan.yaml").write_text((files / "rooms.yaml").read_text().replace("rooms.pgm", "a" * 5000))
    with pytest.raises(RequestError, match=r"a … a") as error:
        with_map(PAPER, files / "orphan.yaml")
    assert len(str(error.value)) < 600


# The gallery


def test_the_gallery_holds_four_maps_of_20_cells_a_side():
    assert list(gallery()) == ["cave", "corridor", "loop", "rooms"]
    for rows in gallery().values():
        assert {len(row) for row in rows} == {20}
        assert len(rows) == 20


@pytest.mark.parametrize("name", gallery())
def test_every_free_cell_of_the_gallery_can_be_reached(name):
    site = floor_plan(gallery()[name])
    assert np.array_equal(site.reachable, ~site.blocked)
    assert site.reachable.sum() > 150


@pytest.mark.parametrize("name", gallery())
def test_the_gallery_has_room_for_all_its_landmarks(name):
    scenario = with_map(PAPER, name)
    assert scenario.landmarks >= 8
    for trial in range(5):
        world = draw_world(scenario, stream("evaluate", 0, scenario.size, trial, "world"))
        assert len(world.landmarks) == scenario.landmarks


def test_a_resolution_makes_no_sense_for_the_gallery():
    with pytest.raises(RequestError, match="made of cells; leave it out"):
        with_map(PAPER, "loop", 0.5)


# Pixels in lidar worlds


def ringed(path, edge):
    """Write a room of this many pixels along each side, with a wall around."""
    wall = np.zeros((edge, edge), dtype=bool)
    wall[[0, -1]] = wall[:, [0, -1]] = True
    np.save(path, wall)
    return path


def test_a_small_map_with_fine_pixels_is_judged_by_its_own_size(tmp_path):
    """4.5 m in pixels of 5 mm: 20 m of them would be too many."""
    scenario = with_map(STAGE, ringed(tmp_path / "fine.npy", 900), 0.005)
    assert (scenario.size, scenario.resolution, scenario.map_resolution) == (6.0, 0.005, pytest.approx(0.1))
    assert len(scenario.map) == 900


def test_a_map_smaller_than_a_cell_is_refused_with_the_fix(tmp_path):
    path = ringed(tmp_path / "tiny.npy", 20)
    with pytest.raises(RequestError, match=r"a map in a square of 2 m gives 1 × 1 cells of 2 m; .* another cell_size"):
        with_map(STAGE, path, 0.05)
    scenario = with_map(STAGE.replace(cell_size=0.5, sensor_range=2.0), path, 0.05)
    assert scenario.size == 2.0, "a metre, and half of one around it"
