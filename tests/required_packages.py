"""Hooks of pytest: with REQUIRE_EXTRAS set, as `.ci/run` does, a test skipped for want of a Python package fails.

`make setup` installs them all. A browser it cannot install, so that those tests may be skipped anywhere.
"""

import os
import re

import pytest

WANTING = re.compile(r"could not import|is missing: install the extra|is not installed")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """Fail what is skipped for want of a package where all are required."""
    report = yield
    return required(report)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Likewise for whole modules."""
    report = yield
    return required(report)


def required(report):
    """Return a report, failed where it was skipped for want of a package and all are required."""
    if os.environ.get("REQUIRE_EXTRAS") and report.skipped and WANTING.search(str(report.longrepr)):
        report.outcome, report.longrepr = "failed", f"REQUIRE_EXTRAS is set: {report.longrepr}"
    return report
