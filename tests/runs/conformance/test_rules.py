"""The contract: sound strategies keep all of it, and each faulty one breaks the rule that it was made to break."""

import inspect
from dataclasses import replace
from pathlib import Path

import faulty_strategies
import hasty
import pytest

from explore_bench.errors import RequestError
from explore_bench.runs.conformance import RULES, Verdict, apart as apart_module, check
from explore_bench.runs.conformance.subject import Subject
from explore_bench.runs.conformance.tours import SMALL
from explore_bench.strategies.registry import strategies

FILE = Path(faulty_strategies.__file__)
READY = [name for name, entry in strategies().items() if entry.ready]
GENEROUS = 600.0

FAULTS = {
    "CannotBeMade": ("made", "cannot be made with (): ValueError: no map of Mars"),
    "NoReset": ("made", "has no method reset"),
    "Sleeps": ("in-time", "20 m, decision 2: it took longer than the 5 s allowed"),
    "RefusesAll": ("kinds", "it refuses all: it waits for worlds to come"),
    "Raises": ("chooses", "20 m, decision 3: it raised KeyError: 'no such frontier'"),
    "AnswersFloat": ("integer", "decision 0: it answered np.float64(1.0) of type float64"),
    "CountsFromOne": ("in-range", "decision 0: it answered 7 of 7 candidates"),
    "NeedsTwoCandidates": ("one-candidate", "decision 0: it raised IndexError: index 1 is out of bounds"),
    "HasRoomForFifty": ("many-candidates", "it raised ValueError: could not broadcast"),
    "NeedsNeighbours": ("corners", "decision 0: it raised AssertionError: too few neighbours"),
    "NeedsLandmark": ("no-landmark", "decision 0: it raised IndexError: index 0 is out of bounds"),
    "UsesGlobalNumpy": ("own-stream", "it used the global generator of numpy.random"),
    "Unseeded": ("deterministic", "when it was asked again"),
    "Remembers": ("forgets", "after another trial"),
    "ChangesAnArray": ("unmodified", "it changed path_lengths"),
    "ChangesTheFineMap": ("unmodified", "12 m by lidar: it changed belief.graph.fine.occupied"),
    "PeeksThroughTheStack": ("truth", "with another world behind the same observations"),
    "WorksInTheMainProcessOnly": ("worker", "failed there: AssertionError: not in the main process"),
}
MORE_FAULTS = {
    "DiesOnImport": ("made", "the process that imported it died (exit code 3)"),
    "Hangs": ("in-time", "was killed: nothing came of it in 5 s, nor could it be interrupted"),
    "Dies": ("chooses", "20 m: the process that it ran in died (exit code 5)"),
    "AnswersNone": ("integer", "it answered None of type NoneType"),
    "AnswersBool": ("integer", "of type bool"),
    "CountsBackwards": ("in-range", "it answered -1 of 7 candidates"),
    "RefusesLate": ("chooses", "12 m by lidar, decision 2: it raised RequestError: it is tired of lidars"),
    "FailsLate": ("plays", "a trial of 20 m failed: RuntimeError: nearly done"),
    "UsesGlobalRandom": ("own-stream", "it used the global generator of random"),
    "GoesByHash": ("deterministic", "in another process, with another seed of hashes"),
    "KeepsItsFirstStream": ("forgets", "after another trial"),
    "ChangesTheBelief": ("unmodified", "it changed belief.known"),
    "ChangesTheRoads": ("unmodified", "20 m: it changed roads.free"),
    "ChangesAField": ("unmodified", "it changed decision"),
    "PeeksThroughTheCollector": ("truth", "with another world behind the same observations"),
    "PeeksAtTheRollout": ("truth", "with another world behind the same observations"),
    "PeeksAtTheSpecification": ("truth", "with another world behind the same observations"),
    "LearnsMapsByHeart": ("truth", "with another world behind the same observations"),
    "ChoosesOtherwiseInWorkers": ("worker", "a trial of 20 m, decision 0: 0, but"),
    "DiesInWorkers": ("worker", "its worker process died"),
}
BY_LIDAR = {
    "Unseeded": ("deterministic", "12 m by lidar, decision"),
    "PeeksThroughTheStack": ("truth", "a trial of 12 m by lidar, decision"),
}
MORE_BY_LIDAR = {
    "Raises": ("chooses", "12 m by lidar, decision 3: it raised KeyError"),
    "AnswersFloat": ("integer", "12 m by lidar, decision 0: it answered np.float64("),
    "CountsFromOne": ("in-range", "12 m by lidar, decision 4: it answered 6 of 6 candidates"),
    "UsesGlobalNumpy": ("own-stream", "12 m by lidar: it used the global generator of numpy.random"),
    "Remembers": ("forgets", "12 m by lidar, decision"),
    "ChangesAnArray": ("unmodified", "12 m by lidar: it changed path_lengths"),
    "ChangesTheRoads": ("unmodified", "12 m by lidar: it changed roads.free"),
    "PeeksThroughTheCollector": ("truth", "a trial of 12 m by lidar, decision"),
    "PeeksAtTheRollout": ("truth", "a trial of 12 m by lidar, decision"),
    "PeeksAtTheSpecification": ("truth", "a trial of 12 m by lidar, decision"),
    "LearnsMapsByHeart": ("truth", "a trial of 12 m by lidar, decision"),
    "ChoosesOtherwiseInWorkers": ("worker", "a trial of 12 m by lidar, decision 0: 0, but"),
}
IN_A_HURRY = ("Sleeps", "Hangs")


