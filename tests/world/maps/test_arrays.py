"""Arrays of numpy: truth values, probabilities, percent, and what is refused."""

import math

import numpy as np
import pytest

from explore_bench.world.maps.arrays import read_array
from explore_bench.world.maps.raster import FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL

F, X, U = FREE_PIXEL, OCCUPIED_PIXEL, UNKNOWN_PIXEL


@pytest.fixture
def saved(tmp_path):
    def write(array):
        np.save(tmp_path / "map.npy", array, allow_pickle=True)
        return tmp_path / "map.npy"

    return write


@pytest.mark.parametrize(
    ("array", "kinds"),
    [
        (np.array([[True, False]]), [[X, F]]),
        (np.array([[0.0, 0.1, 0.4, 0.7, 1.0, math.nan]]), [[F, F, U, X, X, U]]),
        (np.array([[0, 1, -1]]), [[F, X, U]]),
        (np.array([[0, 19, 20, 65, 66, 100, -1]], dtype=np.int8), [[F, F, U, U, X, X, U]]),
        (np.array([[0, 1]], dtype=np.uint8), [[F, X]]),
        (np.asfortranarray(np.array([[0.0, 1.0], [1.0, 0.0]], dtype=np.float32)), [[F, X], [X, F]]),
    ],
)
def test_what_entries_mean(saved, array, kinds):
    raster = read_array(saved(array), 0.25)
    assert raster.pixels.tolist() == kinds
    assert raster.resolution == 0.25


@pytest.mark.parametrize(
    ("array", "named"),
    [
        (np.zeros((2, 2, 2)), "3 axes of float64"),
        (np.zeros(5), "1 axes of float64"),
        (np.zeros((2, 2), dtype=complex), "complex128"),
        (np.array([["#", "."]]), "<U1"),
        (np.array([[1, "a"]], dtype=object), "no whole .npy file of plain numbers"),
        (np.zeros((2, 2), dtype=[("x", float)]), "2 axes of"),
        (np.full((2, 2), 255, dtype=np.uint8), "largest value is 255"),
        (np.array([[math.inf, 0.0]]), "largest value is inf"),
        (np.zeros((0, 3)), "3 × 0 pixels"),
        (np.broadcast_to(np.zeros((), dtype=bool), (5001, 5000)), "5000 × 5001 pixels, more than"),
    ],
)
def test_what_is_no_map_is_refused_by_what_it_is(saved, array, named):
    with pytest.raises(ValueError, match=named) as error:
        read_array(saved(array), 1.0)
    assert "\n" not in str(error.value)


def test_an_array_of_which_all_is_unknown_is_read_as_that(saved):
    assert read_array(saved(np.full((2, 2), math.nan)), 1.0).pixels.tolist() == [[U, U], [U, U]]


def test_a_file_that_is_cut_or_lies_about_its_size_or_is_another_is_refused(saved, tmp_path, recwarn):
    path = saved(np.zeros((4, 4)))
    whole = path.read_bytes()
    huge = whole.replace(b"(4, 4)", b"(9999999999, 9999999999)")
    np.savez(tmp_path / "two.npz", a=np.zeros((2, 2)))
    archive = (tmp_path / "two.npz").read_bytes()
    for content in (whole[:-9], whole[:30], whole[:7], b"", b"no array", huge, archive):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=r"no whole \.npy file|several arrays"):
            read_array(path, 1.0)
    assert not recwarn.list
