"""The rules of imports of docs/architecture.md, read from the page and from the syntax trees."""

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import baselines
import explore_bench
from explore_bench.strategies.registry import strategies
from explore_bench.trial.steps import step_columns
from explore_bench.world.kinds import KINDS

PACKAGE, BASELINES = Path(explore_bench.__file__).parent, Path(baselines.__file__).parent
ROOT = Path(__file__).parents[2]


def name_of(path):
    parts = path.relative_to(PACKAGE.parent if path.is_relative_to(PACKAGE) else BASELINES.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


CORE = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}
OURS = {name_of(path): path for path in sorted(BASELINES.rglob("*.py"))}


@cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def is_type_checking(node):
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)


def nodes(root, types_too):
    """Yield every node of a tree, those within `if TYPE_CHECKING:` only where asked for."""
    for child in ast.iter_child_nodes(root):
        if is_type_checking(child) and not types_too:
            continue
        yield child
        yield from nodes(child, types_too)


def imports(name, path, types_too=False):
    """Return (module, imported name or None) of every import statement, those inside functions included."""
    found = set()
    for node in nodes(tree(path), types_too):
        if isinstance(node, ast.Import):
            found |= {(alias.name, None) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                package = name.split(".") if path.name == "__init__.py" else name.split(".")[:-1]
                base = ".".join([*package[: len(package) - node.level + 1], *filter(None, [base])])
            found |= {(base, alias.name) for alias in node.names}
    return found


def modules(name, path, types_too=False):
    """Return the modules of explore_bench that a file imports; `from package import module` names the module."""
    found = set()
    for base, item in imports(name, path, types_too):
        whole = f"{base}.{item}"
        if whole in CORE:
            found.add(whole)
        elif base in CORE:
            found.add(base)
    return found


def importers(library, files):
    return {
        name
        for name, path in files.items()
        if any(base.split(".")[0] == library for base, _ in imports(name, path, types_too=True))
    }


def test_the_walk_finds_what_is_there():
    """A walk that saw nothing would prove nothing."""
    snapshot = "explore_bench.trial.snapshot"
    assert "explore_bench.robot.belief" in modules(snapshot, CORE[snapshot])
    verb = "explore_bench.cli.run"
    assert "explore_bench.runs.runner" in modules(verb, CORE[verb]), "inside a function"
    metrics = "explore_bench.analysis.metrics"
    assert "explore_bench.records.encoding" not in modules(metrics, CORE[metrics]), "a type"
    assert "explore_bench.records.encoding" in modules(metrics, CORE[metrics], types_too=True)
    assert {"baselines", "baselines.nearest", "baselines.learned.graph", "baselines.training.train"} <= OURS.keys()
    assert len(CORE) > 100


# One door a library


@pytest.mark.parametrize(
    ("library", "doors"),
    [
        ("gtsam", {"explore_bench.robot.landmark.factor_graph", "explore_bench.robot.lidar.pose_graph"}),
        ("gymnasium", {"explore_bench.gymnasium"}),
        ("joblib", {"explore_bench.runs.workers.cluster"}),
        ("distributed", {"explore_bench.runs.workers.cluster"}),
        ("numba", {"explore_bench.compiled"}),
    ],
)
def test_a_library_enters_through_its_own_door(library, doors):
    assert importers(library, CORE) == doors
    assert not importers(library, OURS)


@pytest.mark.parametrize("library", ["torch", "safetensors"])
def test_what_learns_enters_through_the_learned_strategies_and_their_training_only(library):
    assert not importers(library, CORE)
    found = importers(library, OURS)
    assert found
    assert {name.split(".")[1] for name in found} <= {"learned", "training"}


def test_matplotlib_enters_through_the_report_only():
    found = importers("matplotlib", CORE)
    assert found
    assert all(name.startswith("explore_bench.report.") for name in found)
    assert not importers("matplotlib", OURS)


def test_a_generator_is_born_in_seeding_only():
    """No call of anything in numpy.random anywhere else, nor of the standard library's random.

    But that a forked process begins with another state of the global one, which nothing of ours draws from.
    """
    for name, path in (CORE | OURS).items():
        calls = [ast.unparse(node.func) for node in ast.walk(tree(path)) if isinstance(node, ast.Call)]
        born = [call for call in calls if re.match(r"(np|numpy)\.random\.", call) or call.endswith("default_rng")]
        if name == "explore_bench.runs.workers.fork_server":
            assert born == ["np.random.seed"]
        else:
            assert bool(born) == (name == "explore_bench.trial.seeding"), (name, born)
    assert not importers("random", CORE | OURS)


# Who may not know whom


def test_the_core_never_imports_the_baselines():
    assert importers("baselines", CORE) == set()
    for name, path in CORE.items():
        texts = [node.value for node in ast.walk(tree(path)) if isinstance(node, ast.Constant)]
        assert not [text for text in texts if isinstance(text, str) and re.match(r"baselines[.:]\w", text)], name


def test_the_core_knows_no_strategy_by_name():
    names = strategies().keys() - step_columns("landmark").keys()  # there is a column of the name of one
    for name, path in CORE.items():
        texts = {node.value for node in ast.walk(tree(path)) if isinstance(node, ast.Constant)}
        assert not texts & names, name


def page():
    return (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


ROBOT_KNOWS = {"scenario", "signals", "landmark.constants", "lidar.constants"}
"""Modules of `world` that tell nothing of the truth."""


def test_what_runs_on_board_never_imports_what_is_true():
    assert "- `robot` imports of `world` only `scenario`, `signals` and the constants of its kind" in page()
    known = set()
    for name, path in CORE.items():
        if name.startswith("explore_bench.robot"):
            known |= {one for one in modules(name, path, types_too=True) if one.startswith("explore_bench.world.")}
    assert known == {f"explore_bench.world.{one}" for one in ROBOT_KNOWS}


def test_what_is_true_sees_no_estimate():
    for name, path in CORE.items():
        if name.startswith("explore_bench.world"):
            assert not [one for one in modules(name, path, types_too=True) if one.startswith("explore_bench.robot")]


def test_what_is_shared_knows_no_kind_of_world():
    """Else an edit of one kind would make the trials of another stale, or ask for its libraries."""
    assert "Outside of these folders only `world/scenarios.py`, where PAPER is, imports" in page()
    knowing = {
        name
        for name, path in CORE.items()
        for one in modules(name, path, types_too=True)
        if any(f".{kind}." in f"{one}." and f".{kind}." not in f"{name}." for kind in KINDS)
    }
    assert knowing == {"explore_bench", "explore_bench.world.scenarios"}, "the root for those who read types"
    for kind, parts in KINDS.items():
        assert {value.partition(":")[0].split(".")[2] for value in vars(parts).values() if value} == {kind}


# The public names


def from_core(name, path):
    """Return (module, name) of what a file imports of explore_bench."""
    return {(base, item) for base, item in imports(name, path, types_too=True) if base.split(".")[0] == "explore_bench"}


EXAMPLES = {
    path.relative_to(ROOT / "examples").as_posix(): path
    for path in sorted((ROOT / "examples").rglob("*.py"))
    if "plugins" not in path.parts
}


@pytest.mark.parametrize("name", [*OURS, *EXAMPLES])
def test_baselines_and_examples_import_public_names_from_the_root(name):
    found = from_core(name, (OURS | EXAMPLES)[name])
    allowed = {("explore_bench.gymnasium", None)} if name in EXAMPLES else set()
    for base, item in found - allowed:
        assert base == "explore_bench", f"{name} imports {base}"
        assert item is None or item in explore_bench.PUBLIC, f"{name} imports {item}"
        if item is None:
            used = [n.attr for n in ast.walk(tree((OURS | EXAMPLES)[name])) if is_of_root(n)]
            assert set(used) <= {*explore_bench.PUBLIC, "gymnasium"}, (name, used)


def is_of_root(node):
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "explore_bench"


def test_most_public_names_are_used_by_what_ships():
    """A list that nobody needs would prove nothing; the others are for scripts."""
    used = {item for name, path in (OURS | EXAMPLES).items() for _, item in from_core(name, path)}
    assert len(used & explore_bench.PUBLIC.keys()) > 0.6 * len(explore_bench.PUBLIC)


@pytest.mark.parametrize("name", sorted(explore_bench.PUBLIC))
def test_a_public_name_is_defined_where_the_list_says(name):
    module = f"explore_bench.{explore_bench.PUBLIC[name]}"
    assert module in CORE
    defined = {n.name for n in tree(CORE[module]).body if isinstance(n, ast.FunctionDef | ast.ClassDef)}
    for node in tree(CORE[module]).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        defined |= {target.id for target in targets if isinstance(target, ast.Name)}
    assert name in defined
    assert getattr(explore_bench, name) is getattr(importlib.import_module(module), name)
    assert not (PACKAGE / name).exists(), "a name and a package"
    assert not (PACKAGE / f"{name}.py").exists(), "a name and a module"


def test_the_page_on_plugins_shows_all_public_names():
    text = (ROOT / "docs" / "plugins.md").read_text(encoding="utf-8")
    part = text.split("<!-- begin public -->")[1].split("<!-- end public -->")[0]
    assert set(re.findall(r"^\| `(\w+)` \|", part, re.MULTILINE)) == explore_bench.PUBLIC.keys()


MAY_IMPORT = {"": {"catalogue"}, "catalogue": {"colors"}, "learned": {"learned"}, "training": {"learned", "training"}}
MAY_IMPORT |= {part: {part} for part in ("reference", "field")} | {"claims": {"catalogue"}}
"""Part of baselines → those parts that it may import; nobody else may import any baseline."""


@pytest.mark.parametrize("name", OURS)
def test_no_baseline_imports_another_s(name):
    """Each in one file; only the table of all of them, and the claims that it gives rise to, name them, in strings.

    Learned ones share what is in their package, and only their training imports the training; so do those of the field.
    """
    found = [base if item is None else f"{base}.{item}" for base, item in imports(name, OURS[name], types_too=True)]
    packages = {whole.split(".")[1] for whole in found if whole.startswith("baselines.")}
    assert "baselines" not in found
    assert packages <= MAY_IMPORT.get(".".join(name.split(".")[1:2]), set())


def test_another_name_of_the_package_is_an_attribute_error():
    assert sorted(explore_bench.PUBLIC) == explore_bench.__all__
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        _ = explore_bench.nothing_of_the_kind


def test_importing_the_package_takes_under_0_3_seconds():
    """Processor time, the best of five: a busy machine slows a process down and never speeds it up."""
    code = "import sys, time; begin = time.process_time(); import explore_bench; print(time.process_time() - begin)"
    code += "; print(*sorted({name.split('.')[0] for name in sys.modules}))"
    found = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(5)]
    assert min(float(one.stdout.splitlines()[0]) for one in found) < 0.3
    heavy = {"gtsam", "gymnasium", "joblib", "matplotlib", "numba", "numpy", "pandas", "pyarrow", "scipy", "torch"}
    assert not heavy & set(found[0].stdout.splitlines()[1].split())


# Floors and cycles


def floors():
    """Return the floor of each entry, as the page lists them."""
    rows = re.findall(r"^\| (\d+) \| (`.*?`) \|", page(), re.MULTILINE)
    return {entry: int(number) for number, entries in rows for entry in re.findall(r"`(\w+)`", entries)}


def test_the_page_lists_every_entry_on_at_most_twelve_floors():
    assert floors().keys() == {name.split(".")[1] for name in CORE if "." in name}
    assert set(floors().values()) == set(range(1, max(floors().values()) + 1))
    assert max(floors().values()) <= 12


def test_the_package_has_at_most_seventeen_entries():
    assert len([path for path in PACKAGE.iterdir() if path.name != "__pycache__"]) <= 17


def test_every_module_that_the_page_and_contributing_name_is_there():
    text = page() + (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)*\w+(?:\.py|/))`", text)) - {
        f"{stage}/lidar/" for stage in ("world", "robot", "trial")
    }
    assert len(named) > 40
    places = (
        ROOT,
        PACKAGE,
        PACKAGE / "robot" / "landmark",
        PACKAGE / "runs" / "workers",
        PACKAGE / "runs" / "conformance",
    )
    places = (*places, PACKAGE / "trial", PACKAGE / "world" / "landmark", PACKAGE / "trial" / "landmark")
    lost = [name for name in named if not any((place / name).exists() for place in places)]
    assert not lost


@pytest.mark.parametrize("name", [name for name in CORE if "." in name])
def test_imports_only_go_down(name):
    floor = floors()
    own = name.split(".")[1]
    for other in modules(name, CORE[name], types_too=True):
        assert "." in other, f"{name} imports the package's root"
        entry = other.split(".")[1]
        assert entry == own or floor[entry] < floor[own], f"{name} imports {other}"


def test_there_is_no_cycle_of_imports():
    """Those inside functions counted."""
    graph = {name: modules(name, path) - {name} for name, path in CORE.items() if "." in name}
    done, chain = set(), []

    def visit(name):
        assert name not in chain, " → ".join([*chain[chain.index(name) :], name])
        if name in done:
            return
        chain.append(name)
        for other in sorted(graph[name]):
            visit(other)
        chain.pop()
        done.add(name)

    for name in graph:
        visit(name)
    assert done == graph.keys()
