"""The command line: every bad input in one line with its exit code, plans, reports, interruptions and imports."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
import uuid
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest
from handmade import TINY, write_plugin
from safetensors.numpy import load_file

from explore_bench.analysis import tables
from explore_bench.cli import main
from explore_bench.records import store as records
from explore_bench.records.provenance import forget_code
from explore_bench.records.store import PROTOCOL_FILE, Store
from explore_bench.runs import runner
from explore_bench.strategies import registry
from explore_bench.strategies.registry import strategies

pytestmark = pytest.mark.usefixtures("without_training_figures")

HEAVY = ("torch", "safetensors", "gtsam", "pandas", "scipy", "numba", "pyarrow", "matplotlib", "joblib", "dask")


@pytest.fixture
def call(capsys):
    """Return a function that runs a command line and returns its exit code, its output and its complaints."""

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


@pytest.fixture
def refused(call):
    """Return a function that runs a command line that is refused, and returns the one line that says why."""

    def run(*arguments):
        code, out, err = call(*arguments)
        assert code == 2, out + err
        assert out == ""
        assert err.count("\n") == 1, err
        assert err.startswith("explore-bench: ")
        return err.strip()

    return run


@pytest.fixture
def tiny(tmp_path):
    """Return the file of a scenario that is explored in no time."""
    file = tmp_path / "tiny.toml"
    file.write_text("size = 12.0\nlandmark_count = 1\nobstacle_count = 2\ncoverage = 0.8\n")
    return file


@pytest.fixture
def smoke(tmp_path, tiny):
    """Return the arguments of a small run in this process."""
    return ["run", "smoke", "--scenario", tiny, "--results", tmp_path / "results", "--backend", "sequential"]


def everything(folder):
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


# Requests that are wrong


def test_an_unknown_suite(refused, tmp_path):
    line = refused("run", "tabel2", "--results", tmp_path / "results")
    assert "suite 'tabel2' is unknown; did you mean 'table2'?" in line
    assert not (tmp_path / "results").exists()


def test_an_unknown_strategy(refused, smoke):
    assert "strategy 'nearst' is unknown; did you mean 'nearest'?" in refused(*smoke, "-s", "nearst")


def test_an_unknown_scenario(refused):
    assert "scenario 'chen2002' is unknown; did you mean 'chen2020'?" in refused(
        "run", "smoke", "--scenario", "chen2002"
    )


@pytest.mark.parametrize("size", ["0", "-20", "21", "1e9", "nan", "inf"])
def test_a_size_that_no_map_can_have(refused, tmp_path, size):
    line = refused("run", "smoke", "--size", size, "--results", tmp_path / "results")
    assert f"{float(size):g}" in line or str(float(size)) in line
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("arguments", "value"),
    [
        (("--trials", "0"), "0"),
        (("--trials", "-1"), "-1"),
        (("--trials", "many"), "many"),
        (("--size", "large"), "large"),
        (("--workers", "0"), "0"),
        (("--timeout", "0"), "0"),
        (("--timeout", "-3"), "-3"),
        (("--timeout", "nan"), "nan"),
        (("--timeout", "soon"), "soon"),
        (("--seed", "-1"), "-1"),
        (("--seed", "4294967296"), "4294967296"),
        (("--seed", "1.5"), "1.5"),
        (("--backend", "dask"), "dask"),
        (("--backend", "dask", "--scheduler", "tcp://host:1", "--workers", "3"), "workers is 3"),
        (("--scheduler", "tcp://host:1"), "'tcp://host:1'"),
        (("--frobnicate",), "--frobnicate"),
        (("-s", "baselines.nearest:"), "baselines.nearest:"),
        (("-s", "no_such_module_anywhere:Mine"), "no_such_module_anywhere"),
        (("-s", "baselines.nearest:Farthest"), "Farthest"),
        (("-s", "nowhere/plugin.py:Mine"), "nowhere/plugin.py"),
        (("extra",), "extra"),
    ],
    ids=" ".join,
)
def test_a_value_out_of_range(refused, smoke, arguments, value):
    assert value in refused(*smoke, *arguments)


def test_a_cluster_that_is_not_there(refused, smoke, tmp_path):
    pytest.importorskip("distributed", reason="distributed is missing: install the extra 'dask'")
    assert "scheduler 'nowhere' cannot be reached" in refused(*smoke, "--backend", "dask", "--scheduler", "nowhere")
    assert not (tmp_path / "results").exists()


def test_a_cluster_without_the_extra(refused, smoke, monkeypatch):
    monkeypatch.setattr(runner, "find_spec", lambda name: None)
    assert "explore-bench[dask]" in refused(*smoke, "--backend", "dask", "--scheduler", "tcp://host:8786")


@pytest.mark.parametrize(
    "arguments", [("rum",), ("run",), ("demo",), ("list", "strategy"), ("report", "now")], ids=" ".join
)
def test_a_command_that_does_not_exist_or_lacks_something(refused, arguments):
    refused(*arguments)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("sise = 20.0\n", ["sise", "size"]),
        ("[scenario]\nsize = 20.0\n", ["scenario"]),
        ("size = -20.0\n", ["size", "-20"]),
        ("size = 'large'\n", ["size", "large"]),
        ("coverage = 1.5\n", ["coverage", "1.5"]),
        ("fusion = 'sum'\n", ["fusion", "sum"]),
        ("obstacle_count = 3.5\n", ["obstacle_count", "3.5"]),
        ("obstacle_count = 99\n", ["99 obstacles"]),
        ("extends = 'chen2002'\n", ["chen2002", "chen2020"]),
        ("size: 20\n", ["TOML"]),
        ("\ufeff\x00", ["TOML"]),
        (b"\xff\xfe\x00", ["UTF-8"]),
    ],
    ids=lambda content: None if isinstance(content, list) else repr(content)[:30],
)
def test_a_scenario_file_that_is_wrong(refused, tmp_path, content, words):
    file = tmp_path / "scenario.toml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    line = refused("run", "smoke", "--scenario", file, "--results", tmp_path / "results")
    assert str(file) in line
    assert all(word in line for word in words)


def test_a_scenario_file_that_is_not_there(refused, tmp_path):
    line = refused("run", "smoke", "--scenario", tmp_path / "nowhere.toml")
    assert str(tmp_path / "nowhere.toml") in line
    assert "cannot be read" in line


def test_a_scenario_file_that_is_a_folder(refused, tmp_path):
    (tmp_path / "folder.toml").mkdir()
    assert "folder.toml" in refused("run", "smoke", "--scenario", tmp_path / "folder.toml")


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        (":Plugim", ["plugin.py", "'Plugim'"]),
        (":Plugin[k=3]", ["plugin.py", "()", "k=3"]),
        (":Plugin[k]", ["plugin.py", "'k'", "key=value"]),
        (":Plugin[weights=nowhere.safetensors]", ["'Plugin'", "nowhere.safetensors"]),
    ],
)
def test_a_strategy_s_file_that_is_asked_for_wrongly(refused, smoke, tmp_path, asked, words):
    line = refused(*smoke, "-s", write_plugin(tmp_path).replace(":Plugin", asked), "-s", "nearest")
    assert all(word in line for word in words), line
    assert not (tmp_path / "results").exists(), "nothing runs before every strategy can be asked for"


def test_two_strategies_of_one_name(refused, smoke, tmp_path):
    (tmp_path / "other").mkdir()
    first, second = write_plugin(tmp_path), write_plugin(tmp_path / "other")
    line = refused(*smoke, "-s", first, "-s", second)
    assert (
        f"strategies '{first}' and '{second}' have the same name, 'Plugin': one is {first}, the other {second}" in line
    )


BROKEN = {
    "does not parse": ("class Plugin(:\n", "SyntaxError"),
    "does not import": ("import no_such_module_anywhere\n", "No module named 'no_such_module_anywhere'"),
    "imports slowly": ("import time\ntime.sleep(60)\n", "longer than the 2 s allowed"),
    "exits": ("raise SystemExit(3)\n", "SystemExit: 3"),
    "no strategy": ("class Plugin: ...\n", "no method reset; add it"),
    "raises when made": ("class Plugin:\n    def __init__(self): 1 / 0\n", "ZeroDivisionError"),
    "raises in reset": (
        "class Plugin:\n    def reset(self, rng): 1 / 0\n    def choose(self, o): ...\n",
        "ZeroDivisionError",
    ),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_plugin_is_a_failed_row_beside_the_others_and_alone_nothing_is_measured(call, smoke, tmp_path, kind):
    source, words = BROKEN[kind]
    (tmp_path / "plugin.py").write_text(source)
    plugin = ("-s", f"{tmp_path / 'plugin.py'}:Plugin", "--timeout", 2, "--trials", 1)
    code, out, err = call(*smoke, "-s", "nearest", *plugin)
    assert code == 1, err
    assert "1 of those asked for failed" in out
    table = pd.read_csv(tmp_path / "results" / "trials.csv").set_index("strategy")
    assert table["status"].to_dict() == {"Plugin": "failed", "nearest": "explored"}
    assert words in table["reason"]["Plugin"]
    assert "Traceback" not in err
    code, _, err = call(*smoke, *plugin)
    assert code == 3
    assert err.splitlines()[-1].startswith("explore-bench: nothing was measured: ")
    assert words in err.splitlines()[-1]


def test_a_broken_plugin_that_was_mended_leaves_nothing_behind(call, smoke, tmp_path, fresh_digests):
    (tmp_path / "plugin.py").write_text("class Plugin: ...\n")
    request = [*smoke, "-s", f"{tmp_path / 'plugin.py'}:Plugin", "--trials", 1]
    assert call(*request)[0] == 3
    write_plugin(tmp_path)
    fresh_digests()
    assert call(*request)[0] == 0
    assert list(pd.read_csv(tmp_path / "results" / "trials.csv")["status"]) == ["explored"]


def test_an_edited_file_s_trials_run_again_and_no_others(call, smoke, tmp_path, fresh_digests):
    request = [*smoke, "-s", write_plugin(tmp_path), "-s", "nearest", "--trials", 2]
    assert call(*request)[0] == 0
    assert "4 stored, 0 to do" in call(*request)[1]
    write_plugin(tmp_path, "return 0")
    fresh_digests()
    _, out, _ = call(*request)
    assert "2 stored, 2 to do" in out
    assert "4 stored, 0 to do" in call(*request)[1]


def test_parameters_and_weights_are_part_of_what_is_stored(call, smoke, tmp_path, fresh_digests):
    file, weights = tmp_path / "plugin.py", tmp_path / "a.bin"
    file.write_text(
        "class Plugin:\n    def __init__(self, k=0, weights=None): self.k = k\n    def reset(self, rng): ...\n"
        "    def choose(self, observation): return min(self.k, len(observation.candidates) - 1)\n"
    )
    weights.write_bytes(b"one")
    variants = [f"{file}:Plugin{own}" for own in ("", "[k=1]", f"[weights={weights}]")]
    request = [*smoke, *(item for variant in variants for item in ("-s", variant)), "--trials", 1]
    assert call(*request)[0] == 0
    table = pd.read_csv(tmp_path / "results" / "trials.csv").set_index("strategy")
    assert list(table.index) == ["Plugin", "Plugin[k=1]", 'Plugin[weights="a.bin"]']
    assert table["training_seed"].tolist()[2] == 0
    weights.write_bytes(b"two")
    fresh_digests()
    assert "3 trials, 2 stored, 1 to do" in call(*request)[1]


def test_entry_points_that_are_broken_are_listed_and_fail_while_all_others_run(call, smoke, tmp_path, monkeypatch):
    def load():
        raise ImportError("no module named mine")

    point = SimpleNamespace(name="mine", value="mine:STRATEGIES", load=load)
    known = registry.entry_points
    monkeypatch.setattr(registry, "entry_points", lambda group: [*known(group=group), point])
    strategies.cache_clear()
    try:
        code, out, _ = call("list")
        assert code == 0
        assert re.search(r"^mine +mine +table2, table3 +broken$", out, re.MULTILINE)
        assert out.splitlines()[-1].startswith("mine: entry point 'mine' of explore_bench.strategies (mine:STRATEGIES)")
        code, _, err = call(*smoke, "-s", "mine", "-s", "nearest", "--trials", 1)
        assert code == 1
        assert "failed: mine, 12 m, world 0: entry point 'mine'" in err
        table = pd.read_csv(tmp_path / "results" / "trials.csv").set_index("strategy")
        assert table["status"].to_dict() == {"mine": "failed", "nearest": "explored"}
        assert "ImportError: no module named mine; mend or uninstall it." in table["reason"]["mine"]
        assert call("report", "--results", tmp_path / "results")[0] == 0
        assert "| mine |" in (tmp_path / "results" / "tables" / "means.md").read_text()
    finally:
        strategies.cache_clear()


def test_a_world_that_cannot_be_drawn(call, tmp_path, monkeypatch):
    monkeypatch.setattr("explore_bench.world.landmark.world.MAX_DRAWS", 1000)
    (tmp_path / "crowded.toml").write_text("size = 24.0\nobstacle_count = 100\n")
    code, _, err = call(
        *("run", "smoke", "--scenario", tmp_path / "crowded.toml", "-s", "nearest", "--trials", 1),
        *("--results", tmp_path / "results", "--backend", "sequential"),
    )
    assert code == 2
    assert "100 obstacles" in err.splitlines()[-1]


# Results folders that are wrong


def test_a_results_folder_that_cannot_be_made(refused, smoke, tmp_path):
    (tmp_path / "results").write_text("in the way")
    line = refused(*smoke, "-s", "nearest")
    assert str(tmp_path / "results") in line
    assert "--results" in line


def test_a_results_folder_below_a_file(refused, smoke, tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert str(tmp_path / "file" / "deep") in refused(*smoke, "--results", tmp_path / "file" / "deep")


def test_a_results_folder_that_may_not_be_written(refused, smoke, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert "not writable" in refused(*smoke, "-s", "nearest")


@pytest.mark.parametrize("dry", [[], ["--dry-run"]], ids=["run", "dry-run"])
def test_a_results_folder_of_another_record_version(refused, smoke, tmp_path, dry):
    store = Store(tmp_path / "results")
    store.open(0, "evaluate", TINY)
    file = store.runs / PROTOCOL_FILE
    file.write_text(json.dumps(json.loads(file.read_text()) | {"schema": 99}))
    line = refused(*smoke, *dry)
    assert "99" in line
    assert "--results" in line


def test_a_results_folder_of_another_root_seed(refused, smoke, tmp_path):
    Store(tmp_path / "results").open(0, "evaluate", TINY)
    line = refused(*smoke, "--seed", 5)
    assert "root seed" in line
    assert "5" in line


def test_a_results_folder_of_another_scenario(refused, tmp_path):
    Store(tmp_path / "results").open(0, "evaluate", TINY)
    line = refused("run", "smoke", "--results", tmp_path / "results")
    assert "scenario" in line
    assert "coverage=0.8" in line


def test_a_results_folder_with_a_damaged_protocol(refused, smoke, tmp_path):
    store = Store(tmp_path / "results")
    store.open(0, "evaluate", TINY)
    (store.runs / PROTOCOL_FILE).write_text("{")
    assert PROTOCOL_FILE in refused(*smoke)


@pytest.mark.parametrize("damage", ["truncated", "foreign", "a bit"])
@pytest.mark.parametrize("command", ["run", "report"])
def test_a_damaged_record_is_named_and_run_again(call, smoke, tmp_path, command, damage):
    request = [*smoke, "-s", "nearest", "-s", "random", "--trials", 2]
    assert call(*request)[0] == 0
    before = everything(tmp_path / "results")
    path = sorted((tmp_path / "results").glob("runs/*.parquet"))[1]
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[:1000])
    elif damage == "foreign":
        pd.DataFrame({"a": [1]}).to_parquet(path)
    else:
        content = bytearray(path.read_bytes())
        content[500] ^= 1
        path.write_bytes(content)
    words = f"1 damaged record was moved to '{tmp_path / 'results' / 'runs' / 'damaged'}': {path.name}"
    if command == "report":
        code, out, err = call("report", "--results", tmp_path / "results")
        assert (code, err.count("\n")) == (0, 1)
        assert "from 3 trials" in out
        assert words in err
        assert "4 trials, 3 stored, 1 to do" in call(*request)[1]
    else:
        code, out, err = call(*request)
        assert code == 0
        assert "4 trials, 3 stored, 1 to do" in out
        assert words in err
        assert "4 trials in" in out
    after = everything(tmp_path / "results")
    assert after[str(tmp_path / "results" / "trials.csv")] == before[str(tmp_path / "results" / "trials.csv")]
    assert after[str(path)] == before[str(path)]


def test_a_strategy_whose_file_was_moved_is_stored_and_in_the_table(call, smoke, tmp_path):
    (tmp_path / "a").mkdir()
    first = write_plugin(tmp_path / "a")
    assert call(*smoke, "-s", first, "-s", "nearest", "--trials", 2)[0] == 0
    before = pd.read_csv(tmp_path / "results" / "trials.csv")
    (tmp_path / "a").rename(tmp_path / "b")
    code, out, err = call(*smoke, "-s", first.replace("/a/", "/b/"), "--trials", 2)
    assert (code, err) == (0, "")
    assert "2 trials, 2 stored, 0 to do" in out
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "results" / "trials.csv"), before)
    assert "from 4 trials" in call("report", "--results", tmp_path / "results")[1]


def test_trials_that_are_not_in_the_table_are_said_to_be_lacking(call, smoke, tmp_path, monkeypatch):
    """Their file was edited while they ran, so what was stored is of code that is no more."""
    file = write_plugin(tmp_path, name="edited")
    write_trials = tables.write_trials

    def edited_before(store):
        path = Path(file.partition(":")[0])
        path.write_text(path.read_text().replace("argmin", "argmax"))
        forget_code()
        return write_trials(store)

    monkeypatch.setattr(tables, "write_trials", edited_before)
    code, _, err = call(*smoke, "-s", file, "-s", "nearest", "--trials", 2)
    assert code == 3
    assert "2 of the trials asked for are not in trials.csv, since their code or their weights changed" in err


@pytest.mark.parametrize("content", [b"", b"strategy,train", b"\x00\xff", b"strategy,seconds\na,b\n"])
def test_a_damaged_times_file_stops_no_run_and_is_begun_anew(call, smoke, tmp_path, content):
    request = [*smoke, "-s", "nearest"]
    assert call(*request, "--trials", 1)[0] == 0
    (tmp_path / "results" / "times.csv").write_bytes(content)
    code, out, err = call(*request, "--trials", 2, "--dry-run")
    assert (code, err) == (0, "")
    code, out, err = call(*request, "--trials", 2)
    assert code == 0
    assert "2 trials, 1 stored, 1 to do" in out
    assert len(pd.read_csv(tmp_path / "results" / "times.csv")) == 1


def test_a_sentence_about_a_broken_name_has_one_line_of_bounded_length(refused, tmp_path):
    line = refused("run", "smoke", "-s", "no\nsuch\x1b[31m strategy" + 5000 * "y", "--results", tmp_path)
    assert "no such [31m strategyyy" in line
    assert len(line) < 1100


def test_a_report_of_a_folder_without_trials(refused, tmp_path):
    line = refused("report", "--results", tmp_path / "nowhere")
    assert "holds no trials" in line
    assert str(tmp_path / "nowhere") in line


def test_a_report_of_trials_of_older_code_only(refused, own_store, monkeypatch):
    monkeypatch.setattr("explore_bench.records.provenance.library_versions", lambda *_: {"numpy": "0.1"})
    assert "9 trials of older code" in refused("report", "--results", own_store.folder)


def test_a_report_that_cannot_be_written(refused, own_store):
    (own_store.folder / "tables").write_text("in the way")
    assert str(own_store.folder) in refused("report", "--results", own_store.folder)


def test_a_demo_of_another_kind_of_file(refused, tmp_path, tiny):
    line = refused("demo", "nearest", "--scenario", tiny, "--size", 12, "--output", tmp_path / "a.pdf")
    assert ".pdf" in line
    assert ".gif" in line


def test_a_demo_of_a_strategy_that_is_not_trained(refused, untrained, tmp_path):
    untrained("graph-stnn")
    assert "'graph-stnn' is not trained" in refused("demo", "graph-stnn", "--output", tmp_path / "a.png")


@pytest.mark.parametrize("file", ["weights", "card"])
@pytest.mark.parametrize("damage", ["missing", "half"])
def test_a_run_with_damaged_weights(refused, smoke, trained, tmp_path, file, damage):
    path = Path(trained(0, 1)[1])
    path = path if file == "weights" else path.with_suffix(".json")
    path.unlink() if damage == "missing" else path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    line = refused(*smoke, "-s", "gcn-obs")
    assert str(path) in line
    assert "train" in line
    assert not (tmp_path / "results").exists(), "nothing runs before every training seed can be made"


def test_a_demo_that_cannot_be_written(tmp_path, tiny):
    """In a process of its own, for matplotlib may warn when the process ends."""
    (tmp_path / "file").write_text("in the way")
    outputs = [str(tmp_path / "file" / name) for name in ("a.png", "a.gif")]
    code = f"""
