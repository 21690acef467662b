"""Verdicts worked by hand and on real trials, rates of false and of missed alarms, the command and its codes."""

import dataclasses
import itertools
import json
import math
import re
import shlex
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from handmade import trial_rows, write_thresholds
from hypothesis import given, strategies as st

from explore_bench.analysis.csv_files import read_csv
from explore_bench.analysis.gate.judging import LEVEL, Verdict, decide, judge
from explore_bench.analysis.gate.thresholds import Threshold, load_thresholds
from explore_bench.cli import main
from explore_bench.report.pages.gate import gate_table

ROOT = Path(__file__).parents[3]
REFERENCE = ROOT / "results" / "reference"
FAMILY = load_thresholds(REFERENCE / "thresholds.toml")
NOISE = np.random.default_rng(0).normal(0.0, 0.1, 60)
NOISE -= NOISE.mean()

# Decisions on losses


@pytest.mark.parametrize(
    ("loss", "spread", "verdict"),
    [
        (0.00, 0.0, Verdict.PASS),
        (0.04, 0.0, Verdict.PASS),
        (0.06, 0.0, Verdict.REGRESSED),
        (-0.04, 0.0, Verdict.PASS),
        (-0.06, 0.0, Verdict.IMPROVED),
        (0.00, 1.0, Verdict.PASS),
        (0.04, 1.0, Verdict.INCONCLUSIVE),
        (0.06, 1.0, Verdict.INCONCLUSIVE),
        (0.10, 1.0, Verdict.REGRESSED),
        (-0.06, 1.0, Verdict.PASS),
        (-0.10, 1.0, Verdict.IMPROVED),
    ],
)
def test_a_verdict_asks_on_which_side_of_the_tolerance_the_bounds_are(loss, spread, verdict):
    (decision,) = decide([loss + spread * NOISE], [0.05])
    assert decision.verdict is verdict
    assert (decision.at_least > 0.05) == (verdict is Verdict.REGRESSED)
    assert (decision.at_most < 0.05) == (verdict in (Verdict.PASS, Verdict.IMPROVED))


def test_what_is_alone_a_regression_need_not_be_one_in_a_family():
    losses = 0.075 + NOISE
    assert decide([losses], [0.05])[0].verdict is Verdict.REGRESSED
    family = decide([losses, *[NOISE] * 5], [0.05] * 6)
    assert family[0].verdict is Verdict.INCONCLUSIVE
    assert family[0].p_holm == pytest.approx(min(6 * family[0].p, 1.0))
    assert family[0].at_least < 0.05, "the bound is corrected, too"


def test_what_is_alone_an_improvement_need_not_be_one_in_a_family():
    gains = -0.075 + NOISE
    assert decide([gains], [0.05])[0].verdict is Verdict.IMPROVED
    assert decide([gains, *[NOISE] * 5], [0.05] * 6)[0].verdict is Verdict.PASS


@pytest.mark.parametrize("count", [1, 6])
@pytest.mark.parametrize(("loss", "verdict"), [(0.029, Verdict.PASS), (0.031, Verdict.INCONCLUSIVE)])
def test_a_pass_is_uncorrected_however_large_the_family(loss, verdict, count):
    """The bound is 1.67 standard errors of 0.0117 above the loss, the tolerance 0.05; at half the level it is 2.0."""
    assert {own.verdict for own in decide([loss + NOISE] * count, [0.05] * count)} == {verdict}


def test_what_is_missing_has_no_verdict_but_still_counts_in_the_family():
    losses = 0.075 + NOISE
    found = decide([losses, *[np.empty(0)] * 5], [0.05] * 6)
    assert [decision.verdict for decision in found] == [Verdict.INCONCLUSIVE] + [Verdict.MISSING] * 5
    assert math.isnan(found[1].loss)


@given(st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=6))
def test_the_lower_bound_and_holm_s_p_value_agree_on_every_regression(means):
    for decision in decide([mean + NOISE for mean in means], [0.05] * len(means)):
        regressed = decision.verdict is Verdict.REGRESSED
        assert regressed == (decision.p_holm <= LEVEL)
        assert regressed == (decision.at_least > 0.05) or abs(decision.at_least - 0.05) < 1e-9


# False and missed alarms on the spread of real trials: a change that moves every robot on another path


