"""From names to entries: registered ones, modules, files, near spellings, and plugins that are broken."""

import dataclasses
import itertools
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from handmade import TINY, write_plugin

from explore_bench.errors import RequestError, describe, unknown
from explore_bench.runs.runner import check_runnable
from explore_bench.runs.suites import plan
from explore_bench.strategies import registry
from explore_bench.strategies.entry import Entry, parse_factory, weights_file
from explore_bench.strategies.loading import make_strategy
from explore_bench.strategies.registry import (
    GROUP,
    PLUGIN_COLORS,
    entry_named,
    in_order,
    lookup,
    parameter_count,
    plugin_entry,
    strategies,
)
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status


def message(function, *arguments):
    """Return the sentence of the RequestError that a call raises; it has one line."""
    with pytest.raises(RequestError) as caught:
        function(*arguments)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.fixture
def entry_points(monkeypatch):
    """Return a function that puts other mappings in the place of the installed entry points."""

    def register(**mappings):
        points = [
            SimpleNamespace(name=name, value=f"{name}:STRATEGIES", load=(m if callable(m) else lambda m=m: m))
            for name, m in mappings.items()
        ]
        monkeypatch.setattr(registry, "entry_points", lambda group: points if group == GROUP else [])
        strategies.cache_clear()

    yield register
    strategies.cache_clear()


# Registered strategies


def test_the_strategies_of_the_paper_and_the_untrained_ones_are_registered():
    known = strategies()
    assert {"random", "nearest", "entropy", "uncertainty", "clairvoyant", "graph-stnn"} <= known.keys()
    assert all(isinstance(entry, Entry) for entry in known.values())


def test_only_the_clairvoyants_are_references():
    assert [name for name, entry in strategies().items() if entry.reference] == ["clairvoyant", "clairvoyant-accurate"]


def test_no_two_strategies_share_a_label_or_a_colour():
    entries = strategies().values()
    assert len({entry.label for entry in entries}) == len(entries)
    assert len({entry.color for entry in entries}) == len(entries)


def test_the_colours_of_the_field_can_be_told_apart():
    """By CIE's distance in Lab, from one another and from all others; 2.3 is just noticed."""
    colors = [entry.color for entry in strategies().values()] + list(PLUGIN_COLORS)
    field = {entry.color for entry in strategies().values() if "field" in entry.factory}
    for one, other in itertools.combinations(colors, 2):
        if one in field or other in field:
            assert math.dist(lab(one), lab(other)) > 18, (one, other)


def lab(color):
    """CIELAB of an sRGB colour (D65)."""
    linear = [
        value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
        for value in (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    ]
    to_xyz = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))
    white = (0.9505, 1.0, 1.089)
    x, y, z = (sum(map(math.prod, zip(row, linear, strict=True))) / own for row, own in zip(to_xyz, white, strict=True))
    x, y, z = (value ** (1 / 3) if value > 0.008856 else 7.787 * value + 16 / 116 for value in (x, y, z))
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def test_every_registered_strategy_that_is_ready_can_be_made():
    """With the weights of its first training seed, and at one size."""
    suites = [plan(suite, trials=1).specs for suite in ("paper", "field", "field-stage")]
    first = {spec.strategy: spec for specs in suites for spec in reversed(specs)}
    assert first.keys() == {name for name, entry in strategies().items() if entry.ready}
    check_runnable(list(first.values()))


def test_a_registered_name_gives_its_entry():
    assert lookup("nearest") == ("nearest", strategies()["nearest"])


@pytest.mark.parametrize(("wrong", "right"), [("nearst", "nearest"), ("Random", "random"), ("gcn_obs", "gcn-obs")])
def test_an_unknown_name_is_refused_with_the_nearest_spelling(wrong, right):
    sentence = message(lookup, wrong)
    assert f"strategy '{wrong}' is unknown" in sentence
    assert f"did you mean '{right}'?" in sentence


def test_an_unknown_name_like_no_other_is_refused_with_the_choice():
    sentence = message(lookup, "zzzzzz")
    assert "'zzzzzz'" in sentence
    assert all(name in sentence for name in strategies())


