"""Figures of real trials: which are drawn, what their lines show, and bytes that do not change."""

import dataclasses
import io
import itertools
import re
from types import SimpleNamespace

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from handmade import TINY, record, with_spec, write_plugin
from matplotlib.collections import EllipseCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from PIL import Image

from explore_bench.analysis.metrics import CURVES, curve
from explore_bench.analysis.tables import trial_table
from explore_bench.records.store import Store
from explore_bench.report import drawing, figures
from explore_bench.report.aggregates import COVERAGES, write_survival_figures
from explore_bench.report.drawing import entry_of, save, save_all, styled
from explore_bench.report.figures import CURVE_FIGURES, write_figures
from explore_bench.report.moment import Scene
from explore_bench.report.render import write_report
from explore_bench.report.scene import draw_scene
from explore_bench.report.scene_colors import FREE, OCCUPIED, UNKNOWN
from explore_bench.report.vector import width_of
from explore_bench.runs.suites import plan
from explore_bench.strategies.registry import strategies
from explore_bench.trial.run import run_trial
from explore_bench.trial.snapshot import Snapshot
from explore_bench.world.scenario import Scenario

NAMES = ("random", "nearest", "clairvoyant")
TRIALS = 2


def filled(folder, names, scenario=None, trials=TRIALS, sizes=(20.0,)):
    specs = plan("table2", names, sizes, trials, scenario=scenario).specs
    return kept(folder, map(run_trial, specs), scenario)


def kept(folder, results, scenario=None):
    store = Store(folder)
    store.open(0, "evaluate", scenario or Scenario())
    for result in results:
        store.write(result)
    return store


@pytest.fixture(scope="module")
def results():
    """Return the trials of three strategies in two worlds of 20 m."""
    return [run_trial(spec) for spec in plan("table2", NAMES, (20.0,), TRIALS).specs]


@pytest.fixture(scope="module")
def store(tmp_path_factory, results):
    return kept(tmp_path_factory.mktemp("figures") / "results", results)


@pytest.fixture(scope="module")
def records(store):
    return store.records()[0]


@pytest.fixture(scope="module")
def written(store, records):
    """Return the files of all figures."""
    return write_figures(store, records, store.folder / "drawn")


@pytest.fixture
def drawn(monkeypatch):
    """Draw figures without writing them; returns what the axes of each showed, by the name of its file."""
    seen = {}

    def look(figure, path):
        if path.suffix == ".svg":
            seen[path.stem] = [
                SimpleNamespace(
                    title=axes.get_title(),
                    limits=(axes.get_xlim(), axes.get_ylim()),
                    lines=[
                        (to_hex(line.get_color()), line.get_linestyle(), line.get_label(), np.array(line.get_ydata()))
                        for line in axes.get_lines()
                    ],
                    bands=[to_hex(c.get_facecolor()[0]) for c in axes.collections if type(c) is not EllipseCollection],
                    ellipses=[c for c in axes.collections if isinstance(c, EllipseCollection)],
                )
                for axes in figure.axes
            ]
            seen[path.stem + " legend"] = [text.get_text() for legend in figure.legends for text in legend.get_texts()]

    monkeypatch.setattr(drawing, "save", look)

    def draw(store, records=None):
        seen.clear()
        write_figures(store, store.records()[0] if records is None else records, store.folder / "figures")
        return seen

    return draw


def names_of(files):
    return sorted({file.stem for file in files})


# What they have room for


