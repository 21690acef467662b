"""Pixels to cells: shares of a cell worked by hand, alignment, thin walls, specks, and sizes that are refused."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy import ndimage

from explore_bench.world.maps.raster import (
    FREE_PIXEL,
    MAX_PIXELS,
    OCCUPIED_PIXEL,
    UNKNOWN_PIXEL,
    Raster,
    cells_of,
    check_pixels,
    classified,
)

KINDS = {"#": OCCUPIED_PIXEL, ".": FREE_PIXEL, "?": UNKNOWN_PIXEL}


def raster(*rows, resolution=1.0, **others):
    return Raster(np.array([[KINDS[one] for one in row] for row in rows], dtype=np.uint8), resolution, **others)


def test_a_pixel_of_the_size_of_a_cell_is_a_cell():
    rows = ("#.#", "...", "#?.")
    assert cells_of(raster(*rows), 1.0) == rows
    assert cells_of(raster(*rows, resolution=2.0), 2.0) == rows


def test_a_pixel_larger_than_a_cell_is_several_cells():
    assert cells_of(raster("#.", ".?", "..", resolution=2.0), 1.0) == ("##..", "##..", "..??", "..??", "....", "....")
    assert cells_of(raster("#.", resolution=1.5), 1.0) == ("##.", "##.")


@pytest.mark.parametrize(
    ("cell", "kind"),
    [
        (("....", "....", "....", "...."), "."),
        ((".#..", "....", "....", "...."), "."),  # a speck
        (("##..", "....", "....", "...."), "#"),  # half a line across
        (("....", ".#..", "..#.", "...."), "#"),
        (("????", "????", "....", "...."), "."),  # half unknown
        (("????", "????", "?...", "...."), "?"),
        (("????", "????", "????", "##.."), "#"),  # a wall, and nothing behind it
    ],
)
def test_what_a_cell_of_four_by_four_pixels_is(cell, kind):
    beside = tuple("...." for _ in cell)
    assert cells_of(raster(*map(str.__add__, cell, beside)), 4.0) == (f"{kind}.",)


def test_cells_lie_at_multiples_of_their_size_whatever_the_origin():
    """Four pixels from x = 1 to 5 m meet three cells of 2 m; the border cells are half off the image, and so free."""
    assert cells_of(raster("....", "....", origin=(1.0, 0.0)), 2.0) == ("...",)
    assert cells_of(raster("#..#", "#..#", origin=(-5.0, -2.0)), 2.0) == ("#.#",)
    assert cells_of(raster("#...", "#...", origin=(-4.0, -2.0)), 2.0) == ("#.",)


def test_a_border_cell_that_lies_mostly_off_the_image_is_unknown():
    assert cells_of(raster("....", "....", "....", "....", origin=(3.0, 0.0)), 4.0) == ("?.",)


@given(st.integers(0, 12), st.integers(0, 12), st.integers(0, 12), st.integers(0, 12))
def test_margins_of_which_nothing_is_known_change_nothing(left, right, above, below):
    """However an image is cropped, one place gives the same cells."""
    whole = raster("#####", "#...#", "#..?#", "#####", resolution=0.7, origin=(-1.3, 2.9))
    padded = np.pad(whole.pixels, ((above, below), (left, right)), constant_values=UNKNOWN_PIXEL)
    moved = whole.origin[0] - 0.7 * left, whole.origin[1] - 0.7 * below
    assert cells_of(Raster(padded, 0.7, moved), 1.0) == cells_of(whole, 1.0)


@given(
    st.integers(40, 90),
    st.integers(40, 90),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.floats(1.0, 12.0),
    st.floats(-20.0, 20.0),
    st.booleans(),
)
def test_a_straight_wall_one_pixel_thin_stays_closed(height, width, left, right, cell_size, shift, upright):
    """No path of free cells joined by their sides leads from one side of the line to the other."""
    slope = min(max((right - left) * (height - 1), -(width - 1)), width - 1) / (width - 1)
    line = np.clip(np.round(left * (height - 1) + slope * np.arange(width)), 0, height - 1).astype(int)
    above = np.arange(height)[:, None] - line  # < 0 above the line, 0 on it
    above = above.T if upright else above
    pixels = np.where(above == 0, OCCUPIED_PIXEL, FREE_PIXEL).astype(np.uint8)
    cells = np.array([list(row) for row in cells_of(Raster(pixels, 1.0, (shift, shift / 3)), cell_size)])[::-1]
    rows, columns = (
        np.floor((start + np.arange(count) + 0.5) / cell_size + 1e-9).astype(int)
        for start, count in ((shift / 3, len(pixels)), (shift, len(pixels[0])))
    )
    sides = np.zeros(cells.shape)
    np.add.at(sides, (rows[:, None] - rows[0], columns - columns[0]), np.sign(above[::-1]))
    labels, count = ndimage.label(cells == ".")
    for label in range(1, count + 1):
        assert not {-1.0, 1.0} <= set(np.sign(sides[labels == label]))


@given(st.integers(4, 40), st.floats(0.01, 0.9))
def test_a_speck_does_not_block_a_cell_of_many_pixels(pixels_per_cell, resolution):
    pixels = np.zeros((2 * pixels_per_cell, 2 * pixels_per_cell), dtype=np.uint8)
    pixels[pixels_per_cell // 2, pixels_per_cell // 2] = OCCUPIED_PIXEL
    assert cells_of(Raster(pixels, resolution), pixels_per_cell * resolution) == ("..", "..")


def test_the_start_is_the_cell_of_its_point():
    made = raster("......", "......", resolution=1.0, start=(4.5, 0.5))
    assert cells_of(made, 1.0) == ("......", "....S.")
    assert cells_of(made, 2.0) == ("..S",)


def test_a_start_in_a_wall_is_refused():
    with pytest.raises(ValueError, match="start marker stands in a cell that is not free"):
        cells_of(raster("##..", "##..", start=(0.5, 0.5)), 2.0)


@pytest.mark.parametrize(
    ("made", "cell_size", "named"),
    [
        (raster("??", "??"), 1.0, "all is unknown"),
        (Raster(np.zeros((10, 201), dtype=np.uint8), 1.0), 1.0, "201 cells of 1 m a side.*at most 200"),
        (Raster(np.zeros((2, 2), dtype=np.uint8), 1e6), 1.0, "2e.06 × 2e.06 m"),
        (Raster(np.zeros((30, 30), dtype=np.uint8), 0.05), 2.0, "1.5 × 1.5 m, less than a cell of 2 m"),
    ],
)
def test_what_gives_no_map_is_refused(made, cell_size, named):
    with pytest.raises(ValueError, match=named):
        cells_of(made, cell_size)


def test_classes_by_probability_with_unknown_between_and_for_nan():
    values = np.array([0.0, 0.19, 0.196, 0.5, 0.65, 0.66, 1.0, math.nan])
    assert classified(values).tolist() == [0, 0, 2, 2, 2, 1, 1, 2]
    assert classified(values, 0.5, 0.1).tolist() == [0, 2, 2, 2, 1, 1, 1, 2]


@pytest.mark.parametrize(("width", "height", "named"), [(0, 3, "0 × 3 pixels"), (5001, 5000, f"{MAX_PIXELS:,}")])
def test_images_without_or_with_too_many_pixels_are_refused(width, height, named):
    check_pixels(5000, 5000)
    with pytest.raises(ValueError, match=named):
        check_pixels(width, height)
