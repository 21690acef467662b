"""Tables of the studies are of this code, and those that measure the same thing say the same."""

from pathlib import Path

import pandas as pd
import pytest

from explore_bench.records.store import Store
from explore_bench.strategies.registry import strategies

STUDIES = Path(__file__).parents[2] / "docs" / "studies"


@pytest.fixture
def studies(monkeypatch):
    """Make the studies importable."""
    monkeypatch.syspath_prepend(str(STUDIES))


def test_entropy_takes_as_long_in_the_study_of_its_fringe_as_in_that_of_its_path_weight():
    """Both play the rule without a weight in the same calibration worlds."""
    fringe = pd.read_csv(STUDIES / "entropy-fringe.csv").set_index("size [m]")
    sweep = pd.read_csv(STUDIES / "path-weights.csv").set_index(["strategy", "value"]).loc["entropy", 0.0]
    assert list(fringe["worlds"]) == [20, 20]
    for size, steps in fringe["T"].items():
        assert steps == pytest.approx(sweep[f"T {size}"], abs=0.051)  # a decimal less


def test_the_study_of_large_maps_has_every_strategy_of_the_paper_at_100_m_and_none_of_its_trials_broke_down():
    """Ten worlds each, explored but by `random`, which is cut off; and `nearest` in three of 200 m."""
    table = pd.read_csv(STUDIES / "scaling.csv")
    papers = {"table2", "table3", "layers"}
    compared = {name for name, entry in strategies().items() if papers & set(entry.tables) and not entry.reference}
    hundred = table[table["size"] == 100].set_index("strategy")
    assert set(hundred.index) == compared
    assert (hundred["trials"] == 10).all()
    assert (hundred["explored_trials"].drop("random") == 10).all()
    assert len(table[(table["size"] == 200) & (table["strategy"] == "nearest") & (table["trials"] == 3)]) == 1
    assert (table["broken_trials"] == 0).all()


@pytest.mark.parametrize("strategy", ["nearest", "belief-attention"])
def test_the_study_of_large_maps_gives_what_its_table_says(studies, strategy):
    """In the worlds of 20 m."""
    from scaling import measured

    stored = pd.read_csv(STUDIES / "scaling.csv").set_index(["strategy", "size"]).loc[strategy, 20.0]
    rows = pd.DataFrame([measured(strategy, 20.0, number, 10**9) for number in range(int(stored["trials"]))])
    for name in ("steps", "e", "eta"):
        assert rows[name].mean() == pytest.approx(stored[name], rel=6e-4), name


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "value"), [("uncertainty", 3.2), ("entropy", 0.1), ("entropy-per-metre", 5.0)])
def test_the_study_of_path_weights_gives_what_its_table_says(studies, strategy, value, tmp_path, monkeypatch):
    """The tuned values, in the worlds of 20 m."""
    import path_weights

    store = Store(tmp_path)
    store.open(0, "calibrate", scenario=None)
    monkeypatch.setattr(path_weights, "SIZES", (20.0,))
    sweep = path_weights.SWEEPS[strategy]
    [anew] = path_weights.swept(strategy, path_weights.Sweep(sweep.parameter, (value,)), store, 1)
    stored = pd.read_csv(STUDIES / "path-weights.csv").set_index(["strategy", "value"]).loc[strategy, value]
    assert [anew[key] for key in ("e 20", "eta 20", "T 20")] == pytest.approx(
        [stored[key] for key in ("e 20", "eta 20", "T 20")], abs=6e-5
    )


@pytest.mark.slow
def test_the_study_of_the_order_of_fusion_gives_what_its_table_says(studies):
    """In the worlds of 20 m."""
    from virtual_map_order import WORLDS, difference

    stored = pd.read_csv(STUDIES / "virtual-map-order.csv").set_index("size_m").loc[20.0]
    values = pd.Series([difference(20.0, trial) for trial in range(WORLDS)])
    assert [values.mean(), values.abs().max()] == pytest.approx([stored["mean"], stored["largest"]], abs=6e-7)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nearest", "uncertainty"])
def test_the_study_of_causes_gives_what_its_table_says_of_strategies_that_learn_nothing(studies, name, monkeypatch):
    """In the worlds of 40 m."""
    import learning_causes

    monkeypatch.setattr(learning_causes, "WORLDS", {40.0: learning_causes.WORLDS[40.0]})
    stored = pd.read_csv(STUDIES / "learning-causes.csv").set_index("variant").loc[f"`{name}`"]
    anew = learning_causes.untrained(name)
    assert {key: float(f"{value:.4g}") for key, value in anew.items()} == {key: stored[key] for key in anew}
