"""What all tests share: property tests have no deadline, for a kernel may be compiled at its first call.

What takes long is done once: kernels are compiled by several processes of pytest-xdist in another order each, and the
process of which workers are forked serves the tests that follow, too.
"""

import dataclasses
import os
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
from handmade import TINY, random_weights, tiny_plan
from hypothesis import settings
from required_packages import pytest_make_collect_report, pytest_runtest_makereport  # noqa: F401  (hooks)

from explore_bench.records.store import Store
from explore_bench.runs.workers.task import warm_up
from explore_bench.strategies.registry import strategies
from explore_bench.trial.run import TrialResult, run_trial
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.kinds import KINDS
from explore_bench.world.scenario import Scenario

settings.register_profile("explore-bench", deadline=None)
settings.load_profile("explore-bench")


def pytest_sessionstart(session):
    """Begin with the kernels of one kind of world in each of several processes, lest all compile the same at once."""
    number = getattr(session.config, "workerinput", {}).get("workerid", "").removeprefix("gw")
    if number:
        kind = list(KINDS)[int(number) % len(KINDS)]
        warm_up(Scenario(kind=kind).tiny)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem):
    """Leave pytest's note of the test's name out of the environment while the test runs.

    Workers are forked of the same process only for those who have the environment that it was started in.
    """
    name = os.environ.pop("PYTEST_CURRENT_TEST")
    try:
        return (yield)
    finally:
        os.environ["PYTEST_CURRENT_TEST"] = name


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
def without_training_figures(monkeypatch):
    """Leave out of reports what is the same in each and takes two thirds of its time: tests/report has it."""
    monkeypatch.setattr("explore_bench.report.render.write_training_figures", lambda folder, names: [])


@pytest.fixture
def fresh_digests():
    """Forget the digests of code before and after a test that edits it."""
    from explore_bench.records.provenance import forget_code

    forget_code()
    yield forget_code
    forget_code()
