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


def test_colours_are_averaged_and_what_is_transparent_is_unknown(tmp_path, pair):
    path = pair(image="rooms.png")
    colors = [(255, 255, 255, 255), (255, 0, 0, 255), (0, 0, 0, 255), (0, 0, 0, 0)]
    Image.fromarray(np.array([colors], dtype=np.uint8)).save(tmp_path / "rooms.png")
    assert "".join(kinds(read_ros(path))) == ".##?"


def test_a_number_that_yaml_takes_for_text_is_a_number(pair):
    assert read_ros(pair(resolution="5e-2")).resolution == 0.05


def test_the_image_lies_where_the_yaml_lies_or_at_an_absolute_place(tmp_path, pair):
    assert read_ros(pair(image=str(tmp_path / "rooms.pgm"), mode="trinary")).pixels.shape == (1, len(GREYS))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"mode": "raw"}, "mode 'raw' is not supported"),
        ({"mode": "scale"}, "mode 'scale' is not supported"),
        ({"origin": "[0, 0, 1.57]"}, "yaw is 1.57; turn the image"),
        ({"origin": "[0, 0]"}, r"origin is \[0, 0\]"),
        ({"origin": "[0, .nan, 0]"}, "origin's y is nan"),
        ({"origin": "[1e300, 0, 0]"}, "origin's x is "),
        ({"origin": None}, "lacks origin; a map of map_server has image"),
        ({"negate": None, "free_thresh": None}, "lacks negate, free_thresh"),
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
