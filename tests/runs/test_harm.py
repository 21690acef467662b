"""Whatever a plugin does, the rows of its rivals are the same bytes, and its own say what it did."""

import misbehaving
import pytest
from handmade import TINY, tiny_plan, write_plugin

from explore_bench.records.provenance import trial_key
from explore_bench.records.store import Store, missing
from explore_bench.runs import runner
from explore_bench.runs.runner import check_runnable, complete
from explore_bench.runs.workers import process

RIVALS = ("nearest", "random")
IN_SHORT = ("changes nearest", "changes its scenario", "KeyboardInterrupt", "swallows everything", "eats memory")
KINDS = {
    (name, ending): plugin
    for ending, plugins in (
        ("harmless", misbehaving.HARMLESS),
        ("failed", misbehaving.FAILING),
        ("transient", misbehaving.TRANSIENT),
    )
    for name, plugin in plugins.items()
}


def rows_of(specs, folder, workers=2, **options):
    """Run trials in processes; returns their rows, the shards by strategy and trial, and what is to do again."""
    store = Store(folder)
    store.open(0, "evaluate", TINY)
    check_runnable(specs, workers, "processes", 5.0)
    table = complete(specs, store, workers, **options)
    shards = {(spec.strategy, spec.trial): store.path(trial_key(spec)).read_bytes() for spec in specs}
    return table, shards, list(missing(store, specs))


@pytest.fixture(scope="module")
def honest(tmp_path_factory):
    """Return the shards of the rivals where nobody misbehaves."""
    return rows_of(tiny_plan(RIVALS, trials=2), tmp_path_factory.mktemp("honest"))[1]


def judge(case, tmp_path, honest, monkeypatch, workers):
    _, ending = case
    monkeypatch.setattr(process, "GRACE", 1.0)
    monkeypatch.setattr(runner, "CHECK_SECONDS", 1.0)
    head, lines = KINDS[case]
    plugin = write_plugin(tmp_path, lines, head=head)
    own_trials = 1 if ending == "transient" else 2  # what ends its process meets no second trial
    specs = [*tiny_plan([plugin], trials=own_trials), *tiny_plan(RIVALS, trials=2)]
    limit = 2.0 if ending == "transient" else 60.0  # those that do not wait for it have all the time they need
    table, shards, again = rows_of(specs, tmp_path / "results", workers, timeout=limit, memory=2.0)
    assert len(table) == len(specs), "every trial has a row"
    assert {key: shards[key] for key in honest} == honest
    own = table[table["strategy"] == "Plugin"]
    assert set(own["status"]) == ({"explored"} if ending == "harmless" else {"failed"}), own["reason"].tolist()
    assert own["reason"].fillna("").str.len().max() < 1200
    assert [spec.strategy for spec in again] == (["Plugin"] if ending == "transient" else [])


@pytest.mark.parametrize("case", [case for case in KINDS if case[0] in IN_SHORT], ids="-".join)
def test_a_plugin_harms_nobody_but_itself(case, tmp_path, honest, monkeypatch):
    judge(case, tmp_path, honest, monkeypatch, workers=2)


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in KINDS if case[0] not in IN_SHORT], ids="-".join)
def test_nor_do_further_ones(case, tmp_path, honest, monkeypatch):
    judge(case, tmp_path, honest, monkeypatch, workers=1)
