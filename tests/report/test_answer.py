"""The first screen: the sentence that answers, how sure it is, the price, and the ranking as a picture."""

import dataclasses
import json
import math
import re
import xml.etree.ElementTree as ET

import pandas as pd
import pytest
from handmade import record

from explore_bench.analysis.ranking import Duel, Standing
from explore_bench.analysis.statistics import Estimate
from explore_bench.analysis.tables import trial_table
from explore_bench.report.answer import (
    answer,
    headline,
    how_sure,
    price_of,
    training_column,
    training_minutes,
)
from explore_bench.report.ranking import Column, ranking_columns, ranking_svg
from explore_bench.strategies.registry import strategies

PLACES = (("paper", 20.0), ("paper", 40.0))
METRICS = ("trajectory_error", "exploration_efficiency")
BEST = "uncertainty"


def duel(other, place=PLACES[0], metric=METRICS[0], gain=0.1, p=0.01, p_architecture=None):
    again = p if p_architecture is None else p_architecture
    return Duel(other, place, metric, Estimate(-0.2, -0.3, -0.1, 50), 50, gain, p, again)


def against(other, **options):
    return [duel(other, place, metric, **options) for place in PLACES for metric in METRICS]


OPEN, LOST = {"p": 0.4}, {"gain": -0.1}


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (against("nearest") + against("random"), "Uncertainty explores best"),
        (against("nearest") + against("random", **OPEN), "Uncertainty is ahead, not shown to be better than Random"),
        ([duel("nearest"), duel("nearest", **OPEN), *against("random")], "Uncertainty explores best"),
        (
            [duel("nearest"), duel("nearest", **LOST), *against("random")],
            "Uncertainty is ahead, not shown to be better than Nearest",
        ),
        (against("nearest", **OPEN) + against("random", **OPEN), "Nobody is shown to explore best"),
        (
            against("nearest", **LOST) + against("random", **OPEN),
            "Uncertainty is ahead on the whole, not in everything",
        ),
        ([], "Nobody is shown to explore best"),
    ],
)
def test_the_headline_claims_what_is_shown_and_no_more(found, said):
    assert headline([BEST, "nearest", "random"], found) == said


def test_the_headline_counts_where_many_are_open_and_one_alone_is_compared_with_nobody():
    others = ["nearest", "random", "entropy", "gcn-obs"]
    found = against("nearest") + [one for name in others[1:] for one in against(name, **OPEN)]
    assert headline([BEST, *others], found) == "Uncertainty is ahead, not shown to be better than 3 of 4 others"
    assert headline([BEST], []) == "How Uncertainty explores"
    assert how_sure([BEST], []) == ""


def test_how_sure_that_is_counts_comparisons_and_names_the_open_ones_and_the_next():
    found = [*against("nearest"), *against("random")[:3], duel("random", PLACES[1], METRICS[1], **OPEN)]
    said = how_sure([BEST, "nearest", "random"], found)
    assert "In the same 50 worlds Uncertainty is shown to be better in 7 of 8 comparisons" in said
    assert "e and η at 20 and 40 m" in said
    assert "worse in none" in said
    assert "open are 1, with Random" in said
    assert said.endswith("Against the next, Nearest: e −20 [−30, −10] % and η −20 [−30, −10] % at 40 m.")
    assert "better in none of 4" in how_sure([BEST, "nearest"], against("nearest", **OPEN))
    assert "worse in 4" in how_sure([BEST, "nearest"], against("nearest", **LOST))
    assert "tried no world" in how_sure([BEST, "nearest"], [])


def test_of_trained_weights_it_says_what_other_trainings_would_show_again():
    found = [*against("nearest", p_architecture=0.02), *against("random", p_architecture=0.06)]
    said = how_sure([BEST, "nearest", "random"], found)
    assert "better in 8 of 8" in said
    assert "Holm’s correction), in 4 of them after other trainings of the others, too, and worse in none" in said
    assert "in 4 of them after other trainings, too," in how_sure(["graph-stnn", "nearest", "random"], found)
    open_ = [duel("nearest", p=0.4, p_architecture=0.04), duel("random", p_architecture=math.nan)]
    assert "in none of them after other trainings of the others, too" in how_sure([BEST, "nearest", "random"], open_)
    said = how_sure([BEST, "nearest"], against("nearest", p_architecture=math.nan))
    assert "correction) with these weights, whose seeds are too few to say it of other trainings, and worse in" in said
    assert "other trainings" not in how_sure([BEST, "nearest"], against("nearest"))
    assert "other trainings" not in how_sure([BEST, "nearest"], against("nearest", p=0.4, p_architecture=0.5))


def test_scenarios_are_named_where_there_are_several():
    found = [duel("nearest", ("range 5 m", 20.0)), duel("nearest", ("range 10 m", 20.0))]
    said = how_sure([BEST, "nearest"], found)
    assert "e in range 5 m, 20 m and range 10 m, 20 m" in said


def test_the_price_is_what_training_took_and_who_needs_none():
    trainings = {"belief-attention": Estimate(17.2, 12.0, 20.0, 3)}
    said = price_of(["belief-attention", "graph-stnn", "entropy", "nearest"], trainings)
    assert "a training of 17 minutes on one core, 3 seeds of it" in said
    assert said.endswith("of those that need none, Entropy does best.")
    assert price_of(["entropy", "belief-attention"], trainings) == "It needs no training."
    assert price_of(["mine.py:Mine", "entropy"], trainings) == "", "nobody knows what somebody's own took"


