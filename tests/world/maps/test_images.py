"""Images: levels of grey in all depths, the red dot of the start, damaged and huge files."""

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from explore_bench.world.maps.images import read_image
from explore_bench.world.maps.raster import FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL

LEVELS = np.array([[0, 89, 90], [205, 206, 255]], dtype=np.uint8)
KINDS = [[OCCUPIED_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL], [UNKNOWN_PIXEL, FREE_PIXEL, FREE_PIXEL]]


@pytest.fixture
def image(tmp_path):
    """Return a function that writes an array as an image and gives its path."""

    def write(array, mode=None, name="map.png"):
        made = Image.fromarray(np.asarray(array))
        (made.convert(mode) if mode else made).save(tmp_path / name)
        return tmp_path / name

    return write


def header(width, height):
    """Return a PNG of this size that holds next to nothing."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("name", "mode"), [("map.pgm", None), *(("map.png", mode) for mode in (None, "RGB", "RGBA", "P", "LA"))]
)
def test_dark_is_an_obstacle_bright_is_free_and_grey_is_unknown(image, mode, name):
    raster = read_image(image(LEVELS, mode, name), 0.1)
    assert raster.pixels.tolist() == KINDS
    assert (raster.resolution, raster.origin, raster.start) == (0.1, (0.0, 0.0), None)


@pytest.mark.parametrize("name", ["map.jpg", "map.jpeg", "map.gif", "map.bmp", "map.ppm", "map.pbm"])
def test_other_kinds_of_images_are_read(image, name):
    wall = np.repeat(np.repeat(np.array([[0, 255]], dtype=np.uint8), 16, axis=0), 16, axis=1)
    raster = read_image(image(wall, "1" if name == "map.pbm" else "RGB", name), 1.0)
    assert raster.pixels[8, [4, 28]].tolist() == [OCCUPIED_PIXEL, FREE_PIXEL]


def test_levels_between_free_and_occupied_are_named_by_their_share(image):
    [note] = read_image(image(np.array([[0, 127, 195, 208]], dtype=np.uint8)), 1.0).notes
    assert note.startswith(
        "grey 127 (25.0 % of the pixels), 195 (25.0 % of the pixels): between free (brighter than 205)"
    )
    assert read_image(image(np.array([[0, 205, 254, 255]], dtype=np.uint8)), 1.0).notes == ()
    [many] = read_image(image(np.array([[100, 110, 120, 130, 140]], dtype=np.uint8)), 1.0).notes
    assert "and 2 more levels" in many


@pytest.mark.parametrize("name", ["map.png", "map.pgm"])
def test_sixteen_bits_are_read_as_eight(image, tmp_path, name):
    deep = LEVELS.astype(np.uint16) * 257
    if name == "map.png":
        path = image(deep)
    else:
        path = tmp_path / name
        path.write_bytes(b"P5\n3 2\n65535\n" + deep.astype(">u2").tobytes())
    assert read_image(path, 1.0).pixels.tolist() == KINDS


def test_black_and_white_and_text_and_a_smaller_largest_value(image, tmp_path):
    assert read_image(image(np.array([[0, 255]], dtype=np.uint8), "1"), 1.0).pixels.tolist() == [[1, 0]]
    path = tmp_path / "map.pgm"
    path.write_text("P2\n# by hand\n3 1\n99\n0 50 99\n")
    assert read_image(path, 1.0).pixels.tolist() == [[OCCUPIED_PIXEL, UNKNOWN_PIXEL, FREE_PIXEL]]


def test_what_is_transparent_is_unknown(image):
    colors = np.full((1, 3, 4), 255, dtype=np.uint8)
    colors[0, 1] = (255, 0, 0, 0)
    raster = read_image(image(colors), 1.0)
    assert raster.pixels.tolist() == [[FREE_PIXEL, UNKNOWN_PIXEL, FREE_PIXEL]]
    assert raster.start is None


def test_the_middle_of_a_red_dot_is_the_start_and_it_is_free(image):
    colors = np.full((6, 8, 3), 255, dtype=np.uint8)
    colors[1:3, 4:7] = (250, 10, 40)
    raster = read_image(image(colors), 0.5)
    assert raster.start == (5.5 * 0.5, 4.0 * 0.5)
    assert (raster.pixels == FREE_PIXEL).all()


def test_two_red_dots_are_refused(image):
    colors = np.full((6, 8, 3), 255, dtype=np.uint8)
    colors[1, 1] = colors[4, 4] = (255, 0, 0)
    with pytest.raises(ValueError, match="2 red dots; leave one"):
        read_image(image(colors), 1.0)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"", "'map.png' is no whole image"),
        (b"hello", "none of PNG, PPM, BMP, JPEG, GIF"),
        (b"GIF89a" + bytes(30), "'map.png' is no whole image"),
        (b"RIFF\x00\x00\x00\x00WEBP", "none of PNG, PPM, BMP, JPEG, GIF"),
        (b"P5\n8 6\n255\nabc", "'map.png' is no whole image"),
        (header(8, 8)[:45], "'map.png' is no whole image"),
        (header(5001, 5001), "5001 × 5001 pixels, more than 25,000,000"),
        (header(60000, 60000), "more than 25,000,000 pixels"),
        (header(2**31 - 1, 2**31 - 1), "more than 25,000,000 pixels"),
    ],
)
def test_damaged_foreign_and_huge_files_are_refused_without_being_read(tmp_path, content, named, recwarn):
    path = tmp_path / "map.png"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=named) as error:
        read_image(path, 1.0)
    assert "\n" not in str(error.value)
    assert not recwarn.list


def test_an_image_cut_anywhere_is_read_whole_or_refused(image):
    whole = image(np.random.default_rng(0).integers(0, 255, (40, 40)).astype(np.uint8))
    content = whole.read_bytes()
    expected = read_image(whole, 1.0).pixels
    refused = 0
    for length in range(0, len(content), 37):
        whole.write_bytes(content[:length])
        try:
            assert np.array_equal(read_image(whole, 1.0).pixels, expected)
        except ValueError:
            refused += 1
    assert refused >= len(content) // 37 - 1
