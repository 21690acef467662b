"""A trial with a witness is the same trial, and where its strategy raised is told and not stored."""

import dataclasses

import pytest
from handmade import tiny_plan, write_plugin

from explore_bench.records.encoding import encode, read_record
from explore_bench.records.store import Store
from explore_bench.runs.runner import execute
from explore_bench.runs.witness import run_witnessed
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status


def test_with_a_witness_a_trial_has_the_same_bytes(trained):
    trained(0)
    for spec in tiny_plan(("nearest", "clairvoyant", "gcn-obs", "entropy[alpha=0.5]"), trials=1):
        result, told = run_witnessed(spec)
        assert encode(result) == encode(run_trial(spec)), spec.strategy
        assert told == "" == result.reason


FAILING = {
    "raises": ("raise KeyError('x')", "KeyError: 'x' (at decision 1)", ":14: raise KeyError('x')"),
    "answers nonsense": ("return 99", None, ""),
    "takes too long": (
        "while True: pass",
        "took longer than the 0.5 s allowed (at decision 1)",
        ":14: while True: pass",
    ),
}


@pytest.mark.parametrize("kind", FAILING)
def test_the_reason_that_is_told_has_the_place_and_the_one_that_is_stored_has_not(tmp_path, kind):
    lines, reason, place = FAILING[kind]
    [spec] = tiny_plan([write_plugin(tmp_path, lines)], trials=1)
    result, told = run_witnessed(spec, 0.5)
    assert (result.status, result.spec) == (Status.FAILED, spec)
    assert result.reason == reason or reason is None
    assert told == (f"{result.reason}, in {tmp_path}/plugin.py{place}" if place else result.reason)
    if "long" not in kind:
        assert encode(result) == encode(run_trial(spec))


def test_a_comment_moves_the_place_and_leaves_the_record_as_it_is(tmp_path):
    [spec] = tiny_plan([write_plugin(tmp_path, "raise KeyError('x')")], trials=1)
    before = run_witnessed(spec)
    write_plugin(tmp_path, "# because\nraise KeyError('x')")
    after = run_witnessed(spec)
    assert encode(before[0]) == encode(after[0])
    assert ":14: " in before[1]
    assert ":15: " in after[1]


def test_the_place_of_one_trial_is_not_that_of_the_next(tmp_path):
    [failing] = tiny_plan([write_plugin(tmp_path, "raise KeyError('x')")], trials=1)
    run_witnessed(failing)
    assert (
        run_witnessed(dataclasses.replace(failing, broken="it is broken"))[1]
        == "it is broken (before the first decision)"
    )
    assert run_witnessed(tiny_plan(["nearest"], trials=1)[0])[1] == ""


@pytest.mark.parametrize("backend", ["sequential", "processes"])
def test_a_run_tells_the_place_and_keeps_it_out_of_the_record(tmp_path, backend):
    [spec] = tiny_plan([write_plugin(tmp_path, "raise KeyError('x')")], trials=1)
    store = Store(tmp_path / "results")
    store.open(0, "evaluate", spec.scenario)
    [outcome] = execute([spec], store, 1, backend)
    assert outcome.reason == f"KeyError: 'x' (at decision 1), in {tmp_path}/plugin.py:14: raise KeyError('x')"
    [shard] = store.runs.glob("*.parquet")
    assert read_record(shard).reason == "KeyError: 'x' (at decision 1)"