def test_minutes_of_training_come_from_the_cards(tmp_path):
    for seed, seconds in enumerate((60, 180)):
        (tmp_path / f"w-{seed}.json").write_text(json.dumps({"wall_seconds": seconds}))
    (tmp_path / "w-3.json").write_text("[]")
    files = [str(tmp_path / f"w-{seed}.safetensors") for seed in range(5)]
    assert training_minutes({"a": files, "b": files[3:]}) == {"a": Estimate(2.0, 1.0, 3.0, 2)}
    column = training_column({"graph-stnn": Estimate(2.0, 1.0, 3.0, 2)}, ["graph-stnn", "nearest", "mine.py:Mine"])
    assert column.none == ["nearest"]
    assert training_column({}, ["nearest"]) is None


# The picture


def standing(name, e, eta):
    means = {("paper", size): (e * size / 20, eta) for size in (20.0, 40.0)}
    values = {
        (place, metric): Estimate(value, 0.9 * value, 1.1 * value, 50)
        for place, own in means.items()
        for metric, value in zip(METRICS, own, strict=True)
    }
    return Standing(name, values, e)


RANKING = [standing("uncertainty", 0.5, 2.0), standing("random", 1.0, 1.0), standing("clairvoyant-accurate", 0.3, 2.5)]
NAMES = [own.strategy for own in RANKING]
REFERENCES = {"clairvoyant-accurate"}


@pytest.fixture
def drawing():
    return ET.fromstring(ranking_svg(NAMES, ranking_columns(RANKING, PLACES), REFERENCES))


def texts(drawing):
    return [element.text for element in drawing.iter("{http://www.w3.org/2000/svg}text")]


def test_every_strategy_has_a_line_in_order_and_every_place_its_columns(drawing):
    said = texts(drawing)
    labels = [strategies()[name].label for name in NAMES]
    assert [text for text in said if text in labels or text.endswith("(reference)")] == [
        *labels[:2],
        f"{labels[2]} (reference)",
    ]
    assert [text for text in said if text.startswith("map of")] == ["map of 20 m", "map of 40 m"]
    assert said.count("e [m]") == said.count("η [m²/step]") == 2
    assert said.count("◂ better") == said.count("better ▸") == 2
    assert drawing.get("aria-label").startswith("Ranking, best first: Uncertainty, Random, ")


def test_each_mean_stands_with_its_interval_where_the_axis_has_it(drawing):
    space = "{http://www.w3.org/2000/svg}"
    marks = {group.find(f"{space}title").text: group for group in drawing.iter(f"{space}g")}
    assert len(marks) == len(NAMES) * 4
    text = "Uncertainty, map of 20 m: e [m] 0.500 [0.450, 0.550]"
    [first] = [marks[text].find(f"{space}circle")]
    second = marks["Random, map of 20 m: e [m] 1.000 [0.900, 1.100]"].find(f"{space}circle")
    assert float(first.get("cx")) < float(second.get("cx"))
    assert float(first.get("cy")) < float(second.get("cy"))
    low, high = map(
        float, re.fullmatch(r"M([\d.]+) [\d.]+H([\d.]+)", marks[text].find(f"{space}path").get("d")).groups()
    )
    assert low < float(first.get("cx")) < high


@pytest.mark.parametrize(("low", "high"), [(0.3, 4.0), (1.1, 1.3), (0.002, 900.0), (5.0, 5.0), (1.02, 1.03)])
def test_an_axis_is_logarithmic_and_has_a_few_round_numbers(low, high):
    column = Column("", "", "lower", {"a": Estimate(low, math.nan, math.nan, 1), "b": Estimate(high, low, high, 5)})
    ticks = column.ticks()
    assert len(ticks) <= 4
    assert all(0.0 <= column.at(tick) <= 1.0 for tick in ticks)
    assert ticks or high / low < 1.1
    middle = column.at(math.sqrt(low * high))
    assert middle == pytest.approx((column.at(low) + column.at(high)) / 2)


def test_a_value_of_zero_stands_at_the_end_of_its_axis_and_one_that_is_missing_nowhere():
    values = {"a": Estimate(0.0, 0.0, 0.0, 5), "random": Estimate(1.0, 0.5, 2.0, 5)}
    column = Column("", "x", "lower", values)
    assert column.at(0.0) == 0.0
    assert "nan" not in ranking_svg(
        ["random", "a"], [Column("", "x", "lower", {"random": Estimate(*[math.nan] * 3, 0)})]
    )


def test_labels_stay_text(monkeypatch):
    svg = ranking_svg(["<b>&", "random"], [Column("<g>", "<t>", "lower", {"<b>&": Estimate(1.0, 1.0, 1.0, 2)})])
    assert "<b>&" in texts(ET.fromstring(svg))


# From trials


def test_trials_of_which_nothing_can_be_ranked_have_no_answer():
    trials = pd.DataFrame(
        {"strategy": ["nearest"], "scenario": ["paper"], "size": [20.0], "trial": [0]}
        | {key: [math.nan] for key in METRICS}
    )
    assert answer(trials, [record(rows=1)]) is None


def test_a_reader_is_shown_the_first_beside_what_others_are_measured_by(stored):
    records = stored.store.records()[0]
    found = answer(trial_table(records), records)
    assert set(found.beside) == {"random", "nearest"}
    assert "Clairvoyant" not in found.headline
    assert len(found.narrow) == 1


def test_too_few_worlds_to_show_anything_are_said_to_be():
    found = [dataclasses.replace(one, worlds=4) for one in against("nearest", **OPEN)]
    assert how_sure([BEST, "nearest"], found).endswith("So few worlds can show nothing, 8 might.")
    enough = [dataclasses.replace(one, worlds=8) for one in found]
    assert "So few worlds" not in how_sure([BEST, "nearest"], enough)
    assert "So few worlds" not in how_sure([BEST, "nearest"], against("nearest", **OPEN))
