"""Tests that are skipped for want of a package fail where all packages are required."""

import os
import shutil
import subprocess
import sys

import pytest
import required_packages

SKIPPING = """
import pytest

def test_alone():
    pytest.importorskip("no_package_of_this_name")

def test_of_a_browser():
    pytest.skip("chromium is missing: install the package 'chromium'")
"""
WHOLE = """
import pytest

pytest.importorskip("no_package_of_this_name")

def test_never_met(): ...
"""


@pytest.mark.parametrize(("text", "ends"), [(SKIPPING, "1 failed, 1 skipped"), (WHOLE, "1 error")])
def test_a_missing_package_is_an_error_where_all_are_required(tmp_path, text, ends):
    (tmp_path / "test_it.py").write_text(text, encoding="utf-8")
    shutil.copy(required_packages.__file__, tmp_path / "conftest.py")
    for required, expected in (("1", ends), ("", "skipped")):
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"],
            cwd=tmp_path,
            env=os.environ | {"REQUIRE_EXTRAS": required, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert expected in done.stdout.splitlines()[-1], done.stdout + done.stderr
