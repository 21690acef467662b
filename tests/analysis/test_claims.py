"""Claims: comparisons paired by world, corrected within a claim, and verdicts that seeds limit."""

import dataclasses
import itertools
import json
import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from baselines.catalogue import CONTROLS
from explore_bench.analysis import claims as module
from explore_bench.analysis.claims import (
    CONTRADICTED,
    NOT_MEASURED,
    NOT_SHOWN,
    SUPPORTED,
    THESE_WEIGHTS,
    Claim,
    Comparison,
    as_values,
    claims,
    claims_about,
    comparisons,
    examine,
    metric_of,
    verdict,
)
from explore_bench.analysis.metrics import all_metrics
from explore_bench.analysis.statistics import (
    effect_size,
    holm,
    mean_interval,
    ratio_interval,
    sign_flip_p,
    unpaired_difference,
)
from explore_bench.errors import RequestError
from explore_bench.runs.suites import SUITES
from explore_bench.strategies.registry import strategies

NOISE = np.random.default_rng(3).normal(0.0, 0.1, 50)


def rows(strategy, values, seeds=(None,), size=20.0, metric="trajectory_error", scenario="paper"):
    """Rows of `trials.csv` with one value a world, the same for every training seed."""
    return pd.DataFrame(
        [
            {
                "strategy": strategy,
                "training_seed": seed,
                "size": size,
                "trial": trial,
                "scenario": scenario,
                metric: value,
            }
            for seed in seeds
            for trial, value in enumerate(values)
        ]
    ).astype({"training_seed": "Int64"})


def found(*frames, claim=None, **options):
    asked = claim or Claim("x", "a beats b.", (Comparison("a", "b", "trajectory_error", 20.0),), **options)
    return examine(asked, pd.concat(frames))


def test_the_numbers_of_a_comparison_are_those_of_the_paired_differences():
    a, b = 1.0 + NOISE, 1.2 + 2 * NOISE
    [finding] = found(rows("a", a), rows("b", b))
    assert finding.n == 50
    assert finding.means == pytest.approx((a.mean(), b.mean()))
    assert finding.difference == mean_interval(a - b)
    assert finding.relative.mean == pytest.approx((a - b).mean() / b.mean())
    assert finding.relative.low == pytest.approx(ratio_interval(a, b).low - 1.0)
    assert finding.p == finding.p_holm == sign_flip_p(a - b)
    assert finding.effect == pytest.approx(effect_size(b - a))
    assert finding.improvement == np.mean(a < b)
    assert (finding.seeds, finding.verdict) == ((0, 0), SUPPORTED)


@pytest.mark.parametrize(("metric", "shift"), [("trajectory_error", -0.2), ("exploration_efficiency", 0.2)])
def test_a_difference_counts_in_the_direction_of_the_metric(metric, shift):
    claim = Claim("x", "a beats b.", (Comparison("a", "b", metric, 20.0),))
    for sign, word in ((1, SUPPORTED), (-1, CONTRADICTED)):
        frames = rows("a", 1.0 + sign * shift + NOISE, metric=metric), rows("b", np.ones(50), metric=metric)
        [finding] = found(*frames, claim=claim)
        assert (finding.verdict, np.sign(finding.effect)) == (word, sign)
        assert (finding.improvement > 0.9) == (sign > 0)


def test_no_difference_is_not_shown():
    [finding] = found(rows("a", 1.0 + NOISE), rows("b", 1.0 + NOISE[::-1]))
    assert finding.verdict == NOT_SHOWN


def test_only_worlds_that_both_tried_count():
    [finding] = found(rows("a", np.ones(5)), rows("b", np.full(9, 2.0)))
    assert finding.n == 5


def test_a_strategy_without_trials_or_with_an_undefined_value_is_not_measured():
    for other in (rows("c", NOISE), rows("b", [math.nan, *NOISE[1:]]), rows("b", NOISE, size=40.0)):
        [finding] = found(rows("a", NOISE), other)
        assert (finding.verdict, finding.n) == (NOT_MEASURED, 0)


def test_holm_runs_over_the_comparisons_of_the_claim():
    claim = Claim("x", "a beats all.", comparisons("a", ("b", "c", "d"), ("trajectory_error",), (20.0,)))
    others = [rows(name, 1.0 + shift + NOISE[::-1]) for name, shift in zip("bcd", (0.2, 0.05, 0.0), strict=True)]
    findings = found(rows("a", 1.0 + NOISE), *others, claim=claim)
    np.testing.assert_allclose([f.p_holm for f in findings], holm([f.p for f in findings]))
    assert findings[1].p_holm > findings[1].p