@pytest.mark.parametrize("name", ["figure-10a", "figure-10b", "times-20m"])
def test_the_words_of_all_strategies_have_room(store, records, monkeypatch, name):
    """No legend leaves the figure and no title another's place, with every strategy of Table 2."""
    every = [name for name, entry in strategies().items() if "table2" in entry.tables]
    own = [record for record in records if record.spec.strategy == "nearest"]
    of_all = [with_spec(record, strategy=strategy) for strategy in every for record in own]
    replay = store.replay(own[0].spec)
    monkeypatch.setattr(store, "replay", lambda spec: replay)
    monkeypatch.setattr(store, "find", lambda spec: with_spec(own[spec.trial], strategy=spec.strategy))
    timed = [own for own in every if any(map(strategies()[own].fills, COVERAGES))]
    least = {"figure-10a": 1, "figure-10b": len(every), "times-20m": len(timed)}[name]
    looked = []

    def look(figure, path):
        if path.suffix == ".png" and path.stem == name:
            figure.canvas.draw()
            for legend in figure.legends:
                box = legend.get_window_extent()
                assert box.x0 >= figure.bbox.x0 and box.x1 <= figure.bbox.x1
                assert len(legend.get_texts()) >= least
            titles = [axes.title.get_window_extent() for axes in figure.axes if axes.get_title()]
            assert not any(a.overlaps(b) for a, b in itertools.combinations(titles, 2))
            looked.append(len(titles))

    monkeypatch.setattr(drawing, "save", look)
    write_figures(store, of_all, store.folder / "figures")
    write_survival_figures(trial_table(of_all), store.folder / "figures")
    assert looked == [len(every) if name == "figure-10a" else 3]


# Which figures are drawn


def test_figures_are_drawn_for_tables_that_have_trials_of_their_strategies_only(written):
    """Figure 13 would show strategies of Table 3 of which the paper's have no weights: no empty plot is drawn."""
    assert names_of(written) == ["figure-06", "figure-10a", "figure-10b"]
    [folder] = {file.parent for file in written}
    assert {file.name for file in folder.iterdir()} == {f"{n}{s}" for n in names_of(written) for s in (".svg", ".png")}
    assert all(file.stat().st_size > 5000 for file in written)


def test_no_curve_figure_is_drawn_where_only_strategies_ran_that_the_paper_does_not_print(store, records, tmp_path):
    own = [record for record in records if record.spec.strategy in ("nearest", "clairvoyant")]
    assert names_of(write_figures(store, own, tmp_path)) == ["figure-06"]


