"""The stored results belong together: what two suites run alike came out alike."""

from pathlib import Path

import pandas as pd
import pytest

from explore_bench.analysis.csv_files import read_csv
from explore_bench.runs.suites import plan

RESULTS = Path(__file__).parents[2] / "results"
ALIKE = ["strategy", "training_seed", "size", "trial"]
NUMBERS = ["steps", "decisions", "trajectory_error", "exploration_efficiency", "path_length"]


def of_paper(folder):
    trials = read_csv(folder / "trials.csv", ("scenario", *ALIKE, *NUMBERS))
    return trials[trials["scenario"] == "paper"].fillna({"training_seed": -1})


@pytest.mark.parametrize("suite", ["robustness", "field"])
def test_trials_that_two_suites_run_alike_came_out_alike(suite):
    both = of_paper(RESULTS).merge(of_paper(RESULTS / suite), on=ALIKE, suffixes=("", " there"))
    assert len(both) > 200
    for name in NUMBERS:
        pd.testing.assert_series_equal(both[name], both[f"{name} there"], check_names=False, check_exact=True)


@pytest.mark.parametrize("suite", ["paper", "robustness", "field", "stage", "plans", "figure16"])
def test_stored_results_are_of_all_trials_of_their_suite(suite):
    folder = RESULTS if suite == "paper" else RESULTS / suite
    names = ["strategy", "scenario", "size", "trial"]
    stored = read_csv(folder / "trials.csv", names)[names]
    planned = {(spec.strategy, spec.scenario_name, spec.scenario.size, spec.trial) for spec in plan(suite).specs}
    assert set(stored.itertuples(index=False, name=None)) == planned