@pytest.mark.parametrize(("value", "word"), [(1.0, SUPPORTED), (3.0, CONTRADICTED)])
def test_the_verdict_is_that_of_the_corrected_p_value(value, word):
    """Six worlds that agree have p = 2/64, below the level; twice that is not. What z did nobody measured."""
    frames = rows("a", np.full(6, value)), *(rows(name, np.full(6, 2.0)) for name in "bcd")
    verdicts = {}
    for others in ("b", "bz", "bcz", "bcd"):
        claim = Claim("x", "a beats them.", comparisons("a", others, ("trajectory_error",), (20.0,)))
        verdicts[others] = [finding.verdict for finding in found(*frames, claim=claim)]
    assert verdicts["b"] == [word]
    assert verdicts["bz"] == [word, NOT_MEASURED]
    assert verdicts["bcz"] == [NOT_SHOWN, NOT_SHOWN, NOT_MEASURED]
    assert verdicts["bcd"] == [NOT_SHOWN] * 3


def test_a_p_value_of_the_very_level_is_at_most_the_level(monkeypatch):
    frames = rows("a", np.ones(6)), rows("b", np.full(6, 2.0))
    monkeypatch.setattr(module, "LEVEL", 2 / 64)
    assert found(*frames)[0].verdict == SUPPORTED
    monkeypatch.setattr(module, "LEVEL", 1.9 / 64)
    assert found(*frames)[0].verdict == NOT_SHOWN


def varied(strategy, mean, spread, seeds, worlds=50):
    """Rows with the noise of worlds, and as much as `spread` from one training seed to the next."""
    shifts = spread * (np.arange(seeds) - (seeds - 1) / 2)
    return [rows(strategy, mean + shift + NOISE[:worlds], [seed]) for seed, shift in enumerate(shifts)]


def of_b(worlds=50):
    return rows("b", np.full(worlds, 1.2))


@pytest.mark.parametrize(
    ("spread", "seeds", "word"),
    [
        (0.01, 5, SUPPORTED),
        (0.01, 3, SUPPORTED),
        (0.01, 2, SUPPORTED + THESE_WEIGHTS),
        (0.01, 1, SUPPORTED + THESE_WEIGHTS),
        (0.3, 5, SUPPORTED + THESE_WEIGHTS),
        (0.3, 3, SUPPORTED + THESE_WEIGHTS),
    ],
)
def test_a_verdict_about_an_architecture_asks_what_other_trainings_would_show(spread, seeds, word):
    """The weights are better in any case; after other trainings it is so only where these hardly differ."""
    frames = *varied("a", 1.0, spread, seeds), of_b()
    [finding] = found(*frames)
    assert (finding.verdict, finding.seeds) == (word, (seeds, 0))
    assert found(*frames, architecture=False)[0].verdict == SUPPORTED


def test_trainings_that_differ_limit_a_contradiction_as_well():
    [finding] = found(*varied("a", 1.4, 0.3, 5), of_b())
    assert finding.verdict == CONTRADICTED + THESE_WEIGHTS
    [finding] = found(*varied("a", 1.4, 0.0, 5), of_b())
    assert finding.verdict == CONTRADICTED


def test_a_rule_has_no_other_trainings():
    [finding] = found(rows("a", 1.0 + NOISE), of_b())
    assert (finding.p, finding.verdict) == (finding.p_architecture, SUPPORTED)


def test_an_architecture_is_not_shown_where_its_weights_are_not():
    """Three worlds cannot show that any weights differ, however small the other p-value is."""
    [finding] = found(*varied("a", 1.0, 0.01, 3, worlds=3), rows("b", 5.0 + NOISE[:3]))
    assert finding.p_architecture_holm < 0.05 < finding.p_holm
    assert finding.verdict == NOT_SHOWN


def test_what_the_architecture_is_judged_by_is_corrected_by_itself():
    """Of two comparisons the seeds are too few to say: the third stands alone."""
    claim = Claim("x", "a beats all.", comparisons("a", ("b", "c", "d"), ("trajectory_error",), (20.0,)))
    others = [rows("b", 1.2 + NOISE[::-1]), rows("c", 1.2 + NOISE[::-1]), *varied("d", 1.2, 0.05, 3)]
    b, c, d = found(*varied("a", 1.0, 0.05, 1), *others, claim=claim)
    assert math.isnan(b.p_architecture)
    assert math.isnan(c.p_architecture_holm)
    assert d.p_architecture_holm == d.p_architecture < 1.0
    assert d.p_holm > d.p