def paths(trials):
    """Return e and η, shape (metrics, worlds), of every strategy and training seed at 20 m, references aside."""
    here = trials[(trials["size"] == 20.0) & (trials["strategy"] != "clairvoyant")]
    metrics = ["exploration_efficiency", "trajectory_error"]
    cells = here.sort_values("trial").groupby(["strategy", "training_seed"], dropna=False)
    return {name: own[metrics].to_numpy().T for name, own in cells}


def changes(kind):
    """Return pairs of paths whose means are made equal: what a change without a loss does to each world."""
    stored = paths(read_csv((REFERENCE if kind == "reference" else ROOT / "results") / "trials.csv", ["strategy"]))
    pairs = itertools.permutations(stored, 2)
    kept = [(a, b) for a, b in pairs if kind == "reference" or (a[0] == b[0]) == (kind == "training seeds")]
    return [(stored[a], stored[b] * (stored[a].mean(1) / stored[b].mean(1))[:, None]) for a, b in kept]


def simulate(kind, losses, share=1.0, count=300, n=250):
    """Return whether each member of the project's family is called regressed, shape (count, 5).

    Every strategy of the family changes as a pair of `kind` does, in a `share` of the worlds, and has these losses.
    """
    rng, known = np.random.default_rng(0), changes(kind)
    strategies = list(dict.fromkeys(one.strategy for one in FAMILY))
    found = []
    for _ in range(count):
        worlds, changed = rng.integers(0, known[0][0].shape[1], n), rng.random(n) < share
        drawn = {
            name: known[i] for name, i in zip(strategies, rng.integers(0, len(known), len(strategies)), strict=True)
        }
        of_family = []
        for one, loss in zip(FAMILY, losses, strict=True):
            before, after = (own[int(one.metric == "trajectory_error"), worlds] for own in drawn[one.strategy])
            now = np.where(changed, after, before) * (1.0 + one.sign * loss)
            of_family.append(one.sign * (now - before) / before.mean())
        decisions = decide(of_family, [one.tolerance for one in FAMILY])
        found.append([decision.verdict is Verdict.REGRESSED for decision in decisions])
    return np.array(found)


KINDS = ("training seeds", "strategies", "reference")


@pytest.mark.parametrize("kind", KINDS)
def test_without_a_change_of_the_means_at_most_5_in_100_gates_alarm(kind):
    none = [0.0] * len(FAMILY)
    assert simulate(kind, none).any(axis=1).mean() <= 0.05
    assert simulate(kind, none, share=0.1).any(axis=1).mean() <= 0.05


@pytest.mark.parametrize("kind", KINDS)
def test_even_losses_as_large_as_is_tolerated_rarely_alarm(kind):
    """The worst case of what the level promises; 0.03 is two and a half standard errors of the simulation."""
    assert simulate(kind, [one.tolerance for one in FAMILY]).any(axis=1).mean() <= 0.05 + 0.03


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("member", range(4))
def test_efficiency_that_is_10_percent_worse_is_caught_in_9_of_10_gates(kind, member):
    assert FAMILY[member].metric == "exploration_efficiency"
    assert simulate(kind, [0.1 * (i == member) for i in range(len(FAMILY))])[:, member].mean() >= 0.9


def test_the_project_s_gate_has_as_many_worlds_as_were_simulated_and_says_that_power():
    reference = read_csv(REFERENCE / "trials.csv", ["strategy"])
    gate = judge(FAMILY, reference, reference)
    for own in gate.judgements:
        assert len(own.pair.before) == 250
        assert own.power >= 0.9 or own.pair.threshold.metric != "exploration_efficiency"
        assert 0.0 < own.power < 1.0


def test_fifty_worlds_would_not_be_enough():
    assert simulate("training seeds", [0.1, *[0.0] * (len(FAMILY) - 1)], n=50)[:, 0].mean() < 0.9


def test_the_spread_behind_the_power_is_about_that_of_training_seeds_in_one_world():
    """Half of the pairs of training seeds spread less than the worlds do, and hardly one much more."""
    ratios = []
    for before, after in changes("training seeds"):
        own = (after - before) / before.mean(1, keepdims=True)
        ratios.append(own.std(1, ddof=1) * before.mean(1) / before.std(1, ddof=1))
    assert np.median(ratios) < 1.0
    assert np.quantile(ratios, 0.9) < 1.3


# Tables of trials


def threshold(**changes):
    return Threshold(
        **{"metric": "exploration_efficiency", "strategy": "Mine", "size": 20.0, "tolerance": 0.05, "reason": "test"}
        | changes
    )


