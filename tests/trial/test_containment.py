"""A time limit leaves nothing behind, and a process that a strategy forks off ends."""

import dataclasses
import os
import signal

import pytest
from playing import SMALL

from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import TrialSpec

NEAREST = TrialSpec("nearest", "playing:Nearest", SMALL, 0)


@pytest.fixture(scope="module")
def honest_small():
    return run_trial(NEAREST)


@pytest.mark.parametrize("place", ["import", "init", "reset", "choose"])
def test_a_process_that_a_strategy_forks_off_ends_and_the_trial_goes_on(tmp_path, place, honest_small):
    """Each process that came out of the trial would leave a mark."""
    fork = {name: "fork()" if name == place else "None" for name in ("import", "init", "reset", "choose")}
    file, children = tmp_path / "forks.py", tmp_path / "children"
    file.write_text(
        f"import os\n"
        f"def fork():\n"
        f"    if pid := os.fork():\n"
        f"        with open({str(children)!r}, 'a') as file: print(pid, file=file)\n"
        f"{fork['import']}\n"
        f"class Forks:\n"
        f"    def __init__(self): {fork['init']}\n"
        f"    def reset(self, rng): {fork['reset']}\n"
        f"    def choose(self, observation):\n"
        f"        {fork['choose']}\n"
        f"        return int(observation.path_lengths.argmin())\n"
    )
    own = os.getpid()
    try:
        result = run_trial(dataclasses.replace(NEAREST, factory=f"{file}:Forks"))
    finally:
        if os.getpid() != own:
            (tmp_path / f"{os.getpid()}").touch()
            os._exit(1)
    pids = [int(pid) for pid in children.read_text().split()]
    assert pids
    assert [os.waitpid(pid, 0)[1] for pid in pids] == [0] * len(pids), "they have ended by themselves"
    assert [path.name for path in tmp_path.iterdir() if path.name.isdigit()] == []
    assert result.steps == honest_small.steps


def test_the_time_limit_leaves_no_alarm_behind():
    handler = signal.getsignal(signal.SIGALRM)
    run_trial(NEAREST, timeout=30.0)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is handler
