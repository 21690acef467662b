"""Which changes of compiled functions no test notices: a sample, with the compiler off.

    python tests/mutate_kernels.py [--count N] [--seed S] [--workers N] [--module PART]

Mutations are those of cosmic-ray, inside functions under @jit alone, drawn evenly over the modules that have such
functions. Each is tried in a copy of the tree, on the tests of its module, with numba switched off: a kernel is the
Python that it is written in. Three modules are compiled anew instead (COMPILED). Tests that fail without a mutation are
left out. Prints every mutation that nothing noticed, then tried and noticed by module. Tests that last too long have
noticed.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "explore_bench"
TESTS = {
    "analysis/going_back": ("analysis/test_crossings",),
    "geometry/__init__": ("test_geometry",),
    "geometry/rays": ("test_rays", "robot/lidar/test_local_planners", "world/lidar/test_lidar_world"),
    "robot/belief": ("robot/test_belief",),
    "robot/landmark/block_arrow": ("robot/landmark/test_marginals",),
    "robot/landmark/graph": ("robot/landmark/test_landmark_graph",),
    "robot/lidar/driving": ("robot/lidar/test_local_planners", "world/lidar/test_vehicle"),
    "robot/lidar/dwa": ("robot/lidar/test_local_planners",),
    "robot/lidar/pursuit": ("robot/lidar/test_local_planners",),
    "trial/landmark/explorer": ("trial/test_loop",),
    "trial/lidar/explorer": ("trial/lidar",),
    "world/lidar/motion": ("world/lidar/test_vehicle",),
}
"""Tests of the modules whose tests are not called after them."""

COMPILED = ("geometry/rays", "robot/lidar/grid_map", "robot/lidar/matcher")
"""Modules whose float32 the compiler rounds otherwise, or whose tests would last too long without it."""

SKIPPED = re.compile(r"Decorator|Exception|Variable|_(BitOr|BitAnd|BitXor|LShift|RShift|Mod|Pow|Is|IsNot|Invert)\b")
"""Operators of cosmic-ray that break the code or turn numbers into other types rather than change what it computes."""

LIMIT = 600
"""Seconds that the tests of a mutation may take."""


@dataclass(frozen=True)
class Mutation:
    """One change of one module: an operator of cosmic-ray at one of the places where it fits."""

    module: str
    operator: str
    occurrence: int
    row: int

    @property
    def code(self) -> str:
        """Text of the changed module."""
        return str(mutate_code(source(self.module), get_operator(self.operator)(), self.occurrence))

    def __str__(self) -> str:
        title = f"{self.module}.py:{self.row} {self.operator}"
        before, after = source(self.module).splitlines(), self.code.splitlines()
        lines = list(difflib.unified_diff(before, after, n=0, lineterm=""))[3:]
        return "\n".join([title, *lines])


def source(module: str) -> str:
    """Text of a module of the package."""
    return (PACKAGE / f"{module}.py").read_text(encoding="utf-8")


def kernels(code: str) -> list[tuple[int, int]]:
    """First and last lines of the functions under @jit."""
    return [
        (node.lineno, node.end_lineno or node.lineno)
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.FunctionDef) and any(getattr(use, "id", "") == "jit" for use in node.decorator_list)
    ]


def mutations(module: str) -> Iterator[Mutation]:
    """All changes of a module's kernels."""
    code = source(module)
    inside, nodes = kernels(code), list(ast_nodes(get_ast(code)))
    for name in operator_names():
        if SKIPPED.search(name):
            continue
        operator = get_operator(name)()
        spans = [span for node in nodes for span in operator.mutation_positions(node)]
        for occurrence, ((row, _), _) in enumerate(spans):
            if any(first <= row <= last for first, last in inside):
                yield Mutation(module, name, occurrence, row)


def tests_of(module: str) -> list[str]:
    """Files and folders of a module's tests."""
    folder, _, name = module.rpartition("/")
    found = TESTS.get(module, (f"{folder}/test_{name}", f"test_{name}"))
    paths = [f"tests/{path}" if path.count("test_") == 0 else f"tests/{path}.py" for path in found]
    return [path for path in paths if (ROOT / path).exists()]


def run(tree: Path, module: str, left_out: list[str], *options: str) -> subprocess.CompletedProcess[str]:
    """Run the tests of a module in a tree, with the compiler off unless it is in COMPILED."""
    settings = {"NUMBA_DISABLE_JIT": str(int(module not in COMPILED)), "NUMBA_CACHE_DIR": str(tree / "compiled")}
    settings |= {"PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-m", "pytest", "-q", "--no-header", "--tb=no", "-rf", "-p", "no:cacheprovider"]
    command += ["-m", "not slow", *options, *tests_of(module), *(f"--deselect={test}" for test in left_out)]
    return subprocess.run(
        command, cwd=tree, env={**os.environ, **settings}, capture_output=True, text=True, timeout=LIMIT, check=False
    )


def failing(tree: Path, module: str) -> list[str]:
    """Tests of a module that fail although nothing was changed."""
    return re.findall(r"^FAILED (\S+?)(?: - .*)?$", run(tree, module, []).stdout, re.MULTILINE)


def noticed(tree: Path, mutation: Mutation, left_out: list[str]) -> bool:
    """Whether a test fails, or lasts too long, with a mutation."""
    file = tree / "explore_bench" / f"{mutation.module}.py"
    whole = file.read_text(encoding="utf-8")
    file.write_text(mutation.code, encoding="utf-8")
    try:
        return run(tree, mutation.module, left_out, "-x").returncode != 0
    except subprocess.TimeoutExpired:
        return True
    finally:
        file.write_text(whole, encoding="utf-8")


def main() -> None:
    """Try a sample and print what nothing noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--module", default="", help="only modules whose path has this in it")
    asked = parser.parse_args()
    modules = sorted(
        str(path.relative_to(PACKAGE).with_suffix(""))
        for path in PACKAGE.rglob("*.py")
        if kernels(path.read_text(encoding="utf-8")) and asked.module in str(path)
    )
    rng, share = random.Random(asked.seed), -(-asked.count // len(modules))
    every = {module: list(mutations(module)) for module in modules}
    chosen = [one for found in every.values() for one in rng.sample(found, min(share, len(found)))]
    tried, unnoticed = Counter(one.module for one in chosen), Counter[str]()
    with tempfile.TemporaryDirectory() as folder:
        trees: SimpleQueue[Path] = SimpleQueue()
        for number in range(asked.workers):
            tree = Path(folder, str(number))
            git = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
            for name in filter(None, git.stdout.split("\0")):
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, tree / name)
            trees.put(tree)

        def in_a_tree(what, *given):  # type: ignore[no-untyped-def]
            tree = trees.get()
            try:
                return what(tree, *given)
            finally:
                trees.put(tree)

        with ThreadPoolExecutor(asked.workers) as pool:
            left_out = dict(zip(modules, pool.map(lambda one: in_a_tree(failing, one), modules), strict=True))
            for one in modules:
                print(f"{one}: {len(every[one])} mutations, {len(left_out[one])} tests left out", flush=True)
            answers = pool.map(lambda one: in_a_tree(noticed, one, left_out[one.module]), chosen)
            for mutation, answer in zip(chosen, answers, strict=True):
                if not answer:
                    unnoticed[mutation.module] += 1
                    print(f"\n{mutation}", flush=True)
    print("\nmodule, tried, noticed")
    for module in modules:
        print(f"{module}, {tried[module]}, {tried[module] - unnoticed[module]}")
    print(f"all, {tried.total()}, {tried.total() - unnoticed.total()}")


if __name__ == "__main__":
    main()
