"""Processes that are forked: what they begin with, what they share, and what becomes of them and of their server."""

import os
import pickle
import random
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from handmade import alive

from explore_bench import compiled
from explore_bench.runs.workers import THREAD_SETTINGS, fork_server
from explore_bench.runs.workers.fork_server import end_servers, fork

prepared_by = []
"""Processes that prepared what a child has of this module."""


def prepare():
    prepared_by.append(os.getpid())


def tell(facts, descriptor):
    """Call a function and write what it gives."""
    with os.fdopen(descriptor, "wb") as pipe:
        pickle.dump(facts(), pipe)


def told(facts, **options):
    """What a function gives in a child."""
    read_end, write_end = os.pipe()
    with os.fdopen(read_end, "rb") as pipe:
        child = fork(tell, facts, descriptors=[write_end], **options)
        os.close(write_end)
        found = pickle.load(pipe)
    child.kill()
    return found


def surroundings():
    return Path.cwd(), sys.path, {name: os.environ.get(name) for name in (*THREAD_SETTINGS, "PYTHONPATH", "A_SETTING")}


def standing():
    return os.getpid(), os.getppid(), os.getpgid(0), sys.stdin.read(), [*prepared_by]


def chances():
    return random.random(), np.random.random()  # noqa: NPY002  (the global one)


def server_pid():
    return fork_server._servers[None]._process.pid


def sleep():
    time.sleep(600)


def end_with_three():
    os._exit(3)


def print_something():
    print("said")
    os.write(2, b"complained")


def raise_something():
    raise ValueError("so it ends")


@pytest.fixture(scope="module", autouse=True)
def _none_is_left():
    yield
    end_servers()


def test_a_child_has_the_folder_the_imports_and_the_settings_of_the_one_who_asks_and_one_thread(tmp_path, monkeypatch):
    assert told(Path.cwd) == Path.cwd()
    first = server_pid()
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "more")
    folder, imports, settings = told(surroundings)
    assert server_pid() == first, "for another folder and other imports the same server will do"
    assert folder == tmp_path
    assert imports == sys.path
    assert settings.pop("PYTHONPATH").split(os.pathsep) == [entry for entry in sys.path if entry]
    assert settings.pop("A_SETTING") is None
    assert set(settings.values()) == {"1"}
    monkeypatch.setenv("A_SETTING", "2")
    assert told(surroundings)[2]["A_SETTING"] == "2"
    assert ended(first)


def test_a_server_of_older_code_is_replaced(monkeypatch):
    assert told(Path.cwd) == Path.cwd()
    first, code = server_pid(), fork_server.shipped_code()
    newest = max(code, key=code.get)
    monkeypatch.setattr(fork_server, "shipped_code", lambda: code | {newest: code[newest] + 1})
    assert told(Path.cwd) == Path.cwd()
    assert server_pid() != first


def test_the_shipped_code_is_every_file_of_it():
    names = {"/".join(file.parts[-2:]) for file in fork_server.shipped_code()}
    assert {"workers/process.py", "explore_bench/__init__.py", "baselines/nearest.py"} <= names


def test_a_link_to_nothing_that_an_editor_leaves_is_no_code(monkeypatch, tmp_path):
    """Neither where the compiled kernels are named nor where servers are told apart."""
    workers = tmp_path / "explore_bench" / "runs" / "workers"
    workers.mkdir(parents=True)
    (tmp_path / "explore_bench" / ".#kernel.py").symlink_to(tmp_path / "nowhere")
    (tmp_path / "explore_bench" / "kernel.py").write_text("@jit\n")
    monkeypatch.setattr(fork_server, "__file__", str(workers / "fork_server.py"))
    assert [file.name for file in fork_server.shipped_code()] == ["kernel.py"]
    monkeypatch.setattr(compiled, "__file__", str(tmp_path / "explore_bench" / "compiled.py"))
    monkeypatch.setattr(compiled.platformdirs, "user_cache_path", lambda name: tmp_path / "cache")
    assert compiled.cache_folder.__wrapped__().parent == tmp_path / "cache" / "numba"


def test_it_leads_a_group_of_its_own_reads_nothing_and_finds_done_what_was_prepared():
    found = [told(standing, preparation=(prepare, ())) for _ in range(2)]
    for pid, parent, group, read, prepared in found:
        assert group == pid != os.getpid()
        assert parent == server_pid()
        assert read == ""
        assert prepared == [parent], "once, for all"
    assert prepared_by == []


def test_what_goes_wrong_in_a_preparation_is_left_to_the_children():
    assert told(Path.cwd, preparation=(raise_something, ())) == Path.cwd()


def test_no_two_children_have_the_same_chance():
    first, second = told(chances), told(chances)
    assert first[0] != second[0]
    assert first[1] != second[1]


def test_a_child_may_have_another_seed_of_hashes():
    assert {told(hash_of_a_word, hash_seed="1") for _ in range(2)} == {told(hash_of_a_word, hash_seed="1")}
    assert told(hash_of_a_word, hash_seed="2") != told(hash_of_a_word, hash_seed="1")


def hash_of_a_word():
    return hash("word")


@pytest.mark.parametrize(("function", "code"), [(end_with_three, 3), (raise_something, 1), (print_something, 0)])
def test_what_has_ended_has_its_own_exit_code(function, code, capfd):
    child = fork(function)
    assert child.begun(60.0)
    assert child.ended(60.0)
    assert not alive(child.pid), "nothing is left of it"
    assert child.kill() == code
    assert child.kill() == code, "to kill it again does nothing"
    heard = capfd.readouterr()
    assert heard.out == "", "our standard output is not its"
    assert {3: "", 1: "so it ends", 0: "said"}[code] in heard.err