def test_without_trials_nothing_is_drawn(store, tmp_path):
    assert write_figures(store, [], tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_figures_of_an_earlier_report_that_are_no_longer_drawn_are_removed(store, records, tmp_path):
    own = [record for record in records if record.spec.trial == 0]
    assert names_of(write_figures(store, own, tmp_path)) == ["figure-06", "figure-10a", "figure-10b"]
    (tmp_path / "mine.png").write_bytes(b"")
    few = [record for record in own if record.spec.strategy == "nearest"]
    assert names_of(write_figures(store, few, tmp_path)) == ["figure-06"]
    assert {path.name for path in tmp_path.iterdir()} == {"figure-06.svg", "figure-06.png", "mine.png"}


def test_a_plugin_is_drawn_alone_in_both_tables_figures(tmp_path, drawn):
    shown = drawn(filled(tmp_path / "results", [write_plugin(tmp_path)], trials=1))
    names = {"figure-06", "figure-10a", "figure-10b", "figure-13a", "figure-13b"}
    assert {name for name in shown if "legend" not in name} == names


def test_every_figure_of_the_paper_s_results_has_its_table_and_size():
    assert CURVE_FIGURES == {
        "figure-08": ("layers", 20.0),
        "figure-10": ("table2", 20.0),
        "figure-11": ("table2", 40.0),
        "figure-13": ("table3", 20.0),
        "figure-14": ("table3", 30.0),
        "figure-15": ("table3", 40.0),
    }


# Curves


def test_a_line_per_strategy_in_its_registered_colour_and_a_band_of_the_same(store, drawn):
    """The reference plans for the time alone, so it stands beside the others in the exploration rate only."""
    panels = drawn(store)["figure-10b"][:3]
    assert [panel.title for panel in panels] == [title for title, _ in CURVES.values()]
    competitors = {
        "Random": (strategies()["random"].color, "-"),
        "Nearest": (strategies()["nearest"].color, "-"),
    }
    reference = {"Clairvoyant (reference)": (strategies()["clairvoyant"].color, "--")}
    for panel, expected in zip(panels, (competitors | reference, competitors, competitors), strict=True):
        assert {label: (color, style) for color, style, label, _ in panel.lines} == expected
        assert sorted(panel.bands) == sorted(color for color, _ in expected.values())


def test_the_lines_are_the_means_over_worlds_of_the_curves(store, records, drawn):
    panels = drawn(store)["figure-10b"][:3]
    for name, panel in zip(CURVES, panels, strict=True):
        for _, _, label, values in panel.lines:
            own = [r for r in records if entry_of(r.spec.strategy).label == label.removesuffix(" (reference)")]
            expected = np.mean([curve(record, name, len(values)) for record in own], axis=0)
            assert values == pytest.approx(expected, nan_ok=True)


def test_the_numbers_still_running_are_drawn_below(store, records, drawn):
    below = drawn(store)["figure-10b"][3]
    ends = [r.steps["step"][-1] for r in records if r.spec.strategy == "nearest"]
    [values] = [y for color, _, _, y in below.lines if color == strategies()["nearest"].color]
    assert values[0] == TRIALS
    assert values[min(ends)] == TRIALS - 1
    assert values[min(ends) - 1] == TRIALS


def test_an_unfinished_trial_is_still_running_until_the_step_limit(store, records, drawn):
    """Stopping early never pays: neither in the curves nor below them."""
    broken = [dataclasses.replace(r, status="stuck") if r.spec.strategy == "random" else r for r in records]
    panels = drawn(store, broken)["figure-10b"]
    [values] = [y for color, _, _, y in panels[3].lines if color == strategies()["random"].color]
    assert len(values) == 1 + records[0].spec.scenario.step_limit
    assert (values[:-1] == TRIALS).all()


def test_strategies_without_trials_are_neither_drawn_nor_in_the_legend(store, drawn):
    legend = drawn(store)["figure-10b legend"]
    assert sorted(legend) == ["Clairvoyant (reference)", "Nearest", "Random"]


def test_a_trial_that_failed_before_its_first_row_does_not_stop_the_figures(tmp_path, drawn):
    file = tmp_path / "never.py"
    file.write_text(
        "class Never:\n    def reset(self, rng): raise LookupError('no')\n    def choose(self, o): return 0\n"
    )
    store = filled(tmp_path / "results", ["random", f"{file}:Never"], trials=1)
    shown = drawn(store)
    assert "Never" in shown["figure-10b legend"]
    assert len(shown["figure-10a"]) == 1, "it has no example to show"


def test_trials_that_take_a_few_steps_only_can_be_drawn(tmp_path, drawn):
    """With a sensor that sees nearly all of the map at once."""
    store = filled(tmp_path / "results", ["random"], Scenario(size=20.0, sensor_range=12.0))
    assert max(record.steps["step"][-1] for record in store.records()[0]) < 60
    assert "figure-10b" in drawn(store)


def test_trials_that_take_fewer_than_eight_steps_can_be_drawn(tmp_path, drawn):
    store = filled(tmp_path / "results", ["random"], Scenario(size=20.0, sensor_range=14.0, coverage=0.7))
    assert max(record.steps["step"][-1] for record in store.records()[0]) < 7
    assert "figure-10b" in drawn(store)


# Training seeds


@pytest.fixture
def learned(results, trained, tmp_path):
    """Return records of GCN-obs with two training seeds in two worlds: the trials of Random and of Nearest."""
    specs = plan("table2", ["gcn-obs"], (20.0,), TRIALS).specs if trained(0, 1) else ()
    of = {(result.spec.strategy, result.spec.trial): result for result in results}
    took = [of[("random", "nearest")[spec.training_seed], spec.trial] for spec in specs]
    return kept(tmp_path / "results", [dataclasses.replace(r, spec=s) for s, r in zip(specs, took, strict=True)])


def test_training_seeds_are_averaged_within_a_world(learned):
    records = learned.records()[0]
    assert [(r.spec.training_seed, r.spec.trial) for r in records] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    for name in CURVES:
        values = np.array(list(figures._of_worlds(records, name, 50).values()))
        assert values.shape == (TRIALS, 50)
        for world, own in enumerate(values):
            seeds = [curve(record, name, 50) for record in records if record.spec.trial == world]
            assert len(seeds) == 2
            assert own == pytest.approx((seeds[0] + seeds[1]) / 2, nan_ok=True)


def test_worlds_weigh_alike_in_a_curve_however_many_training_seeds_ran_on_them(learned):
    """World 0 with two seeds, world 1 with one."""
    records = learned.records()[0][:3]
    values = np.array(list(figures._of_worlds(records, "explored", 50).values()))
    assert values[1] == pytest.approx(curve(records[1], "explored", 50))
    assert values[0] == pytest.approx((curve(records[0], "explored", 50) + curve(records[2], "explored", 50)) / 2)


def test_a_learned_strategy_has_one_line_over_its_worlds_whatever_its_training_seeds(learned, drawn):
    shown = drawn(learned)
    assert shown["figure-10b legend"] == ["GCN-obs"]
    panels = shown["figure-10b"]
    for name, panel in zip(CURVES, panels[:3], strict=True):
        [(color, _, label, values)] = panel.lines
        assert (color, label) == (strategies()["gcn-obs"].color, "GCN-obs")
        expected = np.mean([*figures._of_worlds(learned.records()[0], name, len(values)).values()], axis=0)
        assert values == pytest.approx(expected, nan_ok=True)
    [(_, _, _, running)] = panels[3].lines
    assert running[0] == TRIALS, "worlds, not trials"


def test_the_example_of_a_learned_strategy_is_that_of_its_first_training_seed(learned, drawn):
    shown = drawn(learned)
    first = learned.records()[0][0]
    assert (first.spec.training_seed, first.spec.trial) == (0, 0)
    [panel] = [panel for panel in shown["figure-10a"] if panel.title]
    assert panel.title == f"GCN-obs\nexplored after {first.steps['step'][-1]} steps"


def test_the_figure_of_the_layers_shows_the_strategies_of_its_table(results, monkeypatch, tmp_path, drawn):
    """The paper prints no table of them, so nothing is left out of the figure."""
    name = "graph-stnn-1-layer"
    weights = tmp_path / "weights-0.safetensors"
    weights.write_bytes(b"")
    monkeypatch.setitem(strategies(), name, dataclasses.replace(strategies()[name], weights={0: str(weights)}))
    [spec] = plan("layers", [name], trials=1).specs
    store = kept(tmp_path / "results", [dataclasses.replace(results[0], spec=spec)])
    shown = drawn(store)
    assert shown["figure-08b legend"] == ["Graph-STNN, 1 GCN layer"]
    assert {key for key in shown if "legend" not in key} == {"figure-08a", "figure-08b"}


# Variants of one network


@pytest.fixture
def variants(results, monkeypatch, tmp_path):
    """Return records of Graph-STNN and a variant: trials of Random and of Nearest, the variant's in world 0 alone."""
    names = ("graph-stnn", "no-state")
    for name in names:
        file = tmp_path / f"{name}-0.safetensors"
        file.write_bytes(b"")
        monkeypatch.setitem(strategies(), name, dataclasses.replace(strategies()[name], weights={0: str(file)}))
    of = {(result.spec.strategy, result.spec.trial): result for result in results}
    took = dict(zip(names, ("random", "nearest"), strict=True))
    specs = [s for s in plan("table3", names, (20.0,), TRIALS).specs if s.strategy == "graph-stnn" or not s.trial]
    return kept(
        tmp_path / "results", [dataclasses.replace(of[took[spec.strategy], spec.trial], spec=spec) for spec in specs]
    )


def test_no_figure_is_cut_off_at_an_edge(written, variants):
    """No dark pixel lies at the edge of a picture: no row of examples, no figure that is narrower than its title."""
    more = write_figures(variants, variants.records()[0], variants.folder / "figures")
    pictures = [file for file in (*written, *more) if file.suffix == ".png"]
    assert {"figure-10a", "figure-13a", "figure-13c"} <= {file.stem for file in pictures}
    for file in pictures:
        with Image.open(file) as picture:
            pixels = np.array(picture.convert("L"))
        edges = (pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1])
        assert min(edge.min() for edge in edges) > 160, file.stem


