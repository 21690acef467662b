"""Runs: identical bytes whatever the workers and the order, resuming, interruptions, and strategies that fail."""

import json
import os

import pandas as pd
import pytest
from handmade import TINY, tiny_plan, write_plugin
from lidar_worlds import LOOPING

import explore_bench
from explore_bench.errors import RequestError
from explore_bench.records.store import Store, missing
from explore_bench.runs import runner
from explore_bench.runs.runner import check_runnable, complete, default_workers, execute
from explore_bench.runs.suites import plan
from explore_bench.runs.workers import local, process
from explore_bench.trial.spec import Status


@pytest.fixture
def store(tmp_path):
    made = Store(tmp_path / "results")
    made.open(0, "evaluate", TINY)
    return made


def opened(folder):
    made = Store(folder)
    made.open(0, "evaluate", TINY)
    return made


def files(store):
    """Return the bytes of everything in a results folder but the times."""
    paths = [path for path in sorted(store.folder.rglob("*")) if path.is_file() and path.name != "times.csv"]
    return {str(path.relative_to(store.folder)): path.read_bytes() for path in paths}


def names(specs):
    return sorted((spec.strategy, spec.trial) for spec in specs)


# Determinism


@pytest.fixture(scope="module")
def sequential(tmp_path_factory):
    """Return the folder of a plan run by one process, and its plan."""
    store = opened(tmp_path_factory.mktemp("sequential") / "results")
    specs = tiny_plan(("random", "nearest", "clairvoyant"), trials=3)
    complete(specs, store, 1, "sequential")
    return store, specs


def test_two_workers_and_another_order_give_the_same_files_byte_for_byte(sequential, tmp_path):
    store, specs = sequential
    other = opened(tmp_path / "results")
    complete(tiny_plan(("nearest", "clairvoyant", "random"), trials=3), other, 2)
    assert len(files(store)) == len(specs) + 2, "the shards, trials.csv and the protocol"
    assert files(other) == files(store)


def test_a_second_run_gives_the_same_files_byte_for_byte(sequential, tmp_path):
    store, specs = sequential
    other = opened(tmp_path / "results")
    complete(specs[::-1], other, 1, "sequential")
    assert files(other) == files(store)


def test_a_plan_run_in_two_parts_gives_the_same_files_byte_for_byte(sequential, tmp_path):
    store, specs = sequential
    other = opened(tmp_path / "results")
    complete(specs[::2], other, 1, "sequential")
    complete(specs[1::2], other, 1, "sequential")
    assert files(other) == files(store)


def test_learned_strategies_give_the_same_files_in_workers_byte_for_byte(trained, tmp_path):
    trained(0, 1)
    specs = tiny_plan(["gcn-obs"], trials=2)
    alone, together = opened(tmp_path / "alone"), opened(tmp_path / "together")
    table = complete(specs, alone, 1, "sequential")
    complete(specs[::-1], together, 2)
    assert list(zip(table["training_seed"], table["trial"], strict=True)) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert "failed" not in set(table["status"]), table["reason"].iloc[0]
    assert files(together) == files(alone)


def test_lidar_worlds_give_the_same_files_in_workers_byte_for_byte(tmp_path):
    """Trials with loop closures, whose graphs are optimized: nothing hangs on who computed what before."""
    specs = plan("smoke", ["nearest"], [12.0], 2, scenario=LOOPING, purpose="calibrate").specs
    alone, together = Store(tmp_path / "alone"), Store(tmp_path / "together")
    for store in (alone, together):
        store.open(0, "calibrate", LOOPING)
    table = complete(list(specs), alone, 1, "sequential")
    complete(list(specs[::-1]), together, 2)
    assert "failed" not in set(table["status"])
    assert table["true_closures"].sum() > 0
    assert files(together) == files(alone)


# What execute yields


