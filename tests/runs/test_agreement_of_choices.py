"""Strategies asked at the same observations: with oneself, by chance, with targets, with a memory, and who fails."""

import subprocess
import sys
import textwrap
from pathlib import Path

import pandas as pd
import pytest
from handmade import TINY, tiny_plan, write_plugin
from lidar_worlds import SMALL

import explore_bench
from explore_bench.analysis.choices import Choice
from explore_bench.errors import RequestError
from explore_bench.runs import choices
from explore_bench.runs.choices import Driven, agreement_of_choices, ask, drive
from explore_bench.runs.suites import plan
from explore_bench.strategies.contract import Target

ATTENTIVE = """
    import numpy as np

    class Attentive:
        '''The nearest frontier; it must have been made for the trial, and see all of it in order.'''

        def reset(self, rng):
            assert not hasattr(self, "seen"), "made for one trial"
            self.seen, self.rng = 0, rng

        def choose(self, observation):
            assert observation.decision == self.seen, "sees every observation once"
            assert len(observation.belief.poses) == observation.step + 1
            self.seen += 1
            self.rng.random(7)  # of its own: nobody else's draws change
            return int(observation.path_lengths.argmin())
"""


THERE = """
    from explore_bench import Target

    class There:
        '''A target as near to the nearest candidate as can be reached.'''

        def reset(self, rng): ...

        def choose(self, observation):
            grid, near = observation.roads.grid, observation.positions[observation.path_lengths.argmin()]
            places = grid.centres(observation.reachable.cells)
            return Target(tuple(places[((places - near) ** 2).sum(axis=1).argmin()].tolist()))
"""


def attentive(folder):
    (folder / "attentive.py").write_text(textwrap.dedent(ATTENTIVE))
    return f"{folder / 'attentive.py'}:Attentive"


def pair(found, a, b):
    table = found.table
    own = table[((table["a"] == a) & (table["b"] == b)) | ((table["a"] == b) & (table["b"] == a))]
    assert len(own) == 1
    return own.iloc[0]


def said_in(events):
    """Return the answer of a job that is done in this process."""
    *_, last = events
    return last.value


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plugins")
    raiser = write_plugin(folder, 'raise LookupError("no map in the glove box")')
    names = ["nearest", "random", "clairvoyant", attentive(folder), raiser]
    return agreement_of_choices(names, trials=12, scenario=TINY, workers=1)


def test_everybody_agrees_with_oneself_and_with_a_copy(found):
    for a, b in (("nearest", "nearest"), ("random", "random"), ("Attentive", "Attentive"), ("nearest", "Attentive")):
        assert pair(found, a, b)["agreement"] == 1.0, (a, b)
        assert pair(found, a, b)["n"] == 12


def test_a_random_one_agrees_by_chance(found):
    own = pair(found, "random", "nearest")
    assert own["ci_low"] < own["chance"] < own["ci_high"]
    assert 0.1 < own["chance"] < 0.6
    assert own["observations"] > 60
    assert own["agreement"] == pair(found, "random", "Attentive")["agreement"]


def test_whoever_raises_is_named_and_references_are_left_out(found):
    assert "clairvoyant is a reference: it is told the true world" in found.left_out[0]
    [raised] = [sentence for sentence in found.left_out if sentence.startswith("Plugin failed in ")]
    assert "first in world" in raised
    assert "LookupError: no map in the glove box (at decision 1)" in raised
    assert not {"clairvoyant"} & {*found.table["a"], *found.table["b"]}
    others = found.table[(found.table["a"] != "Plugin") & (found.table["b"] != "Plugin")]
    assert (others["n"] == 12).all(), "nobody else loses a world"
    assert len(found.left_out) == 2


def test_it_is_a_public_name_and_comes_out_the_same_again(found):
    again = explore_bench.agreement_of_choices(["nearest", "random"], trials=12, scenario=TINY, workers=2)
    assert again.left_out == ()
    for names in (("nearest", "random"), ("random", "random")):
        assert pair(again, *names).equals(pair(found, *names)), "whoever else is asked, and however many processes"


# Jobs in this process


def test_a_copy_that_must_see_all_of_each_trial_from_its_reset_on_agrees_with_the_original(tmp_path):
    """Along its own trials and along others'."""
    names = ["random", attentive(tmp_path), "nearest"]
    for driver in range(3):
        for trial in range(3):
            specs = [own for own in plan("smoke", names, trials=3, scenario=TINY).specs if own.trial == trial]
            driven = said_in(drive(specs[driver], 60.0, Path()))
            heard = said_in(ask(specs, driven, 60.0, Path()))
            assert heard.wrong == {}
            assert heard.answers[driver] == list(driven.answers)
            assert heard.answers[1] == heard.answers[2]