def test_a_verdict_about_an_architecture_is_that_of_its_corrected_p_value():
    """What other trainings would show by itself need not be shown among others."""
    seeds, one = varied("a", 1.0, 0.08, 4), Comparison("a", "b", "trajectory_error", 20.0)
    others = [rows(name, np.full(50, 1.2)) for name in ("b", "c", "d", "e")]
    claim = Claim("x", "a beats all.", comparisons("a", ("b", "c", "d", "e"), ("trajectory_error",), (20.0,)))
    [alone] = found(*seeds, others[0], claim=dataclasses.replace(claim, comparisons=(one,)))
    assert (alone.p_architecture_holm, alone.verdict) == (alone.p_architecture, SUPPORTED)
    for finding in found(*seeds, *others, claim=claim):
        assert finding.p_architecture == alone.p_architecture < 0.05 < finding.p_architecture_holm
        assert finding.p_holm < 0.05
        assert finding.verdict == SUPPORTED + THESE_WEIGHTS


def test_a_relative_difference_has_the_sign_of_the_difference():
    [finding] = found(rows("a", [-1.0, -1.2]), rows("b", [-2.0, -2.0]))
    assert (finding.difference.mean, finding.relative.mean) == (pytest.approx(0.9), pytest.approx(0.45))
    assert 0.4 <= finding.relative.low < finding.relative.mean < finding.relative.high <= 0.5


def test_training_seeds_are_averaged_within_a_world_and_their_range_is_kept():
    frames = rows("a", np.full(50, 1.0), [0]), rows("a", np.full(50, 3.0), [1]), rows("b", np.full(50, 2.5))
    [finding] = found(*frames)
    assert finding.means == (2.0, 2.5)
    assert finding.ranges[0] == (1.0, 3.0)
    assert math.isnan(finding.ranges[1][0])


def test_the_range_of_the_training_seeds_is_over_the_worlds_that_both_tried():
    frames = rows("a", [1.0, 1.0, 9.0], [0]), rows("a", [3.0, 3.0, 30.0], [1]), rows("b", [2.0, 2.0])
    [finding] = found(*frames)
    assert (finding.n, finding.means) == (2, (2.0, 2.0))
    assert finding.ranges[0] == (1.0, 3.0)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([SUPPORTED, SUPPORTED], SUPPORTED),
        ([SUPPORTED, SUPPORTED + THESE_WEIGHTS], SUPPORTED + THESE_WEIGHTS),
        ([SUPPORTED, NOT_SHOWN], NOT_SHOWN),
        ([SUPPORTED, NOT_MEASURED], NOT_SHOWN),
        ([SUPPORTED, CONTRADICTED, NOT_SHOWN], CONTRADICTED),
        ([NOT_SHOWN, CONTRADICTED + THESE_WEIGHTS], CONTRADICTED + THESE_WEIGHTS),
        ([CONTRADICTED + THESE_WEIGHTS, CONTRADICTED], CONTRADICTED),
        ([NOT_MEASURED, NOT_MEASURED], NOT_MEASURED),
    ],
)
def test_a_claim_stands_or_falls_with_its_comparisons(words, expected):
    [finding] = found(rows("a", NOISE), rows("b", NOISE))
    import dataclasses

    assert verdict([dataclasses.replace(finding, verdict=word) for word in words]) == expected


