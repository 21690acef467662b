"""What docs/fill.py writes into docs/field.md: who is best and why, what terms do, and what the tuning found."""

import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from handmade import trial_rows

from baselines.catalogue import CONTROLS, TUNED
from explore_bench.report.pages.claims import examined, write_claims
from explore_bench.report.pages.field import field_table
from explore_bench.strategies.registry import strategies

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs/fill.py"
NOISE = np.random.default_rng(0).normal(0.0, 0.02, 20)
BEST = {"heading-aware": 0.5, "heading-aware-no-heading": 0.5, "heading-aware-no-distance": 0.3, "nearest": 1.0}


@pytest.fixture
def fill(monkeypatch):
    spec = importlib.util.spec_from_file_location("fill", FILE)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "fill", module)  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def results(tmp_path):
    """Return a function that makes a results folder of the suite `field`: e of each strategy, η is one over it."""

    def made(**errors):
        own = [trial_rows(error * (1.0 + NOISE), name.replace("_", "-")) for name, error in errors.items()]
        trials = pd.concat(own)
        further = dict.fromkeys(("t90", "path_length", "regret", "regret_most", "crossings", "round_trips"), 1.0)
        trials = trials.assign(exploration_efficiency=1.0 / trials["trajectory_error"], **further)
        folder = tmp_path / "field"
        folder.mkdir()
        trials.to_csv(folder / "trials.csv", index=False)
        write_claims(examined(trials), folder)
        times = trials.assign(decisions=1, decision_ms=0.125, decision_ms_max=0.5)
        field_table(trials, times).write(folder / "tables", "field")
        return folder

    return made


def test_the_best_rule_of_others_is_named_with_its_place_and_what_its_terms_do(fill, results):
    errors = {"belief_attention": 0.2, "heading_aware": 0.5, "heading_aware_no_distance": 0.6, "nearest": 1.0}
    text = fill.field_words(results(**errors))
    assert text.startswith("**Belief attention (ours) explores best.** In the same 20 worlds ")
    assert (
        "Of the rules of others, Heading-aware gain (`heading-aware`) does best, place 2 of 4. A decision of it takes "
        "0.12 ms at 20 m" in text
    )
    assert text.endswith(
        "Heading-aware gain is shown to be better than Heading-aware gain, no distance in 2 of 2 comparisons and "
        "worse in none."
    )


def test_of_a_tuned_rule_it_is_told_what_the_tuning_and_what_the_terms_do(fill, results):
    errors = {"information_gain_tuned": 0.4, "information_gain": 0.5, "visible_unknown": 0.4001, "nearest": 1.0}
    text = fill.field_words(results(**errors))
    said = text.partition("the median. ")[2]
    assert re.findall(
        r"(\w[^.]*?) is shown to be better than (.+?) in (\w+) of 2 comparisons and worse in (\w+)\.", said
    ) == [
        ("Information gain, tuned", "Information gain", "2", "none"),
        ("Information gain, tuned", "Visible unknown", "2", "none"),
        ("Information gain, tuned", "Nearest", "2", "none"),
    ]


def test_without_a_rule_of_others_there_is_the_answer_alone(fill, results):
    assert "Of the rules" not in fill.field_words(results(nearest=1.0, random=2.0))


def test_what_a_term_does_is_said_of_every_rule_and_control_that_ran(fill, results):
    errors = {name.replace("-", "_"): error for name, error in BEST.items()}
    lines = fill.field_terms(results(**errors)).splitlines()
    assert lines[0] == "| rule | control | the rule | e, 20 m | η, 20 m |"
    assert lines[2].startswith("| `heading-aware` | `heading-aware-no-heading` | not shown | +0 % (1.0000) | ")
    assert lines[3].startswith(
        "| `heading-aware` | `heading-aware-no-distance` | worse in 2 of 2 | **+67 % (0.0004)** | "
    )
    assert len(lines) == 4


@pytest.mark.parametrize(
    ("counts", "words"),
    [((0, 0, 6), "not shown"), ((4, 0, 6), "better in 4 of 6"), ((0, 2, 6), "worse in 2 of 6")],
)
def test_an_effect_is_one_phrase(fill, counts, words):
    assert fill._effect(*counts) == words
    assert fill._effect(1, 2, 6) == "better in 1, worse in 2 of 6"


def test_the_page_shows_the_rows_of_one_size(fill, results):
    folder = results(nearest=1.0, burgard=2.0)
    lines = fill.field_table(folder, **{"size [m]": "20"}).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| Nearest", "| Burgard"]
    assert "R" in lines[0].split(" | ")
    assert len(fill.field_table(folder, **{"size [m]": "40"}).splitlines()) == 2


# The controls of the page's rules


def test_the_rules_of_the_page_have_the_controls_of_the_catalogue(fill):
    told = {row.split("`")[1]: row.rsplit("|", 2)[1].strip() for row in fill.field_rules().splitlines()[2:]}
    assert told["distance-advantage"] == "`remoteness`, `nearest`"
    assert told["visible-unknown"] == "–"
    assert CONTROLS.keys() <= told.keys() | {f"{name}-tuned" for name in TUNED}


