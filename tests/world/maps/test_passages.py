"""Passages of a map in cells: the open floor, what is within reach, and the cell size that keeps it so."""

import numpy as np
import pytest

from explore_bench.errors import RequestError
from explore_bench.world.maps import with_map
from explore_bench.world.maps.passages import finer, kept_by, narrow_for, open_floor, outdoors
from explore_bench.world.maps.raster import FREE_PIXEL, MAX_PIXELS, OCCUPIED_PIXEL, UNKNOWN_PIXEL, Raster, rotated
from explore_bench.world.scenario import MAX_CELLS
from explore_bench.world.scenarios import CHEN_2020, PAPER, STAGE

PIXEL = 0.1


def walled(height, width):
    """Pixels of a room of so many metres with a wall of one pixel around."""
    pixels = np.full((round(height / PIXEL), round(width / PIXEL)), FREE_PIXEL, dtype=np.uint8)
    pixels[[0, -1]] = OCCUPIED_PIXEL
    pixels[:, [0, -1]] = OCCUPIED_PIXEL
    return pixels


def two_rooms(door):
    """Two rooms of 12 m × 8 m with a door of so many pixels, from 2 m on, in the wall between them."""
    pixels = walled(12.0, 16.0)
    pixels[:, 80] = OCCUPIED_PIXEL
    pixels[20 : 20 + door, 80] = FREE_PIXEL
    return pixels


def crossing(width):
    """Corridors of so many metres all around and across a block of 20 m × 20 m."""
    pixels = np.full((200, 200), OCCUPIED_PIXEL, dtype=np.uint8)
    wide = round(width / PIXEL)
    for place in (5, 95, 195 - wide):
        pixels[place : place + wide, 5:195] = FREE_PIXEL
        pixels[5:195, place : place + wide] = FREE_PIXEL
    return pixels


@pytest.fixture
def saved(tmp_path):
    """Return a function that saves pixels as an array of percentages and gives the file."""

    def write(pixels):
        np.save(tmp_path / "map.npy", np.array([0, 100, -1], dtype=np.int8)[pixels])
        return tmp_path / "map.npy"

    return write


def test_a_hole_in_a_wall_is_no_passage_and_a_door_is_one():
    assert open_floor(Raster(two_rooms(4), PIXEL)).sum() == 118 * 79
    assert open_floor(Raster(two_rooms(5), PIXEL)).sum() == 118 * 157 + 5


def test_the_open_floor_is_the_one_with_the_start():
    pixels = two_rooms(0)
    pixels[:, 20] = OCCUPIED_PIXEL
    assert open_floor(Raster(pixels, PIXEL)).sum() == 118 * 78
    assert open_floor(Raster(pixels, PIXEL, start=(0.5, 0.5))).sum() == 118 * 19


def test_what_lies_behind_a_wall_is_out_of_reach_though_it_is_next_to_it():
    """A door of 1 m is a cell of 1 m, and takes no more than half of one of 2 m, which the wall closes."""
    raster = Raster(two_rooms(10), PIXEL)
    assert kept_by(raster, 1.0, MAX_CELLS) > 0.95
    assert 0.45 < kept_by(raster, 2.0, MAX_CELLS) < 0.55


def test_passages_of_a_map_are_narrower_than_two_cells_or_not():
    raster = Raster(crossing(1.5), PIXEL)
    assert narrow_for(raster, 1.0)
    assert not narrow_for(raster, 0.5)


def test_finer_cells_are_halves_but_not_finer_than_half_a_metre_or_a_pixel():
    fine, coarse = Raster(walled(6.0, 6.0), PIXEL), Raster(walled(6.0, 6.0), 0.75)
    assert list(finer(fine, 2.0)) == [1.0, 0.5]
    assert list(finer(fine, 0.8)) == []
    assert list(finer(coarse, 2.0)) == [1.0]


@pytest.mark.parametrize(("width", "cell_size"), [(4.5, 2.0), (1.5, 1.0), (0.9, 0.5)])
def test_the_cell_size_is_the_largest_that_keeps_passages_open(saved, width, cell_size):
    scenario = with_map(PAPER, saved(crossing(width)), PIXEL)
    assert scenario.cell_size == cell_size
    assert scenario.path_tolerance == 0.5 * cell_size
    assert scenario.arrival_radius == min(0.25, 0.4 * cell_size)
    assert scenario.landmark_density == PAPER.landmark_density, "so many per 100 cells, however large they are"