def test_a_network_without_its_variants_has_no_figure_of_variants(variants, tmp_path):
    both = variants.records()[0]
    whole = [record for record in both if record.spec.strategy == "graph-stnn"]
    assert {"figure-13a", "figure-13b", "figure-13c"} <= set(names_of(write_figures(variants, both, tmp_path)))
    assert not any(name.startswith("figure-13") for name in names_of(write_figures(variants, whole, tmp_path)))


def test_a_variant_is_drawn_as_its_difference_to_the_whole_network_paired_by_world(variants, drawn):
    panels = drawn(variants)["figure-13c"]
    records = variants.records()[0]
    of = {record.spec.strategy: record for record in records if not record.spec.trial}
    assert [panel.title.split("\n")[0] for panel in panels] == ["no state", "", ""]
    for name, panel in zip(CURVES, panels, strict=True):
        (color, _, _, zero), (own, _, _, values) = panel.lines
        assert (color, own) == (strategies()["graph-stnn"].color, strategies()["no-state"].color)
        assert set(zero) == {0.0}
        expected = curve(of["no-state"], name, len(values)) - curve(of["graph-stnn"], name, len(values))
        assert values == pytest.approx(expected, nan_ok=True)
        low, high = panel.limits[1]
        assert low == -high, "no difference is in the middle"


