"""The measurement of costs: its arithmetic on times made up, its keys, and one real trial.

The real measurement is that of docs/performance.md, in left_by_pages.py.
"""

import json
from dataclasses import replace
from types import SimpleNamespace

import pytest

from explore_bench.cli import main
from explore_bench.errors import RequestError
from explore_bench.runs import perf
from explore_bench.runs.perf import Part, measure, read_json, text, write_json
from explore_bench.runs.perf_against import comparison
from explore_bench.runs.perf_by_lidar import ScenePart, SceneTimes
from explore_bench.runs.stopwatch import DECISION
from explore_bench.strategies.entry import Entry
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.scenarios import PAPER

NEAREST = Entry("baselines.nearest:Nearest", "Nearest")
WHOLE_TRIALS = perf._whole_trials
PARTS = [ScenePart("match", 6.0, 0.6), ScenePart("loops", 4.0, 0.4), ScenePart("whole key pose", 10.0, 1.0)]


def made_up(size, trial, step_length, most=None):
    """Return times of steps by hand: iSAM2 takes 100 µs, the rest 200 µs, and at 1000 poses 500 µs."""
    count = 1200 if step_length != PAPER.step_length else 60
    return [{"isam2": 1e-4, "world": 2e-4 + (3e-4 if i > 500 else 0.0), "row": 0.0} for i in range(count)]


@pytest.fixture
def cheap(monkeypatch):
    """Two sizes of made-up times, the decisions of one strategy, and two scenes."""
    monkeypatch.setattr(perf, "_steps", made_up)
    monkeypatch.setattr(perf, "TRIALS", 2)
    monkeypatch.setattr(perf, "_whole_trials", lambda name, entry, size: (size / 10, size / 100))
    monkeypatch.setattr(perf, "measure_scene", lambda scene: SceneTimes(scene, 200, 90.0, PARTS))
    untrained = Entry("nowhere:learned", "Learned", trainer="nowhere:train")
    monkeypatch.setattr(perf, "strategies", lambda: {"nearest": NEAREST, "learned": untrained})


def test_ratios_and_growth_worked_by_hand(cheap):
    """300 µs to iSAM2's 100, and 600 µs at 1000 poses to 300 at 100."""
    numbers = measure()
    assert numbers.step_to_isam2_ratio == pytest.approx({"20": 3.0, "40": 3.0})
    assert numbers.step_growth_1000_over_100 == pytest.approx({"20": 2.0, "40": 2.0})
    assert numbers.median_step_to_isam2_ratio["40"] == pytest.approx({"100": 3.0, "300": 3.0, "1000": 6.0})


def test_decisions_are_those_of_the_strategies_that_can_run(cheap):
    assert measure().decision_ms == {"nearest": {"20": 2.0, "40": 4.0}}


@pytest.mark.usefixtures("cheap")
def test_decisions_may_be_those_of_strategies_that_are_asked_for(untrained):
    found = measure(names=("baselines.random_walk:Random", "nearest")).trial_cpu_s
    assert list(found) == ["Random", "nearest"]
    untrained("gcn-obs")
    with pytest.raises(RequestError, match="strategy 'gcn-obs' is not trained"):
        measure(names=("gcn-obs",))


def test_parts_are_given_for_whole_trials_and_each_length_of_trajectory(cheap):
    parts = measure().parts
    assert {(part.size, part.length) for part in parts} == {
        (s, n) for s in (20.0, 40.0) for n in (None, 100, 300, 1000)
    }
    assert Part("world", 20.0, 1000, pytest.approx(500.0), pytest.approx(5.0)) in parts
    assert Part("isam2", 20.0, None, pytest.approx(100.0), pytest.approx(1.0)) in parts
    assert Part("whole step", 40.0, 100, pytest.approx(300.0), pytest.approx(3.0)) in parts


def test_the_ratio_is_the_median_over_trials_of_all_their_steps(cheap, monkeypatch):
    """(1 + 3) / 2, (5 + 5) / 2 and (9 + 3) / 2: 5, where the median step would give 4."""
    totals = [[1.0, 3.0], [5.0, 5.0], [9.0, 3.0]]

    def uneven(size, trial, step_length, most=None):
        if step_length != PAPER.step_length:
            return made_up(size, trial, step_length)
        return [{"isam2": 1.0, "world": total - 1.0} for total in totals[trial]]

    monkeypatch.setattr(perf, "TRIALS", 3)
    monkeypatch.setattr(perf, "_steps", uneven)
    assert measure().step_to_isam2_ratio["20"] == pytest.approx(5.0)


def test_the_json_has_the_keys_of_the_design(cheap, tmp_path):
    write_json(measure(), tmp_path / "perf.json")
    values = json.loads((tmp_path / "perf.json").read_text())
    assert {"step_to_isam2_ratio", "step_growth_1000_over_100", "decision_ms", "parts"} <= values.keys()
    assert values["step_to_isam2_ratio"].keys() == {"20", "40"}
    assert values["decision_ms"]["nearest"].keys() == {"20", "40"}
    assert {"name", "size", "median_us"} <= values["parts"][0].keys()
    assert all(part["median_us"] >= 0.0 for part in values["parts"])


