"""The reference folder: written and read back, deterministic, small, and each wrong file in one sentence."""

import json
import math
from pathlib import Path

import pandas as pd
import pytest
from handmade import trial_rows, write_thresholds

from explore_bench.analysis.gate import accepted as module
from explore_bench.analysis.gate.accepted import NOTE_FILE, TRIALS_FILE, accept, read_accepted, read_results
from explore_bench.analysis.gate.thresholds import load_thresholds
from explore_bench.analysis.tables import TRIAL_COLUMNS, write_trials
from explore_bench.errors import RequestError
from explore_bench.strategies.registry import strategies
from explore_bench.trial.steps import SCHEMA_VERSION

PROJECT = Path(__file__).parents[3] / "results" / "reference"


@pytest.fixture(autouse=True)
def least_worlds(monkeypatch):
    """Two worlds are enough but where more are asked for."""
    monkeypatch.setattr(module, "LEAST_WORLDS", 2)


@pytest.fixture
def results(tmp_path):
    """Return a function that writes the trials.csv of a results folder and returns the folder."""

    def write(rows):
        folder = tmp_path / "results"
        folder.mkdir(exist_ok=True)
        rows.to_csv(folder / "trials.csv", index=False)
        return folder

    return write


@pytest.fixture
def reference(tmp_path):
    folder = tmp_path / "reference"
    write_thresholds(folder)
    return folder


def files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_what_is_accepted_is_read_back(results, reference):
    rows = trial_rows([1.0, 2.0])
    assert accept(reference, results(rows), "  faster A*  ") == 2
    known = read_accepted(reference)
    assert known.reason == "faster A*"
    assert known.family == load_thresholds(reference / "thresholds.toml")
    pd.testing.assert_frame_equal(known.trials, rows, check_dtype=False)
    assert json.loads((reference / NOTE_FILE).read_text()) == {"schema": SCHEMA_VERSION, "reason": "faster A*"}


def test_only_the_family_is_kept_and_the_order_of_rows_is_that_of_any_trials_csv(results, reference):
    own = trial_rows([1.0, 2.0])
    others = [trial_rows([1.0], strategy="Other"), trial_rows([1.0], size=30.0)]
    accept(reference, results(pd.concat((*others, own[::-1]))), "why")
    pd.testing.assert_frame_equal(read_accepted(reference).trials, own, check_dtype=False)


def test_accepting_twice_writes_the_same_bytes(results, reference):
    folder = results(trial_rows([1 / 3, 2 / 3]))
    accept(reference, folder, "why")
    before = files(reference)
    accept(reference, folder, "why")
    assert files(reference) == before


def test_a_folder_with_records_is_read_from_these_and_without_those_of_older_code(own_store, reference, fresh_digests):
    write_thresholds(reference, strategy="nearest", size=12.0, scenario="paper")
    family = load_thresholds(reference / "thresholds.toml")
    expected = write_trials(own_store)
    (own_store.folder / TRIALS_FILE).unlink()
    pd.testing.assert_frame_equal(read_results(own_store.folder, family), expected)
    for shard in sorted(own_store.runs.glob("*.parquet"))[:2]:
        shard.rename(shard.with_stem("0" * 19 + shard.stem[-1]))
    assert len(read_results(own_store.folder, family)) == len(expected) - 2


def test_a_folder_all_of_whose_records_are_of_older_code_has_no_trials(own_store, reference):
    for i, shard in enumerate(sorted(own_store.runs.glob("*.parquet"))):
        shard.rename(shard.with_stem(f"{i:020d}"))
    assert len(read_results(own_store.folder, load_thresholds(reference / "thresholds.toml"))) == 0


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (trial_rows([1.0, 2.0], strategy="Mien"), r"results': strategy 'Mine' is unknown; did you mean 'Mien'"),
        (
            trial_rows([1.0, 2.0], size=30.0),
            "has 0 worlds of Mine, 20 m, paper, and a gate needs 2 for bounds that hold; run",
        ),
        (trial_rows([1.0]), "has 1 world of Mine, 20 m, paper"),
        (trial_rows([1.0, math.nan]), "trajectory_error of Mine, 20 m, paper is not defined in every trial"),
        (trial_rows([0.0, 0.0]), "trajectory_error of Mine, 20 m, paper is 0, so a loss is no share of it"),
        (trial_rows([1.0, 2.0])[:0], "results' holds no trial; run"),
        (trial_rows(["a", "b"]), "something else than numbers in 'trajectory_error'"),
        (pd.concat([trial_rows([1.0, 2.0])] * 2), "has trial 0 of 'Mine' twice"),
        (pd.concat([trial_rows([1.0, 2.0]), trial_rows([3.0])]), "has trial 0 of 'Mine' twice"),
        (trial_rows([1.0, 2.0]).drop(columns="world"), "lacks the column 'world'"),
    ],
)
def test_results_that_cannot_be_a_reference_are_refused_and_the_old_one_stays(results, reference, rows, words):
    accept(reference, results(trial_rows([1.0, 2.0])), "why")
    before = files(reference)
    with pytest.raises(RequestError, match=words) as error:
        accept(reference, results(rows), "why")
    assert "\n" not in str(error.value)
    assert files(reference) == before


