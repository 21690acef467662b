"""Two results folders compared: paired by world, corrected over the table, and what is left out is said."""

import json
import math

import numpy as np
import pandas as pd
import pytest

from explore_bench.analysis import two_folders
from explore_bench.analysis.statistics import effect_size, holm, mean_interval, sign_flip_p
from explore_bench.analysis.two_folders import COMPARED_METRICS, compare_folders
from explore_bench.errors import RequestError
from explore_bench.report.pages.two_folders import comparison_table

NOISE = np.random.default_rng(3).normal(0.0, 0.05, 50)


def rows(errors, strategy="nearest", size=20.0, seed=None, first=0, status="explored", world="w"):
    """Rows of trials.csv with one e a world; η is its inverse and T90 a hundred times as much."""
    return [
        {
            "strategy": strategy,
            "training_seed": seed,
            "size": size,
            "trial": first + i,
            "world": f"{world}{first + i}",
            "status": status,
            "scenario": "paper",
            "trajectory_error": error,
            "exploration_efficiency": 1.0 / error,
            "t90": 100.0 * error,
        }
        for i, error in enumerate(errors)
    ]


@pytest.fixture
def folders(tmp_path):
    """Write two folders with these rows."""

    def write(a, b):
        for name, own in (("a", a), ("b", b)):
            (tmp_path / name).mkdir()
            pd.DataFrame(own).to_csv(tmp_path / name / "trials.csv", index=False)
        return tmp_path / "a", tmp_path / "b"

    return write


def test_the_numbers_are_those_of_the_paired_differences(folders):
    a, b = 1.0 + NOISE, 0.9 + 2 * NOISE
    found = compare_folders(*folders(rows(a), rows(b)))
    assert [d.metric for d in found.differences] == list(COMPARED_METRICS)
    own = found.differences[0]
    assert (own.n, own.means) == (50, (pytest.approx(a.mean()), pytest.approx(b.mean())))
    assert own.difference == mean_interval(b - a)
    assert own.p == sign_flip_p(b - a)
    assert own.effect == pytest.approx(effect_size(a - b))
    assert own.improvement == np.mean(b < a)
    np.testing.assert_allclose([d.p_holm for d in found.differences], holm([d.p for d in found.differences]))
    assert found.left_out == ()


@pytest.mark.parametrize(("shift", "word"), [(-0.3, "better"), (0.3, "worse"), (0.0, "no difference shown")])
def test_a_verdict_knows_the_direction_of_each_metric(folders, shift, word):
    found = compare_folders(*folders(rows(1.0 + NOISE), rows(1.0 + shift + NOISE)))
    assert {d.verdict for d in found.differences} == {word}


@pytest.mark.parametrize(("worlds", "word"), [(6, "no difference shown"), (7, "better")])
def test_the_verdict_is_that_of_the_corrected_p_value(folders, worlds, word):
    """All worlds agree: p = 2/64 is below the level, but not three times that; of seven worlds 3 · 2/128 is."""
    found = compare_folders(*folders(rows([1.0] * worlds), rows([0.9] * worlds)))
    assert [d.p for d in found.differences] == [2 / 2**worlds] * 3
    assert {d.verdict for d in found.differences} == {word}
    assert {(row[7], row[-1]) for row in comparison_table(found).rows} == {(f"{6 / 2**worlds:.4f}", word)}


def test_a_p_value_of_the_very_level_is_at_most_the_level(folders, monkeypatch):
    monkeypatch.setattr(two_folders, "LEVEL", 3 * 2 / 64)
    found = compare_folders(*folders(rows([1.0] * 6), rows([1.1] * 6)))
    assert {d.verdict for d in found.differences} == {"worse"}


def test_the_same_folder_twice_shows_no_difference(folders):
    found = compare_folders(*folders(rows(1.0 + NOISE), rows(1.0 + NOISE)))
    assert all((d.difference.mean, d.p_holm, d.improvement) == (0.0, 1.0, 0.5) for d in found.differences)


def test_only_the_same_worlds_are_compared_and_the_others_are_counted(folders):
    a = rows([1.0] * 6) + rows([1.0] * 2, "random")
    b = rows([2.0] * 4) + rows([2.0] * 2, first=4, world="other") + rows([1.0] * 3, "entropy")
    found = compare_folders(*folders(a, b))
    assert {(d.strategy, d.n) for d in found.differences} == {("nearest", 4)}
    assert found.left_out == (
        "nearest, 20 m, paper: 2 worlds only in A",
        "random, 20 m, paper: 2 worlds only in A",
        "entropy, 20 m, paper: 3 worlds only in B",
        "nearest, 20 m, paper: 2 worlds only in B",
    )


@pytest.mark.parametrize("status", ["stuck", "step_limit", "failed"])
def test_trials_that_did_not_explore_take_part_and_are_said(folders, status):
    found = compare_folders(*folders(rows([1.0, 1.0]), rows([1.0]) + rows([9.0], first=1, status=status)))
    assert found.differences[0].n == 2
    assert found.left_out == ("1 trial of B did not explore; it is scored by the rule for such trials",)


