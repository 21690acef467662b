"""Training figures from curves made by hand, and curves averaged over training seeds."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from handmade import record, with_spec

from explore_bench.errors import RequestError
from explore_bench.registry import strategies
from explore_bench.report import training
from explore_bench.report.figures import _by_world
from explore_bench.report.training import TRAINING_FIGURES, on_one_axis, write_training_figures
from explore_bench.training_curve import CURVE_COLUMNS, curve_path


def curve(steps, **columns):
    values = {name: np.zeros(len(steps)) for name in CURVE_COLUMNS} | {"steps": np.array(steps, dtype=float)}
    return pd.DataFrame(values | columns)


@pytest.fixture
def ship(monkeypatch, tmp_path):
    """Let the registry ship curves for some strategies, by name and training seed, and for no others."""

    def put(**names):
        entries = {name: dataclasses.replace(entry, weights={}) for name, entry in strategies().items()}
        for name, curves in names.items():
            name = name.replace("_", "-")
            paths = {seed: str(tmp_path / f"{name}-{seed}.safetensors") for seed in range(len(curves))}
            for path, own in zip(paths.values(), curves, strict=True):
                if own is not None:
                    own.to_csv(curve_path(path), index=False)
            entries[name] = dataclasses.replace(entries[name], weights=paths)
        monkeypatch.setattr(training, "strategies", lambda: entries)

    return put


def test_the_curve_lies_beside_the_weights(tmp_path):
    assert curve_path(tmp_path / "a-1.safetensors") == tmp_path / "a-1.curve.csv"


def test_curves_of_seeds_meet_on_one_axis_up_to_the_end_of_the_shortest():
    steps, values = on_one_axis(
        [curve([10_000, 30_000], reward=[0.0, 2.0]), curve([10_000, 20_000], reward=[4.0, 4.0])], "reward"
    )
    assert steps.tolist() == [20_000]
    assert values.tolist() == [[1.0], [4.0]]


def test_each_figure_shows_the_learned_strategies_of_its_table(ship, tmp_path):
    own = curve([10_000, 20_000, 30_000], reward=[-1.0, -0.5, -0.4])
    ship(gcn_obs=[own, own], no_state=[own])
    written = write_training_figures(tmp_path / "figures")
    assert sorted(file.name for file in written) == [f"figure-{n}.{s}" for n in ("09", "12") for s in ("png", "svg")]
    assert all(file.stat().st_size > 5000 for file in written)


def test_without_curves_nothing_is_drawn_and_what_was_is_removed(ship, tmp_path):
    ship(gcn_obs=[curve([10_000, 20_000])])
    write_training_figures(tmp_path / "figures")
    ship(gcn_obs=[None])
    curve_path(tmp_path / "gcn-obs-0.safetensors").unlink()
    assert write_training_figures(tmp_path / "figures") == []
    assert list((tmp_path / "figures").iterdir()) == []


def test_a_curve_that_lacks_a_column_is_refused_by_name(ship, tmp_path):
    ship(gcn_obs=[curve([10_000, 20_000]).drop(columns="reward")])
    with pytest.raises(RequestError, match=r"gcn-obs-0.curve.csv' lacks the column 'reward'"):
        write_training_figures(tmp_path)


def test_the_figures_are_the_papers():
    assert TRAINING_FIGURES == {"figure-07": "layers", "figure-09": "table2", "figure-12": "table3"}


def test_curves_of_trials_average_over_training_seeds_within_a_world():
    def trial(number, seed, explored):
        made = record(explored=np.array(explored), trial=number)
        return with_spec(made, training_seed=seed)

    records = [trial(0, 0, [0.0, 0.2]), trial(0, 1, [0.0, 0.4]), trial(1, 0, [0.1, 1.0])]
    assert np.allclose(_by_world(records, "explored", 2), [[0.0, 0.3], [0.1, 1.0]])
