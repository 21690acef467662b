"""A dask cluster on this machine: the same bytes as without, and whatever dies, no run hangs."""

import os
import signal
import socket
import time

import pandas as pd
import pytest
from handmade import TINY, tiny_plan, write_plugin

import explore_bench
from explore_bench.errors import RequestError
from explore_bench.records.store import Store, missing
from explore_bench.runs import runner
from explore_bench.runs.runner import complete
from explore_bench.runs.workers import IncompleteError, task

dask = pytest.importorskip("dask", reason="dask is missing: install the extra 'dask'")
distributed = pytest.importorskip("distributed", reason="distributed is missing: install the extra 'dask'")
from explore_bench.runs.workers import cluster  # noqa: E402  (imports distributed)

LIMIT = 600
"""Seconds that a test may take."""


@pytest.fixture(autouse=True)
def bounded():
    """End a test that hangs; no trial of this file runs in this thread, where that would take away its own limit."""

    def expire(signum, frame):
        raise AssertionError(f"the test hung for {LIMIT} s")

    previous = signal.signal(signal.SIGALRM, expire)
    signal.alarm(LIMIT)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, previous)


@pytest.fixture(scope="module")
def two_workers():
    """Return the address of a scheduler with two workers of one thread each."""
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as made:
        yield made.scheduler_address


def opened(folder):
    made = Store(folder)
    made.open(0, "evaluate", TINY)
    return made


def on(scheduler, specs, store, **options):
    """Run trials on a cluster; returns the rows and the outcomes."""
    outcomes = []
    table = complete(specs, store, 2, "dask", progress=outcomes.append, scheduler=scheduler, **options)
    return table, outcomes


def files(store):
    """Return the bytes of everything in a results folder but the times."""
    paths = [path for path in sorted(store.folder.rglob("*")) if path.is_file() and path.name != "times.csv"]
    return {str(path.relative_to(store.folder)): path.read_bytes() for path in paths}


def ended(process):
    """Whether a process ends within half a minute."""
    for _ in range(60):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.5)
    return False


# The same bytes


BROKEN = """
class Broken:
    def reset(self, rng): ...
    def choose(self, observation): raise LookupError("no map")
"""


@pytest.mark.slow
def test_two_dask_workers_give_the_same_files_as_this_machine_byte_for_byte(two_workers, tmp_path, trained):
    """Strategies with and without weights, of files of this machine, one that is told the truth and one that fails."""
    trained(0, 1)
    (tmp_path / "broken.py").write_text(BROKEN)
    names = ["random", "clairvoyant", "gcn-obs", write_plugin(tmp_path), f"{tmp_path / 'broken.py'}:Broken"]
    specs = tiny_plan(names, trials=3)
    there, here = opened(tmp_path / "dask"), opened(tmp_path / "here")
    table, outcomes = on(two_workers, specs, there)
    complete(specs, here, 2)
    assert sorted(set(table["status"])) == ["explored", "failed"], table["reason"].iloc[0]
    assert len(outcomes) == len(specs)
    assert len(files(there)) == len(specs) + 2, "the shards, trials.csv and the protocol"
    assert files(there) == files(here)


@pytest.mark.slow
def test_from_python_the_rows_are_those_of_this_machine(two_workers, tmp_path):
    options = {"sizes": [12.0], "trials": 2, "scenario": TINY}
    there = explore_bench.run(
        "smoke", ["nearest"], backend="dask", scheduler=two_workers, results=tmp_path / "dask", **options
    )
    here = explore_bench.run(
        "smoke", ["nearest"], workers=1, backend="sequential", results=tmp_path / "here", **options
    )
    pd.testing.assert_frame_equal(there, here)


@pytest.mark.slow
def test_a_trial_has_a_process_with_one_thread_of_its_own(two_workers, tmp_path):
    """Neither that of the one who asks nor that of the worker, whatever joblib does with a lone worker."""
    lines = f"""
        numbers = [os.environ[name] for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")] + [numba.get_num_threads()]
        main = threading.current_thread() is threading.main_thread()
        assert numbers == ["1", "1", 1] and main and "distributed" not in sys.modules, numbers
        assert {os.getpid()} not in (os.getpid(), os.getppid())
        return int(observation.path_lengths.argmin())
    """
    plugin = write_plugin(tmp_path, lines, head="import os, sys, threading, numba")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0") as lone:
        table, _ = on(lone.scheduler_address, tiny_plan([plugin], trials=2), opened(tmp_path / "results"))
    assert list(table["status"]) == ["explored"] * 2, table["reason"].iloc[0]


# What dies, and what hangs

KILL_THE_WORKER = "os.kill(psutil.Process(os.getppid()).ppid(), signal.SIGKILL)"
"""Of a cluster: it asked the parent of a strategy's process to fork that."""


@pytest.mark.slow
def test_trials_of_a_worker_that_is_killed_run_again_and_count(two_workers, tmp_path):
    """The first trial kills the worker under it, and then would go on for ever, were its process not ended, too."""
    mark = tmp_path / "mark"
    lines = f"""
        if not os.path.exists({str(mark)!r}):
            pathlib.Path({str(mark)!r}).write_text(str(os.getpid()))
            {KILL_THE_WORKER}
            while True: time.sleep(1)
        return int(observation.path_lengths.argmin())
    """
    plugin = write_plugin(tmp_path, lines, head="import os, pathlib, psutil, signal, time")
    specs, store = tiny_plan([plugin, "nearest"], trials=3), opened(tmp_path / "results")
    table, outcomes = on(two_workers, specs, store)
    assert ended(int(mark.read_text()))
    assert set(table["status"]) == {"explored"}
    assert len(outcomes) == len(table) == len(specs), "each is reported once"
    assert list(missing(store, specs)) == []