def test_training_seeds_are_averaged_within_a_world_first(folders):
    found = compare_folders(*folders(rows([1.0] * 3, seed=0) + rows([3.0] * 3, seed=1), rows([2.5] * 3, seed=0)))
    assert found.differences[0].means == (2.0, 2.5)
    assert found.differences[0].n == 3
    assert found.left_out == ("nearest, 20 m, paper: training seeds 0, 1 in A, 0 in B; each is averaged over its own",)


def test_the_same_weights_are_compared_seed_by_seed(folders):
    """Each seed is a little better in every world; one against the other it would not be."""
    a = rows([1.0, 1.1, 0.9], seed=0) + rows([3.0, 3.2, 2.9], seed=1)
    b = rows([0.9, 0.99, 0.8], seed=0) + rows([2.8, 3.1, 2.7], seed=1)
    own = compare_folders(*folders(a, b)).differences[0]
    gains = np.array([0.1, 0.11, 0.1]), np.array([0.2, 0.1, 0.2])
    assert own.improvement == 1.0
    assert own.effect == pytest.approx(np.mean([effect_size(gain) for gain in gains]))


def test_worlds_that_not_every_training_seed_tried_are_said(folders):
    full = rows([1.0] * 6, seed=0) + rows([1.0] * 6, seed=1)
    found = compare_folders(*folders(full, full[:6] + full[6:9]))
    assert {d.n for d in found.differences} == {3}
    assert "nearest, 20 m, paper: 3 worlds that not every training seed tried" in found.left_out


def test_seeds_without_a_common_world_are_said(folders):
    apart = rows([1.0] * 3, seed=0) + rows([1.0] * 3, seed=1, first=3)
    with pytest.raises(RequestError, match="no world that every training seed of both tried"):
        compare_folders(*folders(apart, apart))


def test_as_many_but_other_training_seeds_are_said(folders):
    found = compare_folders(*folders(rows([1.0] * 3, seed=0), rows([2.5] * 3, seed=1)))
    assert found.left_out == ("nearest, 20 m, paper: training seeds 0 in A, 1 in B; each is averaged over its own",)


def test_a_metric_that_is_not_defined_is_left_out_by_name(folders):
    a, b = rows([1.0, 1.0]), rows([1.0, 1.0])
    b[0]["t90"] = math.nan
    found = compare_folders(*folders(a, b))
    assert {d.metric for d in found.differences} == set(COMPARED_METRICS) - {"t90"}
    assert found.left_out == ("nearest, 20 m, paper: t90 is not defined for every trial",)


def test_a_reference_is_compared_in_what_it_plans_for_alone(folders):
    own = [row for name in ("nearest", "clairvoyant", "clairvoyant-accurate") for row in rows([1.0, 1.2], name)]
    found = compare_folders(*folders(own, own))
    compared = {
        name: [d.metric for d in found.differences if d.strategy == name] for name in {r["strategy"] for r in own}
    }
    assert compared == {
        "nearest": list(COMPARED_METRICS),
        "clairvoyant": ["t90"],
        "clairvoyant-accurate": ["trajectory_error", "exploration_efficiency"],
    }
    assert found.left_out == (
        "clairvoyant, 20 m, paper: trajectory_error is none that this reference plans for",
        "clairvoyant, 20 m, paper: exploration_efficiency is none that this reference plans for",
        "clairvoyant-accurate, 20 m, paper: t90 is none that this reference plans for",
    )


def test_folders_without_a_common_world_or_without_trials_are_refused(folders, tmp_path):
    a, b = folders(rows([1.0]), rows([1.0], "random"))
    with pytest.raises(RequestError, match="no world in common"):
        compare_folders(a, b)
    with pytest.raises(RequestError, match=r"none.trials\.csv.*explore-bench run"):
        compare_folders(a, tmp_path / "none")


def test_a_folder_whose_table_is_empty_or_damaged_is_refused_by_name(folders, tmp_path):
    a, b = folders(rows([1.0, 2.0]), rows([1.0, 2.0]))
    own = pd.read_csv(b / "trials.csv")
    own[:0].to_csv(b / "trials.csv", index=False)
    with pytest.raises(RequestError, match="no world in common"):
        compare_folders(a, b)
    for column in ("trajectory_error", "size"):
        own.astype({column: object}).assign(**{column: [1.0, "oops"]}).to_csv(b / "trials.csv", index=False)
        with pytest.raises(RequestError, match=rf"b.trials\.csv' has something else than numbers in '{column}'"):
            compare_folders(a, b)


def test_the_table_and_the_json_say_the_same(folders):
    found = compare_folders(*folders(rows(1.0 + NOISE), rows(1.2 + NOISE) + rows([1.0], first=50)))
    table = comparison_table(found)
    assert table.rows[0][:4] == ("Nearest", "20, paper", "e [m]", "50")
    assert table.header[1] == "size [m], scenario"
    assert table.rows[0][6].startswith("0.200 [")
    assert table.rows[0][-1] == "worse"
    assert "- nearest, 20 m, paper: 1 world only in B" in table.note
    values = json.loads(json.dumps(found.values(), allow_nan=False))
    assert values["differences"][0]["difference"]["mean"] == pytest.approx(0.2)
    assert values["left_out"] == list(found.left_out)


def test_a_single_world_has_no_effect_size(folders):
    found = compare_folders(*folders(rows([1.0]), rows([1.2])))
    (row, *_) = comparison_table(found).rows
    assert row[3] == "1"
    assert row[8] == "–"
