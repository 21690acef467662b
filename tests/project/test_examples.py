"""The examples: a plugin of a few lines, a learned one, and a package in a virtual environment of its own."""

import importlib
import os
import re
import resource
import runpy
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from handmade import TINY

import baselines
import explore_bench
from explore_bench.records.provenance import weights_digest
from explore_bench.runs.suites import plan
from explore_bench.strategies.loading import load_factory
from explore_bench.strategies.registry import lookup
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
LEARNED = f"{EXAMPLES / 'learned.py'}:Learned[weights={EXAMPLES / 'learned.safetensors'}]"
COMMAND = "from explore_bench.cli import main; main()"


def written_file(page, name):
    """Return the source of a file that a page shows in a block which begins with its name."""
    found = re.search(rf"```python\n# {re.escape(name)}\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
    assert found, f"{page} shows {name}"
    return found[1]


# A file


def test_a_new_strategy_is_one_file_of_at_most_12_lines():
    for page in ("README.md", "docs/plugins.md"):
        assert len(written_file(page, "mine.py").rstrip().splitlines()) <= 12


@pytest.mark.slow
def test_the_file_of_the_readme_is_in_the_smoke_tables_in_under_a_minute(tmp_path):
    """Processor time: how long it takes by the clock depends on who else is at work."""
    (tmp_path / "mine.py").write_text(written_file("README.md", "mine.py"))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for arguments in (("run", "smoke", "-s", "./mine.py:Mine"), ("report",)):
        command = [sys.executable, "-c", COMMAND, *arguments, "--results", "mine"]
        found = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
        assert found.returncode == 0, found.stderr
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 60.0
    [row] = [row for row in (tmp_path / "mine/tables/means.md").read_text().splitlines() if row.startswith("| Mine ")]
    assert row.startswith("| Mine | 20 | 4 | 0 |")
    assert re.search(r"\| \d\.\d+ \[\d\.\d+, \d\.\d+\] \|", row), "a mean with its interval"
    assert "Mine" in (tmp_path / "mine/report.html").read_text()
    assert (tmp_path / "mine/figures/figure-10b.svg").exists()


# A target of its own


def test_the_file_with_targets_of_its_own_answers_them_and_explores(tmp_path):
    (tmp_path / "border.py").write_text(written_file("docs/plugins.md", "border.py"))
    result = run_trial(TrialSpec("border", f"{tmp_path / 'border.py'}:Border", TINY, 0))
    assert result.status is Status.EXPLORED, result.reason
    decisions = [snapshot for snapshot in result.snapshots.values() if snapshot.candidates]
    assert len(decisions) > 1
    assert all(snapshot.target is not None and snapshot.choice is None for snapshot in decisions)


# A learned strategy


def test_the_learned_example_chooses_as_its_weights_say(tmp_path):
    """The same choices every time, and others with other weights."""
    from safetensors.torch import load_file, save_file

    [spec] = plan("smoke", [LEARNED], trials=1).specs
    assert spec.strategy == 'Learned[weights="learned.safetensors"]'
    result = run_trial(spec)
    assert result.status is Status.EXPLORED, result.reason
    assert run_trial(spec).steps == result.steps
    weights = load_file(EXAMPLES / "learned.safetensors")
    save_file(weights | {"2.weight": -weights["2.weight"]}, tmp_path / "negative.safetensors")
    [other] = plan(
        "smoke", [f"{EXAMPLES / 'learned.py'}:Learned[weights={tmp_path / 'negative.safetensors'}]"], trials=1
    ).specs
    assert weights_digest(other.weights) != weights_digest(spec.weights)
    assert run_trial(other).steps != result.steps


@pytest.mark.slow
def test_the_learned_example_has_learned_something(tmp_path):
    """On worlds that it never saw it is faster than the nearest frontier, and much faster than chance."""
    table = explore_bench.run("smoke", [LEARNED, "nearest", "random"], trials=20, results=tmp_path / "results")
    steps = table.groupby("strategy")["steps"].mean()
    learned = steps.pop('Learned[weights="learned.safetensors"]')
    assert learned < steps["nearest"] < 0.7 * steps["random"]


def test_weights_of_another_network_are_refused_in_a_sentence(tmp_path):
    (tmp_path / "none.safetensors").write_bytes(b"none")
    _, entry = lookup(f"{EXAMPLES / 'learned.py'}:Learned[weights={tmp_path / 'none.safetensors'}]")
    with pytest.raises(explore_bench.RequestError, match=r"none\.safetensors.*train_learned"):
        load_factory(entry.factory)(weights=entry.weights[0])


def test_the_training_writes_weights_that_the_strategy_takes_and_the_same_each_time(tmp_path, monkeypatch):
    """Once by its command, and once in this process."""
    arguments = ["--batches", "1", "--size", "12", "--output", str(tmp_path / "a.safetensors")]
    command = [sys.executable, str(EXAMPLES / "train_learned.py"), *arguments]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    assert re.match(r" +8 episodes: mean efficiency \d\.\d+ m²/step", found.stdout)
    monkeypatch.syspath_prepend(EXAMPLES)
    runpy.run_path(str(EXAMPLES / "train_learned.py"))["train"](tmp_path / "b.safetensors", 1, 0, 12.0)
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()
    load_factory(f"{EXAMPLES / 'learned.py'}:Learned")(weights=str(tmp_path / "a.safetensors"))


# Somebody else's learned planner

GRAPH = f"{EXAMPLES / 'graph_policy.py'}:GraphPolicy[weights={EXAMPLES / 'graph_policy.safetensors'}]"
SMALL_LIDAR = explore_bench.Scenario(kind="lidar", size=8.0, sensor_range=4.0)


@pytest.fixture
def graph_example(monkeypatch):
    """Import the planner and its training the way they run: with their own folder on the path."""
    monkeypatch.syspath_prepend(EXAMPLES)
    yield importlib.import_module("graph_policy"), importlib.import_module("train_graph_policy")
    for name in ("graph_policy", "train_graph_policy"):
        del sys.modules[name]


@pytest.mark.parametrize("scenario", [explore_bench.PAPER, SMALL_LIDAR], ids=["landmark", "lidar"])
def test_the_graph_is_of_reachable_places_their_views_of_frontiers_and_free_lines(graph_example, scenario):
    graph_of = graph_example[0].graph_of
    process = explore_bench.Course(scenario, "validate", 0).begin(0)
    for _ in range(3):
        process.decide(int(process.observation.path_lengths.argmin()))
    seen = process.observation
    graph, grid, fine = graph_of(seen), seen.scenario.grid, seen.roads.grid
    drives = dict(zip(*seen.reachable, strict=True))
    cells = [grid.cell_of(x, y) for x, y in graph.places]
    assert len(set(cells)) == len(cells) > 5
    assert tuple(graph.places[graph.own]) == seen.pose[:2]
    assert not graph.promising[graph.own], "where the robot is it has been"
    belief = seen.belief
    free = belief.known & (belief.occupancy <= 0.5)
    been = {grid.cell_of(x, y) for x, y, _ in belief.poses}
    for node, ((x, y), length, columns) in enumerate(zip(graph.places, graph.lengths, graph.nodes, strict=True)):
        assert length == (0.0 if node == graph.own else drives[fine.cell_of(x, y)])
        assert columns[:2] == pytest.approx([(x - seen.pose[0]) / 20, (y - seen.pose[1]) / 20])
        in_view = np.flatnonzero(belief.view([(x, y)])[0] & free.reshape(-1))
        unknown = [cell for cell in in_view if not patch(belief.known, cell).all()]
        assert columns[2] == pytest.approx(len(unknown) / 10)
        assert columns[3] == (cells[node] in been)
        assert graph.promising[node] == (len(unknown) > 0 and cells[node] not in been)
    assert (graph.edges == graph.edges.T).all()
    assert graph.edges.diagonal().all()
    joined = np.argwhere(graph.edges & ~np.eye(len(cells), dtype=bool))
    assert len(joined) > len(cells)
    for one, other in joined:
        rows, columns = np.divmod([cells[one], cells[other]], grid.columns)
        assert max(abs(rows[0] - rows[1]), abs(columns[0] - columns[1])) == 1
        for share in (0.0, 0.25, 0.75, 1.0):
            cell = fine.cell_of(*(graph.places[one] + share * (graph.places[other] - graph.places[one])))
            assert seen.roads.free.reshape(-1)[cell] or cell == seen.roads.start


def patch(cells, cell):
    """Return a cell of an array with its neighbours."""
    row, column = divmod(int(cell), cells.shape[1])
    return cells[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]


@pytest.mark.parametrize("scenario", [None, SMALL_LIDAR], ids=["landmark", "lidar"])
def test_the_planner_explores_by_targets_as_its_weights_say(scenario):
    [spec] = plan("smoke", [GRAPH], trials=1, scenario=scenario).specs
    result = run_trial(spec)
    assert result.status is Status.EXPLORED, result.reason
    answers = [snapshot.target for snapshot in result.snapshots.values() if snapshot.candidates]
    assert sum(target is not None for target in answers) > len(answers) / 2
    assert run_trial(spec).steps == result.steps


def test_the_planner_s_training_writes_the_same_weights_each_time_and_others_are_refused(tmp_path, graph_example):
    policy, training = graph_example
    for name in ("a", "b"):
        training.train(tmp_path / f"{name}.safetensors", episodes=1, epochs=2, seed=0, size=12.0)
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()
    policy.GraphPolicy(str(tmp_path / "a.safetensors"))
    with pytest.raises(explore_bench.RequestError, match=r"learned\.safetensors.*train_graph_policy"):
        policy.GraphPolicy(str(EXAMPLES / "learned.safetensors"))
    assert (EXAMPLES / "graph_policy.safetensors").stat().st_size < 100_000


@pytest.mark.slow
def test_the_planner_has_learned_its_rule_and_explores_faster_than_chance(tmp_path, graph_example):
    policy, training = graph_example
    network = policy.GraphPolicy(str(EXAMPLES / "graph_policy.safetensors")).network
    examples = training.demonstrations(explore_bench.Course(explore_bench.PAPER, "validate", 1), 5)
    alike = [int(network.of(graph).argmax()) == node for graph, node in examples]
    by_chance = [1.0 / graph.promising.sum() for graph, _ in examples]
    assert np.mean(alike) > 0.6 > 3 * np.mean(by_chance)
    table = explore_bench.run("smoke", [GRAPH, "random"], trials=10, results=tmp_path / "results")
    assert (table["status"] == "explored").all()
    steps = table.groupby("strategy")["steps"].mean()
    assert steps.pop('GraphPolicy[weights="graph_policy.safetensors"]') < 0.9 * steps["random"]


# A package


def environment(folder):
    """Make a virtual environment that sees the packages of this one, and its `explore-bench`; returns its commands.

    The old setuptools that a new environment of some Pythons has would come first, and builds no wheel by itself.
    """
    venv.create(folder, with_pip=True)
    subprocess.run([folder / "bin" / "pip", "uninstall", "--yes", "--quiet", "setuptools"], check=True)
    paths = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    paths |= {str(Path(package.__file__).parent.parent) for package in (explore_bench, baselines)}
    [own] = (folder / "lib").glob("python*/site-packages")
    (own / "those-of-the-tests.pth").write_text("\n".join(sorted(paths)) + "\n")
    script = folder / "bin" / "explore-bench"
    script.write_text(f"#!{folder / 'bin' / 'python'}\n{COMMAND}\n")
    script.chmod(0o755)
    return folder / "bin"


def package_commands():
    """Return the commands of docs/plugins.md that use the package, behind those that put it into a folder apart."""
    block = re.search(r"```console\n\$ pip install(.*?)```", (ROOT / "docs/plugins.md").read_text(), re.DOTALL)[1]
    return [line.removeprefix("$ ") for line in block.splitlines()[2:]]


@pytest.mark.slow
def test_the_package_is_installed_runs_is_reported_and_keeps_the_contract(tmp_path):
    bin_ = environment(tmp_path / "venv")
    shutil.copytree(
        EXAMPLES, tmp_path / "examples", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
    )
    offline = {"PIP_NO_INDEX": "1", "PIP_NO_BUILD_ISOLATION": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    variables = {**os.environ, **offline, "PATH": f"{bin_}{os.pathsep}{os.environ['PATH']}"}
    commands = ["pip install ./examples/explore-bench-frontier", *package_commands()]
    assert [command.split()[0] for command in commands] == ["pip", "explore-bench", "explore-bench", "python"]

    def call(command):
        found = subprocess.run(
            command, shell=True, cwd=tmp_path, env=variables, capture_output=True, text=True, check=False
        )
        assert found.returncode == 0, f"{command}\n{found.stdout}\n{found.stderr}"
        return found.stdout

    assert "nearby-view" not in call("explore-bench list")
    output = [call(command) for command in commands]
    assert "Successfully installed explore-bench-frontier" in output[0]
    assert re.search(r"^nearby-view +Nearby view +table2, table3 +ready$", call("explore-bench list"), re.MULTILINE)
    results = tmp_path / "frontier"
    table = pd.read_csv(results / "trials.csv")
    assert set(table["status"]) == {"explored"}
    assert set(table["strategy"]) == {"nearby-view", "nearby-view[decay=0.5]", "largest-view"}
    labels = ("Nearby view", "Nearby view [decay=0.5]", "Largest view")
    for name in ("tables/means.md", "tables/details.md", "tables/paired.md", "report.html"):
        text = (results / name).read_text()
        assert all(label in text for label in labels), name
    claims = (results / "claims.md").read_text()
    assert "Nearby view has" in claims
    assert "than Largest view at 20 m" in claims
    assert re.search(r"\d+ passed", output[3])
    [factory] = (tmp_path / "venv").glob("lib/python*/site-packages/explore_bench_frontier/next_best_view.py")
    factory.write_text(factory.read_text().replace("DECAY = 0.2", "DECAY = 0.3"))
    assert "6 trials, 0 stored, 6 to do" in call(f"{commands[1]} --dry-run"), "its source counts where it is installed"
