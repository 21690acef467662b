"""Processes of a cluster's worker: limits, deaths, and what they end with."""

import dataclasses
import pickle
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from handmade import alive, tiny_plan, write_plugin

from explore_bench.records.encoding import encode
from explore_bench.runs.workers import apart, process
from explore_bench.runs.workers.apart import run_apart
from explore_bench.runs.workers.parcel import OtherCodeError, pack
from explore_bench.runs.workers.task import make_task
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status


def parcel_of(factory, timeout=60.0):
    return pack(make_task(tiny_plan([factory], trials=1)[0], timeout))


@pytest.fixture(scope="module", autouse=True)
def _end_of_the_process():
    yield
    if own := getattr(apart._own, "process", None):
        own.end()
        apart._own.process = None


def pid_of(process):
    assert process._child.begun()
    return process._child.pid


def own_pid():
    return pid_of(apart._own.process)


def test_a_trial_has_the_same_shard_as_in_this_process(tmp_path):
    """Although its plugin is a copy there."""
    parcel = parcel_of(write_plugin(tmp_path))
    report = run_apart(parcel)
    assert report.shard == encode(run_trial(parcel.task.spec))
    assert report.outcome.spec == parcel.task.spec
    assert report.key == parcel.task.key
    assert report.outcome.status is Status.EXPLORED


def test_trials_of_one_thread_share_a_process_and_those_of_another_have_theirs():
    parcel = parcel_of("nearest")
    run_apart(parcel)
    mine = own_pid()
    run_apart(parcel)
    assert own_pid() == mine
    others = []

    def elsewhere():
        run_apart(parcel)
        others.append(apart._own.process)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert pid_of(others[0]) != mine
    others[0].end()


def test_a_trial_that_hangs_is_stopped_and_the_next_has_another_process(tmp_path):
    """What hung may have left threads, locks or a full memory."""
    plugin = write_plugin(tmp_path, "while True: pass")
    outcome = run_apart(parcel_of(plugin, timeout=1.0)).outcome
    assert re.fullmatch(
        r"took longer than the 1 s allowed \(at decision 1\), in \S+plugin\.py:14: while True: pass", outcome.reason
    )
    assert outcome.steps > 0, "the rows up to there are kept"
    assert apart._own.process is None


def test_a_foreign_strategy_shares_its_process_with_no_other(tmp_path):
    first, second = (parcel_of(write_plugin(tmp_path, name=name)) for name in ("one", "two"))
    pids = []
    for parcel in (parcel_of("nearest"), parcel_of("random"), first, first, second, parcel_of("nearest")):
        assert run_apart(parcel).outcome.status is Status.EXPLORED
        pids.append(own_pid())
    assert [pids[0] == pid for pid in pids] == [True, True, False, False, False, False]
    assert pids[2] == pids[3]
    assert len(set(pids)) == 4


@pytest.mark.slow
def test_a_trial_that_cannot_be_interrupted_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(process, "GRACE", 1.0)
    lines = "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])\nsignal.pause()"
    run_apart(parcel_of("nearest"))
    mine = own_pid()
    report = run_apart(parcel_of(write_plugin(tmp_path, lines, head="import signal"), timeout=1.0))
    assert report.outcome.status is Status.FAILED
    assert report.outcome.reason == "took longer than the 1 s allowed and could not be interrupted"
    assert not alive(mine)
    assert run_apart(parcel_of("nearest")).outcome.status is Status.EXPLORED, "in a new process"


@pytest.mark.slow
def test_a_trial_whose_process_dies_runs_again_and_fails_if_that_dies_too(tmp_path):
    mark = tmp_path / "mark"
    once = f"""
        if not os.path.exists({str(mark)!r}):
            open({str(mark)!r}, "w").close()
            os._exit(1)
        return int(observation.path_lengths.argmin())
    """
    assert run_apart(parcel_of(write_plugin(tmp_path, once, head="import os"))).outcome.status is Status.EXPLORED
    always = parcel_of(write_plugin(tmp_path, "os._exit(1)", "always", head="import os"))
    assert "worker process died" in run_apart(always).outcome.reason


@pytest.mark.slow
def test_other_code_is_refused_by_a_new_process_too():
    """One that has been here for long may only have older code than its files."""
    run_apart(parcel_of("nearest"))
    mine = own_pid()
    parcel = parcel_of("nearest")
    other = dataclasses.replace(parcel, task=dataclasses.replace(parcel.task, key="0" * 20))
    with pytest.raises(OtherCodeError):
        run_apart(other)
    assert not alive(mine)
    assert run_apart(parcel).outcome.status is Status.EXPLORED


OWNER = """
import pickle, sys
from explore_bench.runs.workers.apart import run_apart
with open(sys.argv[1], "rb") as file:
    run_apart(pickle.load(file))
"""


def eventually(fact):
    """Whether something becomes true within two minutes."""
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        if fact():
            return True
        time.sleep(0.2)
    return False


@pytest.mark.slow
def test_the_process_and_its_files_end_with_their_owner(tmp_path):
    """With a worker that is killed in the middle of a trial."""
    note, packed = tmp_path / "note", tmp_path / "parcel"
    lines = f"""
        pathlib.Path({str(note)!r} + ".half").write_text(f"{{os.getpid()}} {{__file__}}")
        os.replace({str(note)!r} + ".half", {str(note)!r})
        while True: time.sleep(1)
    """
    packed.write_bytes(pickle.dumps(parcel_of(write_plugin(tmp_path, lines, head="import os, pathlib, time"))))
    owner = subprocess.Popen([sys.executable, "-c", OWNER, str(packed)])
    assert eventually(note.exists)
    pid, file = note.read_text().split()
    assert Path(file).exists()
    owner.kill()
    owner.wait()
    assert eventually(lambda: not alive(int(pid)))
    assert not Path(file).exists()