def test_the_words_beside_differences_have_room_for_long_numbers(variants, monkeypatch):
    places = []

    def look(figure, path):
        if path.name == "figure-13c.svg":
            for axes in figure.axes:
                axes.set_yticks([-0.025, 0.0, 0.025])
            figure.draw_without_rendering()
            places.extend(axes.yaxis.label.get_window_extent().x0 for axes in figure.axes if axes.get_ylabel())

    monkeypatch.setattr(drawing, "save", look)
    write_figures(variants, variants.records()[0], variants.folder / "figures")
    assert len(places) == len(CURVES)
    assert min(places) > 0.0


def test_differences_are_drawn_only_beside_the_whole_network(variants, drawn):
    alone = [record for record in variants.records()[0] if record.spec.strategy == "no-state"]
    shown = drawn(variants, alone)
    assert "figure-13b" in shown
    assert "figure-13c" not in shown
    assert "figure-10c" not in drawn(variants), "competitors are no variants"


def test_how_much_of_a_difference_is_shown_stands_above_it(variants, drawn):
    """In one world alone there is no band to say it."""
    assert not any("off 0" in panel.title for panel in drawn(variants)["figure-13c"])
    records = variants.records()[0]
    [other] = [record for record in records if record.spec.strategy == "no-state"]
    again = dataclasses.replace(other, spec=dataclasses.replace(other.spec, trial=1))
    titles = [panel.title for panel in drawn(variants, [*records, again])["figure-13c"]]
    assert all(re.search(r"off 0 in \d+% of steps$", title) for title in titles)


# Examples in the manner of Figure 6


def test_there_is_one_example_per_strategy_all_on_the_same_world(store, records, drawn):
    panels = [panel for panel in drawn(store)["figure-10a"] if panel.title]
    assert [panel.title.split("\n")[0] for panel in panels] == ["Random", "Nearest", "Clairvoyant (reference)"]
    for panel, name in zip(panels, NAMES, strict=True):
        [own] = [r for r in records if r.spec.strategy == name and r.spec.trial == 0]
        assert f"explored after {own.steps['step'][-1]} steps" in panel.title
        assert panel.limits == ((0.0, 20.0), (0.0, 20.0))


def test_an_example_shows_true_and_estimated_trajectories_landmarks_and_ellipses(store, records, drawn):
    panel = drawn(store)["figure-06"][0]
    lengths = [len(y) for _, _, _, y in panel.lines]
    record = next(r for r in records if r.spec.trial == 0)
    assert max(lengths) > 10
    assert lengths.count(max(lengths)) == 2, "the true and the estimated trajectory"
    assert len(record.world.landmarks) in lengths
    assert len(panel.ellipses) == 2, "virtual landmarks and poses"


def test_the_legend_of_an_example_names_what_figure_6_shows(store, drawn):
    legend = " ".join(drawn(store)["figure-06 legend"])
    for words in ("unknown", "obstacle", "sensor range", "virtual landmark", "true trajectory", "estimated trajectory"):
        assert words in legend
    for words in ("true landmark", "estimated landmark", "candidate", "chosen"):
        assert words in legend


# Bytes


@pytest.mark.usefixtures("without_training_figures")
def test_figures_drawn_again_by_a_report_have_the_same_bytes(store, written):
    report = write_report(store.folder)
    assert (report.trials, report.stale) == (len(NAMES) * TRIALS, 0)
    for file in written:
        again = store.folder / "figures" / file.name
        assert again in report.files
        assert again.read_bytes() == file.read_bytes(), file.name