def test_nineteen_worlds_make_no_gate(results, reference, monkeypatch):
    monkeypatch.undo()
    with pytest.raises(RequestError, match="has 19 worlds of Mine, 20 m, paper, and a gate needs 20"):
        accept(reference, results(trial_rows([1.0] * 19)), "why")
    assert accept(reference, results(trial_rows([1.0] * 20)), "why") == 20
    trials = (reference / TRIALS_FILE).read_text().splitlines()
    (reference / TRIALS_FILE).write_text("\n".join(trials[:-1]) + "\n")
    with pytest.raises(RequestError, match="has 19 worlds"):
        read_accepted(reference)


def test_a_reference_is_not_shrunk_by_accident(results, reference):
    accept(reference, results(trial_rows([1.0] * 5)), "why")
    with pytest.raises(RequestError, match=r"have 4 worlds of Mine, 20 m, paper, the reference 5; run .* or delete"):
        accept(reference, results(trial_rows([1.0] * 4)), "why")
    (reference / TRIALS_FILE).unlink()
    assert accept(reference, results(trial_rows([1.0] * 4)), "why") == 4


def test_a_reason_of_spaces_is_none(results, reference):
    with pytest.raises(RequestError, match="the reason is empty; say"):
        accept(reference, results(trial_rows([1.0, 2.0])), "  ")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (NOTE_FILE, '{"schema": 0, "reason": "old"}', "is a reference of protocol version 0, not 2; .*to renew it"),
        (NOTE_FILE, '{"reason": "old"}', r"accepted\.json' is damaged; .*to make it anew"),
        (NOTE_FILE, "[]", "is damaged"),
        (NOTE_FILE, "{", "is damaged"),
        (NOTE_FILE, None, r"accepted\.json' cannot be read \(No such file"),
        (TRIALS_FILE, None, r"trials\.csv' cannot be read"),
        (TRIALS_FILE, "", r"trials\.csv' cannot be read"),
        (TRIALS_FILE, "strategy,size\n", r"trials\.csv' lacks the column"),
        ("thresholds.toml", None, r"thresholds\.toml' cannot be read"),
    ],
)
def test_a_reference_that_is_none_is_refused_in_one_sentence(results, reference, name, content, words):
    accept(reference, results(trial_rows([1.0, 2.0])), "why")
    (reference / name).unlink() if content is None else (reference / name).write_text(content)
    with pytest.raises(RequestError, match=words) as error:
        read_accepted(reference)
    assert "\n" not in str(error.value)


def test_thresholds_of_a_strategy_that_the_reference_lacks_are_refused(results, reference):
    accept(reference, results(trial_rows([1.0, 2.0])), "why")
    write_thresholds(reference, strategy="Mime")
    with pytest.raises(RequestError, match=r"trials\.csv': strategy 'Mime' is unknown; did you mean 'Mine'"):
        read_accepted(reference)


@pytest.mark.parametrize(("place", "scenario"), [("", "paper"), ("stage", "stage")])
def test_the_project_s_own_references_are_as_the_thresholds_say(place, scenario):
    known = read_accepted(PROJECT / place)
    own = [name for name in known.trials.columns if name in TRIAL_COLUMNS]
    assert own == [name for name in TRIAL_COLUMNS if name in own], "metrics that came later may be lacking"
    assert (set(known.trials.columns) == set(own)) == (scenario == "paper")
    assert set(known.trials["scenario"]) == {one.scenario for one in known.family} == {scenario}
    assert known.trials["status"].eq("explored").all()
    assert {(one.strategy, one.size) for one in known.family} == set(
        known.trials[["strategy", "size"]].itertuples(index=False, name=None)
    )
    assert all(one.direction and one.size == 20.0 for one in known.family)
    assert (PROJECT / place / TRIALS_FILE).stat().st_size < 200_000


def test_the_project_s_gates_have_six_pairs_at_most_one_of_them_of_a_rule_of_others():
    family = [one for place in ("", "stage") for one in read_accepted(PROJECT / place).family]
    assert len(family) <= 6
    assert [one.strategy for one in family if not strategies()[one.strategy].tables] == ["next-best-view"]