def test_unknown_names_are_refused_alike_whatever_they_are_of():
    assert str(unknown("suite", "tabel2", ["table2", "table3"])) == "suite 'tabel2' is unknown; did you mean 'table2'?"


# Strategies of modules and files


def test_a_module_and_its_factory_need_no_registration():
    name, entry = lookup("baselines.nearest:Nearest")
    assert name == "Nearest"
    assert entry.factory == "baselines.nearest:Nearest"
    assert type(make_strategy(entry.factory, {})).__name__ == "Nearest"


def test_a_file_and_its_factory_need_no_registration(tmp_path, monkeypatch):
    write_plugin(tmp_path)
    monkeypatch.chdir(tmp_path)
    name, entry = lookup("./plugin.py:Plugin")
    assert name == "Plugin"
    assert entry.factory == f"{tmp_path / 'plugin.py'}:Plugin", "workers run in other folders"
    assert type(make_strategy(entry.factory, {})).__name__ == "Plugin"


def test_a_plugin_belongs_to_the_tables_that_compare_methods():
    assert set(plugin_entry("a:B", "B").tables) == {"table2", "table3"}
    assert not plugin_entry("a:B", "B").reference
    assert plugin_entry("a:B", "B").published == {}


def test_the_colour_of_a_plugin_follows_from_its_name_alone():
    assert plugin_entry("a:B", "B").color == plugin_entry("c:D", "B").color
    assert {plugin_entry("a:B", f"plugin-{i}").color for i in range(300)} == set(PLUGIN_COLORS)


def test_no_plugin_has_the_colour_of_a_registered_strategy():
    """Nor do two of theirs look alike."""
    assert not {entry.color for entry in strategies().values()} & set(PLUGIN_COLORS)
    for one, other in itertools.combinations(PLUGIN_COLORS, 2):
        apart = [abs(int(one[i : i + 2], 16) - int(other[i : i + 2], 16)) for i in (1, 3, 5)]
        assert max(apart) >= 30, (one, other)


def test_a_missing_file_is_refused_by_its_path(tmp_path):
    sentence = message(lookup, f"{tmp_path}/nowhere.py:Plugin")
    assert f"{tmp_path}/nowhere.py" in sentence
    assert "check the path" in sentence


@pytest.mark.parametrize(
    "name", ["baselines.nearest:", ":Nearest", "a b:Nearest", "baselines.nearest:Near est", "a/b:C"]
)
def test_a_specification_of_another_form_is_refused_with_the_form(name):
    sentence = message(lookup, name)
    assert f"'{name}'" in sentence
    assert "module:name" in sentence
    assert "file.py:name" in sentence


def test_the_last_colon_separates():
    assert parse_factory("/tmp/a:b/c.py:Name") == ("/tmp/a:b/c.py", "Name")


# Parameters and weights


def test_parameters_override_those_of_the_entry_and_are_in_the_name_and_the_label():
    name, entry = lookup("graph-stnn-1-layer[ state = false ]")
    base = strategies()["graph-stnn-1-layer"]
    assert name == "graph-stnn-1-layer[state=false]"
    assert entry.label == "Graph-STNN, 1 GCN layer [state=false]"
    assert entry.parameters == {"layers": 1, "state": False}
    assert (entry.factory, entry.tables, entry.weights) == (base.factory, base.tables, base.weights)
    assert lookup("graph-stnn-1-layer[layers=2]")[1].parameters == {"layers": 2}


def test_one_spelling_of_parameters_is_as_good_as_another():
    assert lookup("uncertainty[weight=0.10]") == lookup("uncertainty[ weight=1e-1 ]")
    assert lookup("entropy[]") == lookup("entropy")
    with pytest.raises(RequestError, match="same name"):
        plan("smoke", ["uncertainty[weight=0.10]", "uncertainty[weight=0.1]"])


def test_no_paper_prints_a_variant():
    assert strategies()["entropy"].published
    assert lookup("entropy[alpha=0.5]")[1].published == {}


def test_the_colours_of_variants_differ_from_their_plugin_s_and_follow_from_the_name(tmp_path):
    plugin = write_plugin(tmp_path)
    colors = [lookup(f"{plugin}{own}")[1].color for own in ("", "[k=1]", "[k=2]", "[k=3]", "[k=4]")]
    assert colors[0] not in colors[1:]
    assert len(set(colors)) > 2
    assert entry_named("Plugin[k=2]").color == colors[2]