def broken(strategy, timeout=GENEROUS):
    """Return what is said of each rule that a strategy breaks, by the name of the rule."""
    return {finding.rule: finding.detail for finding in check(strategy, timeout) if not finding.ok}


def test_every_fault_is_tested():
    faulty = {name for name, one in vars(faulty_strategies).items() if inspect.isclass(one) and hasattr(one, "choose")}
    assert faulty - {"Sound", "Refuses", "ByLidar"} == FAULTS.keys() | MORE_FAULTS.keys()
    assert {rule for rule, _ in (FAULTS | MORE_FAULTS).values()} == {rule.name for rule in RULES}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_caught_by_its_rule_and_by_no_other(name):
    rule, words = FAULTS[name]
    found = broken(f"{FILE}:{name}", 5.0 if name in IN_A_HURRY else GENEROUS)
    assert found.keys() == {rule}
    assert words in found[rule]


@pytest.mark.slow
@pytest.mark.parametrize("name", MORE_FAULTS)
def test_so_are_further_ones(name):
    rule, words = MORE_FAULTS[name]
    found = broken(f"{FILE}:{name}", 5.0 if name in IN_A_HURRY else GENEROUS)
    assert found.keys() == {rule}
    assert words in found[rule]


def found_by_lidar(name):
    return broken(f"{FILE}:ByLidar[fault={name}]")


@pytest.mark.parametrize("name", BY_LIDAR)
def test_a_fault_that_shows_in_lidar_worlds_alone_is_caught_there(name):
    rule, words = BY_LIDAR[name]
    found = found_by_lidar(name)
    assert found.keys() == {rule}
    assert words in found[rule]


@pytest.mark.slow
@pytest.mark.parametrize("name", MORE_BY_LIDAR)
def test_so_are_further_ones_there(name):
    rule, words = MORE_BY_LIDAR[name]
    found = found_by_lidar(name)
    assert found.keys() == {rule}
    assert words in found[rule]


def test_what_the_workers_played_is_told_in_the_order_of_the_tours(monkeypatch):
    """However their trials end: else another one would be named each time."""
    tours = [replace(SMALL, name=f"number {number}", trial=number) for number in (3, 1, 2)]
    execute = apart_module.execute
    monkeypatch.setattr(
        apart_module, "execute", lambda *given, **named: sorted(execute(*given, **named), key=lambda o: o.spec.trial)
    )
    assert list(apart_module.run_in_workers(Subject.of("nearest", 60.0), tours)) == tours