from explore_bench.cli import main
for output in {outputs!r}:
    try:
        main(["demo", "nearest", "--scenario", {str(tiny)!r}, "--size", "12", "--output", output])
    except SystemExit as ended:
        print(ended.code)
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.stdout.split() == ["2", "2"]
    lines = found.stderr.splitlines()
    assert len(lines) == len(outputs), found.stderr
    assert all(output in line for output, line in zip(outputs, lines, strict=True))


def test_a_demo_of_a_trial_that_fails_before_any_decision(refused, tmp_path, tiny):
    file = tmp_path / "plugin.py"
    file.write_text(
        "class Plugin:\n    def reset(self, rng): raise LookupError('no map')\n    def choose(self, o): ...\n"
    )
    line = refused("demo", f"{file}:Plugin", "--scenario", tiny, "--size", 12, "--output", tmp_path / "a.png")
    assert "no map" in line


def test_measurements_that_cannot_be_written(call, tmp_path, monkeypatch):
    from explore_bench.runs import perf

    nothing = perf.Perf({"20": 1.0, "40": 1.0}, {}, {"20": 1.0, "40": 1.0}, {}, [])
    monkeypatch.setattr(perf, "measure", lambda say, names: nothing)
    code, _, err = call("perf", "--json", tmp_path / "nowhere" / "perf.json")
    assert (code, err.count("\n")) == (2, 1)
    assert str(tmp_path / "nowhere" / "perf.json") in err


