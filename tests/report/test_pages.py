"""The pages of a report: a module each, which can be imported by itself."""

import pkgutil
import subprocess
import sys

from explore_bench.report import pages

NAMES = [module.name for module in pkgutil.iter_modules(pages.__path__)]


def test_there_is_a_module_a_page():
    assert NAMES == ["claims", "field", "gate", "maps", "sensitivity", "training", "two_folders"]


def test_each_page_can_be_imported_first():
    """In an interpreter that has imported nothing else of the package, as a cycle of imports would not allow."""
    code = f"""
import importlib, sys
for name in {NAMES!r}:
    print(name)
    importlib.import_module(f"explore_bench.report.pages.{{name}}")
    for own in [module for module in sys.modules if module.split(".")[0] == "explore_bench"]:
        del sys.modules[own]
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr, done.stdout.split()) == (0, "", NAMES)