def test_a_file_s_parameters_reach_its_factory(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("class Mine:\n    def __init__(self, k, name='x'): self.got = (k, name)\n")
    name, entry = lookup(f'{file}:Mine[name="a b", k=3]')
    assert name == 'Mine[k=3, name="a b"]'
    assert make_strategy(entry.factory, entry.parameters).got == (3, "a b")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("entropy[alpah=0.5]", ["alpha", "alpah=0.5"]),
        ("entropy[alpha=-1]", ["alpha", "-1", "above 0"]),
        ("nearest[k=1]", ["baselines.nearest:Nearest", "k=1"]),
        ("gcn-obs[layers=9]", ["baselines.learned.gcn", "layers=9"]),
    ],
)
def test_parameters_that_a_strategy_does_not_take_are_a_wrong_request(asked, words):
    sentence = message(check_runnable, plan("smoke", [asked], trials=1).specs)
    assert all(word in sentence for word in words), sentence


def test_weights_become_the_entry_s_and_only_their_file_name_is_in_the_strategy_s(tmp_path, monkeypatch):
    plugin = write_plugin(tmp_path)
    (tmp_path / "deep").mkdir()
    for name in ("a.safetensors", "deep/b.safetensors"):
        (tmp_path / name).write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    name, entry = lookup(f"{plugin}[weights=deep/b.safetensors, k=1]")
    assert name == 'Plugin[k=1, weights="b.safetensors"]'
    assert entry.weights == {0: str(tmp_path / "deep" / "b.safetensors")}, "workers run in other folders"
    assert entry.parameters == {"k": 1}
    assert lookup(f'{plugin}[weights=["a.safetensors", "deep/b.safetensors"]]')[1].weights.keys() == {0, 1}
    specs = plan("smoke", [f"{plugin}[weights=deep/b.safetensors]"], trials=1).specs
    assert specs[0].arguments == {"weights": str(tmp_path / "deep" / "b.safetensors")}


def test_weights_of_a_package_are_named_by_it():
    shipped = strategies()["gcn-obs"].weights[1]
    name, entry = lookup(f'gcn-obs[weights="{shipped}"]')
    assert entry.weights == {0: shipped}
    assert name == 'gcn-obs[weights="gcn-obs-1.safetensors"]'


@pytest.mark.parametrize("weights", ["nowhere.safetensors", "3", "[]", '["nowhere.safetensors"]', '"a:b"'])
def test_weights_that_are_not_there_are_refused(tmp_path, weights):
    assert "weights" in message(lookup, f"{write_plugin(tmp_path)}[weights={weights}]")


def test_a_plugin_may_not_take_the_name_of_a_registered_strategy(tmp_path):
    """Its rows would stand under the other's label, beside what the paper prints of that."""
    (tmp_path / "mine.py").write_text("class nearest: ...\n")
    sentence = message(lookup, f"{tmp_path / 'mine.py'}:nearest")
    assert "'nearest'" in sentence
    assert "rename" in sentence


# Names of records


def test_a_name_alone_says_what_is_shown_of_a_strategy_that_is_not_registered(tmp_path):
    plugin = write_plugin(tmp_path)
    for asked in ("entropy[alpha=0.5]", "nearest", plugin, f"{plugin}[k=3, name=x]"):
        name, entry = lookup(asked)
        shown = entry_named(name)
        assert (shown.label, shown.color, shown.tables) == (entry.label, entry.color, entry.tables)
    assert entry_named("Plugin[half").label == "Plugin[half"


def test_variants_follow_their_strategy_and_plugins_come_last():
    names = ["Mine[k=3]", "random", "entropy[alpha=2]", "Mine", "entropy", "A", "entropy[alpha=0.5]", "random"]
    assert in_order(names) == [
        *("entropy", "entropy[alpha=0.5]", "entropy[alpha=2]", "random"),
        *("A", "Mine", "Mine[k=3]"),
    ]


# Plugins that are broken


