"""Files of others: whatever they hold, one sentence, within seconds and little memory."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest

from explore_bench.analysis.csv_files import read_csv
from explore_bench.errors import RequestError
from explore_bench.files import MOST_DEPTH, MOST_TEXT, bounded, parse_json, parse_toml, parse_yaml, read_text
from explore_bench.strategies.notation import split_parameters
from explore_bench.world.landmark.world import LandmarkWorld
from explore_bench.world.maps import with_map
from explore_bench.world.scenario import Scenario
from explore_bench.world.scenarios import PAPER, load_scenario

DEEP = 100_000
LETTERS = "abcdefghijklmnopqrstuvwxyz"
PAIRS = zip(LETTERS[1:], LETTERS, strict=False)
BOMB = "a: &a [x, x]\n" + "".join(f"{new}: &{new} [*{old}, *{old}]\n" for new, old in PAIRS)


@pytest.mark.parametrize("values", [{"a": [1, {"b": "c"}]}, [], "text", None, 2**62, {"x": [0.5] * 1000}])
def test_plain_values_pass(values):
    assert bounded(values) is values
    assert parse_json(json.dumps(values)) == values


def test_limits_are_met_and_not_crossed():
    nested = 0
    for _ in range(MOST_DEPTH - 1):
        nested = [nested]
    assert bounded(nested) is nested
    with pytest.raises(ValueError, match="deep"):
        bounded([nested])


HOSTILE_TOML = {
    "a key of 20,000 parts": (".".join("a" * 20_000) + " = 1", "parts"),
    "one of quoted parts": (".".join(['"a"'] * 20_000) + " = 1", "parts"),
    "a header of 20,000 parts": ("[" + ".".join("a" * 20_000) + "]", "parts"),
    "deep lists": ("a = " + "[" * DEEP, "deep"),
    "lists that end": ("a = " + "[" * 30 + "]" * 30, "deep"),
    "deep tables": ("a = " + "{b = " * 30 + "1" + "}" * 30, "deep"),
    "a long integer": ("a = " + "9" * 5000, "digits"),
    "an integer of 1,000 digits": ("a = " + "9" * 1000, "3322 bits"),
    "something else": ("size == 3", "not TOML"),
    "two of one key": ("a = 1\na = 2", "not TOML"),
}


@pytest.mark.parametrize("kind", HOSTILE_TOML)
def test_hostile_toml_is_one_sentence_at_once(kind, tmp_path):
    text, words = HOSTILE_TOML[kind]
    begin = time.perf_counter()
    with pytest.raises(ValueError, match=words) as caught:
        parse_toml(text)
    path = tmp_path / "own.toml"
    path.write_text(text)
    with pytest.raises(RequestError, match=words):
        load_scenario(str(path))
    assert time.perf_counter() - begin < 5.0
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "values", [".".join("a" * 20_000) + "=1", "a=" + "[" * 5000, "a=" + "9" * 5000, "a=" + "[" * 30 + "]" * 30]
)
def test_hostile_parameters_of_a_strategy_are_one_sentence(values):
    with pytest.raises(RequestError, match="does not read"):
        split_parameters(f"entropy[{values}]")


HOSTILE_YAML = {
    "aliases": (BOMB, "an alias, [*]a"),
    "a tag": ("image: !!python/object/apply:os.system [ls]", "a tag"),
    "another tag": ("resolution: !!float 0.05", "a tag"),
    "deep lists": ("image: " + "[" * DEEP, "deep"),
    "a long integer": ("resolution: " + "9" * 5000, "digits"),
    "an integer of 1,000 digits": ("resolution: " + "9" * 1000, "3322 bits"),
    "no YAML": ("image: [", "not YAML in line"),
}


@pytest.mark.parametrize("kind", HOSTILE_YAML)
def test_hostile_yaml_is_one_sentence_at_once(kind):
    text, words = HOSTILE_YAML[kind]
    begin = time.perf_counter()
    with pytest.raises(ValueError, match=words) as caught:
        parse_yaml(text)
    assert time.perf_counter() - begin < 5.0
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * DEEP, "deep"),
        ("[" * 30 + "]" * 30, "deep"),
        ("9" * 5000, "not JSON"),
        ("9" * 1000, "bits"),
        ("{", "not JSON"),
    ],
)
def test_hostile_json_is_one_sentence(text, words):
    with pytest.raises(ValueError, match=words):
        parse_json(text)


def test_a_byte_order_mark_is_no_content(tmp_path):
    path = tmp_path / "own.toml"
    path.write_bytes(b"\xef\xbb\xbfsize = 30.0\n")
    assert read_text(path) == "size = 30.0\n"
    assert load_scenario(str(path)).size == 30.0


def test_what_is_no_regular_file_is_refused_at_once(tmp_path):
    fifo = tmp_path / "pipe.toml"
    os.mkfifo(fifo)
    for path in (fifo, tmp_path, "/dev/zero"):
        with pytest.raises(ValueError, match="no regular file"):
            read_text(type(tmp_path)(path))
    with pytest.raises(RequestError, match="no regular file"):
        load_scenario(str(fifo))
    for reader in ("trials.csv",):
        os.mkfifo(tmp_path / reader)
        with pytest.raises(RequestError, match="no regular file"):
            read_csv(tmp_path / reader, ())


def test_a_text_that_is_too_large_is_refused(tmp_path):
    path = tmp_path / "own.toml"
    path.write_text("#" * (MOST_TEXT + 1))
    with pytest.raises(RequestError, match="at most"):
        load_scenario(str(path))


@pytest.mark.parametrize("seed", ["1.5", "inf", "1e23", "-inf", "first"])
def test_a_seed_in_a_table_that_is_none_is_one_sentence(seed, tmp_path):
    path = tmp_path / "trials.csv"
    path.write_text(f"strategy,training_seed\nmine,{seed}\n")
    with pytest.raises(RequestError, match="cannot be read") as caught:
        read_csv(path, ("strategy", "training_seed"))
    assert "\n" not in str(caught.value)


def test_a_long_name_or_value_is_shortened_in_what_is_said_of_it():
    for values in ({"a" * 10_000: 1}, {"size": "b" * 10_000}, {"kind": "c" * 10_000}):
        with pytest.raises(RequestError) as caught:
            Scenario(**{"kind": "landmark", **values})
        assert len(str(caught.value)) < 1500


def test_a_damaged_header_of_an_array_is_one_sentence(tmp_path):
    path = tmp_path / "map.npy"
    np.save(path, np.zeros((4, 4)))
    path.write_bytes(path.read_bytes().replace(b"}", b"("))
    with pytest.raises(RequestError, match=r"no whole \.npy file"):
        with_map(PAPER, path)


# Constants of a scenario, one to another


@pytest.mark.parametrize(
    ("constants", "words"),
    [
        ({"step_length": 1e-9}, "step_length 1e-09 m makes more than 1000 steps"),
        ({"steps_per_cell": 1e6}, "steps_per_cell 1e[+]06 lets a trial take 100,000,000 steps"),
        ({"sensor_range": 1e6}, "sensor_range 1e[+]06 m is more than 200 cells"),
        ({"kind": "lidar", "tick": 1e-9}, "ticks of 1e-09 s; lengthen"),
        ({"kind": "lidar", "tick": 10.0}, "in a tick of 10 s the robot drives 5.5 m"),
        ({"kind": "lidar", "sensor_range": 1e6}, "more than 200 cells"),
    ],
)
def test_constants_that_do_not_fit_one_another_are_refused_at_once(constants, words):
    begin = time.perf_counter()
    with pytest.raises(RequestError, match=words):
        Scenario(**{"kind": "landmark", **constants})
    assert time.perf_counter() - begin < 5.0


@pytest.mark.parametrize(("thing", "other"), [("landmark", "obstacle"), ("obstacle", "landmark")])
def test_what_is_too_many_is_named_and_no_world_is_drawn_in_vain(thing, other):
    crowded = PAPER.replace(size=40.0, **{f"{thing}_count": 200, f"{other}_count": 3})
    begin = time.perf_counter()
    with pytest.raises(RequestError, match=f"in 0 draws; lower {thing}_density or {thing}_count"):
        LandmarkWorld.draw(crowded, np.random.default_rng(0))
    assert time.perf_counter() - begin < 5.0


@pytest.mark.parametrize("size", [40.0, 200.0])
def test_a_world_that_can_hardly_be_drawn_is_refused_within_seconds(size):
    cells = (size / 2.0) ** 2
    crowded = PAPER.replace(size=size, obstacle_count=int(0.3 * cells), landmark_count=int(0.08 * cells))
    begin = time.perf_counter()
    with pytest.raises(RequestError, match=r"no connected world .* lower obstacle_density"):
        LandmarkWorld.draw(crowded, np.random.default_rng(0))
    assert time.perf_counter() - begin < 20.0, "5 s on a quiet machine"


# Memory


LARGE = r"""
import re, sys
from pathlib import Path
from explore_bench.world.maps import with_map
from explore_bench.world.scenarios import STAGE
try:
    with_map(STAGE, sys.argv[1], 0.01)
except ValueError as error:
    print(error)
print(int(re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[1]) / 1024)
"""


@pytest.mark.parametrize("kind", ["npy", "png"])
def test_the_largest_map_takes_less_than_half_a_gigabyte(kind, tmp_path):
    from PIL import Image

    path = tmp_path / f"large.{kind}"
    if kind == "npy":
        np.save(path, np.zeros((5000, 5000)))
    else:
        Image.new("L", (5000, 5000), 255).save(path)
    done = subprocess.run([sys.executable, "-c", LARGE, str(path)], capture_output=True, text=True, check=True)
    assert float(done.stdout.splitlines()[-1]) < 500.0, done.stdout