def test_what_goes_on_is_killed():
    child = fork(sleep)
    assert child.begun(60.0)
    assert not child.ended()
    assert child.kill() == -signal.SIGKILL
    assert not alive(child.pid)


def test_the_output_of_a_child_is_where_it_was_told_to_be(tmp_path):
    with (tmp_path / "output").open("wb") as file:
        child = fork(print_something, output=file.fileno())
        assert child.ended(60.0)
        child.kill()
    assert (tmp_path / "output").read_text() == "said\n"


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_server_that_is_killed_or_stopped_takes_no_child_along_and_is_replaced(how, monkeypatch):
    child = fork(sleep)
    assert child.begun(60.0)
    pid, server = child.pid, server_pid()
    os.kill(server, how)
    os.waitid(os.P_PID, server, os.WEXITED | os.WSTOPPED | os.WNOWAIT)
    assert told(Path.cwd) == Path.cwd()
    assert server_pid() != server
    assert not alive(server)
    assert alive(pid)
    child.kill()
    assert ended(pid)


def test_a_child_whose_server_was_replaced_meanwhile_can_be_killed(monkeypatch, tmp_path):
    mark = tmp_path / "mark"
    child = fork(touch_and_sleep, str(mark))
    while not mark.exists():
        time.sleep(0.01)
    monkeypatch.setenv("A_SETTING", "3")
    assert told(Path.cwd) == Path.cwd()
    pid = int(mark.read_text())
    assert alive(pid)
    child.kill()
    assert child.pid == pid
    assert ended(pid)


def touch_and_sleep(file):
    half = Path(file).with_suffix(".half")
    half.write_text(str(os.getpid()))
    half.rename(file)
    sleep()


def ended(pid):
    """Whether a process has ended within ten seconds, though nobody may have waited for it yet."""
    end = time.monotonic() + 10.0
    while time.monotonic() < end:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return True
        except FileNotFoundError:
            return True
        time.sleep(0.05)
    return False


def test_a_child_that_was_not_forked_yet_never_is_and_what_is_busy_goes_on(tmp_path):
    assert told(Path.cwd) == Path.cwd()
    server = server_pid()
    busy = fork(touch, str(tmp_path / "one"), preparation=(time.sleep, (2.0,)))
    idle = fork(touch, str(tmp_path / "two"))
    begin = time.monotonic()
    assert idle.kill() is None
    assert time.monotonic() - begin < 1.0
    assert busy.ended(60.0)
    assert told(Path.cwd) == Path.cwd()
    assert server_pid() == server
    assert (tmp_path / "one").exists()
    assert not (tmp_path / "two").exists()


def test_a_server_that_is_busy_does_what_it_was_asked_although_it_is_replaced(monkeypatch, tmp_path):
    assert told(Path.cwd) == Path.cwd()
    server = server_pid()
    busy = fork(touch, str(tmp_path / "mark"), preparation=(time.sleep, (2.5,)))
    monkeypatch.setenv("A_SETTING", "4")
    assert told(Path.cwd) == Path.cwd()
    assert server_pid() != server
    assert busy.ended(60.0)
    assert busy.code == 0
    assert (tmp_path / "mark").exists()
    assert ended(server)


def test_who_is_stopped_while_it_is_asked_is_found_out():
    assert told(Path.cwd) == Path.cwd()
    server = server_pid()
    child = fork(sleep, preparation=(time.sleep, (1.5,)))
    os.kill(server, signal.SIGSTOP)
    os.waitid(os.P_PID, server, os.WSTOPPED | os.WNOWAIT)
    child.look()
    assert not alive(server)
    assert not child.begun(60.0), "it is told at once"


def test_somebody_else_may_have_waited_for_the_server():
    assert told(Path.cwd) == Path.cwd()
    server = server_pid()
    os.kill(server, signal.SIGKILL)
    os.waitpid(server, 0)
    assert told(Path.cwd) == Path.cwd()


def test_that_there_can_be_no_more_processes_is_told(monkeypatch):
    """As the system would tell, whom the server asks for a fork."""
    child = fork(sleep, preparation=(let_no_fork_succeed, ()))
    assert not child.begun(60.0)
    assert child.error == "[Errno 11] no more"
    end_servers()


def let_no_fork_succeed():
    def refuse():
        raise BlockingIOError(11, "no more")

    os.fork = refuse


def test_as_many_as_one_likes():
    """More than there is room for what is told of them."""
    children = [fork(time.sleep, 600.0) for _ in range(300)]
    assert all(child.begun(60.0) for child in children)
    assert len({child.pid for child in children}) == 300
    for child in children:
        child.kill()
    assert not any(alive(child.pid) for child in children)


def test_a_fork_of_this_process_has_servers_of_its_own():
    assert told(Path.cwd) == Path.cwd()
    server = server_pid()
    with fork_server._lock:  # held by a thread that is not there afterwards
        pid = os.fork()
        if not pid:
            os._exit(told(server_pid_there) == server)
    assert os.waitpid(pid, 0)[1] == 0
    assert told(os.getppid) == server


def server_pid_there():
    return os.getppid()


def test_what_is_left_when_the_one_who_asked_is_gone_is_killed(tmp_path):
    note = tmp_path / "note"
    pid = os.fork()
    if not pid:
        child = fork(sleep)
        child.begun(60.0)
        note.write_text(str(child.pid))
        os._exit(0)
    os.waitpid(pid, 0)
    assert ended(int(note.read_text()))


def touch(file):
    Path(file).touch()


def test_a_server_ends_with_the_one_who_asks(tmp_path):
    note = tmp_path / "note"
    pid = os.fork()
    if not pid:
        told(Path.cwd)
        note.write_text(str(server_pid()))
        os._exit(0)
    os.waitpid(pid, 0)
    assert ended(int(note.read_text()))