# Runs


def test_a_run_prints_its_plan_writes_its_table_and_is_done(call, smoke, tmp_path):
    code, out, err = call(*smoke, "-s", "nearest", "-s", "random", "--trials", 2)
    assert code == 0, err
    assert "plan: 4 trials, 0 stored, 4 to do" in out
    assert str(tmp_path / "results" / "trials.csv") in out
    assert len(pd.read_csv(tmp_path / "results" / "trials.csv")) == 4
    assert {path.name for path in (tmp_path / "results").iterdir()} == {"runs", "trials.csv", "times.csv"}


def test_a_second_run_does_nothing_and_a_larger_one_the_rest(call, smoke, tmp_path):
    call(*smoke, "-s", "nearest", "--trials", 2)
    before = everything(tmp_path / "results")
    code, out, _ = call(*smoke, "-s", "nearest", "--trials", 2)
    assert code == 0
    assert "2 trials, 2 stored, 0 to do" in out
    assert everything(tmp_path / "results") == before
    _, out, _ = call(*smoke, "-s", "nearest", "--trials", 3)
    assert "3 trials, 2 stored, 1 to do" in out


def test_progress_is_in_plain_lines_where_there_is_no_terminal(call, smoke):
    _, _, err = call(*smoke, "-s", "nearest", "--trials", 3)
    *begun, last = err.splitlines()
    assert [re.sub(r"\d+ s", "N s", line) for line in begun] == [
        "1 of 3 trials, about N s to go",
        "2 of 3 trials, about N s to go",
    ]
    assert last == "3 of 3 trials"