@pytest.fixture(scope="module")
def real():
    """Trials of every strategy at 20 m that the repository tracks, all under one name where asked for."""
    trials = read_csv(ROOT / "results" / "trials.csv", ["strategy"])
    return lambda name: trials[(trials["strategy"] == name) & (trials["size"] == 20.0)].assign(strategy="Mine")


def test_a_real_change_for_the_worse_fails_and_the_way_back_is_an_improvement(real):
    family = [threshold(), threshold(metric="trajectory_error")]
    worse = judge(family, real("uncertainty"), real("random"))
    assert worse.verdict is Verdict.REGRESSED
    assert len(worse.of(Verdict.REGRESSED)) == 2
    assert judge(family, real("random"), real("uncertainty")).verdict is Verdict.IMPROVED


def test_identical_results_pass_and_the_power_is_not_that_of_no_spread(real):
    gate = judge([threshold()], real("nearest"), real("nearest"))
    assert gate.verdict is Verdict.PASS
    (own,) = gate.judgements
    assert own.decision.loss == 0.0
    assert 0.1 < own.power < 0.9, "50 worlds"
    values = own.values()
    assert values["reference"] == values["now"] == pytest.approx(own.pair.before.mean(), rel=1e-6)
    assert [values["power"], values["spread"]] == pytest.approx([own.power, own.pair.spread], rel=1e-6)
    assert values["missing"] == own.pair.missing
    assert None not in [values[name] for name in own.pair.threshold.model_dump(exclude_none=True)]
    assert set(values) >= {"n", "unexplored", "verdict"}


def test_a_trial_that_fails_where_it_had_explored_is_counted_and_scored(real):
    now = real("nearest")
    lost = now["trial"] < 25
    now = now.assign(
        status=np.where(lost, "failed", "explored"),
        exploration_efficiency=np.where(lost, 0.0, now["exploration_efficiency"]),
    )
    gate = judge([threshold()], real("nearest"), now)
    assert gate.judgements[0].pair.unexplored == (0, 25)
    assert gate_table(gate, Path("a"), Path("b")).rows[0][9] == "0 → 25"
    assert gate.verdict is Verdict.REGRESSED


@pytest.mark.parametrize("count", [1, 6])
def test_the_power_is_that_of_the_only_loss_among_as_many_pairs(count):
    """In families whose first member alone has become worse, by 10 %, it is called a regression as often as that."""
    rows = pd.concat([trial_rows(1.0 + 2 * NOISE, size=20.0 + i) for i in range(count)])
    gate = judge([threshold(size=20.0 + i) for i in range(count)], rows, rows)
    losses = np.random.default_rng(1).normal(0.0, 2 * NOISE.std(ddof=1), (400, count, len(NOISE)))
    losses[:, 0] += 0.1
    caught = np.mean([decide(own, [0.05] * count)[0].verdict is Verdict.REGRESSED for own in losses])
    assert [own.power for own in gate.judgements] == [pytest.approx(caught, abs=0.06)] * count


def test_a_gate_that_lacks_something_says_so_whatever_else_it_found(real):
    gate = judge(
        [threshold(), threshold(size=30.0)],
        pd.concat((real("uncertainty"), trial_rows([1.0, 2.0], size=30.0))),
        real("random"),
    )
    assert [own.decision.verdict for own in gate.judgements] == [Verdict.REGRESSED, Verdict.MISSING]
    assert gate.judgements[1].power > 0.0, "it is of what would be run"
    assert gate.verdict is Verdict.MISSING


@pytest.mark.parametrize(
    ("gains", "verdict"),
    [
        ((0.2, 0.0), Verdict.IMPROVED),
        ((0.2, -0.05), Verdict.INCONCLUSIVE),
        ((0.0, -0.05), Verdict.INCONCLUSIVE),
        ((-0.2, -0.05), Verdict.REGRESSED),
        ((-0.2, 0.2), Verdict.REGRESSED),
    ],
)
def test_what_fails_or_is_not_shown_outweighs_what_is_better(gains, verdict):
    before = pd.concat([trial_rows(1.0 + NOISE, size=size) for size in (20.0, 30.0)])
    now = pd.concat(
        [trial_rows(1.0 + own + NOISE[::-1], size=size) for own, size in zip(gains, (20.0, 30.0), strict=True)]
    )
    assert judge([threshold(), threshold(size=30.0)], before, now).verdict is verdict