def test_an_outcome_is_yielded_for_every_trial_with_its_times(store):
    specs = tiny_plan(trials=2)
    outcomes = list(execute(specs, store, 1, "sequential"))
    assert names(outcome.spec for outcome in outcomes) == names(specs)
    for outcome in outcomes:
        record = store.find(outcome.spec)
        assert outcome.status is Status.EXPLORED
        assert outcome.steps == len(record.steps["step"]) - 1
        assert len(outcome.decision_seconds) == record.steps["decisions"][-1]
        assert 0.0 < sum(outcome.decision_seconds) < outcome.seconds


def test_a_trial_is_stored_before_its_outcome_is_yielded(store):
    specs = tiny_plan(trials=3)
    for count, outcome in enumerate(execute(specs, store, 1, "sequential"), start=1):
        assert store.has(outcome.spec)
        assert len(list(missing(store, specs))) == len(specs) - count


def test_without_trials_nothing_runs(store, monkeypatch):
    monkeypatch.setattr(local, "Process", lambda job: pytest.fail("a process for nothing"))
    assert list(execute([], store, 2)) == []


def test_larger_maps_begin_first(store):
    """Else the last worker is left alone with a large one."""
    specs = plan("smoke", ["nearest"], [12.0, 16.0], 2, scenario=TINY).specs
    sizes = [outcome.spec.scenario.size for outcome in execute(specs, store, 1, "sequential")]
    assert sizes == [16.0, 16.0, 12.0, 12.0]


def test_the_default_is_a_worker_a_processor():
    assert 1 <= default_workers() <= os.cpu_count()


# Workers


THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
SPY = """
import json, os, pathlib
import numba
def note(folder):
    values = {name: os.environ.get(name) for name in %r} | {"numba": numba.get_num_threads(), "pid": os.getpid()}
    (pathlib.Path(folder) / f"{os.getpid()}.json").write_text(json.dumps(values))
"""


def test_workers_are_other_processes_with_one_thread_each(store, tmp_path):
    factory = write_plugin(
        tmp_path,
        f"note({str(tmp_path)!r})\nreturn int(observation.path_lengths.argmin())",
        head=SPY % (THREADS,),
    )
    before = dict(os.environ)
    outcomes = list(execute(tiny_plan([factory], trials=4), store, 2))
    assert {outcome.status for outcome in outcomes} == {Status.EXPLORED}, outcomes[0].reason
    notes = [json.loads(path.read_text()) for path in tmp_path.glob("*.json")]
    assert 1 <= len(notes) <= 2
    for values in notes:
        assert values.pop("pid") != os.getpid()
        assert values.pop("numba") == 1
        assert values == dict.fromkeys(THREADS, "1")
    assert dict(os.environ) == before, "the environment of the caller is left as it was"


# Resuming


def test_a_second_run_has_nothing_to_do(sequential):
    store, specs = sequential
    assert list(missing(store, specs)) == []


def test_more_worlds_of_a_plan_run_only_the_new_ones(sequential):
    store, _ = sequential
    more = tiny_plan(("nearest",), trials=5)
    assert [spec.trial for spec in missing(store, more)] == [3, 4]


def test_from_python_a_second_run_simulates_nothing(tmp_path, monkeypatch):
    options = {"sizes": [12.0], "trials": 2, "workers": 1, "scenario": TINY, "results": tmp_path / "results"}
    first = explore_bench.run("smoke", ["nearest", "random"], **options)
    monkeypatch.setattr(runner, "run_here", lambda *_: pytest.fail("a stored trial was run again"))
    second = explore_bench.run("smoke", ["nearest", "random"], **options)
    pd.testing.assert_frame_equal(first, second)


def test_from_python_the_rows_are_those_of_the_file_that_were_asked_for(tmp_path):
    options = {"sizes": [12.0], "workers": 1, "scenario": TINY, "results": tmp_path / "results"}
    explore_bench.run("smoke", ["random"], trials=3, **options)
    table = explore_bench.run("smoke", ["nearest"], trials=2, **options)
    assert list(zip(table["strategy"], table["trial"], strict=True)) == [("nearest", 0), ("nearest", 1)]
    file = pd.read_csv(tmp_path / "results" / "trials.csv")
    assert len(file) == 5
    assert list(table.columns) == list(file.columns)


