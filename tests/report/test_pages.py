"""The pages of a report: a module each, which can be imported by itself."""

import pkgutil
import subprocess
import sys

import pytest

from explore_bench.report import pages

NAMES = [module.name for module in pkgutil.iter_modules(pages.__path__)]


def test_there_is_a_module_a_page():
    assert NAMES == ["claims", "gate", "maps", "sensitivity", "training", "two_folders"]


@pytest.mark.parametrize("name", NAMES)
def test_a_page_can_be_imported_first(name):
    """In an interpreter that has imported nothing else, as a cycle of imports would not allow."""
    done = subprocess.run(
        [sys.executable, "-c", f"import explore_bench.report.pages.{name}"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
