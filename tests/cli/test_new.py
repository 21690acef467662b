"""The strategy that `new` writes to begin with."""

import subprocess
import sys
from pathlib import Path

import pytest
from handmade import tiny_plan

from explore_bench.cli import main
from explore_bench.cli.new import STRATEGY
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Return a function that calls `new` in an empty folder and returns its exit code, its output and its complaint."""
    monkeypatch.chdir(tmp_path)

    def run(name):
        with pytest.raises(SystemExit) as ended:
            main(["new", name])
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


def test_it_writes_a_strategy_and_its_test_and_says_what_is_next(call):
    code, out, err = call("my_strategy.py")
    assert (code, err) == (0, "")
    assert sorted(path.name for path in Path.cwd().iterdir()) == ["my_strategy.py", "test_my_strategy.py"]
    assert out.splitlines()[1:] == [
        "  explore-bench check ./my_strategy.py:MyStrategy",
        "  explore-bench run smoke -s ./my_strategy.py:MyStrategy -s random --results my_strategy",
        "  explore-bench report --results my_strategy",
        "run with --map FILE explores a map of your own; give each map another folder of results.",
    ]
    assert sum(bool(line) for line in STRATEGY.template.splitlines()) <= 12


def test_what_it_writes_runs_as_it_is(call, tmp_path):
    call("mine.py")
    for spec in tiny_plan([f"{tmp_path / 'mine.py'}:Mine"], trials=2):
        result = run_trial(spec)
        assert result.status is Status.EXPLORED, result.reason


@pytest.mark.slow
def test_its_test_passes_and_fails_where_the_contract_is_broken(call, tmp_path):
    """The test of the file: `check` finds every rule kept, or the broken one is told."""
    call("mine.py")

    def tested():
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_mine.py"]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)

    file = tmp_path / "mine.py"
    done = tested()
    assert (done.returncode, "1 passed" in done.stdout) == (0, True), done.stdout
    file.write_text(file.read_text().replace("int(observation.path_lengths.argmin())", "int(undefined)"))
    done = tested()
    assert (done.returncode, "1 failed" in done.stdout) == (1, True), done.stdout
    assert "mine.py:14: return int(undefined)" in done.stdout


@pytest.mark.parametrize("there", ["mine.py", "test_mine.py"])
def test_nothing_is_written_over(call, there):
    Path(there).write_text("mine")
    assert call("mine.py") == (
        2,
        "",
        f"explore-bench: '{there}' is there already, and is left as it is; give another name.\n",
    )
    assert [path.read_text() for path in Path.cwd().iterdir()] == ["mine"]


@pytest.mark.parametrize("name", ["mine", "mine.txt", "2nd.py", "my-own.py", ".py", "___.py", "true.py", "größe.py"])
def test_a_name_that_gives_no_class_is_refused(call, name):
    code, out, err = call(name)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert f"'{name}'" in err
    assert not list(Path.cwd().iterdir())


def test_a_folder_that_is_not_there_is_refused(call):
    code, _, err = call("nowhere/mine.py")
    assert code == 2
    assert "'nowhere/mine.py' cannot be written" in err
