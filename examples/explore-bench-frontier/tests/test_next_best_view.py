"""The strategy by hand, and by explore-bench's own rules."""

from types import SimpleNamespace

import numpy as np
import pytest
from explore_bench_frontier import STRATEGIES
from explore_bench_frontier.claims import CLAIMS
from explore_bench_frontier.next_best_view import NextBestView, unknown_area

from explore_bench import RequestError, Scenario, check


@pytest.fixture
def seen():
    """Two candidates of a 20 m map of which the right half is unknown: one on its edge and far, one inside and near."""
    known = np.zeros((10, 10), dtype=bool)
    known[:, :5] = True
    scenario = Scenario(size=20.0)
    return SimpleNamespace(
        scenario=scenario,
        belief=SimpleNamespace(known=known, view=lambda places: scenario.grid.in_reach(places, scenario.sensor_range)),
        positions=np.array([[9.0, 9.0], [3.0, 9.0]]),
        path_lengths=np.array([12.0, 2.0]),
    )


def test_the_area_is_that_of_the_unknown_cells_in_view(seen):
    """From (9, 9), 5 m reach the cells at (11, 5 … 13) and (13, 7 … 11)."""
    assert unknown_area(seen).tolist() == [4.0 * 8, 0.0]


def test_without_decay_only_the_view_counts_and_an_empty_view_never_does(seen):
    assert NextBestView(decay=0.0).choose(seen) == 0
    assert NextBestView(decay=0.5).choose(seen) == 0


def test_among_equal_gains_the_shorter_path_is_taken(seen):
    seen.belief.known[:] = True
    assert NextBestView().choose(seen) == 1


def test_a_negative_decay_is_refused():
    with pytest.raises(RequestError, match="decay of the next-best view is -1"):
        NextBestView(decay=-1)


def test_the_claim_compares_what_is_registered():
    assert {name for one in CLAIMS[0].comparisons for name in (one.better, one.worse)} == STRATEGIES.keys()


@pytest.mark.parametrize("name", STRATEGIES)
def test_the_contract_is_kept(name):
    for finding in check(name):
        assert finding.ok, finding