def test_drawn_worlds_and_maps_that_2_m_keep_have_the_usual_constants(saved):
    path = saved(crossing(4.5))
    assert with_map(PAPER, path, PIXEL) == PAPER.replace(map=with_map(PAPER, path, PIXEL).map)


def test_a_cell_size_that_is_set_stands_and_so_do_constants_that_are(saved):
    path = saved(crossing(1.5))
    assert with_map(PAPER, path, PIXEL, 0.5).cell_size == 0.5
    assert with_map(PAPER.replace(cell_size=0.5, sensor_range=3.0, arrival_radius=0.1), path, PIXEL).cell_size == 0.5
    own = with_map(PAPER.replace(path_tolerance=0.7), path, PIXEL)
    assert (own.cell_size, own.path_tolerance) == (1.0, 0.7)
    assert with_map(CHEN_2020.replace(planner="grid"), path, PIXEL).cell_size == 1.0


def test_a_cell_size_that_leaves_nothing_is_refused_with_the_one_that_does_not(saved):
    path = saved(crossing(1.5))
    with pytest.raises(RequestError, match="cells of 2 m leave nothing of it to explore; set a cell size of 1 m"):
        with_map(PAPER, path, PIXEL, 2.0)
    with pytest.raises(RequestError, match="cell_size is -1; give the metres"):
        with_map(PAPER, path, PIXEL, -1.0)


def test_a_map_that_no_cell_size_keeps_is_refused_with_the_lidar_world_that_takes_it(saved):
    path = saved(np.roll(crossing(0.6), (3, 3), (0, 1)))  # across the borders of cells of 0.5 m
    with pytest.raises(RequestError) as caught:
        with_map(PAPER, path, PIXEL)
    assert "in cells of 2 m 0 %, of 1 m 0 %, of 0.5 m 0 % of its open floor can be reached" in str(caught.value)
    assert "add --scenario stage, whose robot with a lidar takes it in pixels" in str(caught.value)
    assert with_map(STAGE.replace(robot_radius=0.1, passage=0.25), path, PIXEL).resolution == PIXEL


def test_a_map_of_which_nothing_is_free_names_the_grey_that_is_not(tmp_path):
    from PIL import Image

    pixels = np.full((80, 80), 0, dtype=np.uint8)
    pixels[4:-4, 4:-4] = 150
    Image.fromarray(pixels).save(tmp_path / "map.png")
    with pytest.raises(RequestError, match=r"no free cell; .*; grey 150 \(81\.0 % of the pixels\)"):
        with_map(PAPER, tmp_path / "map.png", 0.1)


def test_the_share_outdoors_is_of_floor_without_a_wall_in_one_of_the_four_directions():
    pixels = np.full((100, 100), FREE_PIXEL, dtype=np.uint8)
    pixels[20:80, 20:80] = walled(6.0, 6.0)
    pixels[79, 40:60] = FREE_PIXEL
    inside = 58 * (58 - 20)  # below the door, too, is no wall
    assert outdoors(Raster(pixels, PIXEL)) == pytest.approx(1 - inside / (pixels == FREE_PIXEL).sum(), abs=0.02)
    assert outdoors(Raster(two_rooms(10), PIXEL)) == 0.0


@pytest.mark.parametrize("degrees", [0.5, 30, 45, 61, 137])
def test_a_turned_wall_one_pixel_thin_still_parts_what_it_parted(degrees):
    raster = rotated(Raster(two_rooms(0), PIXEL, (3.0, -2.0)), np.radians(degrees))
    assert open_floor(raster, 0.0).sum() == pytest.approx(118 * 79, rel=0.03)
    assert {UNKNOWN_PIXEL} == set(raster.pixels[[0, 0, -1, -1], [0, -1, 0, -1]].tolist()) or degrees < 1


def test_a_start_is_turned_with_its_map():
    raster = rotated(Raster(walled(2.0, 4.0), PIXEL, (1.0, 1.0), start=(4.0, 1.5)), np.pi / 2)
    assert raster.start == pytest.approx((0.5, 4.0))
    assert raster.origin == pytest.approx((-1.0, 1.0))


def test_an_image_that_is_too_large_once_it_is_turned_is_refused():
    edge = round(MAX_PIXELS**0.5)
    with pytest.raises(ValueError, match="more than 25,000,000"):
        rotated(Raster(np.zeros((edge, edge), dtype=np.uint8), PIXEL), 0.5)