def test_a_dry_run_writes_nothing(call, smoke, tmp_path, monkeypatch, untrained):
    untrained()
    monkeypatch.setattr(runner, "run_here", lambda *_: pytest.fail("a trial was run"))
    code, out, err = call(*smoke, "--trials", 2, "--dry-run")
    assert (code, err) == (0, "")
    assert "16 trials, 0 stored, 16 to do" in out
    assert "not trained: graph-stnn" in out
    assert not (tmp_path / "results").exists()


def test_a_dry_run_of_a_folder_with_records_counts_them_and_leaves_it_alone(call, own_store, tiny):
    before = everything(own_store.folder)
    request = ["run", "smoke", "--scenario", tiny, "-s", "nearest", "--trials", 5, "--results", own_store.folder]
    code, out, _ = call(*request, "--dry-run")
    assert code == 0
    assert "5 trials, 3 stored, 2 to do" in out
    assert everything(own_store.folder) == before


def test_a_learned_strategy_runs_with_every_training_seed_and_is_reported(call, smoke, tmp_path, trained):
    trained(0, 3)
    code, out, err = call(*smoke, "-s", "gcn-obs", "-s", "nearest", "--trials", 2)
    assert code == 0, err
    assert "plan: 6 trials, 0 stored, 6 to do" in out
    table = pd.read_csv(tmp_path / "results" / "trials.csv", dtype={"training_seed": "Int64"})
    learned = table[table["strategy"] == "gcn-obs"]
    assert list(zip(learned["training_seed"], learned["trial"], strict=True)) == [(0, 0), (0, 1), (3, 0), (3, 1)]
    assert (table.groupby("trial")["world"].nunique() == 1).all(), "the same worlds as all others"
    assert "6 trials, 6 stored, 0 to do" in call(*smoke, "-s", "gcn-obs", "-s", "nearest", "--trials", 2)[1]
    code, _, err = call("report", "--results", tmp_path / "results")
    assert code == 0, err
    summary = pd.read_csv(tmp_path / "results" / "summary.csv").set_index(["strategy", "size", "metric"])
    assert summary.loc[("gcn-obs", 12.0, "trajectory_error"), "n"] == 2, "worlds, not training seeds"


