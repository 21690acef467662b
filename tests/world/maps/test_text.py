"""Maps drawn with characters."""

import pytest

from explore_bench.world.maps.raster import cells_of
from explore_bench.world.maps.text import read_text


@pytest.fixture
def drawn(tmp_path):
    def write(text):
        path = tmp_path / "map.txt"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_a_character_is_a_pixel_and_short_rows_are_unknown(drawn):
    rows = ("####", "#S.#", "#. ", "####")
    path = drawn("\n".join(rows) + "\n")
    assert cells_of(read_text(path, 2.0), 2.0) == ("####", "#S.#", "#.??", "####")
    raster = read_text(path, 0.5)
    assert raster.start == (0.75, 1.25)
    assert raster.resolution == 0.5


def test_lines_may_end_as_windows_ends_them(drawn):
    assert cells_of(read_text(drawn("..\r\n.#\r\n"), 1.0), 1.0) == ("..", ".#")


def test_a_byte_order_mark_is_no_character_of_the_map(drawn):
    assert cells_of(read_text(drawn(b"\xef\xbb\xbf..\n.#\n"), 1.0), 1.0) == ("..", ".#")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("..\n.x\n", "row 2 holds 'x'; draw with #"),
        ("S.\n.S\n", "2 starts; leave one S"),
        ("", "0 × 0 pixels"),
        ("\n\n", "0 × 2 pixels"),
        (b"\xff\xfe.\x00", "not UTF-8 text"),
        ("." * 1_000_001, "1,000,001 bytes"),
    ],
)
def test_what_is_no_drawing_is_refused(drawn, text, named):
    with pytest.raises(ValueError, match=named):
        read_text(drawn(text), 1.0)