BROKEN = [
    ("class Plugin(:\n", "SyntaxError"),
    ("import no_such_module_anywhere\n", "no_such_module_anywhere"),
    ("1 / 0\n", "ZeroDivisionError"),
    ("raise SystemExit(3)\n", "SystemExit"),
    ("class Plugin:\n    def __init__(self): raise RuntimeError('first\\nsecond')\n", "RuntimeError: first"),
    ("class Plugin:\n    def choose(self, observation): ...\n", "no method reset"),
    ("class Plugin:\n    def reset(self, rng): ...\n", "no method choose"),
    ("class Plugin:\n    reset = choose = 3\n", "no method reset"),
    ("Plugin = 3\n", "int"),
]


@pytest.mark.parametrize(("source", "words"), BROKEN)
def test_a_broken_plugin_is_a_failed_trial_that_is_tried_again(tmp_path, source, words):
    """The request was right, and whatever it lacks may be there the next time."""
    file = tmp_path / "broken.py"
    file.write_text(source)
    specs = plan("smoke", [f"{file}:Plugin"], [TINY.size], 1, scenario=TINY).specs
    check_runnable(specs)
    result = run_trial(specs[0])
    assert (result.status, result.transient, result.steps) == (Status.FAILED, True, [])
    assert words in result.reason
    assert "before the first decision" in result.reason
    assert "\n" not in result.reason


@pytest.mark.parametrize(
    ("source", "words"),
    [("class Other: ...\n", "'Plugin'"), ("class Plugin:\n    def __init__(self, weight): ...\n", "(weight)")],
)
def test_a_plugin_that_was_asked_for_wrongly_is_refused_before_anything_runs(tmp_path, source, words):
    file = tmp_path / "wrong.py"
    file.write_text(source)
    sentence = message(check_runnable, plan("smoke", [f"{file}:Plugin"], trials=1).specs)
    assert str(file) in sentence
    assert words in sentence


def test_a_plugin_that_was_mended_can_be_imported(tmp_path):
    """Nothing half-made is kept of the first try."""
    file = tmp_path / "mended.py"
    file.write_text("class Plugin: ...\nraise LookupError('not yet')\n")
    assert "not yet" in message(make_strategy, f"{file}:Plugin", {})
    file.write_text("class Plugin: done = True\n")
    assert make_strategy(f"{file}:Plugin", {}).done


def test_a_module_that_does_not_exist_is_refused_by_its_name():
    sentence = message(check_runnable, plan("smoke", ["no_such_package.strategy:Mine"], trials=1).specs)
    assert "no_such_package" in sentence


def test_a_strategy_that_is_told_the_truth_needs_another_method(tmp_path, entry_points):
    factory = write_plugin(tmp_path)
    entry_points(mine={"mine": Entry(factory, "Mine", reference=True)})
    specs = plan("smoke", ["mine"], [TINY.size], 1, scenario=TINY).specs
    assert "reset_with_world" in run_trial(specs[0]).reason


def test_parameters_that_a_factory_refuses_are_named(tmp_path):
    factory = write_plugin(tmp_path)
    sentence = message(make_strategy, factory, {"weight": 0.5})
    assert factory in sentence
    assert "weight=0.5" in sentence


def test_a_request_that_a_factory_refuses_itself_is_passed_on_unchanged(tmp_path):
    """It says already what is wrong and what mends it."""
    head = "from explore_bench.errors import RequestError"
    factory = write_plugin(tmp_path, head=head)
    file = tmp_path / "plugin.py"
    file.write_text(
        file.read_text().replace(
            "    def reset", "    def __init__(self, weights): raise RequestError('no weights; train')\n\n    def reset"
        )
    )
    assert message(make_strategy, factory, {"weights": "a.safetensors"}) == "no weights; train"


def test_weights_that_are_gone_are_refused_in_the_words_of_the_strategy(trained):
    from baselines.learned.gcn import strategy

    [path] = trained(0).values()
    Path(path).unlink()
    specs = plan("smoke", ["gcn-obs"], trials=1).specs
    assert message(check_runnable, specs) == message(strategy, path)
    assert path in message(strategy, path)