def test_strategies_that_are_not_trained_are_no_failure(call, smoke, untrained):
    untrained("graph-stnn")
    code, out, _ = call(*smoke, "-s", "graph-stnn", "-s", "nearest", "--trials", 1)
    assert code == 0
    assert "not trained: graph-stnn" in out


def test_a_run_of_nothing_but_strategies_that_are_not_trained_measures_nothing(call, tmp_path, untrained):
    untrained()
    code, out, _ = call("run", "layers", "--results", tmp_path / "results")
    assert code == 3
    assert "not trained: graph-stnn" in out
    assert not (tmp_path / "results").exists()


def test_a_failed_trial_is_a_row_with_its_reason_and_the_answer_is_no(call, smoke, tmp_path):
    plugin = write_plugin(tmp_path, "raise LookupError('no map in the glove box')")
    code, out, err = call(*smoke, "-s", plugin, "-s", "nearest", "--trials", 1)
    assert code == 1
    assert "1 of those asked for failed" in out
    assert "failed: Plugin, 12 m, world 0: LookupError: no map in the glove box (at decision 1), in " in err
    assert "plugin.py:14: raise LookupError('no map in the glove box')\n" in err
    table = pd.read_csv(tmp_path / "results" / "trials.csv").set_index("strategy")
    assert table["status"].to_dict() == {"Plugin": "failed", "nearest": "explored"}
    assert "no map in the glove box" in table["reason"]["Plugin"]


def test_the_answer_stays_no_when_the_failed_trial_is_stored(call, smoke, tmp_path):
    request = [*smoke, "-s", write_plugin(tmp_path, "return 99"), "--trials", 1]
    assert call(*request)[0] == 1
    code, out, _ = call(*request)
    assert code == 1
    assert "0 to do" in out


def test_failures_of_strategies_that_were_not_asked_for_are_no_failure(call, smoke, tmp_path):
    call(*smoke, "-s", write_plugin(tmp_path, "return 99"), "--trials", 1)
    assert call(*smoke, "-s", "nearest", "--trials", 1)[0] == 0


def test_a_strategy_that_takes_too_long_fails(call, smoke, tmp_path):
    code, _, err = call(*smoke, "-s", write_plugin(tmp_path, "while True: pass"), "--trials", 1, "--timeout", 0.5)
    assert code == 1
    assert "took longer than the 0.5 s allowed" in err


def interrupting(folder, what):
    """Return a strategy whose second trial does this."""
    file = folder / "second.py"
    file.write_text(
        "begun = []\n"
        "class Second:\n"
        "    def reset(self, rng): begun.append(1)\n"
        "    def choose(self, observation):\n"
        f"        if len(begun) > 1: {what}\n"
        "        return int(observation.path_lengths.argmin())\n"
    )
    return f"{file}:Second"


def test_an_interrupted_run_says_so_and_keeps_what_is_done(call, smoke, tmp_path):
    strategy = interrupting(tmp_path, "import signal; signal.raise_signal(signal.SIGINT)")
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)  # in the background it is ignored
    try:
        code, _, err = call(*smoke, "-s", strategy, "--trials", 3)
    finally:
        signal.signal(signal.SIGINT, previous)
    assert code == 130
    assert err.splitlines()[-1] == "explore-bench: interrupted; what is done is stored, the same command goes on."
    assert "Traceback" not in err
    table = pd.read_csv(tmp_path / "results" / "trials.csv")
    assert list(table["trial"]) == [0]
    assert list(table["status"]) == ["explored"]
    _, out, _ = call(*smoke, "-s", strategy, "--trials", 3, "--dry-run")
    assert "3 trials, 1 stored, 2 to do" in out


@pytest.mark.parametrize(
    ("verb", "worker"),
    [
        (("demo", "nearest"), "explore_bench.report.demo.draw_trials"),
        (("report",), "explore_bench.report.render.write_report"),
        (("check", "nearest"), "explore_bench.runs.conformance.findings"),
    ],
)
def test_a_verb_that_stores_nothing_does_not_promise_to_go_on(call, monkeypatch, verb, worker):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(worker, interrupted)
    code, _, err = call(*verb)
    assert code == 130
    assert err.strip() == "explore-bench: interrupted; the same command begins anew."


def test_ctrl_c_on_a_terminal_reaches_all_workers_and_ends_the_run_quietly(tmp_path, tiny):
    """The terminal sends SIGINT to the whole group of processes, the workers among them."""
    lines = "import time; time.sleep(0.05)\nreturn int(observation.path_lengths.argmin())"
    arguments = ["run", "smoke", "--scenario", str(tiny), "--results", str(tmp_path / "results"), "--workers", "2"]
    arguments += ["-s", write_plugin(tmp_path, lines), "--trials", "500"]
    # where the tests themselves run in the background of a script, SIGINT is ignored, and that is inherited
    code = f"""import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from explore_bench.cli import main
main({arguments!r})"""
    process = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        wait_for(lambda: len(list((tmp_path / "results").glob("runs/*.parquet"))) > 3 or process.poll() is not None)
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=120)  # seconds, on a busy machine
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    assert "interrupted" in err.splitlines()[-1]
    stored = len(list((tmp_path / "results").glob("runs/*.parquet")))
    assert len(pd.read_csv(tmp_path / "results" / "trials.csv")) in (stored - 2, stored - 1, stored)


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGKILL])
def test_a_main_process_that_is_told_to_end_takes_its_workers_along(tmp_path, tiny, sent):
    """Only the main process gets the signal, as from a scheduler of jobs or from a lack of memory."""
    mark = f"sign-of-{uuid.uuid4().hex}"
    lines = "import time; time.sleep(0.05)\nreturn int(observation.path_lengths.argmin())"
    folder = tmp_path / "results"
    arguments = ["run", "smoke", "--scenario", str(tiny), "--results", str(folder), "--workers", "2"]
    arguments += ["-s", write_plugin(tmp_path, lines), "--trials", "500"]
    command = [sys.executable, "-c", f"from explore_bench.cli import main\nmain({arguments!r})"]
    environment = os.environ | {"EXPLORE_BENCH_TEST": mark}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        wait_for(lambda: len(list(folder.glob("runs/*.parquet"))) > 3 or process.poll() is not None)
        assert len(marked(mark)) > 2, "the main process and its workers"
        process.send_signal(sent)
        process.wait(timeout=120)
        wait_for(lambda: not marked(mark))
        _, err = process.communicate(timeout=10)
    finally:
        for number in marked(mark):
            os.kill(number, signal.SIGKILL)
    if sent == signal.SIGTERM:
        assert process.returncode == 130, err
        assert "interrupted" in err.splitlines()[-1]
        assert len(pd.read_csv(folder / "trials.csv")) > 3
    assert "warn" not in err.lower()
    assert "Traceback" not in err


