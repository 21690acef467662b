"""Where in its own source a strategy raised, as it is told."""

import sys

import pytest

from explore_bench.strategies.loading import StrategyError, make_strategy
from explore_bench.strategies.tracing import MOST_CODE, place_of, with_place

SOURCE = """import json


class Mine:
    def __init__(self, text="{"):
        self.text = text

    def reset(self, rng):
        self.parsed(self.text)

    def parsed(self, text):
        return json.loads(text)  # a library raises

    def choose(self, observation):
        try:
            self.parsed("{")
        except ValueError as error:
            raise LookupError("no map") from error
"""


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "mine.py").write_text(SOURCE)
    return f"{tmp_path / 'mine.py'}:Mine"


def raised(function):
    with pytest.raises(BaseException) as caught:
        function()
    return caught.value


def test_it_is_the_innermost_line_of_its_own_file(mine, tmp_path, monkeypatch):
    error = raised(lambda: make_strategy(mine, {}).reset(None))
    assert place_of(error, mine) == f"{tmp_path}/mine.py:12: return json.loads(text) # a library raises"
    monkeypatch.chdir(tmp_path)
    assert place_of(error, mine) == "mine.py:12: return json.loads(text) # a library raises"
    assert place_of(error, mine.replace(str(tmp_path), ".")).startswith("mine.py:12: "), "named from here"


def test_of_an_error_raised_from_another_it_is_where_the_last_was_raised(mine):
    error = raised(lambda: make_strategy(mine, {}).choose(None))
    assert place_of(error, mine).endswith('mine.py:18: raise LookupError("no map") from error')


@pytest.mark.parametrize(
    ("source", "place"),
    [
        ("import no_such_module_anywhere\n", "mine.py:1: import no_such_module_anywhere"),
        ("x = 1\nclass Mine(:\n", "mine.py:2: class Mine(:"),
        ("class Mine:\n    def __init__(self):\n        self.x = undefined\n", "mine.py:3: self.x = undefined"),
    ],
    ids=["import", "syntax", "making"],
)
def test_an_error_before_it_is_made_has_its_place(tmp_path, source, place):
    (tmp_path / "mine.py").write_text(source)
    error = raised(lambda: make_strategy(f"{tmp_path / 'mine.py'}:Mine", {}))
    assert isinstance(error, StrategyError)
    assert place_of(error, f"{tmp_path / 'mine.py'}:Mine") == f"{tmp_path}/{place}"


def test_of_a_package_it_is_the_module_that_raised(tmp_path, monkeypatch):
    (tmp_path / "own_package").mkdir()
    (tmp_path / "own_package" / "__init__.py").write_text("")
    (tmp_path / "own_package" / "deep.py").write_text("def fall():\n    raise ValueError\n")
    (tmp_path / "own_package" / "mine.py").write_text("from own_package import deep\n\nMine = deep.fall\n")
    monkeypatch.syspath_prepend(tmp_path)
    error = raised(lambda: make_strategy("own_package.mine:Mine", {}))
    assert place_of(error, "own_package.mine:Mine") == f"{tmp_path}/own_package/deep.py:2: raise ValueError"
    for name in [name for name in sys.modules if name.startswith("own_package")]:
        del sys.modules[name]


def test_an_error_that_its_source_has_no_part_in_has_no_place(mine):
    error = raised(lambda: make_strategy(mine, {"no": 1}))
    assert place_of(error, mine) == ""
    assert place_of(error, "no_such_module_anywhere:Mine") == ""
    assert with_place("it failed", "") == "it failed"
    assert with_place("it failed", "mine.py:3") == "it failed, in mine.py:3"


def test_a_long_line_and_one_without_text_have_a_place_of_bounded_length(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(f"class Mine:\n    def __init__(self):\n        raise ValueError({'1 + ' * 500}1)\n")
    error = raised(lambda: make_strategy(f"{file}:Mine", {}))
    place = place_of(error, f"{file}:Mine")
    assert len(place) <= len(f"{file}:3: ") + MOST_CODE
    assert " … " in place
    file.unlink()
    assert place_of(error, f"{file}:Mine") == f"{file}:3"


def test_an_error_that_is_its_own_cause_has_an_end(mine):
    error = ValueError("round")
    error.__cause__ = LookupError("and round")
    error.__cause__.__cause__ = error
    assert place_of(error, mine) == ""