def test_every_training_seed_is_made_before_anything_runs(trained):
    weights = trained(0, 1)
    Path(weights[1]).write_bytes(b"half")
    assert weights[1] in message(check_runnable, plan("smoke", ["gcn-obs"], trials=1).specs)


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (LookupError("no map"), "LookupError: no map"),
        (LookupError("no map\nsecond line"), "LookupError: no map"),
        (LookupError(), "LookupError"),
        (RuntimeError("\nIndeterminate linear system\nin x1"), "RuntimeError: Indeterminate linear system"),
    ],
)
def test_an_exception_is_described_in_one_line_that_says_something(error, text):
    """The messages of gtsam begin with an empty line."""
    assert describe(error) == text


# Entry points of others


def test_other_packages_register_entries_or_plain_strings(entry_points):
    entry = Entry("theirs.a:A", "Their A", "#123456")
    entry_points(baselines={"ours": "ours:X"}, theirs={"a": entry, "b": "theirs.b:B"})
    assert list(strategies()) == ["ours", "a", "b"]
    assert strategies()["a"] is entry
    assert strategies()["b"] == plugin_entry("theirs.b:B", "b")


def test_the_project_s_own_strategies_come_first_and_cannot_be_taken_over(entry_points):
    entry_points(a_plugin={"nearest": "evil:Nearest", "z": "evil:Z"}, baselines={"nearest": "ours:Nearest"})
    assert list(strategies()) == ["nearest", "z"]
    assert strategies()["nearest"].factory == "ours:Nearest"


def test_listing_strategies_imports_none_of_them(entry_points):
    entry_points(theirs={"a": "no_such_package_anywhere:A"})
    assert "a" in strategies()
    assert "no_such_package_anywhere" not in sys.modules


def fails_to_load():
    raise ImportError("cannot import name 'STRATEGIES'")


def exits():
    raise SystemExit(3)


UNUSABLE = {
    "cannot be imported": (fails_to_load, "theirs", "cannot import name 'STRATEGIES'"),
    "exits": (exits, "theirs", "SystemExit: 3"),
    "no mapping": (lambda: 3, "theirs", "TypeError"),
    "no entry": ({"a": 7, "good": "theirs:A"}, "a", "7"),
    "no factory": ({"a": "no colon", "good": "theirs:A"}, "a", "no colon"),
    "no name": ({"a[b]": "theirs:A", "good": "theirs:A"}, "a[b]", "is no name"),
}


@pytest.mark.parametrize("kind", UNUSABLE)
def test_an_entry_point_that_cannot_be_used_is_a_broken_strategy_among_the_others(entry_points, kind):
    mapping, name, words = UNUSABLE[kind]
    entry_points(baselines={"ours": "baselines.nearest:Nearest"}, theirs=mapping)
    known = strategies()
    assert known.keys() == {"ours", name} | ({"good"} if isinstance(mapping, dict) else set())
    assert not known["ours"].broken
    assert all(part in known[name].broken for part in (words, "'theirs'", GROUP, "uninstall"))
    specs = plan("smoke", [], [TINY.size], 1, scenario=TINY).specs
    check_runnable([spec for spec in specs if spec.strategy != "good"])
    reasons = {spec.strategy: run_trial(spec).reason for spec in specs}
    assert known[name].broken in reasons[name]
    assert reasons["ours"] == ""


def test_what_an_entry_point_prints_goes_to_stderr(entry_points, capsys):
    entry_points(theirs=lambda: print("hello") or {"a": "theirs:A"})
    assert list(strategies()) == ["a"]
    assert capsys.readouterr() == ("", "hello\n")


# Entries


@pytest.mark.parametrize("color", ["red", "#12345", "#1234567", "#12345g", ""])
def test_an_entry_s_colour_is_checked(color):
    with pytest.raises(ValueError, match="#rrggbb"):
        Entry("a:B", "B", color)


def test_an_entry_s_factory_is_checked():
    with pytest.raises(RequestError, match="module:name"):
        Entry("nonsense", "B")


def test_a_strategy_that_is_not_learned_is_ready_without_weights():
    entry = Entry("a:B", "B")
    assert entry.ready
    assert (entry.trainer, dict(entry.training), dict(entry.weights)) == (None, {}, {})


def test_a_learned_strategy_is_ready_once_it_has_weights(untrained):
    entry = Entry("a:B", "B", trainer="a:train")
    assert not entry.ready
    assert dataclasses.replace(entry, weights={3: "b-3.safetensors"}).ready
    untrained()
    known = strategies()
    assert {name for name, entry in known.items() if not entry.ready} == {n for n, e in known.items() if e.trainer}