def marked(mark):
    """Numbers of the processes that have a mark in their environment."""
    found = []
    for place in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            if mark.encode() in place.read_bytes():
                found.append(int(place.parent.name))
    return found


def wait_for(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_a_trial_that_kills_its_worker_is_reported_as_failed(call, tiny, tmp_path):
    plugin = write_plugin(tmp_path, "os._exit(1)", head="import os")
    request = ["run", "smoke", "--scenario", tiny, "--results", tmp_path / "results", "--workers", 1, "--trials", 1]
    code, _, err = call(*request, "-s", plugin)
    assert code == 3, "nothing was measured"
    assert err.count("its worker process died") == 2, "a line for the trial, and one for all"
    assert "Traceback" not in err
    assert (tmp_path / "results" / "trials.csv").exists()


def test_a_disk_that_is_full_is_said_in_one_line(call, smoke, monkeypatch):
    def fail(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    request = [*smoke, "-s", "nearest", "--trials", 2]
    call(*request[:-1], 1)
    monkeypatch.setattr(os, "fsync", fail)
    code, _, err = call(*request)
    assert code in (2, 3)
    assert "No space left on device" in err.splitlines()[-1]
    assert "Traceback" not in err


# Reports and demos


def test_a_report_simulates_nothing(call, own_store, monkeypatch):
    def fail(*_, **__):
        pytest.fail("something was simulated")

    monkeypatch.setattr("explore_bench.trial.run.rollout", fail)
    monkeypatch.setattr("explore_bench.trial.run.run_trial", fail)
    monkeypatch.setattr("explore_bench.trial.landmark.explorer.LandmarkExplorer.__init__", fail)
    monkeypatch.setattr("explore_bench.world.landmark.world.LandmarkWorld.draw", fail)
    code, out, err = call("report", "--results", own_store.folder)
    assert code == 0, err
    assert "from 9 trials" in out
    for name in ("trials.csv", "summary.csv", "tables/means.md", "tables/paired.tex", "tables/details.csv"):
        assert (own_store.folder / name).stat().st_size > 0, name


def test_a_report_writes_the_same_table_of_trials_as_the_run(call, smoke, tmp_path):
    call(*smoke, "-s", "nearest", "--trials", 2)
    before = (tmp_path / "results" / "trials.csv").read_bytes()
    call("report", "--results", tmp_path / "results")
    assert (tmp_path / "results" / "trials.csv").read_bytes() == before


def test_a_report_counts_the_trials_of_older_code_that_it_leaves_out(call, smoke, tmp_path, fresh_digests):
    plugin = write_plugin(tmp_path)
    call(*smoke, "-s", plugin, "-s", "nearest", "--trials", 1)
    write_plugin(tmp_path, "return 0")
    fresh_digests()
    code, out, _ = call("report", "--results", tmp_path / "results")
    assert code == 0
    assert "from 1 trials, 1 of older code left out" in out


@pytest.mark.parametrize(
    "source",
    [
        "    def reset(self, rng): raise LookupError('no')\n    def choose(self, o): return 0\n",
        "    def reset(self, rng): ...\n    def choose(self, o): raise LookupError('no')\n",
    ],
    ids=["before any row", "at the first decision"],
)
def test_a_report_of_trials_that_failed_can_be_written(call, smoke, tmp_path, source):
    file = tmp_path / "plugin.py"
    file.write_text(f"class Plugin:\n{source}")
    assert call(*smoke, "-s", f"{file}:Plugin", "-s", "nearest", "-s", "random", "--trials", 2)[0] == 1
    code, _, err = call("report", "--results", tmp_path / "results")
    assert code == 0, err
    assert "Plugin" in (tmp_path / "results" / "tables" / "details.md").read_text()


def test_two_folders_are_compared_by_world_as_a_table_and_as_json(call, smoke, tmp_path):
    for folder, names in (("a", ("nearest",)), ("b", ("nearest", "random"))):
        arguments = [item for name in names for item in ("-s", name)]
        assert call(*smoke, *arguments, "--trials", 2, "--results", tmp_path / folder)[0] == 0
    code, out, _ = call("compare", tmp_path / "a", tmp_path / "b", "--json", tmp_path / "c.json")
    assert code == 0
    assert "| Nearest | 12, tiny.toml | e [m] | 2 |" in out
    assert "- random, 12 m, tiny.toml: 2 worlds only in B" in out
    values = json.loads((tmp_path / "c.json").read_text())
    assert {row["difference"]["mean"] for row in values["differences"]} == {0.0}


def test_a_comparison_with_a_folder_without_trials_or_to_a_file_that_cannot_be(refused, call, smoke, tmp_path):
    assert "nowhere" in refused("compare", tmp_path / "nowhere", tmp_path)
    assert call(*smoke, "-s", "nearest", "--trials", 1, "--results", tmp_path / "a")[0] == 0
    code, _, err = call("compare", tmp_path / "a", tmp_path / "a", "--json", tmp_path / "no" / "c.json")
    assert (code, err.count("\n")) == (2, 1)


def test_two_folders_are_merged_and_reported(call, smoke, tmp_path):
    for name in ("nearest", "random"):
        assert call(*smoke, "-s", name, "--trials", 2, "--results", tmp_path / name)[0] == 0
    merge = ("merge", tmp_path / "nearest", tmp_path / "random", "--results", tmp_path / "all")
    assert call(*merge) == (0, f"4 trials in {tmp_path / 'all'}, 4 of them new\n", "")
    assert call(*merge) == (0, f"4 trials in {tmp_path / 'all'}, 0 of them new\n", "")
    assert call("report", "--results", tmp_path / "all")[0] == 0


def test_a_merge_of_nothing_but_trials_of_other_code_has_nothing_to_show(call, own_store, tmp_path, monkeypatch):
    monkeypatch.setattr(records, "trial_key", lambda spec: "")
    code, out, _ = call("merge", own_store.folder, "--results", tmp_path / "all")
    assert code == 3
    assert "9 of other code" in out


@pytest.mark.parametrize("folders", [(), ("nowhere",), ("nowhere", "nowhere")], ids=len)
def test_a_merge_of_what_is_no_folder_of_records(refused, tmp_path, folders):
    assert refused("merge", *(tmp_path / name for name in folders), "--results", tmp_path / "all")
    assert not (tmp_path / "all").exists()


def test_robustness_has_a_folder_of_its_own_and_a_report_of_its_own(call, refused, tmp_path):
    own = ("run", "robustness", "-s", "nearest", "--size", 12, "--trials", 1, "--backend", "sequential")
    assert call(*own, "--results", tmp_path / "own")[:1] == (0,)
    assert len(pd.read_csv(tmp_path / "own" / "trials.csv")) == 10
    assert len(pd.read_csv(tmp_path / "own" / "times.csv")) == 10
    assert "0 to do" in call(*own, "--results", tmp_path / "own")[1]
    assert call("report", "--results", tmp_path / "own")[0] == 0
    assert (tmp_path / "own" / "tables" / "sensitivity.md").is_file()
    assert not (tmp_path / "own" / "summary.csv").exists()
    assert "'any'" in refused("run", "smoke", "-s", "nearest", "--trials", 1, "--results", tmp_path / "own")


def test_maps_has_a_folder_of_its_own_and_a_report_of_its_own(call, refused, tmp_path):
    own = ("run", "maps", "-s", "nearest", "--trials", 1, "--backend", "sequential", "--results", tmp_path / "own")
    assert call(*own)[0] == 0
    trials = pd.read_csv(tmp_path / "own" / "trials.csv")
    assert list(trials["scenario"]) == ["cave", "corridor", "loop", "rooms"]
    assert set(trials["status"]) == {"explored"}
    assert "0 to do" in call(*own)[1]
    assert call("report", "--results", tmp_path / "own")[0] == 0
    assert (tmp_path / "own" / "tables" / "maps.md").is_file()
    assert (tmp_path / "own" / "figures" / "maps.svg").is_file()
    assert not (tmp_path / "own" / "summary.csv").exists()


def test_stage_has_a_folder_of_its_own_and_goes_on_where_it_stopped(call, refused, tmp_path):
    own = ("-s", "nearest", "--size", 8, "--backend", "sequential", "--results", tmp_path / "own")
    assert call("run", "stage", "--trials", 1, *own)[0] == 0
    code, out, _ = call("run", "stage", "--trials", 2, *own)
    assert code == 0
    assert "plan: 4 trials, 2 stored, 2 to do" in out
    trials = pd.read_csv(tmp_path / "own" / "trials.csv")
    assert sorted(trials["scenario"]) == ["range 10 m"] * 2 + ["range 5 m"] * 2
    assert call("report", "--results", tmp_path / "own")[0] == 0
    assert "'any'" in refused("run", "figure16", *own)


def test_figure_16_runs_on_the_constants_of_its_scenario(call, refused, tmp_path):
    own = ("-s", "nearest", "--size", 8, "--trials", 1, "--backend", "sequential", "--results", tmp_path / "own")
    assert call("run", "figure16", *own)[0] == 0
    assert list(pd.read_csv(tmp_path / "own" / "trials.csv")["scenario"]) == ["stage"]
    assert "1 stored, 0 to do" in call("run", "smoke", "--scenario", "stage", *own)[1], "the same trials"
    assert "not 'paper'" in refused("run", "smoke", *own)


def test_a_run_says_what_is_not_for_its_kind_of_world(call, refused, tmp_path):
    dry = ("--dry-run", "--results", tmp_path / "own")
    assert "not for this kind of world: clairvoyant, clairvoyant-accurate\n" in call("run", "stage", *dry)[1]
    assert "not for" not in call("run", "smoke", *dry)[1]
    assert "'clairvoyant' runs in worlds of kind landmark, not 'lidar'; leave it out" in refused(
        "run", "stage", "-s", "clairvoyant", *dry
    )
    assert "leave your scenario or map out" in refused("run", "plans", "--map", "loop", *dry)
    assert "leave your scenario or map out" in refused("run", "stage", "--scenario", "stage", *dry)


MAP = "##########\n#........#\n#.######.#\n#........#\n##########\n"


def test_a_map_from_a_file_is_the_world_of_a_run_and_of_its_demo(call, refused, tmp_path, tiny):
    file = tmp_path / "ring.txt"
    file.write_text(MAP)
    own = ("run", "smoke", "-s", "nearest", "--trials", 2, "--backend", "sequential", "--results", tmp_path / "own")
    assert call(*own, "--map", file)[0] == 0
    trials = pd.read_csv(tmp_path / "own" / "trials.csv")
    assert set(trials["scenario"]) == {"ring.txt"}
    assert set(trials["size"]) == {20.0}
    assert call("report", "--results", tmp_path / "own")[0] == 0
    page = (tmp_path / "own" / "report.html").read_text(encoding="utf-8")
    assert "explore-bench demo STRATEGY --map FILE --trial WORLD" in page
    assert (tmp_path / "own" / "figures" / "ways.png").is_file()
    assert "'paper'" in refused(*own)
    picture = tmp_path / "ring.png"
    code, out, _ = call("demo", "nearest", "--map", file, "--scenario", tiny, "--trial", 1, "--output", picture)
    assert (code, out.splitlines()[-1].split(":")[0]) == (0, "nearest, 20 m, world 1")
    assert picture.is_file()
    file.write_text(MAP.replace("###.#", "#...#"))
    assert "trials of scenario 'map=" in refused(*own, "--map", file), "an edited map is another"


def test_a_map_of_the_gallery_has_a_demo_by_its_name(call, tmp_path):
    code, out, _ = call("demo", "nearest", "--map", "loop", "--output", tmp_path / "loop.html")
    assert (code, out.splitlines()[-1].split(":")[0]) == (0, "nearest, 40 m, world 0")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--map", "gone.yaml"), "map 'gone.yaml': it cannot be read"),
        (("--map", "gone"), "nor one of the gallery"),
        (("--map", "loop", "--size", 20), "size 20 m is not that of the map, 40 m"),
        (("--map", "loop", "--resolution", 0.05), "made of cells; leave it out"),
        (("--resolution", 0.05), "resolution 0.05 is given without a map; add --map FILE"),
    ],
)
@pytest.mark.parametrize("command", [("demo", "nearest"), ("run", "smoke", "-s", "nearest")])
def test_a_map_that_cannot_be_is_refused(refused, tmp_path, monkeypatch, command, arguments, named):
    monkeypatch.chdir(tmp_path)
    assert named in refused(*command, *arguments)
    assert not list(tmp_path.iterdir())