def test_every_control_is_another_strategy_that_runs_where_the_rule_does():
    known = strategies()
    for rule, controls in CONTROLS.items():
        for control in controls:
            assert control != rule
            assert all(known[control].runs_in(kind) for kind in known[rule].kinds or ("landmark", "lidar"))


# The tuning


def study(tmp_path, *best):
    """Write a study of one rule whose objective is least at these values."""
    values = [1.0, 3.0, 6.0]
    table = pd.DataFrame({"strategy": "information-gain", "value": values})
    objective = [-0.5 if value in best else -0.2 for value in values]
    table = table.assign(objective=objective, low=np.subtract(objective, 0.1), high=np.add(objective, 0.1))
    table.to_csv(tmp_path / "field-tuning.csv", index=False)
    return tmp_path / "field-tuning.csv"


@pytest.mark.parametrize("best", [(3.0,), (1.0, 3.0), (3.0, 6.0)])
def test_an_untuned_value_that_is_best_needs_no_line_also_where_another_is_as_good(fill, tmp_path, best):
    row = fill.field_tuning(study(tmp_path, *best)).splitlines()[2]
    assert row == ("| `information-gain` | `gain` | 3 | −0.500 [−0.600, −0.400] | 3 | −0.500 [−0.600, −0.400] | – |")


def test_another_best_value_is_asked_for_in_the_catalogue_and_shown_once_it_is_there(fill, tmp_path, monkeypatch):
    file = study(tmp_path, 6.0)
    monkeypatch.delitem(fill.STRATEGIES, "information-gain-tuned", raising=False)
    with pytest.raises(AssertionError, match=r"TUNED lacks 'information-gain': \{'gain': 6\}"):
        fill.field_tuning(file)
    entry = fill.STRATEGIES["information-gain"]
    for gain in (12.0, 6.0):
        tuned = type(entry)(entry.factory, "tuned", parameters={"gain": gain})
        monkeypatch.setitem(fill.STRATEGIES, "information-gain-tuned", tuned)
        if gain != 6.0:
            with pytest.raises(AssertionError, match="TUNED has gain 12 of information-gain, the study 6"):
                fill.field_tuning(file)
    row = fill.field_tuning(file).splitlines()[2]
    assert row.endswith(
        "| 3 | −0.200 [−0.300, −0.100] | 6, the largest tried | −0.500 [−0.600, −0.400] | `information-gain-tuned` |"
    )


def test_a_constant_of_no_effect_is_said_to_have_none(fill, tmp_path):
    row = fill.field_tuning(study(tmp_path, 1.0, 3.0, 6.0)).splitlines()[2]
    assert row.split(" | ")[2:] == ["3", "−0.500 [−0.600, −0.400]", "all are alike", "−0.500 [−0.600, −0.400]", "– |"]


def test_a_tuned_rule_is_the_rule_with_one_other_constant_and_is_measured_by_it_and_its_controls():
    for rule, constants in TUNED.items():
        entry, tuned = strategies()[rule], strategies()[f"{rule}-tuned"]
        assert (tuned.factory, tuned.suites, tuned.kinds) == (entry.factory, entry.suites, entry.kinds)
        assert tuned.parameters == {**entry.parameters, **constants} != entry.parameters
        assert CONTROLS[f"{rule}-tuned"] == (rule, *CONTROLS[rule])


def test_what_a_stored_folder_says_of_terms_is_read_from_its_claims(fill, results):
    folder = results(heading_aware=0.5, heading_aware_no_distance=0.6, nearest=1.0)
    claims = json.loads((folder / "claims.json").read_text())
    assert [claim["claim"] for claim in claims] == ["heading-aware"]
    assert fill._effects(folder) == {("heading-aware", "heading-aware-no-distance"): (2, 0, 2)}


# What the page says in words of its own


def test_the_page_s_own_words_are_what_was_measured():
    page = " ".join((ROOT / "docs/field.md").read_text(encoding="utf-8").split())
    table = pd.read_csv(ROOT / "results/field-stage/tables/field.csv").set_index("Method")
    order = list(dict.fromkeys(table.index))
    assert order.index("Belief attention (ours)") == 9
    assert "it is behind nine others" in page
    times = table["decision, median [ms]"]
    ratios = (times["Next best view"].to_numpy(float) / times["Heading-aware gain"].to_numpy(float)).round()
    assert set(ratios.tolist()) <= {7.0, 8.0}
    assert "`heading-aware` in a seventh of its time" in page
    asked = pd.read_csv(ROOT / "docs/studies/field-choices.csv")
    asked = asked[(asked["scenario"] == "paper") & (asked["a"] != asked["b"]) & asked["seed_a"].isna()]
    both = asked[~asked["a"].isin({"visible-unknown", "nearest"}) & ~asked["b"].isin({"visible-unknown", "nearest"})]
    ends = (100 * both["agreement"]).round()
    assert f"choose the same in {ends.min():.0f} to {ends.max():.0f} % of the cases" in page
    answer = json.loads((ROOT / "results/confirmation/2026.json").read_text(encoding="utf-8"))["comparisons"]
    assert {one["p"] for one in answer} == {0.0001}
    assert {one["p_holm"] for one in answer} == {0.0366}
    assert "over 366 comparisons none below 0.0366" in page