def test_training_seeds_are_compared_unpaired(monkeypatch):
    values = {"a": [3.0, 3.1, 3.2, 3.3, 3.4], "b": [1.0, 1.1, 1.2, 1.3, 1.4]}
    monkeypatch.setattr(module, "strategies", lambda: {name: name for name in values})
    monkeypatch.setattr(module, "training_values", lambda entry, metric: dict(enumerate(values[entry])))
    claim = Claim("x", "a learns better.", comparisons("a", "b", ("final_reward",)))
    [finding] = found(rows("a", NOISE), claim=claim)
    assert (finding.n, finding.seeds, finding.verdict) == (5, (5, 5), SUPPORTED)
    assert (finding.difference, finding.p) == unpaired_difference(np.array(values["a"]), np.array(values["b"]))
    assert finding.p_architecture == finding.p
    assert finding.improvement == 1.0
    assert finding.means == pytest.approx((3.2, 1.2))
    assert finding.ranges == ((3.0, 3.4), (1.0, 1.4))
    assert (finding.relative.mean, finding.relative.n) == (pytest.approx(2.0 / 1.2), 5)
    assert math.isnan(finding.relative.low)
    assert math.isnan(finding.relative.high)
    assert finding.effect == pytest.approx(effect_size(np.subtract.outer(values["a"], values["b"]).reshape(-1)))
    values["b"] = [1.0]
    [finding] = found(rows("a", NOISE), claim=claim)
    assert (finding.n, finding.verdict) == (1, NOT_SHOWN)
    values["b"] = [1.0, 1.1, math.nan]
    [finding] = found(rows("a", NOISE), claim=claim)
    assert (finding.n, finding.verdict) == (0, NOT_MEASURED)
    values["b"] = []
    [finding] = found(rows("a", NOISE), claim=claim)
    assert finding.verdict == NOT_MEASURED


def test_a_difference_of_logarithms_is_no_share(monkeypatch):
    values = {"a": [-1.0, -1.1, -1.2], "b": [-0.5, -0.6, -0.7]}
    monkeypatch.setattr(module, "strategies", lambda: {name: name for name in values})
    monkeypatch.setattr(
        module,
        "training_values",
        lambda entry, metric: dict(enumerate(values[entry])) if "validation" in metric else {},
    )
    claim = Claim("x", "a learns better.", comparisons("a", "b", ("final_validation",)))
    [finding] = found(rows("a", NOISE), claim=claim)
    assert math.isnan(finding.relative.mean)
    assert finding.verdict == SUPPORTED, "of a validation less is better"
    assert finding.effect > 0.0


def test_of_what_is_not_measured_every_number_is_none():
    [finding] = found(rows("a", NOISE))
    numbers = [*finding.means, *itertools.chain(*finding.ranges)]
    numbers += [
        getattr(one, name) for one in (finding.difference, finding.relative) for name in ("mean", "low", "high")
    ]
    numbers += [finding.p, finding.p_architecture, finding.effect, finding.improvement]
    assert all(isinstance(number, float) and math.isnan(number) for number in numbers)
    assert (finding.n, finding.seeds, finding.difference.n, finding.relative.n) == (0, (0, 0), 0, 0)


def test_claims_are_about_scenarios_that_were_run():
    assert claims_about(rows("graph-stnn", [1.0], scenario="paper"))
    assert {claim.scenario for claim in claims_about(rows("graph-stnn", [1.0], scenario="paper"))} == {"paper"}
    assert claims_about(rows("graph-stnn", [1.0], scenario="no such")) == ()


def test_claims_are_about_strategies_that_ran_as_the_better_one():
    assert claims_about(rows("nearest", [1.0], scenario="paper")) == (), "it is only what others are compared with"
    both = pd.concat([rows("burgard", [1.0], scenario="paper"), rows("graph-stnn", [1.0], scenario="range 5 m")])
    assert [claim.name for claim in claims_about(both)] == ["v, range 5 m", "burgard"]


@pytest.mark.parametrize("metric", ["no_such", "decisions", "early_reward"])
def test_a_metric_without_a_direction_or_of_the_other_kind_is_refused(metric):
    with pytest.raises(RequestError, match=metric):
        metric_of(Comparison("a", "b", metric, 20.0))


CELLS = "ii, H_γ of a cell"


def test_the_paper_has_four_claims_about_registered_strategies_and_no_reference():
    known = strategies()
    numbered = [claim for claim in claims() if all(known[one.better].tables for one in claim.comparisons)]
    assert [claim.name for claim in numbered if claim.scenario == "paper"] == ["i", "ii", CELLS, "iii", "iv"]
    by_name = {claim.name: claim for claim in numbered}
    for claim in claims():
        assert claim.comparisons
        for comparison in claim.comparisons:
            metric_of(comparison)
            assert not known[comparison.better].reference
            assert not known[comparison.worse].reference
    assert {c.size for c in by_name["iii"].comparisons} == {30.0, 40.0}
    assert [claim.architecture for claim in numbered[:5]] == [True] * 5
    other = [(f"{c.better}-cell", f"{c.worse}-cell", c.metric) for c in by_name["ii"].comparisons if c.size == 20.0]
    assert [(c.better, c.worse, c.metric) for c in by_name[CELLS].comparisons] == other, "both readings ask the same"
    named = {name for suite in ("stage", "plans") for name in SUITES[suite].variations}
    assert {claim.scenario for claim in numbered[5:]} == named, "the others are asked of every set of lidar worlds"


