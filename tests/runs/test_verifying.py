"""Stored trials that run again: the same, close, otherwise, undone, and what cannot be said of."""

import dataclasses

import pytest
from handmade import TINY, tiny_plan, write_plugin

from explore_bench.cli import main
from explore_bench.errors import RequestError
from explore_bench.records.encoding import encode
from explore_bench.records.provenance import forget_code, trial_key
from explore_bench.records.store import Store
from explore_bench.runs.runner import complete
from explore_bench.runs.verifying import verify
from explore_bench.trial.run import run_trial


@pytest.fixture
def store(tmp_path):
    made = Store(tmp_path / "results")
    made.open(0, "evaluate", TINY)
    return made


def verified(folder, *arguments):
    with pytest.raises(SystemExit) as ended:
        main(["verify", "--results", str(folder), "--workers", "1", *arguments])
    return ended.value.code


def stored_as(store, spec, change):
    """Store a trial that came out as somebody changed it."""
    result = run_trial(spec)
    store.keep(trial_key(spec), encode(change(result)))


def shifted(by):
    def change(result):
        steps = [dataclasses.replace(step, true_x=step.true_x * (1 + by)) for step in result.steps]
        return dataclasses.replace(result, steps=steps)

    return change


def test_what_was_stored_comes_out_the_same(store, capsys):
    complete(tiny_plan(["nearest", "random"], trials=3), store, 1, "sequential")
    files = {path: path.read_bytes() for path in store.folder.rglob("*") if path.is_file()}
    found = verify(store.folder, backend="sequential")
    assert (found.same, found.close, found.different, found.undone, found.stale) == (6, 0, (), (), 0)
    assert verify(store.folder, sample=2, backend="sequential").same == 2
    assert verified(store.folder, "--sample", "4") == 0
    assert "4 of 6 trials ran again: 4 gave the same bytes" in capsys.readouterr().out
    assert {path: path.read_bytes() for path in store.folder.rglob("*") if path.is_file()} == files


@pytest.mark.parametrize(("by", "code"), [(1e-12, 0), (1e-3, 1)])
def test_last_digits_are_the_machines_and_others_are_not(store, capsys, by, code):
    spec = tiny_plan(["nearest"], trials=1)[0]
    stored_as(store, spec, shifted(by))
    assert verified(store.folder) == code
    said = capsys.readouterr().out
    assert ("1 the same decisions" if code == 0 else "1 came out otherwise") in said
    assert ("true_x is" in said) == bool(code)


DIFFERENT = {
    "another decision": (
        lambda result: dataclasses.replace(
            result, snapshots={k: s._replace(choice=None) if k == 0 else s for k, s in result.snapshots.items()}
        ),
        "decision 0 is",
    ),
    "another end": (
        lambda result: dataclasses.replace(result, reason="none known"),
        "it ended as explored (no reason)",
    ),
    "fewer rows": (
        lambda result: dataclasses.replace(
            result,
            steps=result.steps[:-1],
            snapshots={k: s for k, s in result.snapshots.items() if k < len(result.steps) - 1},
            final_poses=result.final_poses[:-1],
            final_covariances=result.final_covariances[:-1],
        ),
        "rows, and had",
    ),
    "another world": (
        lambda result: dataclasses.replace(
            result, world=dataclasses.replace(result.world, landmarks=result.world.landmarks + 0.1)
        ),
        "its world is",
    ),
}


@pytest.mark.parametrize("kind", DIFFERENT)
def test_a_trial_that_comes_out_otherwise_is_told_with_what_differs(store, kind):
    change, words = DIFFERENT[kind]
    spec = tiny_plan(["nearest"], trials=1)[0]
    stored_as(store, spec, change)
    found = verify(store.folder, backend="sequential")
    assert (found.same, found.close) == (0, 0)
    assert found.different[0][0] == spec
    assert words in found.different[0][1]


def test_a_strategy_with_a_generator_of_its_own_is_found_out(store, tmp_path, capsys):
    plugin = write_plugin(
        tmp_path,
        "return int(rng.integers(len(observation.candidates)))",
        head="import numpy as np\nrng = np.random.default_rng()",
    )
    complete(tiny_plan([plugin], trials=8), store, 1, "sequential")
    assert verified(store.folder) == 1
    assert "decision 1 is" in capsys.readouterr().out


def test_what_cannot_be_run_again_is_undone(store, tmp_path, monkeypatch):
    mark = tmp_path / "mark"
    plugin = write_plugin(
        tmp_path, f"while pathlib.Path({str(mark)!r}).exists(): pass\nreturn 0", head="import pathlib"
    )
    complete(tiny_plan([plugin], trials=1), store, 1, "sequential")
    mark.touch()
    found = verify(store.folder, backend="sequential", timeout=1.0)
    assert found.same == 0
    assert "longer than the 1 s allowed" in found.undone[0][1]


def test_a_folder_without_current_trials_is_refused(store, tmp_path):
    plugin = write_plugin(tmp_path)
    complete(tiny_plan([plugin], trials=1), store, 1, "sequential")
    write_plugin(tmp_path, "return 0")
    forget_code()
    with pytest.raises(RequestError, match="no trial of the present code"):
        verify(store.folder, backend="sequential")
