"""Seven significant digits: what is kept, and that nothing written depends on those after them."""

import dataclasses
import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st

from explore_bench.analysis.csv_files import plain
from explore_bench.analysis.rounding import DIGITS, ROUNDING, rounded, significant
from explore_bench.records.provenance import trial_key
from explore_bench.records.store import Store
from explore_bench.report.render import write_report


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        (math.pi, 3.141593),
        (-math.pi * 1e-9, -3.141593e-9),
        (123456789.0, 123456800.0),
        (0.41801615283726, 0.4180162),
        (1.0, 1.0),
        (9.9999999, 10.0),
        (0.0, 0.0),
    ],
)
def test_seven_digits_are_kept(value, kept):
    assert significant(np.array([value])).tolist() == [kept]


def test_what_is_no_number_stays():
    values = np.array([math.nan, math.inf, -math.inf])
    np.testing.assert_array_equal(significant(values), values)


@given(st.floats(min_value=1e-12, max_value=1e12), st.sampled_from((1.0, -1.0)))
def test_it_is_what_seven_digits_written_and_read_give(value, sign):
    kept = significant(np.array([sign * value]))
    assert kept == pytest.approx(float(f"{sign * value:.{DIGITS}g}"), rel=1.01 * ROUNDING)
    assert float(f"{kept[0]:.{DIGITS}g}") == kept[0]
    np.testing.assert_array_equal(significant(kept), kept)


def test_whole_numbers_and_words_of_a_table_stay():
    table = pd.DataFrame({"a": [1234567891, 2], "b": ["x", "y"], "c": [1 / 3, math.nan]})
    assert rounded(table).equals(table.assign(c=[0.3333333, math.nan]))
    assert plain({"p": 1 / 3, "n": 1234567891, "none": math.nan}) == {"p": 0.3333333, "n": 1234567891, "none": None}


def on_another_machine(record, rng):
    """Return a record whose numbers differ from the twelfth digit on, but for short ones: a start is given."""
    steps = dict(record.steps)
    for name, values in steps.items():
        if values.dtype == np.float64 and name != "explored":  # a ratio of whole numbers
            other = values * (1.0 + 1e-11 * rng.uniform(-1.0, 1.0, len(values)))
            steps[name] = np.where(values == np.round(values, 6), values, other)
    return dataclasses.replace(record, steps=steps)


@pytest.mark.usefixtures("without_training_figures")
def test_another_machine_writes_the_same_bytes(own_store, monkeypatch):
    first = {file: file.read_bytes() for file in write_report(own_store.folder).files}
    rng, survey = np.random.default_rng(0), Store.survey
    others = {trial_key(record.spec): on_another_machine(record, rng) for _, record in own_store.survey()}
    monkeypatch.setattr(Store, "find", lambda self, spec: others[trial_key(spec)])
    monkeypatch.setattr(Store, "survey", lambda *told, **how: ((p, others[p.stem]) for p, _ in survey(*told, **how)))
    second = {file: file.read_bytes() for file in write_report(own_store.folder).files}
    assert first.keys() == second.keys()
    assert [file.name for file in first if first[file] != second[file]] == []
