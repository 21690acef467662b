"""Processes of this machine: which are kept for the next call, and which are not."""

import os

import pytest
from handmade import alive, tiny_plan, write_plugin

from explore_bench import compiled
from explore_bench.runs import runner
from explore_bench.runs.runner import check_runnable
from explore_bench.runs.workers import local, process
from explore_bench.runs.workers.local import end_spare, results_of
from explore_bench.runs.workers.process import READY, Answer, Job


def tell_pid(folder):
    yield READY
    yield Answer(os.getpid())


def pids(count=1, workers=1, owner=""):
    """Processes that do so many jobs."""
    return {pid for _, pid in results_of([Job(tell_pid, (), 60.0, owner)] * count, workers)}


@pytest.fixture(autouse=True)
def _none_is_kept():
    end_spare()
    yield
    end_spare()


def test_processes_of_the_shipped_strategies_are_kept_until_the_end():
    (pid,) = pids(3)
    assert alive(pid)
    assert pids(2) == {pid}
    end_spare()
    assert not alive(pid)


def test_those_of_a_foreign_strategy_are_not():
    (pid,) = pids(owner="Plugin")
    assert not alive(pid)
    assert not local._spare


@pytest.mark.parametrize("change", ["settings", "folder", "imports", "code"])
def test_a_process_that_was_started_in_other_surroundings_is_not_used_again(change, monkeypatch, tmp_path):
    (pid,) = pids()
    if change == "settings":
        monkeypatch.setenv("SOME_SETTING", "1")
    elif change == "folder":
        monkeypatch.chdir(tmp_path)
    elif change == "imports":
        monkeypatch.syspath_prepend(tmp_path)
    else:
        now = process.surroundings()
        *others, files = now
        newest = max(files, key=files.get)
        monkeypatch.setattr(local, "surroundings", lambda: (*others, files | {newest: files[newest] + 1}))
    assert pids() != {pid}
    assert not alive(pid)


def test_surroundings_hold_every_file_of_the_shipped_code():
    *_, files = process.surroundings()
    names = {"/".join(file.parts[-2:]) for file in files}
    assert {"workers/process.py", "explore_bench/__init__.py", "baselines/nearest.py"} <= names


def test_a_link_to_nothing_that_an_editor_leaves_is_no_code(monkeypatch, tmp_path):
    """Neither where the compiled kernels are named nor where kept processes are told apart."""
    (tmp_path / "explore_bench" / "runs" / "workers").mkdir(parents=True)
    (tmp_path / "explore_bench" / ".#kernel.py").symlink_to(tmp_path / "nowhere")
    (tmp_path / "explore_bench" / "kernel.py").write_text("@jit\n")
    monkeypatch.setattr(process, "__file__", str(tmp_path / "explore_bench" / "runs" / "workers" / "process.py"))
    *_, files = process.surroundings()
    assert [file.name for file in files] == ["kernel.py"]
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "explore_bench" / "compiled.py"))
    monkeypatch.setattr(compiled.platformdirs, "user_cache_path", lambda name: tmp_path / "cache")
    assert compiled.cache_folder.__wrapped__().parent == tmp_path / "cache" / "numba"


def test_the_look_at_strategies_leaves_processes_for_the_run(tmp_path, monkeypatch):
    """Although a foreign one is looked at, too, and comes first among those asked for."""
    specs = tiny_plan([write_plugin(tmp_path), "nearest"], trials=1)
    check_runnable(specs, 1, "processes", 60.0)
    (kept,) = local._spare
    assert kept.owner == ""
    begun = []
    monkeypatch.setattr(local, "Process", lambda owner: begun.append(owner) or process.Process(owner))
    list(runner.results_of([Job(tell_pid, (), 60.0)], 1))
    assert begun == []