def test_a_driven_trial_tells_its_candidates_and_answers_and_is_heard_again():
    [spec] = tiny_plan(["random"], trials=1)
    driven = said_in(drive(spec, 60.0, Path()))
    assert driven.wrong == ""
    assert len(driven.candidates) == len(driven.answers) > 1
    heard = said_in(ask([spec, tiny_plan(["nearest"], trials=1)[0]], driven, 60.0, Path()))
    assert heard.wrong == {}
    assert heard.answers[0] == list(driven.answers)
    assert heard.answers[1] != list(driven.answers)


@pytest.mark.parametrize("scenario", [TINY, SMALL], ids=["landmark", "lidar"])
def test_targets_are_driven_again_and_compared_by_their_cell(tmp_path, scenario):
    """A strategy that answers the place of its nearest candidate, and the nearest."""
    (tmp_path / "there.py").write_text(textwrap.dedent(THERE))
    file = f"{tmp_path / 'there.py'}:There"
    specs = plan("smoke", ["nearest", file], trials=1, scenario=scenario).specs
    driven = said_in(drive(specs[1], 60.0, Path()))
    assert driven.wrong == ""
    assert sum(isinstance(answer, Target) for answer in driven.answers) >= 1
    heard = said_in(ask(specs, driven, 60.0, Path()))
    own = choices._choices(specs[1], driven, driven.answers)
    nearest = choices._choices(specs[0], driven, heard.answers[0])
    assert own == choices._choices(specs[1], driven, heard.answers[1])
    assert any(choice.candidate is None for choice in own)
    agreed = [one.same(other) for one, other in zip(own, nearest, strict=True)]
    assert agreed.count(True) >= len(agreed) / 2
    grid = scenario.grid
    targets = [(a, c) for a, c in zip(driven.answers, own, strict=True) if isinstance(a, Target)]
    assert all(choice == Choice(None, grid.cell_of(*answer.position)) for answer, choice in targets)


@pytest.mark.parametrize(
    ("later", "words"),
    [
        ("return 99", "the answer 99 is not the index of a candidate"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("import time; time.sleep(30)", "took longer than the 0.5 s allowed"),
    ],
)
def test_what_is_wrong_with_whom_is_asked_is_told_and_the_others_are_heard(tmp_path, later, words):
    """But for time: one who is late is alone in its process."""
    specs = plan("smoke", ["nearest", write_plugin(tmp_path, later)], trials=1, scenario=TINY).specs
    driven = said_in(drive(specs[0], 60.0, Path()))
    late = "longer" in words
    heard = said_in(ask(specs[1:] if late else specs, driven, 0.5 if late else 60.0, Path()))
    assert words in heard.wrong[0 if late else 1]
    if not late:
        assert heard.answers[0] == list(driven.answers)


def test_a_trial_that_does_not_repeat_is_noticed():
    [spec] = tiny_plan(["nearest"], trials=1)
    driven = said_in(drive(spec, 60.0, Path()))
    other = Driven(((0,), *driven.candidates[1:]), driven.answers)
    with pytest.raises(RuntimeError, match="came out otherwise"):
        said_in(ask([spec], other, 60.0, Path()))


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([], "name two or more"),
        ("nearest", "name two or more"),
        (["nowhere"], "strategy 'nowhere' is unknown"),
        (["clairvoyant"], "only references are left"),
    ],
)
def test_a_wrong_request_is_refused_in_a_sentence(names, words):
    with pytest.raises(RequestError, match=words):
        agreement_of_choices(names, trials=1, scenario=TINY)


@pytest.mark.slow
def test_the_study_asks_any_strategies_and_writes_a_table(tmp_path):
    """Its own command, with a strategy of a file and a lidar; a wrong request ends it with a sentence."""
    study = Path(__file__).parents[2] / "docs" / "studies" / "choices.py"
    asked = ["-s", "nearest", "-s", attentive(tmp_path), "--scenario", "stage", "--size", "8", "--trials", "1"]
    command = [sys.executable, str(study), *asked, "--output", str(tmp_path / "own.csv")]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    table = pd.read_csv(tmp_path / "own.csv")
    assert set(table["scenario"]) == {"stage"}
    assert table[(table["a"] == "nearest") & (table["b"] == "Attentive")]["agreement"].tolist() == [1.0]
    wrong = subprocess.run([sys.executable, str(study), "-s", "nowhere"], capture_output=True, text=True, check=False)
    assert wrong.returncode == 1
    assert wrong.stderr.startswith("choices: strategy 'nowhere' is unknown")