def test_the_text_shows_both_numbers_that_are_goals_and_every_part(cheap):
    shown = text(measure())
    assert shown.count("whole step to iSAM2's update over whole trials: 3.00") == 2
    assert shown.count("whole step at 1000 poses to that at 100: 2.00") == 2
    for words in ("20 m", "40 m", "100 poses", "1000 poses", "isam2", "world", "nearest"):
        assert words in shown
    assert "learned" not in shown


def test_scenes_stand_after_the_rest_and_come_back_from_the_file(cheap, tmp_path):
    numbers = measure()
    write_json(numbers, tmp_path / "perf.json")
    assert read_json(tmp_path / "perf.json") == numbers
    shown = text(read_json(tmp_path / "perf.json")).splitlines()
    assert shown.index("lidar worlds: mean ms of each part per key pose (share)") > shown.index(
        next(line for line in shown if line.startswith("median decision"))
    )
    assert shown[-1].split() == ["times", "real", "time", "90", "90"]
    old = json.loads((tmp_path / "perf.json").read_text())
    del old["scenes"]
    (tmp_path / "old.json").write_text(json.dumps(old))
    assert "lidar" not in text(read_json(tmp_path / "old.json"))


def test_the_cpu_time_of_a_whole_trial_stands_by_strategy_and_size(cheap):
    numbers = measure()
    assert numbers.trial_cpu_s == {"nearest": {"20": 0.2, "40": 0.4}}
    shown = text(numbers).splitlines()
    title = next(i for i, line in enumerate(shown) if line.startswith("CPU s a whole trial"))
    assert shown[title].split()[-4:] == ["20", "m", "40", "m"]
    assert shown[title + 1].split() == ["nearest", "0.200", "0.400"]
    assert "CPU" not in text(replace(numbers, trial_cpu_s={})), "a file of before has none"


def test_cpu_time_is_that_of_the_process_and_counts_decisions(monkeypatch, tmp_path):
    """A strategy that works for 20 ms a decision costs that; one that sleeps as long does not."""
    monkeypatch.setattr(perf, "DECISION_TRIALS", 1)
    spent = {}
    for name, wait in (("works", "while time.process_time() < begin + 0.02: pass"), ("sleeps", "time.sleep(0.02)")):
        file = tmp_path / f"{name}.py"
        file.write_text(
            "import time\n"
            "class Slow:\n"
            "    def reset(self, rng): ...\n"
            "    def choose(self, observation):\n"
            "        begin = time.process_time()\n"
            f"        {wait}\n"
            "        return int(observation.path_lengths.argmin())\n"
        )
        spent[name] = perf._whole_trials(name, Entry(f"{file}:Slow", name), 20.0)[1]
    assert 0.0 < spent["sleeps"] < spent["works"]


def halved(numbers):
    """Return a measurement on a machine twice as fast: all times halved, all ratios the same."""

    def half(times):
        return {name: {key: value / 2 for key, value in by_size.items()} for name, by_size in times.items()}

    parts = [replace(part, median_us=part.median_us / 2) for part in numbers.parts]
    return replace(numbers, parts=parts, decision_ms=half(numbers.decision_ms), trial_cpu_s=half(numbers.trial_cpu_s))


def test_a_faster_machine_shows_in_no_line_of_a_comparison(cheap):
    numbers = measure()
    lines = comparison(numbers, halved(numbers)).splitlines()[1:]
    assert len(lines) == 2 * (4 * 2 + 2 + 2), "world and whole step at four lengths, two ratios, a decision, a trial"
    assert all(line.split()[-1] == "1.00" for line in lines)


def test_a_comparison_worked_by_hand(cheap):
    """A trial at 20 m takes 0.2 s, which is 2000 updates of 100 µs, and then 0.3 s."""
    then = measure()
    now = replace(then, trial_cpu_s={"nearest": {"20": 0.3, "40": 0.4}, "new": {"20": 1.0, "40": 1.0}})
    lines = {line[:40].strip(): line[40:].split() for line in comparison(then, now).splitlines()}
    assert lines["20 m: trial of nearest"] == ["2000.00", "3000.00", "1.50"]
    assert lines["40 m: trial of nearest"] == ["4000.00", "4000.00", "1.00"]
    assert lines["20 m: decision of nearest"] == ["20.00", "20.00", "1.00"]
    assert lines["20 m, 1000 poses: world"] == ["5.00", "5.00", "1.00"]
    assert lines["40 m: step at 1000 poses to 100"] == ["2.00", "2.00", "1.00"]
    assert not any("new" in name for name in lines), "there is nothing to compare it with"


