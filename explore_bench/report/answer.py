"""What a reader sees first: who explores best, how sure that is, and at what price."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd
from markupsafe import Markup

from explore_bench.analysis.metrics import METRICS, all_metrics
from explore_bench.analysis.ranking import Duel, Place, duels, places_of, ranking_metrics, standings
from explore_bench.analysis.statistics import LEVEL, Estimate
from explore_bench.records.encoding import TrialRecord
from explore_bench.report.drawing import entry_of
from explore_bench.report.origin import card_of
from explore_bench.report.ranking import Column, ranking_columns, ranking_svg
from explore_bench.report.tables import percent_text
from explore_bench.strategies.registry import strategies

NARROW = 440
"""Width of a picture for a narrow screen [px]."""


@dataclass(frozen=True)
class Answer:
    """The first screen of the page.

    Attributes
    ----------
    headline : who explores best, in a sentence without its stop.
    sentences : how sure that is, and at what price.
    wide, narrow : the ranking as one picture, and as one a place for a narrow screen.
    terms : what the symbols in it mean.
    beside : strategies to watch side by side, the first first.
    """

    headline: str
    sentences: tuple[str, ...]
    wide: Markup
    narrow: tuple[Markup, ...]
    terms: str
    beside: tuple[str, ...]


def answer(trials: pd.DataFrame, records: Sequence[TrialRecord]) -> Answer | None:
    """Return what the trials say; None where nothing can be ranked."""
    references = {name for name in dict.fromkeys(trials["strategy"]) if entry_of(name).reference}
    ranking = standings(trials, references)
    names = [own.strategy for own in ranking]
    competitors = [name for name in names if name not in references]
    if not competitors:
        return None
    found = duels(trials, competitors)
    trainings = training_minutes(_weights_of(records))
    columns = ranking_columns(ranking, places_of(trials))
    groups = list(dict.fromkeys(column.group for column in columns))
    price = training_column(trainings, names)
    parts = [[own for own in columns if own.group == group] for group in groups]
    narrow = [ranking_svg(names, own, references, NARROW) for own in parts]
    wide = ranking_svg(names, [*columns, *([price] if price else [])], references)
    return Answer(
        headline(competitors, found),
        tuple(filter(None, (how_sure(competitors, found), price_of(competitors, trainings)))),
        Markup(wide),
        tuple(map(Markup, narrow)),
        _terms(ranking_metrics(trials)),
        _beside(competitors),
    )


def headline(competitors: Sequence[str], found: Sequence[Duel]) -> str:
    """Who explores best, as far as that is shown: against everybody, against some, or against nobody."""
    label = entry_of(competitors[0]).label
    if len(competitors) == 1:
        return f"How {label} explores"
    won, lost = ({duel.other for duel in found if getattr(duel, how)} for how in ("won", "lost"))
    open_ = [name for name in competitors[1:] if name not in won or name in lost]
    if not open_:
        return f"{label} explores best"
    if len(open_) == len(competitors) - 1:
        return "Nobody is shown to explore best" if not lost else f"{label} is ahead on the whole, not in everything"
    if len(open_) > 2:
        return f"{label} is ahead, not shown to be better than {len(open_)} of {len(competitors) - 1} others"
    return f"{label} is ahead, not shown to be better than {_joined([entry_of(name).label for name in open_])}"


def how_sure(competitors: Sequence[str], found: Sequence[Duel]) -> str:
    """How many comparisons of the first with the others are shown, and what it gains over the next."""
    if len(competitors) == 1:
        return ""
    first, second = (entry_of(name).label for name in competitors[:2])
    if not found:
        return f"{first} tried no world that another strategy tried, so nothing can be said of the order."
    won, lost = sum(duel.won for duel in found), sum(duel.lost for duel in found)
    open_ = Counter(entry_of(duel.other).label for duel in found if not (duel.won or duel.lost))
    worlds = sorted({duel.worlds for duel in found})
    on = f"{worlds[0]}" if len(worlds) == 1 else f"{worlds[0]} to {worlds[-1]}"
    text = (
        f"In the same {on} worlds {first} is shown to be better in {won or 'none'} of {len(found)} comparisons with "
        f"the others ({_compared(found)}; paired by world, p ≤ {LEVEL:g} after Holm’s correction)"
        f"{_trained(found, competitors[0])} and worse in {lost or 'none'}"
    )
    if 0 < len(open_) <= 4:
        text += f"; open are {sum(open_.values())}, with {_joined(list(open_))}"
    own = [duel for duel in found if duel.other == competitors[1]]
    last = [duel for duel in own if duel.place == max((one.place for one in own), key=lambda place: place[1])]
    gains = [f"{all_metrics()[duel.metric].symbol} {percent_text(duel.relative)} %" for duel in last]
    if last:
        text += f". Against the next, {second}: {_joined(gains)} at {_named(last[0].place, found)}"
    least = math.ceil(math.log2(2.0 * len(found) / LEVEL))  # worlds: the least p is 2/2ⁿ, times Holm's correction
    return f"{text}." + (f" So few worlds can show nothing, {least} might." if worlds[-1] < least else "")


def _trained(found: Sequence[Duel], first: str) -> str:
    """In how many comparisons it is so after other trainings, too; nothing where none is won, or nobody was trained."""
    if not any(duel.won for duel in found) or all(duel.p_architecture == duel.p for duel in found):
        return ""
    if not any(math.isfinite(duel.p_architecture) for duel in found):
        return " with these weights, whose seeds are too few to say it of other trainings,"
    again = sum(duel.won_after_other_trainings for duel in found)
    whose = "" if entry_of(first).trainer else " of the others"
    return f", in {again or 'none'} of them after other trainings{whose}, too,"


def _compared(found: Sequence[Duel]) -> str:
    """Metrics and places of some comparisons."""
    symbols = [all_metrics()[name].symbol for name in dict.fromkeys(duel.metric for duel in found)]
    places = list(dict.fromkeys(duel.place for duel in found))
    if len({scenario for scenario, _ in places}) > 1:
        return f"{_joined(symbols)} in {_joined([_named(place, found) for place in places])}"
    return f"{_joined(symbols)} at {_joined([f'{size:g}' for _, size in places])} m"


def _named(place: Place, found: Sequence[Duel]) -> str:
    """Size of a place, and its scenario where there are several."""
    scenario, size = place
    return f"{scenario}, {size:g} m" if len({duel.place[0] for duel in found}) > 1 else f"{size:g} m"


def price_of(competitors: Sequence[str], trainings: dict[str, Estimate]) -> str:
    """What the first costs in training, and who does best without any."""
    first = competitors[0]
    known = strategies()
    if first in trainings:
        own = trainings[first]
        seeds = f", {own.n} seeds of it" if own.n > 1 else ""
        text = f"Its price is a training of {own.mean:.0f} minutes on one core{seeds}"
        untrained = next((name for name in competitors if name in known and known[name].trainer is None), None)
        return text + (f"; of those that need none, {entry_of(untrained).label} does best." if untrained else ".")
    if first in known and known[first].trainer is None:
        return "It needs no training."
    return ""


def training_minutes(weights: Mapping[str, Iterable[str]]) -> dict[str, Estimate]:
    """Minutes that the training of weights took by strategy, mean, least and most of the seeds, from the cards."""
    found = {}
    for name, files in weights.items():
        cards = [card_of(file) for file in files]
        seconds = [card.get("wall_seconds") for card in cards if card is not None]
        minutes = [one / 60 for one in seconds if isinstance(one, (int, float)) and one > 0]
        if minutes:
            found[name] = Estimate(sum(minutes) / len(minutes), min(minutes), max(minutes), len(minutes))
    return found


def _weights_of(records: Iterable[TrialRecord]) -> dict[str, list[str]]:
    """Weights with which each strategy ran."""
    found: dict[str, dict[str, None]] = {}
    for record in records:
        if record.spec.weights:
            found.setdefault(record.spec.strategy, {})[record.spec.weights] = None
    return {name: list(files) for name, files in found.items()}


def training_column(trainings: dict[str, Estimate], names: Sequence[str]) -> Column | None:
    """Column of what strategies cost in training; None where none of them has a card that tells."""
    own = {name: trainings[name] for name in names if name in trainings}
    known = strategies()
    none = [name for name in names if name in known and known[name].trainer is None]
    return Column("price", "training [min]", "lower", own, none) if own else None


def _terms(metrics: Sequence[str]) -> str:
    """Symbols of metrics in words."""
    known = all_metrics()
    words = [
        f"{known[name].symbol}: {name.replace('_', ' ') if name in METRICS else known[name].equation}"
        for name in metrics
    ]
    return "; ".join(words)


def _beside(competitors: Sequence[str]) -> tuple[str, ...]:
    """The first, and what others are measured by, else the next."""
    first, *others = competitors
    second = next((name for name in others if entry_of(name).baseline), others[0] if others else None)
    return (first, second) if second else (first,)


def _joined(words: Sequence[str]) -> str:
    """Words as a list; with semicolons where one of them has a comma."""
    comma = "; " if any("," in word for word in words) else ", "
    return " and ".join([comma.join(words[:-1]), words[-1]] if len(words) > 1 else words)