def test_the_verdict_does_not_depend_on_the_order_of_rows(real):
    now = real("entropy")
    family = [threshold(), threshold(metric="trajectory_error")]
    assert judge(family, real("nearest"), now[::-1]).values() == judge(family, real("nearest"), now).values()


def test_the_table_says_what_to_do_about_every_verdict(real):
    reference = pd.concat((real("uncertainty"), trial_rows([1.0, 2.0], size=30.0)))
    family = [threshold(reason="it is all there is"), threshold(size=30.0)]
    table = gate_table(judge(family, reference, real("random")), Path("my results"), Path("ref"))
    assert table.title == "Gate: missing (1 of 2 pairs)"
    assert [row[-1] for row in table.rows] == ["regressed", "missing"]
    assert "- Mine, 30 m, paper: 2 of its 2 trials were not run" in table.note
    assert "`explore-bench run smoke -s Mine --size 30 --trials 2 --results 'my results'`" in table.note
    assert table.header[1] == "size [m], scenario"
    assert [row[1] for row in table.rows] == ["20, paper", "30, paper"]
    lidar = [threshold(scenario="stage")]
    absent = gate_table(judge(lidar, real("random").assign(scenario="stage"), real("random")), Path("a"), Path("b"))
    assert "`explore-bench run smoke -s Mine --size 20 --scenario stage --trials 50 --results a`" in absent.note
    assert [row[1] for row in absent.rows] == ["20, stage"]
    assert "- Mine, 20 m, paper, exploration_efficiency: it is all there is" in table.note
    assert "`explore-bench gate --results 'my results' --reference ref --accept --reason TEXT`" in table.note
    better = gate_table(judge([threshold()], real("random"), real("uncertainty")), Path("a"), Path("b"))
    assert "accept what is better" in better.note
    assert re.fullmatch(r"−\d+\.\d \[−\d+\.\d, −\d+\.\d\] %", better.rows[0][6])


@pytest.mark.parametrize(("loss", "verdict", "advised"), [(0.0, "pass", False), (0.05, "inconclusive", True)])
def test_more_worlds_are_advised_where_nothing_is_shown(loss, verdict, advised):
    table = gate_table(judge([threshold()], STEADY, trial_rows(1.0 - loss + NOISE[::-1])), Path("a"), Path("b"))
    assert table.rows[0][-1] == verdict
    assert ("More worlds tell" in table.note) == advised


def test_the_table_shows_corrected_p_values_and_no_more_power_than_there_is():
    rows = pd.concat((STEADY, trial_rows(1.0 + NOISE, size=30.0)))
    worse = rows.assign(exploration_efficiency=0.955 * rows["exploration_efficiency"])
    gate = judge([threshold(), threshold(size=30.0)], rows, worse)
    gate = dataclasses.replace(gate, judgements=tuple(dataclasses.replace(own, power=0.899) for own in gate.judgements))
    for row in gate_table(gate, Path("a"), Path("b")).rows:
        assert row[8] == "1.0000"
        assert row[10] == "89 %"


# The command


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """Return a function that writes a results folder and an accepted reference, and their place."""
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)

    def write(before, now):
        write_thresholds(tmp_path / "reference")
        for name, rows in (("before", before), ("now", now)):
            (tmp_path / name).mkdir()
            rows.to_csv(tmp_path / name / "trials.csv", index=False)
        call_quietly("gate", "--results", tmp_path / "before", "--accept", "--reason", "first", *of(tmp_path))
        return tmp_path

    return write


def of(folder):
    return "--reference", folder / "reference"