def test_every_entry_has_a_factory_and_learned_ones_say_what_trains_them():
    known = strategies()
    assert all(entry.factory for entry in known.values())
    assert {name for name, entry in known.items() if entry.trainer is None and entry.tables} == {
        *("entropy", "entropy-path", "entropy-per-metre", "uncertainty", "random", "nearest"),
        *("clairvoyant", "clairvoyant-accurate"),
    }


def test_shipped_weights_are_named_by_strategy_and_training_seed_and_have_a_card_and_a_curve():
    for name, entry in strategies().items():
        for seed, weights in entry.weights.items():
            assert weights == f"baselines:weights/{name}-{seed}.safetensors", "a checkout may be moved"
            path = weights_file(weights)
            assert path.is_absolute(), "workers run in other folders"
            assert path.is_file()
            assert path.with_suffix(".json").is_file()
            assert path.with_suffix(".curve.csv").is_file()
        assert list(entry.weights) == sorted(entry.weights)
        assert entry.trainer or not entry.weights


def test_strategies_are_of_the_tables_in_which_they_are_compared():
    """The paper's own is in all of them; what needs no training is of Table 2 only, and the field of none."""
    known = strategies()
    assert known["graph-stnn"].tables == ("table2", "table3", "layers")
    assert {known[name].tables for name in ("graph-stnn-1-layer", "graph-stnn-3-layers")} == {("layers",)}
    field = {name for name, entry in known.items() if entry.factory.startswith("baselines.field.")}
    assert {name for name, entry in known.items() if not entry.tables} == field
    assert {entry.tables for name, entry in known.items() if not entry.trainer and name not in field} == {("table2",)}
    assert sum("table3" in entry.tables for entry in known.values()) == 7


# Cards


def test_the_number_of_parameters_is_that_of_the_weights(trained):
    from safetensors.numpy import load_file

    [path] = trained(0).values()
    assert parameter_count(strategies()["gcn-obs"]) == sum(values.size for values in load_file(path).values())


@pytest.mark.parametrize(
    "content",
    [None, b"", b"{", b"[]", b"3", b"{}", b'{"parameter_count": null}', b'{"parameter_count": "many"}', b"\xff\xfe"],
    ids=["missing", "empty", "half", "list", "number", "without the count", "null", "word", "bytes"],
)
def test_a_damaged_card_is_refused_by_its_file(trained, content):
    [path] = trained(0).values()
    card = Path(path).with_suffix(".json")
    card.unlink() if content is None else card.write_bytes(content)
    sentence = message(parameter_count, strategies()["gcn-obs"])
    assert str(card) in sentence
    assert "'GCN-obs'" in sentence


def test_the_paper_s_values_are_keyed_by_table_size_and_metric():
    """Graph-STNN's e differs between Tables 2 and 3."""
    published = strategies()["graph-stnn"].published
    assert published["table2", 20.0, "trajectory_error"] == 0.8761
    assert published["table3", 20.0, "trajectory_error"] == 1.0160
    assert published["table2", 20.0, "exploration_efficiency"] == published["table3", 20.0, "exploration_efficiency"]


def test_the_paper_s_tables_are_complete():
    """Table 2: 6 methods at 2 sizes, Table 3: 7 variants at 3 sizes, e and η each."""
    keys = [key for entry in strategies().values() for key in entry.published]
    assert sum(table == "table2" for table, _, _ in keys) == 24
    assert sum(table == "table3" for table, _, _ in keys) == 42


# Names that changed


def test_a_strategy_is_found_by_the_name_that_it_had_before():
    name, entry = lookup("graph-stnn-plus")
    assert (name, entry) == ("belief-attention", strategies()["belief-attention"])
    assert "graph-stnn-plus" not in strategies()
    assert entry_named("graph-stnn-plus") is entry, "records of that time have its label and its colour"


def test_former_names_of_strategies_are_no_present_ones():
    former = [name for entry in strategies().values() for name in entry.formerly]
    assert len(set(former)) == len(former)
    assert not set(former) & strategies().keys()