def test_from_python_progress_is_told_of_every_trial(tmp_path):
    told = []
    options = {"sizes": [12.0], "trials": 2, "workers": 1, "scenario": TINY, "results": tmp_path / "results"}
    explore_bench.run("smoke", ["nearest"], progress=told.append, **options)
    assert names(outcome.spec for outcome in told) == [("nearest", 0), ("nearest", 1)]


def test_a_suite_of_several_physics_from_python_makes_a_folder_of_any(tmp_path):
    table = explore_bench.run(
        "robustness", ["nearest"], sizes=[12.0], trials=1, backend="sequential", results=tmp_path / "results"
    )
    assert table["scenario"].nunique() == len(table) > 1
    assert Store(tmp_path / "results").protocol()["scenario"] == "any"


# Interruptions


class Interrupt:
    """Progress callback that raises at its second trial."""

    def __init__(self, error):
        self.error, self.seen = error, []

    def __call__(self, outcome):
        self.seen.append(outcome.spec)
        if len(self.seen) == 2:
            raise self.error


@pytest.mark.parametrize("error", [KeyboardInterrupt(), LookupError("the bar broke")], ids=lambda e: type(e).__name__)
def test_an_interrupted_run_keeps_what_is_done_and_a_second_one_does_the_rest(store, sequential, error):
    specs = sequential[1]
    interrupt = Interrupt(error)
    with pytest.raises(type(error)):
        complete(specs, store, 1, "sequential", progress=interrupt)
    rest = list(missing(store, specs))
    assert names(rest) == names(set_difference(specs, interrupt.seen))
    table = pd.read_csv(store.folder / "trials.csv")
    assert len(table) == len(pd.read_csv(store.folder / "times.csv")) == 2
    again = list(execute(rest, store, 1, "sequential"))
    assert names(outcome.spec for outcome in again) == names(rest)
    complete([], store, 1)
    assert files(store) == files(sequential[0])


def set_difference(specs, others):
    return [spec for spec in specs if spec not in others]


def test_a_generator_that_is_closed_keeps_what_is_done(store):
    specs = tiny_plan(trials=3)
    outcomes = execute(specs, store, 1, "sequential")
    done = next(outcomes).spec
    outcomes.close()
    assert store.has(done)
    assert len(list(missing(store, specs))) == len(specs) - 1