def call_quietly(*arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code


STEADY = trial_rows(1.0 + NOISE)


@pytest.mark.parametrize(
    ("now", "code", "verdict"),
    [
        (STEADY, 0, "pass"),
        (trial_rows(0.8 + NOISE), 0, "improved"),
        (trial_rows(1.05 + NOISE[::-1]), 0, "inconclusive"),
        (trial_rows(1.2 + NOISE), 1, "regressed"),
        (STEADY[:59], 3, "missing"),
        (trial_rows(1.0 + NOISE, strategy="Other"), 3, "missing"),
        (trial_rows(1.0 + NOISE, world="other"), 3, "missing"),
        (trial_rows(1.0 + NOISE, size=30.0), 3, "missing"),
    ],
)
def test_the_exit_code_says_what_the_verdict_does(folders, capsys, now, code, verdict):
    place = folders(STEADY, now)
    capsys.readouterr()
    assert call_quietly("gate", "--results", place / "now", *of(place)) == code
    assert capsys.readouterr().out.startswith(f"**Gate: {verdict} (1 of 1 pairs)**")


def test_json_and_summaries_say_what_is_printed(folders, capsys, monkeypatch):
    place = folders(STEADY, trial_rows(1.2 + NOISE))
    step = place / "step.md"
    step.write_text("# Job\n")
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", str(step))
    capsys.readouterr()
    written = "--json", place / "gate.json", "--summary", place / "gate.md"
    assert call_quietly("gate", "--results", place / "now", *of(place), *written) == 1
    printed = capsys.readouterr().out
    assert (place / "gate.md").read_text() == printed
    assert step.read_text() == "# Job\n" + printed
    values = json.loads((place / "gate.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert (values["verdict"], values["level"], values["stated_loss"]) == ("regressed", 0.05, 0.1)
    (row,) = values["pairs"]
    assert row["loss"] == pytest.approx(0.2)
    assert row["at_least"] > row["tolerance"] == 0.05
    assert (row["metric"], row["strategy"], row["n"], row["unexplored"]) == ("trajectory_error", "Mine", 60, [0, 0])


def test_what_is_accepted_passes_afterwards(folders):
    place = folders(STEADY, trial_rows(0.8 + NOISE))
    before = call_quietly("gate", "--results", place / "before", *of(place))
    assert call_quietly("gate", "--results", place / "now", *of(place), "--accept", "--reason", "faster") == 0
    assert call_quietly("gate", "--results", place / "now", *of(place)) == 0
    assert (before, call_quietly("gate", "--results", place / "before", *of(place))) == (0, 1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--accept"], "--accept and --reason TEXT go together"),
        (["--reason", "why"], "--accept and --reason TEXT go together"),
        (["--results", "nowhere"], r"nowhere/trials\.csv' cannot be read"),
        (["--reference", "nowhere"], r"nowhere/thresholds\.toml' cannot be read"),
        (["--json", "no/such/file.json"], r"no/such/file\.json' cannot be written"),
        (["--summary", "no/such/file.md"], r"no/such/file\.md' cannot be written"),
    ],
)
def test_a_wrong_request_is_one_line_and_code_2(folders, capsys, monkeypatch, arguments, words):
    place = folders(STEADY, STEADY)
    monkeypatch.chdir(place)
    capsys.readouterr()
    assert call_quietly("gate", "--results", "now", "--reference", "reference", *arguments) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(words, error)


def test_a_reference_of_another_protocol_version_is_refused_and_renewed(folders, capsys):
    place = folders(STEADY, STEADY)
    note = place / "reference" / "accepted.json"
    note.write_text(json.dumps({"schema": 0, "reason": "old"}))
    assert call_quietly("gate", "--results", place / "now", *of(place)) == 2
    assert "is a reference of protocol version 0, not 2" in capsys.readouterr().err
    assert call_quietly("gate", "--results", place / "now", *of(place), "--accept", "--reason", "new protocol") == 0
    assert call_quietly("gate", "--results", place / "now", *of(place)) == 0


@pytest.mark.slow
def test_the_project_s_own_gate(tmp_path, monkeypatch, capsys):
    """What `make gate` does, into a folder of the test's: some 1,000 trials and 50 with a lidar, two minutes."""
    monkeypatch.delenv("GITHUB_STEP_SUMMARY", raising=False)
    monkeypatch.chdir(ROOT)
    text = (ROOT / "Makefile").read_text().replace("\\\n", " ")
    recipe = re.findall(r"explore-bench ((?:run smoke|gate) [^;&]*results/gate[^;&]*?)(?=;| &&|\n)", text)[:4]
    called = [shlex.split(line.replace("results/gate", shlex.quote(str(tmp_path / "gate")))) for line in recipe]
    assert [line[0] for line in called] == ["run", "run", "gate", "gate"]
    for run in called[:2]:
        assert call_quietly(*run) == 0
    for gate, worlds in zip(called[2:], (250, 50), strict=True):
        capsys.readouterr()
        assert call_quietly(*gate) == 0
        table = capsys.readouterr().out
        assert "regressed" not in table.split("\n\n")[1]
        assert f" {worlds} | " in table
