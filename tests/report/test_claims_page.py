"""claims.md and claims.json from rows made by hand."""

import dataclasses
import json
import math

import numpy as np
import pandas as pd
import pytest

from explore_bench.analysis.claims import Claim, Comparison, claims, comparisons, examine, verdict
from explore_bench.analysis.training_curve import TRAINING_METRICS
from explore_bench.report.pages.claims import (
    HEADER,
    claims_section,
    comparison_table,
    examined,
    overview,
    sentence,
    tried,
    verdicts,
    write_claims,
)
from explore_bench.report.tables import p_text

CLAIM = Claim("x", "Nearest beats random.", (Comparison("nearest", "random", "trajectory_error", 20.0),), False)


@pytest.fixture
def trials():
    """Twenty worlds on which nearest has e = 1 and random e = 2, but for two worlds on which it is the other way.

    Graph-STNN, of which the paper claims something, is as good as nearest.
    """
    values = {"nearest": [1.0] * 18 + [2.0] * 2, "random": [2.0] * 18 + [1.0] * 2}
    values["graph-stnn"] = values["nearest"]
    rows = [
        {
            "strategy": name,
            "scenario": "paper",
            "size": 20.0,
            "trial": trial,
            "trajectory_error": value,
            "exploration_efficiency": 1.0,
        }
        for name, own in values.items()
        for trial, value in enumerate(own)
    ]
    return pd.DataFrame(rows).assign(training_seed=pd.array([None] * len(rows), dtype="Int64"))


def test_a_row_holds_every_number(trials):
    [row] = comparison_table(CLAIM, examine(CLAIM, trials)).rows
    cells = dict(zip(HEADER, row, strict=True))
    assert (cells["claimed better"], cells["than"], cells["metric"], cells["size [m]"]) == (
        "Nearest",
        "Random",
        "e",
        "20",
    )
    assert (cells["n"], cells["means"], cells["relative [%]"][:5]) == ("20", "1.100 / 1.900", "−42 [")
    assert cells["difference"].startswith("−0.800 [−1.000, ")
    assert (cells["P(better)"], cells["seeds"], cells["single seeds"]) == ("0.90", "– / –", "– / –")
    assert cells["d_z"] == f"{0.8 / np.std([-1.0] * 18 + [1.0] * 2, ddof=1):+.2f}"
    assert cells["verdict"] == "supported"


def test_a_sentence_says_it_in_plain_words(trials):
    text = sentence(examine(CLAIM, trials)[0])
    assert text.startswith(
        "Nearest has 42 % lower trajectory error e than Random at 20 m (1.100 to 1.900 m; difference −0.800 ["
    )
    assert text.endswith(": supported.")


def test_p_values_stand_as_they_are_and_corrected_and_the_sentence_says_the_corrected_one(trials):
    """Six worlds that agree have p = 2/64, twice that as one of two comparisons."""
    six = trials[trials["trial"] < 6]
    others = six[six["strategy"] == "random"].assign(strategy="entropy")
    claim = Claim("x", "", comparisons("nearest", ("random", "entropy"), ("trajectory_error",), (20.0,)))
    findings = examine(claim, pd.concat((six, others)))
    for row, finding in zip(comparison_table(claim, findings).rows, findings, strict=True):
        cells = dict(zip(HEADER, row, strict=True))
        assert (cells["p, weights"], cells["verdict"]) == ("0.0312", "not shown")
        assert row[HEADER.index("p, weights") + 1] == "0.0625"
        assert sentence(finding).endswith("p = 0.0625 after Holm): not shown.")


def test_where_trainings_matter_the_sentence_says_both_p_values(trials):
    nearest, random = (trials[trials["strategy"] == name] for name in ("nearest", "random"))
    seeds = [nearest.assign(training_seed=i, trajectory_error=nearest["trajectory_error"] + 0.4 * i) for i in range(3)]
    claim = dataclasses.replace(CLAIM, architecture=True)
    [finding] = examine(claim, pd.concat((*seeds, random)))
    assert finding.p < 0.05 < finding.p_architecture
    assert sentence(finding).endswith(
        f"p = {finding.p_holm:.4f} after Holm for these weights, = {finding.p_architecture_holm:.4f} for the "
        "architecture): supported for these weights."
    )
    [finding] = examine(claim, pd.concat((seeds[0], random)))
    assert "for the architecture" not in sentence(finding)
    [row] = comparison_table(claim, [finding]).rows
    assert row[HEADER.index("p, architecture")] == "–"


def test_no_p_value_is_printed_as_nothing():
    assert [p_text(p) for p in (0.0, 0.00004, 0.00006, 0.05, 1.0, math.nan)] == [
        *("< 0.0001", "< 0.0001", "0.0001", "0.0500", "1.0000", "–")
    ]


