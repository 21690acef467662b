"""ROS map_server pairs: thresholds, negate, origin and resolution honoured; what is refused and how."""

import numpy as np
import pytest
from PIL import Image

from explore_bench.world.maps.raster import FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL
from explore_bench.world.maps.ros import read_ros

USUAL = {
    "image": "rooms.pgm",
    "resolution": "0.05",
    "origin": "[-1.5, 2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
GREYS = [0, 89, 90, 128, 205, 206, 254, 255]
"""Probabilities 1, 0.651, 0.647, 0.498, 0.19608, 0.192, 0.004 and 0; map_saver writes 0, 205 and 254."""


@pytest.fixture
def pair(tmp_path):
    """Return a function that writes a pair with some lines changed (None: left out) and gives the .yaml."""

    def write(greys=GREYS, text=None, **changes):
        Image.fromarray(np.array([greys], dtype=np.uint8)).save(tmp_path / "rooms.pgm")
        lines = [f"{key}: {value}" for key, value in (USUAL | changes).items() if value is not None]
        path = tmp_path / "rooms.yaml"
        path.write_text("\n".join(lines) if text is None else text)
        return path

    return write


def kinds(raster):
    return ["#.?"[[OCCUPIED_PIXEL, FREE_PIXEL, UNKNOWN_PIXEL].index(one)] for one in raster.pixels[0].tolist()]


def test_a_pair_as_map_saver_writes_it(pair):
    raster = read_ros(pair())
    assert "".join(kinds(raster)) == "##???..."
    assert (raster.resolution, raster.origin, raster.start) == (0.05, (-1.5, 2.0), None)


def test_the_thresholds_are_those_of_the_file_and_are_not_reached_by_being_equal(pair):
    assert "".join(kinds(read_ros(pair(occupied_thresh=0.5, free_thresh=0.25)))) == "###?...."
    assert "".join(kinds(read_ros(pair([0, 51, 204, 255], occupied_thresh=0.8, free_thresh=0.2)))) == "#??."


def test_negate_takes_bright_for_occupied(pair):
    assert "".join(kinds(read_ros(pair(negate=1)))) == ".???####"
    assert "".join(kinds(read_ros(pair(negate="true")))) == ".???####"


def test_the_first_row_of_the_image_is_the_northernmost(tmp_path, pair):
    path = pair()
    Image.fromarray(np.array([[0], [254]], dtype=np.uint8)).save(tmp_path / "rooms.pgm")
    assert read_ros(path).pixels.tolist() == [[OCCUPIED_PIXEL], [FREE_PIXEL]]


ALPHA = [(255, 255, 255, 255), (255, 0, 0, 255), (0, 0, 0, 255), (0, 0, 0, 0), (205, 205, 205, 255), (255, 255, 255, 0)]
"""White, red, black, nothing, opaque grey 205, and white that is transparent: means 255, 128, 64, 0, 218 and 191."""


def test_alpha_is_averaged_with_the_colours_as_map_server_does_in_the_mode_trinary(tmp_path, pair):
    path = pair(image="rooms.png")
    Image.fromarray(np.array([ALPHA], dtype=np.uint8)).save(tmp_path / "rooms.png")
    raster = read_ros(path)
    assert "".join(kinds(raster)) == ".?##.?"
    assert "its image has alpha, which is averaged with the colours" in raster.notes[0]


def test_colours_without_alpha_are_averaged(tmp_path, pair):
    path = pair(image="rooms.png")
    Image.fromarray(np.array([[color[:3] for color in ALPHA]], dtype=np.uint8)).save(tmp_path / "rooms.png")
    assert "".join(kinds(read_ros(path))) == ".###?."


def test_in_the_mode_scale_what_is_not_opaque_is_unknown_and_what_lies_between_a_percentage(tmp_path, pair):
    """Thresholds 0.25 and 0.75: p = 0.5 becomes 50, unknown; 0.31 becomes 13, free; 0.69 becomes 87, an obstacle."""
    path = pair(image="rooms.png", mode="scale", free_thresh=0.25, occupied_thresh=0.75)
    levels = [(255, 255), (0, 255), (127, 255), (175, 255), (80, 255), (255, 254), (0, 0)]
    colors = [(level, level, level, alpha) for level, alpha in levels]
    Image.fromarray(np.array([colors], dtype=np.uint8)).save(tmp_path / "rooms.png")
    assert "".join(kinds(read_ros(path))) == ".#?.#??"


def test_in_the_mode_raw_a_level_is_a_percentage_whatever_negate_says(pair):
    levels = [0, 19, 20, 65, 66, 100, 101, 255]
    assert "".join(kinds(read_ros(pair(levels, mode="raw")))) == "..??##??"
    assert "".join(kinds(read_ros(pair(levels, mode="Raw", negate=1, free_thresh=0.9)))) == "..??##??"


def test_a_mode_is_named_in_upper_or_lower_case(pair):
    assert "".join(kinds(read_ros(pair(mode="Trinary")))) == "##???..."


@pytest.mark.parametrize("name", ["map.jpg", "map.JPEG", "map.gif", "map.bmp", "map.ppm"])
def test_the_image_may_be_of_any_kind_that_map_server_reads(tmp_path, pair, name):
    path = pair(image=name)
    pixels = np.repeat(np.repeat(np.array([[0, 254]], dtype=np.uint8), 16, axis=0), 16, axis=1)
    Image.fromarray(pixels).convert("RGB").save(tmp_path / name, quality=95)
    assert read_ros(path).pixels[8, [4, 28]].tolist() == [OCCUPIED_PIXEL, FREE_PIXEL]


def test_what_map_saver_writes_is_taken_for_what_a_file_does_not_say_and_told(pair):
    raster = read_ros(pair(negate=None, free_thresh=None, occupied_thresh=None))
    assert "".join(kinds(raster)) == "##???..."
    said = [f"it does not say {word}, and" for word in ("negate", "occupied_thresh", "free_thresh")]
    assert [note[: len(start)] for note, start in zip(raster.notes, said, strict=False)] == said


def test_levels_between_the_thresholds_are_named_and_205_alone_is_not(pair):
    assert read_ros(pair([0, 205, 254])).notes == ()
    [note] = read_ros(pair([0, 127, 127, 195, 205, 254, 254, 254])).notes
    assert "grey 127 (25.0 % of the pixels), 195 (12.5 % of the pixels), 205 (12.5 %" in note
    assert "between free (brighter than 205) and occupied (darker than 89)" in note
    [negated] = read_ros(pair([0, 127, 254], negate=1)).notes
    assert "grey 127 (33.3 % of the pixels): between free (darker than 50) and occupied (brighter than 166)" in negated


def corner(pair, yaw, tmp_path):
    """Read an obstacle at the lower left and one above, of an image of three columns and two rows, turned by a yaw."""
    path = pair(origin=f"[1.0, 2.0, {yaw}]", resolution=1.0)
    Image.fromarray(np.array([[0, 254, 254], [0, 254, 205]], dtype=np.uint8)).save(tmp_path / "rooms.pgm")
    raster = read_ros(path)
    rows = [
        "".join("#.?"[[OCCUPIED_PIXEL, FREE_PIXEL, UNKNOWN_PIXEL].index(one)] for one in row) for row in raster.pixels
    ]
    return rows, tuple(round(place, 9) for place in raster.origin)


def test_a_yaw_of_next_to_nothing_is_none(tmp_path, pair):
    assert corner(pair, 1e-5, tmp_path) == (["#..", "#.?"], (1.0, 2.0))
    assert corner(pair, 6.283185, tmp_path) == (["#..", "#.?"], (1.0, 2.0))


def test_the_image_is_turned_about_its_lower_left_corner_by_the_yaw(tmp_path, pair):
    quarter = 1.5707963267948966
    assert corner(pair, quarter, tmp_path) == ([".?", "..", "##"], (-1.0, 2.0))
    assert corner(pair, 2 * quarter, tmp_path) == (["?.#", "..#"], (-2.0, 0.0))
    assert corner(pair, -quarter, tmp_path) == (["##", "..", "?."], (1.0, -1.0))


def test_a_number_that_yaml_takes_for_text_is_a_number(pair):
    assert read_ros(pair(resolution="5e-2")).resolution == 0.05


def test_a_byte_order_mark_is_no_part_of_the_first_key(pair):
    path = pair()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert "".join(kinds(read_ros(path))) == "##???..."


def test_the_image_lies_where_the_yaml_lies_or_at_an_absolute_place(tmp_path, pair):
    assert read_ros(pair(image=str(tmp_path / "rooms.pgm"), mode="trinary")).pixels.shape == (1, len(GREYS))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"mode": "binary"}, "mode is 'binary'; give one of trinary, scale, raw"),
        ({"mode": "3"}, "mode is 3; give one of"),
        ({"text": "image: a.pgm\nnegate: 0\nnegate: 1\n"}, "the key negate twice, in lines 2 and 3; leave one"),
        ({"text": "- {a: 1, b: {c: 1, c: 2}}"}, "the key c twice"),
        ({"origin": "[0, 0]"}, r"origin is \[0, 0\]"),
        ({"origin": "[0, .nan, 0]"}, "origin's y is nan"),
        ({"origin": "[1e300, 0, 0]"}, "origin's x is "),
        ({"origin": None}, "lacks origin; a map of map_server has image"),
        ({"image": None, "resolution": None}, "lacks image, resolution"),
        ({"resolution": "0"}, "resolution is 0;"),
        ({"resolution": "-0.05"}, "resolution is -0.05;"),
        ({"resolution": ".inf"}, "resolution is inf;"),
        ({"resolution": "fine"}, "resolution is 'fine';"),
        ({"resolution": "true"}, "resolution is True;"),
        ({"resolution": "[1]"}, r"resolution is \[1\];"),
        ({"occupied_thresh": "65"}, "occupied_thresh is 65; give a number from 0 to 1"),
        ({"free_thresh": "0.7"}, "free_thresh 0.7 is not below occupied_thresh 0.65"),
        ({"negate": "2"}, "negate is 2"),
        ({"image": "3"}, "image is 3"),
        ({"text": "image: [rooms.pgm"}, "not YAML in line 1"),
        ({"text": "a: &x [*x"}, "an alias"),
        ({"text": "a: 2001-99-99"}, "not YAML"),
        ({"text": "[" * 5000}, "lie more than 20 deep"),
        ({"text": "!!python/object/apply:os.system ['true']"}, "a tag"),
        ({"text": ""}, "holds no keys"),
        ({"text": "- 1\n- 2\n"}, "holds no keys"),
        ({"text": "#" * 1_000_001}, "has 1,000,001 bytes"),
    ],
)
def test_what_is_no_pair_is_refused_with_what_is_wrong(pair, changes, named):
    with pytest.raises(ValueError, match=named) as error:
        read_ros(pair(**changes))
    assert "\n" not in str(error.value)


def test_an_image_that_is_missing_or_damaged_is_named(tmp_path, pair):
    path = pair()
    with pytest.raises(FileNotFoundError, match=r"gone\.pgm"):
        read_ros(pair(image="gone.pgm"))
    pair()
    (tmp_path / "rooms.pgm").write_bytes(b"P5\n8 6\n255\nshort")
    with pytest.raises(ValueError, match=r"'rooms\.pgm' is no whole image"):
        read_ros(path)