@pytest.mark.parametrize("kind", ["landmark", "lidar"])
def test_a_kind_may_be_refused_and_the_rest_is_kept(kind):
    found = {finding.rule: finding for finding in check(f"{FILE}:Refuses[kind={kind}]", GENEROUS)}
    other = {"landmark": "lidar", "lidar": "landmark"}[kind]
    sentence = f"it does not run in kind '{kind}'; leave it out"
    assert found["kinds"].detail == f"it runs in {other}; it refuses {kind}: {sentence}"
    situations = {"one-candidate", "many-candidates", "corners", "no-landmark"}
    skipped = {rule for rule, finding in found.items() if finding.verdict is Verdict.SKIPPED}
    assert skipped == (situations if kind == "landmark" else set())
    assert {found[rule].verdict for rule in found.keys() - skipped} == {Verdict.OK}
    assert ("by lidar" in found["plays"].detail) == (kind == "landmark")
    assert ("a trial of 20 m" in found["plays"].detail) == (kind == "lidar")


def test_a_sound_strategy_keeps_the_whole_contract():
    """The registered ones are slow tests."""
    found = check(f"{FILE}:Sound", GENEROUS)
    assert [finding.rule for finding in found] == [rule.name for rule in RULES]
    for finding in found:
        assert finding.verdict is Verdict.OK, finding


FIRST_OF = {strategies()[name].factory: name for name in reversed(READY)}
"""The first strategy of each factory; rules of the field differ from others of theirs in a constant alone."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in READY if strategies()[n].tables or FIRST_OF[strategies()[n].factory] == n])
def test_every_registered_strategy_keeps_the_contract(name):
    for finding in check(name, GENEROUS):
        assert finding.ok, finding


@pytest.mark.parametrize("name", [name for name in READY if strategies()[name].reference])
def test_a_reference_is_told_the_truth_and_keeps_the_rest(name, monkeypatch):
    """With hasty tours; those of the whole budget are a slow test."""
    monkeypatch.setitem(strategies(), name, replace(strategies()[name], factory=f"{hasty.__file__}:Hasty"))
    found = {finding.rule: finding for finding in check(name, GENEROUS)}
    assert found["truth"].verdict is Verdict.SKIPPED
    assert found["truth"].detail == "not applicable: a reference is told the truth"
    assert found["kinds"].detail == "it runs in landmark; it refuses lidar: its entry names landmark"
    assert {finding.verdict for rule, finding in found.items() if rule != "truth"} == {Verdict.OK}


def test_what_hangs_on_a_broken_rule_is_skipped_and_says_so():
    found = {finding.rule: finding for finding in check(f"{FILE}:CannotBeMade", GENEROUS)}
    assert found["made"].verdict is Verdict.BROKEN
    assert {finding.verdict for rule, finding in found.items() if rule != "made"} == {Verdict.SKIPPED}
    assert found["in-time"].detail == "the rule 'made' comes first"


def test_every_rule_is_a_sentence_and_needs_only_what_was_tested_before():
    names = [rule.name for rule in RULES]
    assert len(set(names)) == len(names)
    for number, rule in enumerate(RULES):
        assert rule.sentence[0].isupper() and rule.sentence.endswith(".")
        assert set(rule.needs) <= set(names[:number])


def test_a_finding_reads_as_its_sentence_and_what_happened():
    found = check(f"{FILE}:NoReset", GENEROUS)[0]
    assert str(found).startswith("broken   made             It can be imported and made, and has the methods reset")
    assert str(found).endswith("has no method reset; add it.")


def test_an_unknown_or_untrained_strategy_is_refused(monkeypatch):
    with pytest.raises(RequestError, match="did you mean 'nearest'"):
        check("nearst")
    with pytest.raises(RequestError, match="there is no file"):
        check("./nothing.py:Here")
    with pytest.raises(RequestError, match="has no 'Missing'"):
        check(f"{FILE}:Missing")
    with pytest.raises(RequestError, match="there is no module 'nothing'"):
        check("nothing.here:Missing")
    with pytest.raises(RequestError, match="takes the parameters"):
        check(f"{FILE}:Sound[depth=3]")
    untrained = replace(strategies()["gcn-obs"], weights={})
    monkeypatch.setitem(strategies(), "gcn-obs", untrained)
    with pytest.raises(RequestError, match="not trained"):
        check("gcn-obs")


def test_a_process_that_says_nothing_is_killed(monkeypatch):
    monkeypatch.setattr(apart_module, "GRACE", -4.999)
    found = broken(f"{FILE}:Sound", 5.0)
    assert found.keys() == {"made"}
    assert "was killed" in found["made"]
