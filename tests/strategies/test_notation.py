"""NAME[key=value,…]: what is read from it, what is refused, and that the canonical form reads back."""

import math

import pytest
from hypothesis import given, strategies as st

from explore_bench.errors import RequestError
from explore_bench.strategies.notation import split_parameters, written_parameters


@pytest.mark.parametrize(
    ("written", "name", "parameters"),
    [
        ("entropy", "entropy", {}),
        ("entropy[]", "entropy", {}),
        ("entropy[alpha=0.5]", "entropy", {"alpha": 0.5}),
        ("gcn-obs[ b = true , a = [1, 2] ]", "gcn-obs", {"a": [1, 2], "b": True}),
        ("entropy[alpha=inf]", "entropy", {"alpha": math.inf}),
        ('./mine.py:Mine[k=3,name="x"]', "./mine.py:Mine", {"k": 3, "name": "x"}),
        ("./mine.py:Mine[name=x,k=-3]", "./mine.py:Mine", {"k": -3, "name": "x"}),
        ("mine.py:Mine[weights=a/w-0.safetensors]", "mine.py:Mine", {"weights": "a/w-0.safetensors"}),
        ("a.b:C[k=1e3]", "a.b:C", {"k": 1000.0}),
        ("/a[b]/c.py:X", "/a[b]/c.py:X", {}),
        ("/a[b]/c.py:X[k=[[1], []]]", "/a[b]/c.py:X", {"k": [[1], []]}),
        ("entropy[deep={a=1, b='c'}]", "entropy", {"deep": {"a": 1, "b": "c"}}),
        ('x[name="a:b[c], d=e"]', "x", {"name": "a:b[c], d=e"}),
    ],
)
def test_a_name_and_its_parameters_are_told_apart(written, name, parameters):
    assert split_parameters(written) == (name, parameters)


@pytest.mark.parametrize(
    "written",
    ["entropy[alpha]", "entropy[=1]", "entropy[alpha=1 2]", "entropy[alpha=1,alpha=2]", "entropy[a=1\nb=2]"]
    + ["entropy[a=1}\nb={c=2]", "entropy[a=07]", "entropy[a=]", "entropy[0.5]"],
)
def test_what_is_no_list_of_parameters_is_refused_with_the_form(written):
    with pytest.raises(RequestError, match=r"write values like 0\.5") as caught:
        split_parameters(written)
    assert "entropy" in str(caught.value)


@pytest.mark.parametrize(("value", "words"), [("2020-01-01", "a date"), ("nan", "nan")])
def test_values_that_no_record_can_keep_are_refused(value, words):
    with pytest.raises(RequestError, match=words):
        split_parameters(f"entropy[alpha={value}]")


def test_the_canonical_form_is_sorted_and_quoted():
    assert written_parameters({"b": "x y", "a": 0.5, "c": [True, {"e": 1, "d": -math.inf}]}) == (
        'a=0.5, b="x y", c=[true, {d=-inf, e=1}]'
    )


TEXTS = st.text(st.characters(exclude_categories=["C", "Z"]), max_size=8) | st.sampled_from(["a b", '"', "]", "[", "="])
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False) | TEXTS,
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=6,
)


NAMES = st.text("aZ_9", min_size=1, max_size=5).filter(str.isidentifier)


@given(st.dictionaries(NAMES, VALUES, max_size=4))
def test_the_canonical_form_reads_back(parameters):
    written = written_parameters(parameters)
    name, found = split_parameters(f"entropy[{written}]")
    assert (name, found) == ("entropy", parameters)
    assert written_parameters(found) == written
