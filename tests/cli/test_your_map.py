"""Maps of others: what was understood of one, what is told of one that cannot be used, and that the page quotes it."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from explore_bench.cli import main

PAGE = (Path(__file__).parents[2] / "docs" / "your-map.md").read_text(encoding="utf-8")
FREE, UNKNOWN, WALL, RED = (254, 254, 254), (205, 205, 205), (0, 0, 0), (255, 0, 0)


def room(edge=80, level=FREE):
    """Pixels of a walled square, shape (edge, edge, 3)."""
    pixels = np.full((edge, edge, 3), WALL, dtype=np.uint8)
    pixels[2:-2, 2:-2] = level
    return pixels


def with_dot(pixels, row, column):
    pixels[row : row + 4, column : column + 4] = RED
    return pixels


def corridor(width):
    """Pixels of a corridor along a wall, shape (80, 80, 3)."""
    pixels = room(level=WALL)
    pixels[40 : 40 + width, 2:-2] = FREE
    return pixels


REFUSED = {
    "a start beside a wall": (with_dot(room(), 3, 3), "does not fit where the map starts; move the start"),
    "a corridor that is too narrow": (corridor(14), "does not fit anywhere in the map; look at the resolution"),
    "a map that is too large": (room(2600), "at most 2000; crop it, scale it down, or give the metres of a pixel"),
    "an image that is too large": (np.zeros((5200, 5200), dtype=np.uint8), "25,000,000; crop it, or scale it down"),
    "nothing but grey": (np.full((80, 80), 205, dtype=np.uint8), "all is unknown; look at the thresholds"),
    "nothing but walls": (room(level=WALL), "the map has no free cell; mark some as free"),
}


@pytest.mark.parametrize(("pixels", "words"), REFUSED.values(), ids=REFUSED)
def test_a_map_that_cannot_be_used_is_refused_before_anything_runs_in_a_sentence_of_the_page(
    tmp_path, capsys, pixels, words
):
    file, results = tmp_path / "map.png", tmp_path / "results"
    Image.fromarray(pixels).save(file)
    options = ["--scenario", "stage", "--map", file, "--resolution", "0.05", "-s", "nearest", "--results", results]
    with pytest.raises(SystemExit) as ended:
        main(["run", "smoke", *map(str, options)])
    captured = capsys.readouterr()
    assert ended.value.code == 2
    assert captured.out == ""
    assert not results.exists(), "else the folder would refuse the map once it is mended"
    assert captured.err.count("\n") == 1
    sentence = captured.err.strip().removeprefix("explore-bench: ").removeprefix(f"map '{file}': ")
    assert words in sentence
    assert f"`{sentence}`" in PAGE


def test_a_corridor_that_is_wide_enough_is_explored(tmp_path, capsys):
    """0.9 m: a passage of 0.4 m to either side, and the pixels."""
    file = tmp_path / "map.png"
    Image.fromarray(corridor(18)).save(file)
    options = ["--scenario", "stage", "--map", file, "--resolution", "0.05", "--output", tmp_path / "end.png"]
    with pytest.raises(SystemExit) as ended:
        main(["demo", "nearest", *map(str, options)])
    assert ended.value.code == 0
    assert "explored after" in capsys.readouterr().out


# What was understood


def corridors():
    """Pixels of corridors of 1.5 m around a block of 20 m, shape (420, 420, 3)."""
    pixels = np.full((420, 420, 3), WALL, dtype=np.uint8)
    for place in (10, 380):
        pixels[place : place + 30, 10:410] = FREE
        pixels[10:410, place : place + 30] = FREE
    return pixels


def told(tmp_path, capsys, pixels, *options):
    """Exit code and lines of a plan of trials in the map of these pixels of 5 cm."""
    file = tmp_path / "map.png"
    Image.fromarray(pixels).save(file)
    with pytest.raises(SystemExit) as ended:
        main(["run", "smoke", "-s", "nearest", "--dry-run", "--map", str(file), "--resolution", "0.05", *options])
    captured = capsys.readouterr()
    return ended.value.code, [line.strip() for line in (captured.out + captured.err).splitlines()]


def test_a_map_is_told_in_pixels_metres_cells_and_what_can_be_reached(tmp_path, capsys):
    code, lines = told(tmp_path, capsys, corridors())
    assert code == 0
    assert lines[0] == f"map {tmp_path / 'map.png'}:"
    assert lines[1] == "420 × 420 pixels of 0.05 m, 21 × 21 m: 25 % free, 75 % occupied, 0 % unknown"
    assert lines[2] == (
        "cells of 1 m, 21 × 21 of them: 100 % of its open floor can be reached (cells of 2 m would leave 0 %)"
    )
    assert lines[3] == "the robot sees 5 m far, through walls (occlusion = false)"
    assert lines[4].startswith("its passages are narrower than two cells; add --scenario stage")
    assert lines[-1].startswith("plan: 4 trials")


def test_a_cell_size_of_ones_own_is_taken_and_what_it_closes_is_told(tmp_path, capsys):
    two_halves = np.full((420, 420, 3), WALL, dtype=np.uint8)
    two_halves[2:-2, 2:208] = two_halves[2:-2, 212:-2] = two_halves[20:40, 208:212] = FREE
    code, lines = told(tmp_path, capsys, two_halves, "--cell-size", "2")
    assert code == 0
    assert lines[2].startswith("cells of 2 m, 11 × 11 of them: 50 % of its open floor")
    assert "cells of 2 m close passages; --cell-size 1 keeps them open" in lines
    _, lines = told(tmp_path, capsys, two_halves, "--cell-size", "0.5")
    assert lines[2].startswith("cells of 0.5 m, 42 × 42 of them: 100 % of its open floor")


def test_a_cell_size_that_leaves_nothing_is_refused_with_the_one_that_does_not(tmp_path, capsys):
    code, lines = told(tmp_path, capsys, corridors(), "--cell-size", "2")
    assert code == 2
    assert lines[-1].endswith("cells of 2 m leave nothing of it to explore; set a cell size of 1 m.")


def test_levels_of_grey_between_the_thresholds_are_told(tmp_path, capsys):
    pixels = room(200, (208, 208, 208))
    pixels[60:140, 60:140] = 127
    _, lines = told(tmp_path, capsys, pixels)
    assert any(line.startswith("grey 127 (16.0 % of the pixels): between free") for line in lines)


def test_a_map_that_is_seen_at_once_is_told(tmp_path, capsys):
    _, lines = told(tmp_path, capsys, room(120))
    assert any("100 % of it at once, from the start of world 0" in line for line in lines)


def test_floor_outdoors_is_told(tmp_path, capsys):
    pixels = np.full((400, 400, 3), FREE, dtype=np.uint8)
    pixels[100:300, 100:300] = room(200)
    pixels[296:300, 180:240] = FREE
    _, lines = told(tmp_path, capsys, pixels)
    assert any(re.match(r"\d+ % of its open floor is outdoors", line) for line in lines)


def test_a_lidar_world_tells_how_much_a_robot_reaches_and_what_keeps_it_out(tmp_path, capsys):
    pixels = room(200)
    pixels[:, 120:122] = WALL
    pixels[90:102, 120:122] = FREE  # 0.6 m
    code, lines = told(tmp_path, capsys, pixels, "--scenario", "stage")
    assert code == 0
    assert re.match(r"a robot of 0.22 m that wants 0.4 m to either side reaches 6\d % of the free 9[56] m²", lines[2])
    assert any("behind a passage of less than 0.8 m does not count" in line for line in lines)


def test_the_metres_of_a_pixel_that_nothing_says_are_told_to_be_assumed(tmp_path, capsys):
    """An image of a floor of 10 m would else become one of 400 m in silence; in a text a character is a cell."""
    Image.fromarray(np.full((20, 20), 255, np.uint8)).save(tmp_path / "floor.png")
    (tmp_path / "floor.txt").write_text("......\n......\n......\n")
    assumed = "nothing says how wide a pixel is, and 2 m is taken; else add --resolution METRES"
    for name, options, said in (
        ("floor.png", (), True),
        ("floor.png", ("--resolution", "2"), False),
        ("floor.txt", (), False),
    ):
        with pytest.raises(SystemExit) as ended:
            main(["run", "smoke", "-s", "nearest", "--dry-run", "--map", str(tmp_path / name), *options])
        out = capsys.readouterr().out
        assert ended.value.code in (None, 0)
        assert (assumed in out) == said


def test_a_map_of_a_scenario_file_is_told_too(tmp_path, capsys):
    (tmp_path / "own.TOML").write_text('map = ["####", "#S.#", "#..#", "####"]\n')
    with pytest.raises(SystemExit):
        main(["run", "smoke", "-s", "nearest", "--dry-run", "--scenario", str(tmp_path / "own.TOML")])
    out = capsys.readouterr().out
    assert "map of the scenario:" in out
    assert "4 × 4 pixels of 2 m, 8 × 8 m: 25 % free, 75 % occupied, 0 % unknown" in out


@pytest.mark.parametrize("option", ["--resolution", "--cell-size"])
def test_an_option_of_a_map_without_one_is_refused(capsys, option):
    with pytest.raises(SystemExit) as ended:
        main(["demo", "nearest", option, "1"])
    assert ended.value.code == 2
    assert f"{option[2:]} 1 is given without a map; add --map FILE." in capsys.readouterr().err
