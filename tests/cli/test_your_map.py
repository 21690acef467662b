"""Maps of others in lidar worlds: what a map that cannot be used is told, and that docs/your-map.md quotes it."""

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
