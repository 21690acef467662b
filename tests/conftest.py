"""What all tests share: property tests have no deadline, for a kernel may be compiled at its first call.

With REQUIRE_EXTRAS set, as `.ci/run` does, a test that is skipped for want of a Python package fails: `make setup`
installs them all. A browser it cannot install, so that those tests may be skipped anywhere.
"""

import dataclasses
import os
import re
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
from handmade import TINY, random_weights, tiny_plan
from hypothesis import settings

from explore_bench.records.store import Store
from explore_bench.strategies.registry import strategies
from explore_bench.trial.run import TrialResult, run_trial
from explore_bench.trial.spec import TrialSpec

settings.register_profile("explore-bench", deadline=None)
settings.load_profile("explore-bench")


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


class Stored(NamedTuple):
    """A results folder of real trials, and what was written into it."""

    store: Store
    specs: tuple[TrialSpec, ...]
    results: tuple[TrialResult, ...]


@pytest.fixture(scope="session")
def stored(tmp_path_factory) -> Stored:
    """Three strategies, one of them a reference, on three tiny worlds; to be read only."""
    specs = tiny_plan(("random", "nearest", "clairvoyant"), trials=3)
    store = Store(tmp_path_factory.mktemp("stored") / "results")
    store.open(0, "evaluate", TINY)
    results = tuple(run_trial(spec) for spec in specs)
    for result in results:
        store.write(result)
    return Stored(store, specs, results)


@pytest.fixture
def own_store(stored, tmp_path) -> Store:
    """A copy of those records that a test may change."""
    folder: Path = tmp_path / "results"
    shutil.copytree(stored.store.folder, folder)
    return Store(folder)


@pytest.fixture
def untrained(monkeypatch):
    """Return a function that takes the weights of these strategies away, of all without a name, until the test ends."""

    def forget(*names):
        known = strategies()
        for name in names or [name for name, entry in known.items() if entry.trainer]:
            monkeypatch.setitem(known, name, dataclasses.replace(known[name], weights={}))

    return forget


@pytest.fixture
def trained(monkeypatch, tmp_path):
    """Return a function that gives the strategy gcn-obs random weights of some training seeds instead of its own."""

    def draw(*seeds):
        weights = {seed: str(tmp_path / "weights" / f"gcn-obs-{seed}.safetensors") for seed in seeds}
        for seed, path in weights.items():
            random_weights(Path(path), seed)
        known = strategies()
        monkeypatch.setitem(known, "gcn-obs", dataclasses.replace(known["gcn-obs"], weights=weights))
        return weights

    return draw


@pytest.fixture
def fresh_digests():
    """Forget the digests of code before and after a test that edits it."""
    from explore_bench.records import provenance

    cached = [f for f in vars(provenance).values() if hasattr(f, "cache_clear")]

    def forget():
        for function in cached:
            function.cache_clear()

    forget()
    yield forget
    forget()
