"""SVG in fewer bytes: the same picture, ids of its own."""

import re

import numpy as np
import pytest
from hypothesis import given, strategies as st

from explore_bench.report.vector import LONG, TOLERANCE, inline, short_path, slim, thinned, width_of

WHOLE = """<?xml version="1.0"?>
<!DOCTYPE svg PUBLIC "x" "y">
<svg xmlns:xlink="http://www.w3.org/1999/xlink" width="90pt" height="60pt" viewBox="0 0 90 60" version="1.1">
 <metadata>who</metadata>
 <defs><style type="text/css">*{stroke-linejoin: round; stroke-linecap: butt}</style></defs>
 <g id="axes_1"><!-- <script> -->
  <path d="M 0 0
L 1.234567 2
" clip-path="url(#p1)" style="fill: none; stroke: #000000"/>
  <path d="M 5 5
L 6 6
" clip-path="url(#p1)" style="fill: none; stroke: #000000"/>
  <use xlink:href="#axes_1"/>
 </g>
</svg>
"""


def absolute(data):
    """Points of a path, absolute, by walking its relative commands."""
    x = y = sx = sy = 0.0
    points = []
    sizes = {"M": 1, "l": 1, "q": 2, "c": 3}
    for command, text in re.findall(r"([Mlqcz])([^Mlqcz]*)", data):
        numbers = [float(number) for number in re.findall(r"-?\d*\.?\d+", text)]
        if command == "z":
            x, y = sx, sy
            continue
        count = sizes[command]
        for i in range(0, len(numbers), 2 * count):
            own = [(numbers[i + 2 * k], numbers[i + 2 * k + 1]) for k in range(count)]
            own = own if command == "M" else [(x + a, y + b) for a, b in own]
            points += own
            x, y = own[-1]
        if command == "M":
            sx, sy = x, y
    return points


number = st.floats(-900, 900).map(lambda value: round(value, 6))
command = st.one_of(
    st.tuples(st.just("L"), st.lists(number, min_size=2, max_size=2)),
    st.tuples(st.just("Q"), st.lists(number, min_size=4, max_size=4)),
    st.tuples(st.just("C"), st.lists(number, min_size=6, max_size=6)),
    st.just(("z", [])),
)


@given(st.lists(command, max_size=LONG - 2))
def test_every_point_of_a_short_path_stays_within_half_a_hundredth(commands):
    commands = [("M", [1.5, -2.25]), *commands]
    data = " \n".join(f"{name} {' '.join(f'{value:.6f}' for value in values)}" for name, values in commands)
    wanted = [pair for _, values in commands for pair in zip(values[::2], values[1::2], strict=True)]
    found = absolute(short_path(data))
    assert np.array(found) == pytest.approx(np.array(wanted), abs=0.00501)


def test_offsets_are_written_without_a_zero_or_a_blank_too_many():
    assert short_path("M 1 2 \nL 1.5 1.5 \nL 0 0 \nz \n") == "M1 2l.5-.5-1.5-1.5z"


def test_a_command_that_matplotlib_does_not_write_is_left_alone():
    assert short_path("M 0 0 A 1 1 0 0 0 2 2") == "M 0 0 A 1 1 0 0 0 2 2"


def distance(point, line):
    a, b = np.array(line[:-1], dtype=float), np.array(line[1:], dtype=float)
    along = b - a
    square = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - a) * along).sum(axis=1) / square, 0, 1)
    return np.hypot(*(a + share[:, None] * along - point).T).min()


@given(st.lists(st.tuples(st.integers(-300, 300), st.integers(-300, 300)), min_size=LONG + 1, max_size=120))
def test_a_thinned_line_passes_every_point_at_the_tolerance(points):
    found = thinned(points)
    assert (found[0], found[-1]) == (points[0], points[-1])
    assert set(found) <= set(points)
    assert max(distance(np.array(point), found) for point in points) <= TOLERANCE + 1e-6


def test_a_straight_line_of_many_points_is_its_ends():
    assert len(thinned([(10 * i, 20 * i) for i in range(200)])) <= 3


def test_a_line_that_turns_back_keeps_its_tip():
    there = [(10 * i, 0) for i in range(30)]
    assert (290, 0) in thinned([*there, *reversed(there)])


def test_neighbours_of_one_style_become_one_path_and_see_through_ones_do_not():
    text = slim(WHOLE)
    assert text.count("<path") == 1
    assert 'd="M0 0l1.23 2M5 5l1 1"' in text
    assert slim(WHOLE.replace("fill: none;", "fill: none; stroke-opacity: 0.7;")).count("<path") == 2
    assert slim(WHOLE.replace("fill: none", "fill: #ff0000")).count("<path") == 2


def test_comments_and_metadata_go():
    assert "script" not in slim(WHOLE)
    assert "who" not in slim(WHOLE)


def test_a_picture_in_a_page_has_ids_of_its_own_and_no_style_for_others():
    text = inline(slim(WHOLE), "figure-1", 'A "title" <b>')
    assert text.startswith("<svg")
    assert 'aria-label="A &quot;title&quot; &lt;b&gt;"' in text
    assert 'id="figure-1-axes_1"' in text
    assert 'xlink:href="#figure-1-axes_1"' in text
    assert "url(#figure-1-p1)" in text
    assert "<style" not in text
    assert 'style="stroke-linejoin: round; stroke-linecap: butt"' in text
    assert "90pt" not in text
    assert width_of(text) == 90