def test_a_demo_draws_one_trial_and_writes_nothing_else(call, tmp_path, tiny, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = call("demo", "nearest", "--scenario", tiny, "--size", 12, "--output", tmp_path / "a.png")
    assert code == 0, err
    assert "nearest, 12 m, world 0: explored after" in out
    assert {path.name for path in tmp_path.iterdir()} == {"a.png", "tiny.toml"}


def test_a_demo_of_several_strategies_draws_them_together_and_names_each(call, tmp_path, tiny):
    names = ("nearest", "random")
    code, out, err = call("demo", *names, "--scenario", tiny, "--size", 12, "--results", tmp_path / "demos")
    assert code == 0, err
    picture = tmp_path / "demos" / "demo-nearest+random-12m-0.gif"
    assert list((tmp_path / "demos").iterdir()) == [picture]
    assert [line.split(",")[0] for line in out.splitlines()] == list(names)
    assert all(line.endswith(str(picture)) for line in out.splitlines())


def test_a_demo_of_a_scenario_that_is_none_is_refused_before_anything_runs(refused, tmp_path, tiny, monkeypatch):
    monkeypatch.setattr("explore_bench.report.demo.run_witnessed", lambda _: pytest.fail("a trial was run"))
    assert "nowhere" in refused("demo", "nearest", "--scenario", tiny, "--scenario", "nowhere")


def test_a_demo_of_a_strategy_with_parameters_has_a_file_name_that_any_shell_takes(call, tmp_path, tiny, monkeypatch):
    monkeypatch.chdir(tmp_path)
    asked = "entropy[alpha=0.5]"
    code, _, err = call("demo", asked, "--scenario", tiny, "--size", 12, "--results", tmp_path / "demos")
    assert code == 0, err
    assert [path.name for path in (tmp_path / "demos").iterdir()] == ["demo-entropy_alpha=0.5-12m-0.gif"]


def test_a_demo_of_a_trial_that_fails_is_drawn_and_the_answer_is_no(call, tmp_path, tiny):
    plugin = write_plugin(tmp_path, "return 99")
    code, out, _ = call("demo", plugin, "--scenario", tiny, "--size", 12, "--output", tmp_path / "a.png")
    assert code == 1
    assert re.search(r"failed after \d+ steps; ", out)
    assert (tmp_path / "a.png").stat().st_size > 0


@pytest.mark.parametrize(
    ("lines", "code", "words"),
    [
        ("raise LookupError('no map')", 1, "failed: LookupError: no map (at decision 1), in {}:14: raise LookupError"),
        ("return 99", 1, "failed: the answer 99 is not the index of a candidate"),
    ],
)
def test_a_demo_says_why_and_where_it_failed(call, tmp_path, tiny, lines, code, words):
    plugin = write_plugin(tmp_path, lines)
    found, _, err = call("demo", plugin, "--scenario", tiny, "--size", 12, "--output", tmp_path / "a.png")
    assert (found, err.count("\n")) == (code, 1)
    assert words.format(tmp_path / "plugin.py") in err


@pytest.mark.parametrize("source", ["import no_such_module_anywhere\n", "class Plugin(:\n"], ids=["import", "syntax"])
def test_a_file_that_cannot_be_imported_is_told_with_the_line(call, refused, smoke, tmp_path, tiny, source):
    file = tmp_path / "plugin.py"
    file.write_text(source)
    place = f", in {file}:1: {source.strip()}"
    code, _, err = call(*smoke, "-s", f"{file}:Plugin", "--trials", 1)
    assert (code, err.count(place)) == (3, 1)
    assert place in refused("demo", f"{file}:Plugin", "--scenario", tiny, "--output", tmp_path / "a.png")
    code, out, _ = call("check", f"{file}:Plugin")
    assert (code, out.count(place)) == (1, 1)


# Lists and help


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("strategies", ["nearest", "ready", "reference: told the truth", "table2", "layers"]),
        ("scenarios", ["paper", "chen2020"]),
        ("suites", ["smoke", "paper", "20, 30, 40", "50"]),
        ("metrics", ["trajectory_error", "regret", "m²/step", "Eq. 3", "lower"]),
    ],
)
def test_lists(call, what, words):
    code, out, err = call("list", what)
    assert (code, err) == (0, "")
    assert all(word in out for word in words)


