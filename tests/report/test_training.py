"""Training figures from curves made by hand, and curves averaged over training seeds."""

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import matplotlib
import numpy as np
import pandas as pd
import pytest
from handmade import record, with_spec
from matplotlib.colors import to_hex

from explore_bench.analysis.training_curve import (
    CURVE_COLUMNS,
    CURVE_WINDOW,
    TRAINING_METRICS,
    Training,
    curve_path,
    training_values,
    validations_path,
)
from explore_bench.errors import RequestError
from explore_bench.report import drawing
from explore_bench.report.figures import _of_worlds
from explore_bench.report.pages import training
from explore_bench.report.pages.training import PANELS, TRAINING_FIGURES, on_one_axis, write_training_figures
from explore_bench.strategies.registry import strategies


def curve(steps, **columns):
    values = {name: np.zeros(len(steps)) for name in CURVE_COLUMNS} | {"steps": np.array(steps, dtype=float)}
    return pd.DataFrame(values | columns)


@pytest.fixture
def ship(monkeypatch, tmp_path):
    """Let the registry ship curves for some strategies, by name and training seed, and for no others.

    With `validated`, these rows are the validations of each.
    """

    def put(validated=None, **names):
        entries = {name: dataclasses.replace(entry, weights={}) for name, entry in strategies().items()}
        for name, curves in names.items():
            name = name.replace("_", "-")
            paths = {seed: str(tmp_path / f"{name}-{seed}.safetensors") for seed in range(len(curves))}
            for path, own in zip(paths.values(), curves, strict=True):
                if own is not None:
                    own.to_csv(curve_path(Path(path)), index=False)
                    if validated is not None:
                        validated.to_csv(validations_path(Path(path)), index=False)
            entries[name] = dataclasses.replace(entries[name], weights=paths)
        monkeypatch.setattr(training, "strategies", lambda: entries)

    return put


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Draw the figures without writing them; returns what each showed, by the name of its file."""
    seen = {}

    def look(figure, path):
        if path.suffix == ".svg":
            panels = [
                SimpleNamespace(
                    title=axes.get_title(),
                    lines={line.get_label(): line for line in axes.get_lines()},
                    bands=list(axes.collections),
                )
                for axes in figure.axes
            ]
            legend = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
            seen[path.stem] = SimpleNamespace(panels=panels, legend=legend)

    monkeypatch.setattr(drawing, "save", look)

    def draw():
        seen.clear()
        write_training_figures(tmp_path / "figures")
        return dict(seen)

    return draw


STRAIGHT = curve([10_000, 20_000, 30_000], reward=[-3.0, -2.0, -1.0], efficiency=[0.5, 0.6, 0.7], error=[3.0, 2.0, 1.0])


def test_early_and_final_reward_worked_by_hand():
    """Thirty rows of 10 000 steps with rewards 1 to 30: the first twenty, the last of them at step 200 000; three."""
    own = curve(10_000.0 * np.arange(1, 31), reward=np.arange(1.0, 31.0))
    assert TRAINING_METRICS["early_reward"].value(Training(own, None)) == 10.5
    assert TRAINING_METRICS["final_reward"].value(Training(own, None)) == 29.0
    assert TRAINING_METRICS["final_reward"].value(Training(own[:9], None)) == 9.0


VALIDATED = pd.DataFrame(
    {
        "episodes": [504, 1000, 1504, 2000, 2504],
        "objective": [-1.0, -2.0, -3.0, -5.0, -7.0],
        "time": 100.0,
        "efficiency": [1.0, 1.1, 1.2, 1.3, 1.4],
        "error": [0.9, 0.8, 0.7, 0.6, 0.5],
    }
)


def test_early_and_final_validations_worked_by_hand():
    """The third is made at the end of the round of eight in which 1,500 episodes are full."""
    training_ = Training(STRAIGHT, VALIDATED)
    assert TRAINING_METRICS["early_validation"].value(training_) == -2.0
    assert TRAINING_METRICS["final_validation"].value(training_) == -5.0
    assert math.isnan(TRAINING_METRICS["final_validation"].value(Training(STRAIGHT, None)))
    assert {TRAINING_METRICS[name].better for name in ("early_validation", "final_validation")} == {"lower"}


def test_a_training_that_was_never_validated_has_no_such_figure(ship, drawn):
    ship(validated=VALIDATED[:0], gcn_obs=[STRAIGHT])
    assert drawn().keys() == {"figure-09"}


def test_greedy_policies_have_figures_of_their_own(ship, drawn):
    ship(validated=VALIDATED, gcn_obs=[STRAIGHT, STRAIGHT])
    shown = drawn()
    assert shown.keys() == {"figure-09", "validation-09"}
    assert shown["validation-09"].legend == ["GCN-obs (2 seeds)"]
    for panel, column in zip(shown["validation-09"].panels, ("objective", "efficiency", "error"), strict=True):
        [line] = panel.lines.values()
        assert line.get_ydata()[-1] == pytest.approx(VALIDATED[column].iloc[-1])
        assert line.get_xdata()[-1] == pytest.approx(2.504)


def test_training_values_are_by_training_seed(ship):
    ship(gcn_obs=[STRAIGHT, None, STRAIGHT.assign(reward=[0.0, 1.0, 5.0])])
    assert training_values(training.strategies()["gcn-obs"], "final_reward") == {0: -1.0, 2: 5.0}


def test_the_curve_lies_beside_the_weights(tmp_path):
    assert curve_path(tmp_path / "a-1.safetensors") == tmp_path / "a-1.curve.csv"


def test_curves_of_seeds_meet_on_one_axis_up_to_the_end_of_the_shortest():
    steps, values = on_one_axis(
        [curve([10_000, 30_000], reward=[0.0, 2.0]), curve([10_000, 20_000], reward=[4.0, 4.0])], "reward"
    )
    assert steps.tolist() == [20_000]
    assert values.tolist() == [[1.0], [4.0]]


def test_values_between_rows_are_interpolated_worked_by_hand():
    """Rows at 5000, 15000 and 25000; three windows, so that the points are 12500 and 25000."""
    steps, values = on_one_axis([curve([5_000, 15_000, 25_000], error=[4.0, 2.0, 3.0])], "error")
    assert steps == pytest.approx([12_500, 25_000])
    assert values == pytest.approx(np.array([[2.5, 3.0]]))


def test_a_curve_of_one_row_is_a_point():
    steps, values = on_one_axis([curve([12_345], reward=[0.5])], "reward")
    assert (steps[-1], values[0, -1]) == (12_345, 0.5)


def test_there_is_about_a_point_a_window_at_even_distances():
    steps, _ = on_one_axis([curve([CURVE_WINDOW * i for i in range(1, 101)])], "reward")
    assert len(steps) == pytest.approx(100, abs=1)
    assert np.diff(steps) == pytest.approx(np.diff(steps)[0])


def test_a_row_without_a_value_takes_none_from_others():
    gap = curve([10_000, 20_000, 30_000, 40_000, 50_000], reward=[1.0, 2.0, math.nan, 4.0, 5.0])
    steps, values = on_one_axis([gap], "reward")
    known = ~np.isnan(values[0])
    assert values[0][known] == pytest.approx(steps[known] / 10_000)
    assert known[[0, -1]].all()
    assert not known.all()


@pytest.mark.parametrize(
    ("name", "figures"),
    [
        ("graph-stnn", {"figure-07", "figure-09", "figure-12"}),
        ("graph-stnn-1-layer", {"figure-07"}),
        ("gcn-obs", {"figure-09"}),
        ("no-state", {"figure-12"}),
    ],
)
def test_a_strategy_with_a_curve_is_in_the_figures_of_its_tables_only(ship, drawn, name, figures):
    ship(**{"graph-stnn-3-layers": [STRAIGHT], "no-spatial": [STRAIGHT], name: [STRAIGHT]})
    label = strategies()[name].label
    assert {stem for stem, shown in drawn().items() if label in shown.legend} == figures


def test_a_line_per_strategy_in_its_colour_and_a_panel_per_measure(ship, drawn):
    ship(gcn_obs=[STRAIGHT], graph_stnn=[STRAIGHT])
    shown = drawn()["figure-09"]
    assert list(PANELS) == ["reward", "efficiency", "error"]
    assert [panel.title for panel in shown.panels] == list(PANELS.values())
    assert shown.legend == ["Graph-STNN", "GCN-obs"], "in the registered order"
    for column, panel in zip(PANELS, shown.panels, strict=True):
        assert not panel.bands, "one seed has no spread"
        for name in ("graph-stnn", "gcn-obs"):
            entry = strategies()[name]
            line = panel.lines[entry.label]
            assert to_hex(line.get_color()) == entry.color
            steps, values = on_one_axis([STRAIGHT], column)
            assert 1000 * np.array(line.get_xdata()) == pytest.approx(steps)
            assert np.array(line.get_ydata()) == pytest.approx(values[0])


def test_training_seeds_are_their_mean_with_a_band_from_lowest_to_highest(ship, drawn):
    higher = STRAIGHT.assign(reward=STRAIGHT["reward"] + 2.0)
    ship(gcn_obs=[STRAIGHT, higher])
    shown = drawn()["figure-09"]
    assert shown.legend == ["GCN-obs (2 seeds)"]
    panel = shown.panels[list(PANELS).index("reward")]
    [line], [band] = panel.lines.values(), panel.bands
    _, values = on_one_axis([STRAIGHT, higher], "reward")
    assert np.array(line.get_ydata()) == pytest.approx(values[0] + 1.0)
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx((values[0].min(), values[1].max()))


def test_a_training_seed_without_a_curve_is_left_out(ship, drawn):
    ship(gcn_obs=[STRAIGHT, None])
    assert drawn()["figure-09"].legend == ["GCN-obs"]


def test_styles_and_figures_do_not_leak(ship, drawn):
    before = dict(matplotlib.rcParams)
    ship(gcn_obs=[STRAIGHT])
    assert drawn()
    assert dict(matplotlib.rcParams) == before
    assert matplotlib.pyplot.get_fignums() == []


def test_figures_that_are_not_of_the_training_are_left_alone(ship, tmp_path):
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "figure-10a.png").write_bytes(b"another's")
    ship()
    assert write_training_figures(tmp_path / "figures") == []
    assert [file.name for file in (tmp_path / "figures").iterdir()] == ["figure-10a.png"]


def test_each_figure_shows_the_learned_strategies_of_its_table(ship, tmp_path):
    own = curve([10_000, 20_000, 30_000], reward=[-1.0, -0.5, -0.4])
    ship(gcn_obs=[own, own], no_state=[own])
    written = write_training_figures(tmp_path / "figures")
    assert sorted(file.name for file in written) == [f"figure-{n}.{s}" for n in ("09", "12") for s in ("png", "svg")]
    assert all(file.stat().st_size > 5000 for file in written)


def test_a_report_shows_the_training_of_what_ran_and_no_network_without_its_variants(ship, tmp_path):
    own = curve([10_000, 20_000, 30_000], reward=[-1.0, -0.5, -0.4])
    ship(gcn_obs=[own], graph_stnn=[own], no_state=[own])
    for ran, drawn in (
        ({"graph-stnn", "no-state", "nearest"}, {"figure-09", "figure-12"}),
        ({"graph-stnn", "nearest"}, {"figure-09"}),
        ({"nearest"}, set()),
    ):
        assert {file.stem for file in write_training_figures(tmp_path / "figures", ran)} == drawn
        assert {file.stem for file in (tmp_path / "figures").glob("*")} == drawn


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


@pytest.mark.parametrize("content", ["", "\x00\x01"], ids=["empty", "bytes"])
def test_a_damaged_curve_is_refused_by_its_file(ship, tmp_path, content):
    ship(gcn_obs=[STRAIGHT])
    file = curve_path(tmp_path / "gcn-obs-0.safetensors")
    file.write_text(content)
    with pytest.raises(RequestError) as caught:
        write_training_figures(tmp_path / "figures")
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_figures_are_the_papers():
    assert TRAINING_FIGURES == {"figure-07": "layers", "figure-09": "table2", "figure-12": "table3"}


def test_curves_of_trials_average_over_training_seeds_within_a_world():
    def trial(number, seed, explored):
        made = record(explored=np.array(explored), trial=number)
        return with_spec(made, training_seed=seed)

    records = [trial(0, 0, [0.0, 0.2]), trial(0, 1, [0.0, 0.4]), trial(1, 0, [0.1, 1.0])]
    assert np.allclose(list(_of_worlds(records, "explored", 2).values()), [[0.0, 0.3], [0.1, 1.0]])


def test_a_curve_without_a_row_is_left_out(ship, tmp_path):
    ship(gcn_obs=[curve([])])
    assert write_training_figures(tmp_path / "figures") == []