def test_two_workers_that_are_interrupted_keep_what_is_done(store):
    specs = tiny_plan(trials=6)
    interrupt = Interrupt(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        complete(specs, store, 2, progress=interrupt)
    assert all(store.has(spec) for spec in interrupt.seen)
    complete(list(missing(store, specs)), store, 1, "sequential")
    assert list(missing(store, specs)) == []


# Strategies that fail


FAILURES = {
    "raises": ("raise LookupError('no map in the glove box')", "LookupError: no map in the glove box"),
    "no such index": ("return len(observation.candidates)", "is not the index of a candidate"),
    "negative index": ("return -1", "-1 is not the index of a candidate"),
    "float": ("return 0.0", "0.0 is of type float"),
    "exits": ("raise SystemExit(4)", "SystemExit: 4"),
    "hangs": ("while True: pass", "longer than the 1 s allowed"),
}


@pytest.mark.parametrize("failure", FAILURES)
def test_a_strategy_that_fails_gives_a_failed_trial_with_its_reason(store, tmp_path, failure):
    later, reason = FAILURES[failure]
    specs = tiny_plan(["nearest", write_plugin(tmp_path, later)], trials=1)
    table = complete(specs, store, 1, "sequential", timeout=1.0)
    failed, fine = table[table["strategy"] == "Plugin"].iloc[0], table[table["strategy"] == "nearest"].iloc[0]
    assert (failed["status"], fine["status"]) == ("failed", "explored")
    assert reason in failed["reason"]
    assert failed["steps"] > 0, "the rows up to there are kept"
    assert failed["trajectory_error"] > fine["trajectory_error"]


def test_a_strategy_that_fails_in_a_worker_gives_a_failed_trial_too(store, tmp_path):
    specs = tiny_plan(["nearest", write_plugin(tmp_path, "raise LookupError('no map')")], trials=2)
    table = complete(specs, store, 2)
    assert sorted(table["status"]) == ["explored", "explored", "failed", "failed"]


def test_a_strategy_that_hangs_in_a_worker_is_stopped(store, tmp_path):
    specs = tiny_plan(["nearest", write_plugin(tmp_path, "while True: pass")], trials=2)
    table = complete(specs, store, 2, timeout=1.0)
    assert sorted(table["status"]) == ["explored", "explored", "failed", "failed"]
    assert table["reason"].str.contains("longer than the 1 s").sum() == 2


def test_a_trial_that_ran_out_of_time_is_run_again(store, tmp_path):
    specs = tiny_plan([write_plugin(tmp_path, "while True: pass")], trials=1)
    complete(specs, store, 1, "sequential", timeout=0.5)
    assert list(missing(store, specs)) == list(specs)


def test_a_failed_trial_is_not_run_again(store, tmp_path):
    specs = tiny_plan([write_plugin(tmp_path, "return 99")], trials=1)
    complete(specs, store, 1, "sequential")
    assert list(missing(store, specs)) == []


def later_on(folder, lines):
    """Return small maps on which a strategy misbehaves, and larger ones, which run first, on which none does."""
    good = plan("smoke", ["nearest"], [16.0], 4, scenario=TINY).specs
    return good, tiny_plan([write_plugin(folder, lines, head="import os, signal")], trials=1)


def test_a_trial_that_kills_its_worker_is_a_failed_row_and_the_others_go_on(store, tmp_path):
    good, bad = later_on(tmp_path, "os._exit(1)")
    done = []
    table = complete([*good, *bad], store, 2, progress=done.append)
    assert len(table) == len(done) == len(good) + len(bad)
    killers = table[table["strategy"] == bad[0].strategy]
    assert list(killers["status"]) == ["failed"] * len(bad)
    assert "worker process died" in killers["reason"].iloc[0]
    assert set(table[table["strategy"] == "nearest"]["status"]) == {"explored"}
    assert list(missing(store, [*good, *bad])) == list(bad), "what was killed from outside is worth another try"


def test_a_single_worker_is_another_process_too(store, tmp_path):
    """A strategy that ends its process does not end the run."""
    plugin = write_plugin(tmp_path, "os._exit(1)", head="import os")
    table = complete(tiny_plan(["nearest", plugin], trials=1), store, 1)
    assert dict(zip(table["strategy"], table["status"], strict=True)) == {"Plugin": "failed", "nearest": "explored"}


PERILOUS = {
    "ends its process when imported": "import os; os._exit(1)",
    "takes for ever to import": "import time; time.sleep(600)",
    "loops when imported": "while True: pass",
}


@pytest.mark.parametrize("kind", PERILOUS)
def test_a_plugin_that_is_perilous_to_import_is_a_failed_row_and_the_others_run(store, tmp_path, monkeypatch, kind):
    monkeypatch.setattr(runner, "CHECK_SECONDS", 1.0)
    specs = tiny_plan([write_plugin(tmp_path, head=PERILOUS[kind]), "nearest"], trials=1)
    check_runnable(specs, 2, "processes", 2.0)
    table = complete(specs, store, 2, timeout=2.0)
    assert dict(zip(table["strategy"], table["status"], strict=True)) == {"Plugin": "failed", "nearest": "explored"}


def test_strategies_are_looked_at_in_other_processes(tmp_path):
    head = f"import os, pathlib; pathlib.Path({str(tmp_path)!r}, 'pid').write_text(str(os.getpid()))"
    check_runnable(tiny_plan([write_plugin(tmp_path, head=head)], trials=1), 1, "processes")
    assert int((tmp_path / "pid").read_text()) != os.getpid()


def test_a_wrong_request_is_found_in_a_worker_beside_a_broken_plugin(tmp_path):
    broken = write_plugin(tmp_path, head="1 / 0", name="broken").replace(":Plugin", ":Broken")
    specs = tiny_plan([broken, "nearest", "entropy[alpah=1]", "entropy[beta=1]"], trials=1)
    with pytest.raises(RequestError, match="alpah"):
        check_runnable(specs, 2, "processes")


def test_a_strategy_that_forks_leaves_a_store_as_one_that_does_not(store, tmp_path):
    plugin = write_plugin(tmp_path, "os.fork()\nreturn int(observation.path_lengths.argmin())", head="import os")
    specs = tiny_plan([plugin, "nearest"], trials=3)
    done = []
    table = complete(specs, store, 2, progress=done.append)
    assert names(outcome.spec for outcome in done) == names(specs), "each is reported once"
    assert set(table["status"]) == {"explored"}
    assert len(list(store.runs.glob("*.parquet"))) == len(specs)
    assert list(store.runs.glob(".*")) == [], "nothing half written"
    forked, plain = (table[table["strategy"] == name]["steps"].tolist() for name in ("Plugin", "nearest"))
    assert forked == plain


def test_a_trial_whose_worker_is_killed_from_outside_runs_again_and_counts(store, tmp_path):
    """Larger maps run first: the others wait behind it, or are lost with it, and none of them is lost for good."""
    mark = tmp_path / "mark"
    lines = f"""
        if not os.path.exists({str(mark)!r}):
            open({str(mark)!r}, "w").close()
            os.kill(os.getpid(), signal.SIGKILL)
        return int(observation.path_lengths.argmin())
    """
    plugin = write_plugin(tmp_path, lines, head="import os, signal")
    specs = [*plan("smoke", [plugin], [16.0], 1, scenario=TINY).specs, *tiny_plan(["nearest"], trials=5)]
    done = []
    table = complete(specs, store, 2, progress=done.append)
    assert mark.exists()
    assert set(table["status"]) == {"explored"}
    assert names(outcome.spec for outcome in done) == names(specs), "each is reported once"
    assert list(missing(store, specs)) == []


def test_a_trial_that_cannot_be_interrupted_is_killed_and_the_others_run(store, tmp_path, monkeypatch):
    monkeypatch.setattr(process, "GRACE", 2.0)
    lines = "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])\nsignal.pause()"
    good, bad = later_on(tmp_path, lines)
    table = complete([*good, *bad], store, 2, timeout=2.0).set_index("strategy")
    assert set(table.loc["nearest", "status"]) == {"explored"}
    assert table.loc["Plugin", "status"] == "failed"
    assert table.loc["Plugin", "reason"] == "took longer than the 2 s allowed and could not be interrupted"
    assert list(missing(store, [*good, *bad])) == list(bad), "it is worth another try"


def test_a_world_that_cannot_be_drawn_is_a_wrong_request(store, monkeypatch):
    """100 obstacles and 1 landmark on 144 cells hardly ever leave connected ones."""
    monkeypatch.setattr("explore_bench.world.landmark.world.MAX_DRAWS", 1000)
    crowded = TINY.replace(size=24.0, obstacle_count=100)
    with pytest.raises(RequestError, match="no connected world"):
        complete(plan("smoke", ["nearest"], trials=1, scenario=crowded).specs, store, 1, "sequential")


# Two names of one strategy


def test_a_strategy_under_two_names_has_rows_under_both(store):
    specs = tiny_plan(["nearest", "baselines.nearest:Nearest"], trials=2)
    table = complete(specs, store, 1, "sequential")
    assert sorted(set(table["strategy"])) == ["Nearest", "nearest"]


def test_a_renamed_strategy_has_rows_under_its_new_name(store):
    complete(tiny_plan(["nearest"], trials=2), store, 1, "sequential")
    renamed = tiny_plan(["baselines.nearest:Nearest"], trials=2)
    table = complete(list(missing(store, renamed)), store, 1, "sequential")
    assert sorted(set(table["strategy"])) in (["Nearest"], ["Nearest", "nearest"])
