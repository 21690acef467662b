"""The rules of imports of the design and of CONTRIBUTING.md, read from the syntax trees."""

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
from explore_bench.trial.steps import STEP_COLUMNS

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
    assert "explore_bench.robot.belief" in modules("explore_bench.trial.steps", CORE["explore_bench.trial.steps"])
    command = "explore_bench.cli.run"
    assert "explore_bench.runs.runner" in modules(command, CORE[command]), "inside a function"
    assert "explore_bench.records.store" not in modules(
        "explore_bench.analysis.metrics", CORE["explore_bench.analysis.metrics"]
    ), "a type"
    assert "explore_bench.records.store" in modules(
        "explore_bench.analysis.metrics", CORE["explore_bench.analysis.metrics"], types_too=True
    )
    assert {"baselines", "baselines.nearest", "baselines.learned.graph", "baselines.training.train"} <= OURS.keys()
    assert len(CORE) > 30


# One door a library


@pytest.mark.parametrize(
    ("library", "doors"),
    [
        ("gtsam", {"explore_bench.robot.landmark.factor_graph"}),
        ("gymnasium", {"explore_bench.gymnasium"}),
        ("joblib", {"explore_bench.runs.workers.local", "explore_bench.runs.workers.cluster"}),
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
    """No call of anything in numpy.random anywhere else, nor of the standard library's random."""
    for name, path in (CORE | OURS).items():
        calls = [ast.unparse(node.func) for node in ast.walk(tree(path)) if isinstance(node, ast.Call)]
        born = [call for call in calls if re.match(r"(np|numpy)\.random\.", call) or call.endswith("default_rng")]
        assert bool(born) == (name == "explore_bench.trial.seeding"), (name, born)
    assert not importers("random", CORE | OURS)


# Who may not know whom


def test_the_core_never_imports_the_baselines():
    assert importers("baselines", CORE) == set()
    for name, path in CORE.items():
        texts = [node.value for node in ast.walk(tree(path)) if isinstance(node, ast.Constant)]
        assert not [text for text in texts if isinstance(text, str) and re.match(r"baselines[.:]\w", text)], name


def test_the_core_knows_no_strategy_by_name():
    names = strategies().keys() - STEP_COLUMNS.keys()  # there is a column of the name of one
    for name, path in CORE.items():
        texts = {node.value for node in ast.walk(tree(path)) if isinstance(node, ast.Constant)}
        assert not texts & names, name


@pytest.mark.parametrize(
    ("package", "other"),
    [
        ("slam", "simulator"),
        ("slam", "planning"),
        ("planning", "simulator"),
        ("simulator", "slam"),
        ("simulator", "planning"),
    ],
)
def test_truth_and_belief_do_not_know_each_other(package, other):
    for name, path in CORE.items():
        if name.startswith(f"explore_bench.{package}"):
            known = modules(name, path, types_too=True)
            assert not [one for one in known if one.startswith(f"explore_bench.{other}")], name


def test_the_baselines_use_public_names_only():
    for name, path in OURS.items():
        for base, item in imports(name, path, types_too=True):
            if base.split(".")[0] == "explore_bench":
                parts = [*base.split("."), *([item] if item else [])]
                assert not [part for part in parts if part.startswith("_")], (name, parts)
                if item:
                    module = importlib.import_module(base)
                    assert hasattr(module, item), (name, parts)


def test_the_baselines_reach_no_private_attribute_of_a_module():
    for name, path in OURS.items():
        own = {base.split(".")[-1] for base, item in imports(name, path) if base.startswith("explore_bench")}
        own |= {item for base, item in imports(name, path) if f"{base}.{item}" in CORE}
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in own:
                assert not node.attr.startswith("_"), (name, ast.unparse(node))


MAY_IMPORT = {"learned": {"learned"}, "training": {"learned", "training"}}
"""Package of baselines → those of its packages that it may import; nobody else may import any baseline."""


@pytest.mark.parametrize("name", OURS)
def test_no_baseline_imports_another_s(name):
    """Each in one file; only the table of all of them names them, and it does so in strings.

    Learned ones share what is in their package, and only their training imports the training.
    """
    found = [base if item is None else f"{base}.{item}" for base, item in imports(name, OURS[name], types_too=True)]
    packages = {whole.split(".")[1] for whole in found if whole.startswith("baselines.")}
    assert "baselines" not in found
    assert packages <= MAY_IMPORT.get(".".join(name.split(".")[1:2]), set())


def test_all_public_names_of_the_package_can_be_had():
    for name in explore_bench.__all__:
        assert getattr(explore_bench, name).__name__ == name
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


# Layers and cycles


UNNAMED = {"errors": -1, "compiled": -1, "spec": -2, "vehicle": -3}
"""Layers, from the lowest, of modules that CONTRIBUTING.md leaves out."""


def layers():
    """Return the layer of each module, 0 the lowest, as CONTRIBUTING.md lists them from above."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    sentence = re.search(r"Imports go down:(.*?)\. `explore_bench` never", text, re.DOTALL)
    assert sentence, "CONTRIBUTING.md lists the layers"
    from_above = [re.findall(r"`(\w+)`", part) for part in sentence.group(1).split("→")]
    assert len(from_above) >= 5
    found = {name: len(from_above) - 1 - i for i, part in enumerate(from_above) for name in part}
    return {name: -1 - place for name, place in UNNAMED.items()} | found


def test_every_module_has_a_layer():
    parts = {name.split(".")[1] for name in CORE if "." in name}
    assert parts == layers().keys()


@pytest.mark.parametrize("name", [name for name in CORE if "." in name])
def test_imports_only_go_down(name):
    place = layers()
    for other in modules(name, CORE[name]):
        if "." in other:
            assert place[other.split(".")[1]] <= place[name.split(".")[1]], f"{name} imports {other}"
        else:
            pytest.fail(f"{name} imports the package's root")


def test_there_is_no_cycle_of_imports():
    """Those inside functions counted."""
    graph = {name: modules(name, path) - {name} for name, path in CORE.items()}
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
    assert done == CORE.keys()
