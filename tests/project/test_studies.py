"""Tables of the studies that measure the same thing say the same."""

from pathlib import Path

import pandas as pd
import pytest

STUDIES = Path(__file__).parents[2] / "docs" / "studies"


def test_entropy_takes_as_long_in_the_study_of_its_fringe_as_in_that_of_its_path_weight():
    """Both play the rule without a weight in the same calibration worlds."""
    fringe = pd.read_csv(STUDIES / "entropy-fringe.csv").set_index("size [m]")
    sweep = pd.read_csv(STUDIES / "path-weights.csv").set_index(["strategy", "value"]).loc["entropy", 0.0]
    assert list(fringe["worlds"]) == [20, 20]
    for size, steps in fringe["T"].items():
        assert steps == pytest.approx(sweep[f"T {size}"], abs=0.051)  # a decimal less