@pytest.mark.slow
def test_a_trial_that_kills_its_process_or_hangs_is_a_failed_row_and_the_others_go_on(two_workers, tmp_path):
    source = "import os\nclass {}:\n    def reset(self, rng): ...\n    def choose(self, observation): {}\n"
    names = ["nearest"]
    for name, lines in {"Killer": "os._exit(1)", "Hanging": "\n        while True: pass"}.items():
        (tmp_path / f"{name}.py").write_text(source.format(name, lines))
        names.append(f"{tmp_path / name}.py:{name}")
    specs, store = tiny_plan(names, trials=2), opened(tmp_path / "results")
    table, _ = on(two_workers, specs, store, timeout=5.0)
    reasons = table.groupby("strategy")["reason"].agg(set)
    assert set(table["status"][table["strategy"] == "nearest"]) == {"explored"}
    assert reasons["Killer"] == {"its worker process died (killed, or out of memory)"}
    assert reasons["Hanging"] == {"took longer than the 5 s allowed (at decision 0)"}
    assert len(list(missing(store, specs))) == 4, "what was killed or late is worth another try"


@pytest.mark.slow
def test_a_cluster_whose_workers_are_all_lost_ends_the_run_as_incomplete(tmp_path, monkeypatch):
    """A worker's death is one too many here, and nothing replaces what dies."""
    plugin = write_plugin(
        tmp_path, "os.kill(psutil.Process(os.getppid()).ppid(), signal.SIGKILL)", head="import os, psutil, signal"
    )
    specs, store = tiny_plan([plugin], trials=2), opened(tmp_path / "results")
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0") as made,
        pytest.raises(IncompleteError, match="gave up"),
    ):
        on(made.scheduler_address, specs, store)
    assert list(missing(store, specs)) == list(specs)


@pytest.mark.slow
def test_a_cluster_from_which_nothing_comes_ends_the_run_as_incomplete(two_workers, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "START", 1.0)
    monkeypatch.setattr(cluster, "GRACE", 1.0)
    monkeypatch.setattr(task, "trial_key", lambda spec: "0" * 20)  # so that nothing is stored as something else
    monkeypatch.setattr(cluster, "run_apart", time.sleep)
    monkeypatch.setattr(cluster, "pack", lambda _: 20.0)
    store = opened(tmp_path / "results")
    begin = time.monotonic()
    with pytest.raises(IncompleteError, match="nothing came"):
        on(two_workers, tiny_plan(["nearest"], trials=1), store, timeout=1.0)
    assert 5.0 <= time.monotonic() - begin < 60.0
    assert list(files(store)) == ["runs/protocol.json", "trials.csv"]


@pytest.mark.slow
def test_an_interrupted_run_keeps_what_is_done_and_the_cluster_does_the_rest(two_workers, tmp_path):
    specs, store = tiny_plan(["nearest"], trials=6), opened(tmp_path / "results")
    done = []

    def interrupt(outcome):
        done.append(outcome.spec)
        if len(done) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        complete(specs, store, 2, "dask", progress=interrupt, scheduler=two_workers)
    assert all(store.has(spec) for spec in done)
    rest = list(missing(store, specs))
    table, _ = on(two_workers, rest, store)
    assert len(table) == len(specs)
    assert list(missing(store, specs)) == []


# Refusals


@pytest.mark.slow
def test_a_worker_of_other_code_refuses_and_nothing_is_stored(two_workers, tmp_path, monkeypatch):
    """Its key is that of this machine; here another is asked for."""
    monkeypatch.setattr(task, "trial_key", lambda spec: "0" * 20)
    store = opened(tmp_path / "results")
    with pytest.raises(RequestError, match="would mix records") as caught:
        on(two_workers, tiny_plan(["nearest"], trials=2), store)
    assert "\n" not in str(caught.value)
    assert list(files(store)) == ["runs/protocol.json", "trials.csv"]


@pytest.fixture
def hurried(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT", 1.0)


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "http://127.0.0.1:1", "", "127.0.0.1:port"])
def test_a_scheduler_that_cannot_be_reached_is_refused_by_its_address(hurried, address):
    begin = time.monotonic()
    with pytest.raises(RequestError, match="cannot be reached") as caught:
        runner.crew("dask", None, address)
    assert f"'{address}'" in str(caught.value)
    assert "dask scheduler" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert time.monotonic() - begin < 30.0


def test_another_service_that_never_answers_is_refused_in_time(hurried):
    with socket.create_server(("127.0.0.1", 0)) as mute, pytest.raises(RequestError, match="cannot be reached"):
        runner.crew("dask", None, f"tcp://127.0.0.1:{mute.getsockname()[1]}")


def test_a_scheduler_without_workers_is_refused(hurried):
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0", processes=False) as empty,
        pytest.raises(RequestError, match="has no worker; start some with 'dask worker "),
    ):
        runner.crew("dask", None, empty.scheduler_address)


def test_threads_of_all_workers_are_counted(hurried):
    with distributed.LocalCluster(n_workers=2, threads_per_worker=3, processes=False, dashboard_address=":0") as made:
        assert runner.crew("dask", None, made.scheduler_address) == 6