@pytest.fixture
def listed(call):
    """Return a function that gives the columns of each strategy in the list, by its name."""

    def read():
        code, out, err = call("list")
        assert (code, err) == (0, "")
        header, *rows = [re.split(r" {2,}", line) for line in out.splitlines()]
        assert header == ["name", "label", "tables and suites", "state", "parameters"]
        return {name: columns for name, *columns in rows}

    return read


def test_the_list_says_what_is_not_trained(listed, untrained):
    untrained()
    states = {name: columns[2:] for name, columns in listed().items()}
    assert list(states) == list(strategies())
    for name, entry in strategies().items():
        assert states[name] == [
            "not trained" if entry.trainer else "reference: told the truth" if entry.reference else "ready"
        ]


def test_the_list_shows_training_seeds_and_parameter_counts(listed, trained):
    [path] = trained(2).values()
    count = sum(values.size for values in load_file(path).values())
    assert count > 1000
    assert listed()["gcn-obs"][2:] == ["learned, 1 training seed", f"{count:,}"]
    trained(0, 1, 2)
    assert listed()["gcn-obs"][2:] == ["learned, 3 training seeds", f"{count:,}"]


@pytest.mark.parametrize("content", ["", "{", "[]", '{"parameter_count": "many"}'])
def test_a_list_with_a_damaged_card(call, trained, content):
    [path] = trained(0).values()
    card = Path(path).with_suffix(".json")
    card.write_text(content)
    code, out, _ = call("list")
    assert code == 0
    assert f"gcn-obs: card '{card}' of 'GCN-obs' cannot be read" in out.splitlines()[-1]
    assert "nearest" in out, "the others are listed all the same"


def test_the_list_without_a_word_is_that_of_the_strategies(call):
    assert call("list") == call("list", "strategies")


@pytest.mark.parametrize(
    "arguments", [["--help"], ["-h"], ["run", "--help"], ["demo", "-h"], ["--version"]], ids=" ".join
)
def test_help(call, arguments):
    code, out, err = call(*arguments)
    assert (code, err) == (0, "")
    assert "explore-bench" in out


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["run", "--help"], ["list"], ["list", "scenarios"], ["list", "suites"], ["list", "metrics"]],
    ids=" ".join,
)
def test_help_and_lists_import_nothing_heavy(arguments):
    code = f"""
import sys
from explore_bench.cli import main
try:
    main({arguments!r})
except SystemExit as ended:
    assert not ended.code
print("heavy:", *[name for name in {HEAVY!r} if name in sys.modules])
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "heavy:"


def test_the_console_script_refuses_in_one_line_with_code_2():
    """In a process of its own."""
    code = """
import sys
from importlib.metadata import entry_points
[script] = entry_points(group="console_scripts", name="explore-bench")
sys.argv = ["explore-bench", "run", "smok"]
sys.exit(script.load()())
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (2, "")
    assert found.stderr.count("\n") == 1
    assert "did you mean 'smoke'?" in found.stderr
