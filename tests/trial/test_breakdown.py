"""A trial in which the simulator or its SLAM breaks down is nobody's failure; one that a strategy breaks is its own."""

import json
import signal

import numpy as np
import pytest
from handmade import TINY, record, tiny_plan, write_plugin
from playing import SMALL, Nearest, interruptible

from explore_bench.analysis.tables import measured, summary_table, trial_table
from explore_bench.analysis.two_folders import compare_folders
from explore_bench.cli import main
from explore_bench.errors import RequestError
from explore_bench.records.store import Store
from explore_bench.report.render import write_report
from explore_bench.robot.landmark.smoother import Smoother
from explore_bench.runs.runner import complete
from explore_bench.trial.containment import time_limit
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec

ERRORS = [RuntimeError("Indeterminate linear system"), np.linalg.LinAlgError("Singular matrix"), IndexError("7")]


class Predicts(Nearest):
    def choose(self, observation):
        observation.belief.predict(observation.paths[0])
        return super().choose(observation)


class Inverts(Nearest):
    def choose(self, observation):
        return int(np.linalg.inv(np.zeros((2, 2)))[0, 0])


class Divides(Nearest):
    def choose(self, observation):
        return 1 // len(observation.candidates[:0])


def spec_of(name):
    return TrialSpec(name, f"test_breakdown:{name}", SMALL, 0)


def breaking(monkeypatch, error, after=5):
    """Let SLAM raise after so many updates."""
    update, count = Smoother.update, [0]

    def broken(self, *arguments):
        count[0] += 1
        if count[0] > after:
            raise error
        return update(self, *arguments)

    monkeypatch.setattr(Smoother, "update", broken)


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: type(error).__name__)
def test_a_breakdown_of_slam_is_that_of_the_simulator(monkeypatch, error):
    breaking(monkeypatch, error)
    result = run_trial(spec_of("Predicts"))
    assert result.status is Status.BROKEN
    assert not result.transient, "it would break down again"
    assert result.reason.startswith(f"{type(error).__name__}: ")
    assert 1 <= len(result.steps) <= 5, "the rows up to there are kept"


def test_one_of_what_a_strategy_asked_for_is_too(monkeypatch):
    """With a path of the observation; where it is numpy that raises, whoever called numpy did."""

    def singular(self, belief, places):
        return np.linalg.inv(np.zeros((2, 2)))

    monkeypatch.setattr("explore_bench.robot.landmark.graph.LandmarkGraph.predict", singular)
    singular.__globals__["__name__"] = "explore_bench.robot.landmark.graph"
    try:
        assert run_trial(spec_of("Predicts")).status is Status.BROKEN
    finally:
        singular.__globals__["__name__"] = "test_breakdown"


@pytest.mark.parametrize("name", ["Inverts", "Divides"])
def test_arithmetic_of_its_own_is_a_failure_of_a_strategy(name):
    assert run_trial(spec_of(name)).status is Status.FAILED


# What is made of it


def records(broken=()):
    """Two strategies in three worlds, broken in some (strategy, world)."""
    found = []
    for strategy in ("nearest", "random"):
        for trial in range(3):
            status = "broken" if (strategy, trial) in broken else "explored"
            found.append(record(status, TINY, strategy, trial, step=[0, 10 + trial], explored=[0.1, 0.9]))
    return found


def test_a_strategy_has_no_trial_in_a_world_in_which_the_simulator_broke_down():
    table = trial_table(records({("nearest", 1)}))
    kept = measured(table)
    assert list(zip(kept["strategy"], kept["trial"], strict=True)) == [
        ("nearest", 0),
        ("nearest", 2),
        ("random", 0),
        ("random", 1),
        ("random", 2),
    ]
    assert measured(kept) is kept
    rows = summary_table(kept).set_index(["strategy", "metric"])
    assert rows.loc[("nearest", "path_length"), "n"].max() == 2
    assert rows.loc[("nearest", "path_length"), "failed"].max() == 0


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return a function that runs `nearest` and `random`; the SLAM of the second world's nearest breaks down."""

    def run(name, broken):
        store = Store(tmp_path / name)
        store.open(0, "evaluate", TINY)
        specs = tiny_plan(["random", "nearest"], trials=3)
        with monkeypatch.context() as patched:
            for spec in specs:
                if (spec.strategy, spec.trial) in broken:
                    breaking(patched, ERRORS[0])
                else:
                    patched.undo()
                complete([spec], store, 1, "sequential")
        return store.folder

    return run


@pytest.mark.usefixtures("without_training_figures")
def test_no_table_counts_it_and_the_report_and_the_comparison_say_so(folder):
    whole, broken = folder("whole", ()), folder("broken", {("nearest", 1)})
    write_report(broken)
    rows = (broken / "trials.csv").read_text()
    assert rows.count(",broken,") == 1
    page = (broken / "report.html").read_text()
    assert "1 of 6 trials did not explore their map" in page
    assert "Indeterminate linear system" in page
    assert "Nearest lacks 1 of 3 worlds of 12 m" in page
    found = compare_folders(whole, broken)
    assert any("1 world only in A" in words for words in found.left_out)
    assert {difference.strategy: difference.n for difference in found.differences} == {"nearest": 2, "random": 3}


def test_a_folder_of_breakdowns_says_so(folder):
    broken = folder("broken", {(name, trial) for name in ("nearest", "random") for trial in range(3)})
    with pytest.raises(RequestError, match=r"in all 6 trials .* the simulator broke down"):
        write_report(broken)


def test_a_run_ends_with_3_and_blames_the_simulator(monkeypatch, tmp_path, capsys):
    breaking(monkeypatch, ERRORS[0])
    arguments = ["run", "smoke", "-s", "nearest", "--size", "20", "--trials", "1", "--backend", "sequential"]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--results", str(tmp_path)])
    assert ended.value.code == 3
    said = capsys.readouterr()
    assert "the simulator broke down in 1 of them" in said.err
    assert "0 of those asked for failed" in said.out


# Whose interruption it is


def test_an_interruption_of_a_strategy_is_its_failure_and_that_of_the_user_ends_the_run(tmp_path):
    own = tiny_plan([write_plugin(tmp_path, "raise KeyboardInterrupt", "own")], trials=1)[0]
    assert run_trial(own).status is Status.FAILED
    for number in ("SIGINT", "SIGTERM"):
        lines = f"""
            try:
                os.kill(os.getpid(), signal.{number})
                time.sleep(5)
            except BaseException:
                pass
            return int(observation.path_lengths.argmin())
        """
        users = write_plugin(tmp_path, lines, number.lower(), head="import os, signal, time")
        with interruptible(), pytest.raises(KeyboardInterrupt):
            run_trial(tiny_plan([users], trials=1)[0])


def test_the_limit_leaves_the_handlers_as_they_were():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)]
    with time_limit(30.0) as told:
        assert not told.expired
        assert not told.interrupted
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)] == before


def test_what_was_chosen_after_the_time_is_not_stored_even_where_a_strategy_swallowed_it(tmp_path):
    lines = """
        try:
            time.sleep(60)
        except BaseException:
            pass
        return int(observation.path_lengths.argmin())
    """
    result = run_trial(tiny_plan([write_plugin(tmp_path, lines, head="import time")], trials=1)[0], timeout=1.0)
    assert result.status is Status.FAILED
    assert result.transient
    assert result.reason.startswith("took longer than the 1 s allowed")
    assert json.dumps(result.notes) == "{}"