def test_only_several_training_seeds_have_a_range(trials):
    nearest, random = (trials[trials["strategy"] == name] for name in ("nearest", "random"))
    worse = nearest.assign(training_seed=1, trajectory_error=nearest["trajectory_error"] + 0.5)
    seeded = pd.concat((nearest.assign(training_seed=0), worse, random.assign(training_seed=0)))
    [row] = comparison_table(CLAIM, examine(CLAIM, seeded)).rows
    cells = dict(zip(HEADER, row, strict=True))
    assert (cells["seeds"], cells["single seeds"]) == ("2 / 1", "1.100–1.600 / –")


def test_what_was_not_measured_is_said(trials):
    only = trials[trials["strategy"] == "random"]
    [finding] = examine(CLAIM, only)
    assert sentence(finding) == "Nearest and Random at 20 m: not both measured in trajectory error e."
    [row] = comparison_table(CLAIM, [finding]).rows
    assert row[4:6] == ("not measured", "0")


def test_all_claims_are_written_with_a_verdict_each_and_the_same_bytes_twice(trials, tmp_path):
    found = examined(trials)
    about = [claim for claim in claims() if (claim.scenario, claim.comparisons[0].better) == ("paper", "graph-stnn")]
    assert len(about) == 3
    assert [row[0] for row in overview(found).rows] == [claim.name for claim in about]
    first = [path.read_bytes() for path in write_claims(found, tmp_path)]
    second = [path.read_bytes() for path in write_claims(examined(trials), tmp_path)]
    assert first == second
    page, values = first[0].decode(), json.loads(first[1])
    assert [value["claim"] for value in values] == [claim.name for claim in about]
    for claim, value in zip(about, values, strict=True):
        assert f"## Claim ({claim.name}): {value['verdict']}" in page
        assert len(value["comparisons"]) == len(claim.comparisons)
        words = [own["sentence"] for own in value["comparisons"]]
        assert all(f"\n- {own}\n" in page for own in words)
    assert page.count("\n- ") == sum(len(claim.comparisons) for claim in about)


def test_the_page_says_every_comparison_in_words_and_explains_what_was_measured(trials):
    section = claims_section(examined(trials))
    pairs = zip(section.tables[1::2], section.tables[2::2], strict=True)
    for (claim, findings), (words, numbers) in zip(examined(trials).items(), pairs, strict=True):
        assert claim.name in words.title
        assert [row[-1] for row in words.rows] == [sentence(finding) for finding in findings]
        assert numbers == comparison_table(claim, findings)
    assert all(metric.symbol in section.paragraphs[1] for metric in TRAINING_METRICS.values())


def test_trials_of_another_scenario_say_nothing_of_the_paper_s_claims(trials, tmp_path):
    """Whatever the claims, training curves' ones too; what an earlier report wrote of them goes."""
    write_claims(examined(trials), tmp_path)
    found = examined(trials.assign(scenario="stage"))
    assert found == {}
    assert write_claims(found, tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_a_claim_is_examined_where_the_trials_are_of_its_scenario(trials, monkeypatch):
    own = dataclasses.replace(CLAIM, scenario="stage")
    monkeypatch.setattr("explore_bench.analysis.claims.claims", lambda: (CLAIM, own))
    assert list(examined(trials)) == [CLAIM]
    assert list(examined(trials.assign(scenario="stage"))) == [own]
    assert verdict(examined(trials.assign(scenario="stage"))[own]) == "supported"


def test_every_table_of_the_claims_names_the_scenario_of_its_claim(trials, monkeypatch, tmp_path):
    own = dataclasses.replace(CLAIM, name="y", scenario="stage")
    monkeypatch.setattr("explore_bench.analysis.claims.claims", lambda: (CLAIM, own))
    found = examined(pd.concat((trials, trials.assign(scenario="stage"))))
    section = claims_section(found)
    for tables, scenario in ((section.tables[1:3], "paper"), (section.tables[3:], "stage")):
        assert [table.note for table in tables] == [f"Scenario: {scenario}."] * 2
    assert section.tables[0].header == ("claim", "scenario", "statement", "verdict", "comparisons")
    assert [row[:2] for row in section.tables[0].rows] == [("x", "paper"), ("y", "stage")]
    assert verdicts(found) == tuple((row[0], *row[2:]) for row in section.tables[0].rows)
    one = examined(trials)
    assert (overview(one).note, overview(one).rows) == ("Scenario: paper.", verdicts(one))
    page = write_claims(found, tmp_path)[0].read_text(encoding="utf-8")
    assert (page.count("\nScenario: paper.\n"), page.count("\nScenario: stage.\n")) == (1, 1)


def test_a_page_does_not_begin_with_claims_about_strategies_that_did_not_run(trials):
    found = examined(trials)
    begun = tried(found, trials)
    assert begun.keys() < found.keys()
    ran = set(trials["strategy"])
    assert all(any({one.better, one.worse} & ran for one in claim.comparisons) for claim in begun)
    assert tried(found, trials.assign(strategy="mine")) == {}