def test_figures_do_not_depend_on_the_order_of_the_records(store, records, drawn):
    """It follows digests, which any edit of the code turns over."""
    shown = [
        {name: [panel.title for panel in panels] for name, panels in draw.items() if "legend" not in name}
        for draw in (dict(drawn(store, records)), dict(drawn(store, records[::-1])))
    ]
    assert shown[0] == shown[1]


def test_an_svg_holds_no_date_and_no_font_but_paths(written):
    for file in written:
        if file.suffix == ".svg":
            text = file.read_text()
            assert "<dc:date>" not in text
            assert "<text" not in text


def test_styles_and_figures_do_not_leak(store, drawn):
    before = dict(matplotlib.rcParams)
    assert drawn(store)
    assert dict(matplotlib.rcParams) == before
    assert matplotlib.pyplot.get_fignums() == []


def test_a_cell_that_is_as_likely_free_as_not_is_drawn_free_and_one_not_seen_unknown():
    """In a replay 100, 101 and 255 stand for 0.5, 0.505 and unknown."""
    levels = np.zeros(36, dtype=np.uint8)
    levels[:3] = 100, 101, 255
    made = record(rows=2)
    axes = Figure().add_subplot()
    draw_scene(axes, Scene(TINY, made.world, made.steps, Snapshot(None, None, None, levels.tobytes(), bytes(108), [])))
    shown = {to_hex(patch.get_facecolor()): patch.get_path().vertices[0].tolist() for patch in axes.patches[:3]}
    assert shown == {FREE: [0.0, 0.0], OCCUPIED: [2.0, 0.0], UNKNOWN: [4.0, 0.0]}


def test_bands_are_intervals_around_the_mean(tmp_path):
    """Two worlds with the values 0 and 1: the band spans from one to the other."""
    with styled():
        figure, axes = matplotlib.pyplot.subplots()
        figures._band(axes, np.arange(3), np.array([[0.0] * 3, [1.0] * 3]), "nearest", 0)
        [band] = [c for c in axes.collections if isinstance(c, PolyCollection)]
        heights = band.get_paths()[0].vertices[:, 1]
        assert (heights.min(), heights.max()) == (0.0, 1.0)
        assert axes.get_lines()[0].get_ydata() == pytest.approx([0.5] * 3)
        save(figure, tmp_path / "deep" / "band.svg")
    assert (tmp_path / "deep" / "band.svg").exists()


@pytest.mark.parametrize(("low", "high"), [(90, 195), (130, 480), (18, 2000), (95, 105)])
def test_a_logarithmic_axis_has_two_plain_numbers_at_least(low, high):
    """However little of a decade is in view."""
    figure, axes = plt.subplots()
    axes.set(xscale="log", xlim=(low, high))
    drawing.plain_log(axes.xaxis)
    figure.canvas.draw()
    shown = [float(label.get_text()) for label in axes.get_xticklabels() if low <= label.get_position()[0] <= high]
    plt.close(figure)
    assert len(shown) > 1
    assert all(low <= number <= high for number in shown)


# Files


@pytest.mark.parametrize("layout", ["constrained", "none"])
def test_both_files_of_a_figure_show_it_laid_out_as_it_was_made(tmp_path, layout):
    """What matplotlib's own way of saving it draws, once it is laid out."""
    with styled():
        figure, axes = plt.subplots(figsize=(3.0, 2.0), layout=layout)
        axes.plot([0.0, 1.0], [0.0, 1000.0])
        axes.set(title="A title", ylabel="as wide\nas two lines")
        figure.canvas.draw()
        place = axes.get_position().bounds
        save_all(figure, tmp_path / "figure")
        assert axes.get_position().bounds == pytest.approx(place, abs=0.01)
        figure.set_layout_engine("none")
        drawn = io.BytesIO()
        figure.savefig(drawn, format="png", metadata={"Software": None})
    assert (tmp_path / "figure.png").read_bytes() == drawn.getvalue()
    assert width_of((tmp_path / "figure.svg").read_text(encoding="utf-8")) == 216.0
