"""What the shell completes is what there is, and it comes at once."""

import os
import resource
import subprocess
import sys

import pytest

from explore_bench.cli import completion
from explore_bench.runs.suites import SUITES
from explore_bench.strategies.registry import strategies
from explore_bench.world.maps import gallery
from explore_bench.world.scenarios import SCENARIOS

HEAVY = ("numpy", "pydantic", "torch", "gtsam", "pandas", "scipy", "numba", "pyarrow", "matplotlib", "joblib", "dask")


def test_the_names_are_those_that_there_are():
    """They are read from the source, so a table that moves is missed here."""
    assert completion.suites() == list(SUITES)
    assert completion.scenarios() == list(SCENARIOS)
    assert completion.maps() == list(gallery())
    assert set(completion.strategies()) == {name for name, entry in strategies().items() if entry.ready}
    assert set(completion.learned()) == {name for name, entry in strategies().items() if entry.trainer}
    with pytest.raises(LookupError, match="no NOTHING"):
        completion._keys("runs/suites.py", "NOTHING")


def completed(line, tmp_path):
    """Return what bash is told at the end of a line, in a process that says what it imported."""
    code = f"""
import atexit, sys
atexit.register(lambda: print("heavy:", *[name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr))
from explore_bench.cli import main
main([])
"""
    words = line.split()
    number = len(words) if line.endswith(" ") else len(words) - 1
    asked = {"_EXPLORE_BENCH_COMPLETE": "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(number)}
    found = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | asked, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert found.stderr.strip() == "heavy:", found.stderr
    return [tuple(one.split(",", 1)) for one in found.stdout.split()]


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("explore-bench run t", [("plain", "table2"), ("plain", "table3")]),
        ("explore-bench run smoke -s near", [("plain", "nearest")]),
        ("explore-bench run smoke -s ./mi", [("file", "./mi")]),
        ("explore-bench check uncert", [("plain", "uncertainty")]),
        ("explore-bench demo nearest --map l", [("plain", "loop")]),
        ("explore-bench run smoke --scenario ch", [("plain", "chen2020")]),
        ("explore-bench train gcn-n", [("plain", "gcn-no-obs")]),
        ("explore-bench list su", [("plain", "suites")]),
        ("explore-bench dem", [("plain", "demo")]),
        ("explore-bench run nothing-like-it", []),
    ],
)
def test_a_word_is_completed_by_what_fits_and_nothing_heavy_is_imported(tmp_path, line, found):
    assert completed(line, tmp_path) == found


@pytest.mark.parametrize("line", ["explore-bench run ", "explore-bench run smoke -s "])
def test_a_completion_takes_under_0_3_seconds(tmp_path, line):
    """Processor time, the best of five: a busy machine slows a process down and never speeds it up."""

    def spent():
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime

    times = []
    for _ in range(5):
        before = spent()
        assert len(completed(line, tmp_path)) >= len(SUITES)
        times.append(spent() - before)
    assert min(times) < 0.3
