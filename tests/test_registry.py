"""From names to entries: registered ones, modules, files, near spellings, and plugins that are broken."""

import dataclasses
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from handmade import write_plugin

from explore_bench import registry
from explore_bench.errors import RequestError, unknown
from explore_bench.registry import GROUP, PLUGIN_COLORS, lookup, parameter_count, plugin_entry, strategies
from explore_bench.runner import check_runnable
from explore_bench.strategy import Entry, describe, make_strategy, parse_factory
from explore_bench.suites import plan
from explore_bench.weights import weights_file


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


def test_only_the_clairvoyant_is_a_reference():
    assert [name for name, entry in strategies().items() if entry.reference] == ["clairvoyant"]


def test_no_two_strategies_share_a_label_or_a_colour():
    entries = strategies().values()
    assert len({entry.label for entry in entries}) == len(entries)
    assert len({entry.color for entry in entries}) == len(entries)


def test_every_registered_strategy_that_is_ready_can_be_made():
    """With the weights of its first training seed, and at one size."""
    first = {spec.strategy: spec for spec in reversed(plan("paper", trials=1).specs)}
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


def test_the_colour_of_a_plugin_follows_from_its_name():
    assert plugin_entry("a:B", "B").color == plugin_entry("c:D", "B").color
    assert {plugin_entry("a:B", name).color for name in "ABCDEFGHIJ"} == set(PLUGIN_COLORS)


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


# Plugins that are broken


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("class Plugin(:\n", "SyntaxError"),
        ("import no_such_module_anywhere\n", "no_such_module_anywhere"),
        ("1 / 0\n", "ZeroDivisionError"),
        ("raise SystemExit(3)\n", "SystemExit"),
        ("class Other: ...\n", "'Plugin'"),
        ("class Plugin:\n    def __init__(self, weight): ...\n", "weight"),
        ("class Plugin:\n    def __init__(self): raise RuntimeError('first\\nsecond')\n", "RuntimeError: first"),
        ("class Plugin:\n    def choose(self, observation): ...\n", "no method reset"),
        ("class Plugin:\n    def reset(self, rng): ...\n", "no method choose"),
        ("class Plugin:\n    reset = choose = 3\n", "no method reset"),
    ],
)
def test_a_broken_plugin_is_refused_before_anything_runs(tmp_path, source, words):
    file = tmp_path / "broken.py"
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
    assert "reset_with_world" in message(check_runnable, plan("smoke", ["mine"], trials=1).specs)


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


@pytest.mark.parametrize(
    "mapping",
    [fails_to_load, lambda: 3, {"a": 7}, {"a": "no colon"}],
    ids=["cannot be imported", "no mapping", "no entry", "no factory"],
)
def test_an_entry_point_that_cannot_be_used_is_refused_by_its_name(entry_points, mapping):
    entry_points(theirs=mapping)
    sentence = message(strategies)
    assert "'theirs'" in sentence
    assert GROUP in sentence
    assert "uninstall" in sentence


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
    assert {name for name, entry in known.items() if entry.trainer is None} == {
        *("entropy", "uncertainty", "random", "nearest", "clairvoyant")
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
    """The paper's own is in all of them; what needs no training is of Table 2 only."""
    known = strategies()
    assert known["graph-stnn"].tables == ("table2", "table3", "layers")
    assert {known[name].tables for name in ("graph-stnn-1-layer", "graph-stnn-3-layers")} == {("layers",)}
    assert {entry.tables for entry in known.values() if entry.trainer is None} == {("table2",)}
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