@pytest.mark.parametrize(
    ("content", "reason"),
    [(None, "cannot be read"), ("{", "no measurement"), ("[1]", "no measurement"), ('{"parts": []}', "no measurement")],
)
def test_what_is_no_measurement_is_refused_before_anything_is_measured(monkeypatch, tmp_path, capsys, content, reason):
    monkeypatch.setattr(perf, "measure", lambda say: pytest.fail("it measured"))
    if content is not None:
        (tmp_path / "old.json").write_text(content)
    with pytest.raises(SystemExit) as ended:
        main(["perf", "--against", str(tmp_path / "old.json")])
    assert ended.value.code == 2
    assert reason in capsys.readouterr().err


def test_the_command_compares_with_what_was_stored(cheap, tmp_path, capsys):
    write_json(measure(), tmp_path / "perf.json")
    with pytest.raises(SystemExit) as ended:
        main(["perf", "--against", str(tmp_path / "perf.json")])
    assert ended.value.code == 0
    assert "20 m: all steps to all updates" in capsys.readouterr().out


def test_a_file_that_cannot_be_written_is_named(cheap, tmp_path):
    with pytest.raises(RequestError, match="nowhere"):
        write_json(measure(), tmp_path / "nowhere" / "perf.json")


def test_the_command_prints_and_writes_what_was_measured(cheap, tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["perf", "--json", str(tmp_path / "perf.json")])
    assert ended.value.code == 0
    captured = capsys.readouterr()
    assert "whole step" in captured.out
    assert "whole trials at 20 m" in captured.err
    assert json.loads((tmp_path / "perf.json").read_text())["step_growth_1000_over_100"]["20"] == pytest.approx(2.0)


def test_every_step_of_a_real_trial_is_timed_in_all_its_parts():
    steps = perf._steps(20.0, 0, PAPER.step_length)
    spec = TrialSpec("perf", "explore_bench.runs.stopwatch:FreeChoice", PAPER, 0, purpose="calibrate")
    assert len(steps) == len(run_trial(spec).steps) - 1
    names = {"isam2", "row", "world", "driver"}
    assert all(names <= step.keys() for step in steps)
    assert all(seconds >= 0.0 for step in steps for seconds in step.values())
    assert DECISION not in steps[0], "a strategy's time is not the harness's"


def test_a_long_trajectory_is_cut_off_where_no_length_needs_it():
    assert len(perf._steps(20.0, 0, perf.SHORT_STEPS[20.0], 20)) == 20
    assert perf.LENGTHS[-1] * (1 + perf.WINDOW / 2) <= perf.LONGEST


def test_the_time_of_a_decision_is_that_of_the_strategy(monkeypatch, tmp_path):
    monkeypatch.setattr(perf, "DECISION_TRIALS", 1)
    file = tmp_path / "slow.py"
    file.write_text(
        "import time\n"
        "class Slow:\n"
        "    def reset(self, rng): ...\n"
        "    def choose(self, observation):\n"
        "        time.sleep(0.01)\n"
        "        return int(observation.path_lengths.argmin())\n"
    )
    assert 10.0 <= perf._whole_trials("slow", Entry(f"{file}:Slow", "Slow"), 20.0)[0] < 30.0
    assert perf._whole_trials("nearest", NEAREST, 20.0)[0] < 5.0


def test_a_broken_plugin_has_no_time_and_does_not_end_the_measurement(cheap, monkeypatch, tmp_path):
    monkeypatch.setattr(perf, "DECISION_TRIALS", 1)
    broken = Entry("no_such_module_anywhere:Mine", "Mine", broken="it cannot be used")
    monkeypatch.setattr(perf, "_whole_trials", WHOLE_TRIALS)
    monkeypatch.setattr(perf, "strategies", lambda: {"mine": broken, "nearest": NEAREST})
    write_json(measure(), tmp_path / "perf.json")
    values = json.loads((tmp_path / "perf.json").read_text())["decision_ms"]
    assert values["mine"] == {"20": None, "40": None}
    assert values["nearest"]["20"] > 0.0


def test_a_learned_strategy_decides_with_the_weights_of_its_first_training_seed(monkeypatch):
    asked = []

    def remember(spec):
        asked.append(spec)
        return SimpleNamespace(decision_seconds=[0.002])

    monkeypatch.setattr(perf, "run_trial", remember)
    weights = {2: "two.safetensors", 5: "five.safetensors"}
    entry = Entry("a:b", "Learned", parameters={"layers": 1}, trainer="a:train", weights=weights)
    assert perf._whole_trials("learned", entry, 20.0)[0] == pytest.approx(2.0)
    assert len(asked) == 1 + perf.DECISION_TRIALS, "a tiny one first"
    assert {spec.purpose for spec in asked} == {"calibrate"}
    assert all(spec.arguments == {"layers": 1, "weights": "two.safetensors"} for spec in asked)
    asked.clear()
    perf._whole_trials("reference", Entry("a:b", "Reference", reference=True), 20.0)
    assert len(asked) == 2, "it plans for seconds and is no decision's time"
