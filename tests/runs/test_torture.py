"""`make torture` in small: whatever is killed, filled up, wounded or let loose, nothing is lost and nobody harmed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TORTURE = Path(__file__).parents[1] / "torture.py"


@pytest.mark.slow
def test_a_hundredth_of_the_torture_violates_nothing():
    """A row for every part, each tried at least once where the machine allows it."""
    done = subprocess.run(
        [sys.executable, TORTURE, "--share", "0.01"],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(TORTURE.parent), *filter(None, sys.path)])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in done.stdout.splitlines()[2:] if line]
    assert len(rows) == 10
    for name, tried, violated in rows:
        assert tried.startswith("not tried: ") or int(tried) >= 1, name
        assert violated == "0"
    assert not rows[0][1].startswith("not"), "kills are possible everywhere"