def test_every_rule_of_others_is_claimed_to_be_better_than_its_controls_in_the_metrics_that_rank():
    own = {claim.name: claim for claim in claims() if claim.comparisons[0].better in CONTROLS}
    for rule, controls in CONTROLS.items():
        asked = [claim for claim in own.values() if claim.comparisons[0].better == rule]
        kinds = strategies()[rule].kinds or ("landmark", "lidar")
        assert len(asked) == (1 if "landmark" in kinds else 0) + 2
        for claim in asked:
            assert {one.worse for one in claim.comparisons} == set(controls)
            ranked = {one.metric for one in claim.comparisons}
            assert all(all_metrics()[metric].ranks for metric in ranked)
            assert len(claim.comparisons) == 2 * len(controls) * (3 if claim.scenario == "paper" else 1)
            assert not claim.architecture


def test_a_claim_is_about_the_trials_of_its_scenario_among_others():
    asked = Claim("x", "a beats b.", (Comparison("a", "b", "l90", 20.0),), scenario="range 5 m")
    own = {"metric": "l90", "scenario": "range 5 m"}
    frames = [rows("a", 1.0 + NOISE, **own), rows("b", 2.0 + NOISE, **own)]
    others = [rows(name, 9.0 - NOISE, metric="l90", scenario="range 10 m") for name in ("a", "b")]
    [finding] = found(*frames, *others, claim=asked)
    assert (finding.verdict, finding.n) == (SUPPORTED, 50)
    assert finding == found(*frames, claim=asked)[0]
    assert found(*others, claim=asked)[0].verdict == NOT_MEASURED


def test_a_metric_of_another_kind_of_world_is_not_measured():
    asked = Claim("x", "a beats b.", (Comparison("a", "b", "l90", 20.0),))
    assert found(rows("a", NOISE), rows("b", 1 + NOISE), claim=asked)[0].verdict == NOT_MEASURED


@pytest.fixture
def claimed(monkeypatch):
    """Return a function that gives the claims of packages whose entry points load by these calls."""

    def read(**loads):
        points = [SimpleNamespace(name=name, value=f"{name}:CLAIMS", load=load) for name, load in loads.items()]
        monkeypatch.setattr(module, "entry_points", lambda group: points)
        claims.cache_clear()
        return claims()

    yield read
    claims.cache_clear()


def raising(error):
    def load():
        raise error

    return load


OURS = Claim("x", "a beats b.", (Comparison("a", "b", "trajectory_error", 20.0),))
WRONG = Claim("y", "a beats b.", (Comparison("a", "b", "no_such", 20.0),))


def test_packages_add_claims_after_the_project_s_own(claimed):
    theirs = Claim("theirs", "b beats a.", OURS.comparisons)
    assert claimed(another=lambda: (theirs,), baselines=lambda: [OURS]) == (OURS, theirs)


@pytest.mark.parametrize(
    ("load", "words"),
    [
        (raising(ImportError("no mine")), "ImportError: no mine"),
        (raising(SystemExit(3)), "SystemExit: 3"),
        (lambda: 3, "TypeError"),
        (lambda: [OURS, "a beats b"], "'a beats b' is no Claim"),
        (lambda: [WRONG], "'no_such'"),
    ],
)
def test_an_entry_point_that_cannot_be_used_is_a_claim_that_says_why_beside_the_others(claimed, load, words):
    ours, broken = claimed(baselines=lambda: [OURS], mine=load)
    assert ours == OURS
    assert broken.name == "mine"
    assert all(part in broken.statement for part in ("mine:CLAIMS", words, "uninstall"))
    findings = examine(broken, rows("a", NOISE))
    assert (findings, verdict(findings)) == ([], NOT_MEASURED)


def test_values_can_be_written_as_json():
    claim = Claim("x", "a beats b.", (Comparison("a", "b", "trajectory_error", 20.0),))
    values = as_values(claim, found(rows("a", NOISE), rows("c", NOISE), claim=claim))
    assert list(values) == ["claim", "statement", "verdict", "comparisons"]
    assert (values["claim"], values["statement"]) == (claim.name, claim.statement)
    assert json.loads(json.dumps(values, allow_nan=False)) == values
    assert values["verdict"] == NOT_MEASURED
    assert values["comparisons"][0]["difference"]["mean"] is None
