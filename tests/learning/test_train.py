"""`explore-bench train`: what it writes, that it goes on where it stopped, and what it says of whatever goes wrong.

That it learns is asked of the training of docs/learning.md, in left_by_pages.py.
"""

import dataclasses
import errno
import json
import math
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from safetensors.torch import load_file

from baselines import STRATEGIES
from baselines.learned import checkpoint
from baselines.learned.checkpoint import describe, load_state, load_weights
from baselines.training import train as training
from baselines.training.episodes import play
from baselines.training.learner import DivergedError
from baselines.training.returns import ReturnsLearner
from explore_bench.cli import main
from explore_bench.errors import RequestError
from explore_bench.records.provenance import scenario_digest
from explore_bench.strategies.loading import make_strategy
from explore_bench.trial import seeding
from explore_bench.trial.decision_process import Course
from explore_bench.world.scenarios import PAPER, load_scenario

torch.set_num_threads(1)

SMALL = PAPER.replace(size=10.0, landmark_count=1, obstacle_count=2)
LEARNED = [name for name, entry in STRATEGIES.items() if entry.trainer]
QUICK = {
    "baselines.learned.graph_stnn": {"episodes_per_update": 2},
    "baselines.learned.belief_attention": {"episodes_per_update": 2},
    "baselines.learned.gcn": {"episodes_at_once": 2, "warm_up": 2, "batch": 4, "decisions_per_update": 2},
}
each_learner = pytest.mark.parametrize("name", ["graph-stnn", "gcn-obs", "belief-attention"])


@pytest.fixture(autouse=True)
def _short(monkeypatch):
    """Small maps, two episodes a gradient step, validations every four, eight episodes in all."""
    recipes = {
        module: dataclasses.replace(recipe, settings=dataclasses.replace(recipe.settings, **QUICK[module]), episodes=8)
        for module, recipe in training.RECIPES.items()
    }
    recipes |= {
        module: dataclasses.replace(recipe, scales=(1.0, 1.2))
        for module, recipe in recipes.items()
        if recipe.scales[1:]
    }
    values = {"PAPER": SMALL, "RECIPES": recipes, "VALIDATION_WORLDS": 3, "VALIDATE_EVERY": 4, "CURVE_WINDOW": 40}
    for name, value in values.items():
        monkeypatch.setattr(training, name, value)


@pytest.fixture
def call(capsys, tmp_path):
    """Return a function that trains into tmp_path and returns the exit code, the output and the complaints."""

    def run(*arguments, out=tmp_path):
        with pytest.raises(SystemExit) as ended:
            main(["train", *map(str, arguments), "--out", str(out)])
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return run


@pytest.fixture
def refused(call):
    """Return a function that trains in vain and returns the one line that says why."""

    def run(*arguments, **options):
        code, out, err = call(*arguments, **options)
        assert code == 2, out + err
        assert err.count("\n") == 1, err
        assert err.startswith("explore-bench: ")
        return err.strip()

    return run


def train(folder, name="graph-stnn", seed=0, episodes=8, resume=False):
    """Train without the command line and return the lines said."""
    said = []
    training.train(name, STRATEGIES[name], seed, episodes, resume, folder, said.append)
    return said


def network_of(name):
    module = STRATEGIES[name].factory.split(":")[0]
    return training.RECIPES[module].network(**STRATEGIES[name].parameters)


def same(one, other):
    assert one.keys() == other.keys()
    return all(torch.equal(one[name], other[name]) for name in one)


def everything(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def log_of(folder, name="graph-stnn", seed=0):
    """Return the log of a checkpoint without what the clock says."""
    log = load_state(folder / f"{name}-{seed}.last")[1]["log"]
    return {key: value for key, value in log.items() if key != "seconds"}


def stop_after(monkeypatch, episodes, error):
    """Make the learner raise once it is asked to play beyond so many episodes."""
    improve = ReturnsLearner.improve

    def stopping(self, numbers):
        if numbers[0] >= episodes:
            raise error
        return improve(self, numbers)

    monkeypatch.setattr(ReturnsLearner, "improve", stopping)


# What is written


@each_learner
def test_a_training_writes_weights_card_curve_and_checkpoint(call, tmp_path, name):
    code, out, err = call(name, "--seed", 7)
    assert (code, err) == (0, "")
    assert out.splitlines()[-1] == f"best weights: {tmp_path / f'{name}-7.safetensors'}"
    assert "validation after 8 episodes" in out
    files = {f"{name}-7{ending}" for ending in (".safetensors", ".json", ".curve.csv", ".validations.csv", ".last")}
    assert {path.name for path in tmp_path.iterdir()} == files
    assert log_of(tmp_path, name, 7)["episodes"] == 8


def test_the_card_says_what_the_weights_are_and_how_they_were_made(tmp_path):
    train(tmp_path, seed=7)
    card = json.loads((tmp_path / "graph-stnn-7.json").read_text())
    log = log_of(tmp_path, seed=7)
    assert card.items() >= describe(network_of("graph-stnn")).items()
    assert (card["strategy"], card["training_seed"]) == ("graph-stnn", 7)
    assert card["episodes"] in (4, 8)
    assert card["command"] == f"explore-bench train graph-stnn --seed 7 --episodes {card['episodes']}"
    assert 0 < card["decisions"] <= card["steps"] <= log["steps"]
    assert card["wall_seconds"] > 0
    assert card["settings"]["episodes_per_update"] == 2
    assert card["reward_weights"].keys() == {"uncertainty", "turning", "length", "error", "steps", "explored"}
    assert card["scales"] == [1.0]
    assert card["resumed"] == []
    assert card["scenario"] == {"kind": "landmark", "size": 10.0, "landmark_count": 1, "obstacle_count": 2}
    assert card["scenario_digest"] == scenario_digest(SMALL)
    assert card["versions"].keys() == {"gtsam", "numpy", "torch"}
    assert card["versions"]["torch"] == torch.__version__
    best = min(reversed(log["validations"]), key=lambda row: row[1])  # the latest of equals
    assert [card["episodes"], *list(card["validation"].values())[1:]] == best


@each_learner
def test_the_weights_make_a_strategy_that_validates_as_the_card_says(tmp_path, name):
    """Three validation worlds, one after another, with what the registry would load."""
    train(tmp_path, name)
    entry, path = STRATEGIES[name], tmp_path / f"{name}-0.safetensors"
    strategy = make_strategy(entry.factory, {**entry.parameters, "weights": str(path)})
    scores = []
    for number in range(3):
        strategy.reset(np.random.default_rng(0))
        course = Course(SMALL, "validate", 0, scales=training.RECIPES[entry.factory.split(":")[0]].scales)
        (episode,) = play(course, [number], lambda _, seen: [strategy.choose(seen[0])])
        scores.append(episode.score(course.scenario_of(number)))
    time, efficiency, error = np.array(scores).T
    assert checkpoint.read_card(path)["validation"] == {
        "worlds": 3,
        "objective": pytest.approx((np.log(error) - np.log(efficiency)).mean()),
        "time": pytest.approx(time.mean()),
        "exploration_efficiency": pytest.approx(efficiency.mean()),
        "trajectory_error": pytest.approx(error.mean()),
    }


@each_learner
def test_the_curve_has_a_row_for_every_window(tmp_path, name):
    train(tmp_path, name)
    curve, log = pd.read_csv(tmp_path / f"{name}-0.curve.csv"), log_of(tmp_path, name)
    assert list(curve.columns) == list(training.CURVE_COLUMNS)
    assert len(curve) >= 2
    assert (np.diff([0, *curve["steps"]]) >= 40).all()
    assert curve["steps"].iloc[-1] <= log["steps"] < curve["steps"].iloc[-1] + 40
    assert (np.diff(curve["episodes"]) > 0).all()
    assert np.isfinite(curve.drop(columns="loss")).all(axis=None)


def test_a_row_of_the_curve_by_hand():
    """Two episodes of one window: reward a decision, the others a mean over the episodes."""

    def episode(steps, rewards, *score):
        return SimpleNamespace(number=0, steps=steps, rewards=rewards, score=lambda _: score)

    log, course = training.Log(), Course(SMALL, "train", 0)
    log.add([episode(30, [1.0, 2.0, 3.0], 30.0, 1.0, 0.5)], 0.25, course)
    assert log.curve == []
    log.add([episode(20, [4.0], 20.0, 2.0, 0.7)], 0.75, course)
    ((steps, episodes, _, *means),) = log.curve
    assert (steps, episodes) == (50, 2)
    np.testing.assert_allclose(means, [2.5, 25.0, 1.5, 0.6, 0.5])
    assert log.pending == [0.0] * 9
    assert (log.episodes, log.decisions, log.steps) == (2, 4, 50)


def test_a_row_of_the_curve_is_of_maps_of_the_own_size_alone():
    """Its steps are all, its means those of the first and the third episode."""

    def episode(number, steps, *score):
        return SimpleNamespace(number=number, steps=steps, rewards=[1.0] * (number + 1), score=lambda _: score)

    log, course = training.Log(), Course(SMALL, "train", 0, scales=(1.0, 1.2))
    log.add([episode(0, 10, 10.0, 1.0, 0.5), episode(1, 50, 50.0, 9.0, 9.0)], 0.5, course)
    log.add([episode(2, 40, 20.0, 2.0, 0.7)], 0.5, course)
    first, second = log.curve
    np.testing.assert_allclose(first[:7], [60, 2, 3, 1.0, 10.0, 1.0, 0.5])
    np.testing.assert_allclose(second[:7], [100, 3, 6, 1.0, 20.0, 2.0, 0.7])


def test_the_best_weights_of_all_validations_are_kept(tmp_path, monkeypatch):
    """The second of three is the best."""
    seen, scores = [], iter([(10.0, 1.0, 1.0), (10.0, 1.0, 0.5), (10.0, 1.0, 0.8)])

    def greedy(network, course, count):
        score = next(scores)
        seen.append({name: tensor.clone() for name, tensor in network.state_dict().items()})
        return [SimpleNamespace(number=0, score=lambda _: score)] * count

    monkeypatch.setattr(training, "greedy", greedy)
    said = train(tmp_path, episodes=12)
    assert len(seen) == 3
    assert same(load_file(tmp_path / "graph-stnn-0.safetensors"), seen[1])
    assert not same(seen[1], seen[2])
    card = checkpoint.read_card(tmp_path / "graph-stnn-0.safetensors")
    assert card["episodes"] == 8
    assert card["validation"]["objective"] == pytest.approx(math.log(0.5))
    assert ["(best)" in line for line in said if "validation" in line] == [True, True, False]


def test_a_training_is_reproducible(tmp_path):
    for folder, seed in (("one", 1), ("again", 1), ("other", 2)):
        torch.manual_seed(len(folder))
        train(tmp_path / folder, seed=seed, episodes=4)
    one, again = (load_file(tmp_path / folder / "graph-stnn-1.safetensors") for folder in ("one", "again"))
    assert same(one, again)
    assert not same(one, load_file(tmp_path / "other" / "graph-stnn-2.safetensors"))


@each_learner
def test_progress_is_said_now_and_then(tmp_path, monkeypatch, name):
    """Means over the episodes of the row of the curve that is not full yet, here all of them."""
    monkeypatch.setattr(training, "SAY_SECONDS", 0.0)
    monkeypatch.setattr(training, "CURVE_WINDOW", 10**6)
    said = train(tmp_path, name)
    lines = [line for line in said if "min left" in line]
    assert [f"episode {count}," in line for count, line in zip((2, 4, 6, 8), lines, strict=True)] == [True] * 4
    exploration = {"graph-stnn": "noise σ", "gcn-obs": "dropout", "belief-attention": "entropy"}[name]
    assert all(exploration in line and "steps/s" in line for line in lines)
    _, count, decisions, reward, time, efficiency, error, *_ = log_of(tmp_path, name)["pending"]
    means = f"reward {reward / decisions:.3f}, T {time / count:.0f}, η {efficiency / count:.3f}, e {error / count:.3f}"
    assert f"{name} seed 0: episode 8, {means}, " in lines[-1]


@pytest.mark.parametrize("name", LEARNED)
def test_every_learned_strategy_can_be_trained(tmp_path, name):
    """Its network is that of its factory and has its switches; validation is on the paper's maps for all."""
    run = training.Training(name, STRATEGIES[name], 3, tmp_path)
    wanted = dict(STRATEGIES[name].parameters)
    assert ("path_length" in run.network.columns) == (wanted.pop("distance", "straight") == "path")
    assert ("cell_shannon" in run.network.columns) == (wanted.pop("entropy", "view") == "cell")
    assert run.network.switches.items() >= wanted.items()
    scales = (1.0, 1.2) if name == "belief-attention" else (1.0,)
    assert run.course == Course(SMALL.replace(**STRATEGIES[name].training), "train", 3, scales=scales)
    assert run.validation == Course(SMALL, "validate", 0, scales=scales)
    assert list(tmp_path.iterdir()) == []


# Other worlds, and weights to start from


@pytest.fixture
def lidar(tmp_path):
    """Return the file of a scenario of lidar worlds whose episodes take a tenth of a second."""
    file = tmp_path / "lidar.toml"
    file.write_text('extends = "stage"\nsize = 8.0\nsensor_range = 4.0\n')
    return file


def test_a_training_in_lidar_worlds_is_of_them_alone_and_goes_on(call, tmp_path, lidar):
    for folder, counts in (("through", (8,)), ("stopped", (4, 8))):
        for count in counts:
            options = ("--scenario", lidar, "--episodes", count, "--resume")
            code, out, err = call("graph-stnn", *options, out=tmp_path / folder)
            assert (code, err) == (0, ""), out
    one, other = (load_state(tmp_path / folder / "graph-stnn-0.last")[0] for folder in ("through", "stopped"))
    assert same(one, other)
    assert log_of(tmp_path / "through") | {"resumed": [4]} == log_of(tmp_path / "stopped")
    card = checkpoint.read_card(tmp_path / "through" / "graph-stnn-0.safetensors")
    assert card["scenario"] == {"kind": "lidar", "size": 8.0, "sensor_range": 4.0}
    assert card["scenario_digest"] == scenario_digest(load_scenario(str(lidar)))
    assert card["command"].endswith(f" --scenario {lidar}")


def test_a_training_goes_on_in_the_worlds_in_which_it_began(refused, tmp_path, lidar):
    train(tmp_path, episodes=4)
    assert "is of another network or other settings" in refused("graph-stnn", "--resume", "--scenario", lidar)


def test_in_a_given_map_all_worlds_have_its_size(tmp_path):
    file = tmp_path / "mapped.toml"
    file.write_text('map = ["#####", "#...#", "#...#", "#####"]\n')
    run = training.Training("belief-attention", STRATEGIES["belief-attention"], 0, tmp_path, str(file))
    assert run.course.scales == run.validation.scales == (1.0,)
    assert run.course.scenario_of(1).map


def test_what_a_strategy_changes_must_be_a_constant_of_the_scenario(refused, lidar):
    line = refused("gcn-no-obs", "--scenario", lidar)
    assert f"strategy 'gcn-no-obs' cannot be trained in the scenario '{lidar}': scenario key 'obstacle_count'" in line


def test_weights_to_start_from_are_kept_where_nothing_that_follows_is_better(tmp_path, monkeypatch):
    train(tmp_path / "before", seed=5)
    begin = tmp_path / "before" / "graph-stnn-5.safetensors"
    seen, scores = [], iter([(10.0, 1.0, 0.5), (10.0, 1.0, 0.8), (10.0, 1.0, 0.7)])

    def greedy(network, course, count):
        score = next(scores)
        seen.append({name: tensor.clone() for name, tensor in network.state_dict().items()})
        return [SimpleNamespace(number=0, score=lambda _: score)] * count

    monkeypatch.setattr(training, "greedy", greedy)
    name = "graph-stnn"
    monkeypatch.chdir(begin.parent)
    training.train(name, STRATEGIES[name], 0, 8, False, tmp_path / "after", lambda _: None, start=begin)
    assert same(seen[0], load_file(begin))
    assert not same(seen[1], seen[0]), "it learns"
    assert [row[0] for row in log_of(tmp_path / "after")["validations"]] == [0, 4, 8]
    assert same(load_file(tmp_path / "after" / "graph-stnn-0.safetensors"), seen[0])
    card = checkpoint.read_card(tmp_path / "after" / "graph-stnn-0.safetensors")
    assert card["start"] == {"weights": begin.name, "sha256": checkpoint.read_card(begin)["sha256"]}
    assert card["episodes"] == 0
    assert card["command"] == f"explore-bench train graph-stnn --seed 0 --episodes 1 --from {begin.name}"


def test_a_training_goes_on_from_the_weights_from_which_it_began(call, refused, tmp_path):
    for seed in (5, 6):
        train(tmp_path / "before", seed=seed, episodes=4)
    one, other = (tmp_path / "before" / f"graph-stnn-{seed}.safetensors" for seed in (5, 6))
    assert call("graph-stnn", "--episodes", 4, "--from", one)[0] == 0
    assert "is of another network or other settings" in refused("graph-stnn", "--resume", "--from", other)
    assert "is of another network or other settings" in refused("graph-stnn", "--resume")
    assert call("graph-stnn", "--episodes", 8, "--from", one, "--resume")[0] == 0
    assert [row[0] for row in log_of(tmp_path)["validations"]] == [0, 4, 8], "not validated twice"


def test_weights_that_are_none_or_of_another_network_are_refused(refused, tmp_path):
    assert "there are no weights 'nowhere.safetensors'" in refused("graph-stnn", "--from", "nowhere.safetensors")
    assert "were made for network 'GCN'" in refused("graph-stnn", "--from", "baselines:weights/gcn-obs-0.safetensors")
    assert list(tmp_path.iterdir()) == []


# Streams


@each_learner
def test_training_asks_for_the_streams_of_training_and_validation_alone(tmp_path, monkeypatch, name):
    """Wherever `stream` was imported to; validation worlds are the same for all training seeds."""
    asked, stream = [], seeding.stream

    def spy(purpose, root, size, trial, role):
        asked.append((purpose, root, size, trial, role))
        return stream(purpose, root, size, trial, role)

    for module in [m for key, m in sys.modules.items() if key.startswith(("baselines", "explore_bench"))]:
        for attribute in [key for key, value in vars(module).items() if value is stream]:
            monkeypatch.setattr(module, attribute, spy)
    train(tmp_path, name, seed=7, episodes=4)
    assert {(purpose, root) for purpose, root, *_ in asked} == {("train", 7), ("validate", 0)}
    assert {trial for purpose, _, _, trial, _ in asked if purpose == "train"} == set(range(4))
    assert {trial for purpose, _, _, trial, _ in asked if purpose == "validate"} == set(range(3))
    assert {role for purpose, *_, role in asked if purpose == "validate"} == {"world", "motion", "sensor"}


def test_validation_leaves_no_trace_in_learning(tmp_path, monkeypatch):
    train(tmp_path / "with")
    monkeypatch.setattr(training, "VALIDATE_EVERY", 1000)
    train(tmp_path / "without")
    one, other = (load_state(tmp_path / folder / "graph-stnn-0.last")[0] for folder in ("with", "without"))
    assert same(one, other)


# Going on


@pytest.mark.parametrize("name", ["graph-stnn", "belief-attention"])
def test_a_resumed_training_ends_with_the_same_weights(call, tmp_path, name):
    train(tmp_path / "through", name, episodes=12)
    train(tmp_path / "stopped", name, episodes=4)
    code, out, _ = call(name, "--episodes", 12, "--resume", out=tmp_path / "stopped")
    assert code == 0
    assert out.startswith(f"{name}, seed 0: going on after 4 episodes\n")
    one, other = (load_state(tmp_path / folder / f"{name}-0.last")[0] for folder in ("through", "stopped"))
    assert same(one, other)
    assert log_of(tmp_path / "through", name) | {"resumed": [4]} == log_of(tmp_path / "stopped", name)
    card = checkpoint.read_card(tmp_path / "stopped" / f"{name}-0.safetensors")
    assert card["resumed"] == ([4] if card["episodes"] > 4 else [])
    one, other = (load_file(tmp_path / folder / f"{name}-0.safetensors") for folder in ("through", "stopped"))
    assert same(one, other)
    one, other = ((tmp_path / folder / f"{name}-0.curve.csv").read_text() for folder in ("through", "stopped"))
    assert one == other


def test_an_interrupted_training_goes_on_from_its_last_checkpoint(call, tmp_path, monkeypatch):
    """Ctrl-C in the seventh episode; the checkpoint is that of the validation after the fourth."""
    train(tmp_path / "through")
    with monkeypatch.context() as patch:
        stop_after(patch, 6, KeyboardInterrupt())
        code, _, err = call("graph-stnn", out=tmp_path / "stopped")
        assert code == 130
        assert err.strip().startswith("explore-bench: interrupted")
        assert err.strip().count("\n") == 0
    assert log_of(tmp_path / "stopped")["episodes"] == 4
    assert call("graph-stnn", "--resume", out=tmp_path / "stopped")[0] == 0
    one, other = (load_state(tmp_path / folder / "graph-stnn-0.last")[0] for folder in ("through", "stopped"))
    assert same(one, other)
    assert log_of(tmp_path / "through") | {"resumed": [4]} == log_of(tmp_path / "stopped")


class Killed(BaseException):
    """What no code catches, as a signal that cannot be caught."""


def killed_at(monkeypatch, write):
    """Make the training die as a file of this number is about to take its place; returns the names of all that did."""
    replace, done = Path.replace, []

    def dying(self, target):
        if len(done) == write:
            raise Killed
        done.append(Path(target).name)
        return replace(self, target)

    monkeypatch.setattr(Path, "replace", dying)
    return done


def test_a_training_killed_at_any_write_goes_on_to_the_same_end(tmp_path, monkeypatch):
    def end_of(folder):
        card = checkpoint.read_card(folder / "graph-stnn-0.safetensors")
        files = {path.name: path.read_bytes() for path in folder.glob("*.csv")}
        return files, {key: value for key, value in card.items() if key not in ("wall_seconds", "resumed")}

    with monkeypatch.context() as patch:
        written = killed_at(patch, -1)
        train(tmp_path / "through")
    assert len(written) > 10
    assert {Path(name).suffix for name in written} == {".last", ".safetensors", ".json", ".csv"}
    for write in range(len(written)):
        folder = tmp_path / str(write)
        with monkeypatch.context() as patch:
            killed_at(patch, write)
            with pytest.raises(Killed):
                train(folder)
        train(folder, resume=True)
        load_weights(network_of("graph-stnn"), folder / "graph-stnn-0.safetensors")
        assert end_of(folder) == end_of(tmp_path / "through"), f"killed before '{written[write]}', number {write}"


def test_checkpoints_come_by_the_clock_too(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "SAVE_SECONDS", 0.0)
    stop_after(monkeypatch, 6, KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        train(tmp_path)
    assert log_of(tmp_path)["episodes"] == 6


def test_the_replay_learner_goes_on_too(tmp_path):
    train(tmp_path, "gcn-obs", episodes=4)
    counters = load_state(tmp_path / "gcn-obs-0.last")[1]["counters"]
    train(tmp_path, "gcn-obs", episodes=12, resume=True)
    after = load_state(tmp_path / "gcn-obs-0.last")[1]["counters"]
    assert log_of(tmp_path, "gcn-obs")["episodes"] == 12
    assert after["decisions"] == log_of(tmp_path, "gcn-obs")["decisions"] > counters["decisions"]
    assert after["updates"] > counters["updates"]


def test_the_time_of_a_resumed_training_adds_up(tmp_path):
    train(tmp_path, episodes=4)
    before = load_state(tmp_path / "graph-stnn-0.last")[1]["log"]["seconds"]
    train(tmp_path, episodes=8, resume=True)
    assert load_state(tmp_path / "graph-stnn-0.last")[1]["log"]["seconds"] > before > 0


def test_resuming_what_has_not_begun_begins(tmp_path):
    said = train(tmp_path, episodes=4, resume=True)
    assert not any("going on" in line for line in said)
    assert log_of(tmp_path)["episodes"] == 4


def test_a_training_that_stops_before_its_last_validation_makes_up_for_it(tmp_path, monkeypatch):
    """Taken no farther than it has come, it still says what it has come to."""
    with monkeypatch.context() as patch:
        patch.setattr(training, "SAVE_SECONDS", 0.0)
        stop_after(patch, 6, KeyboardInterrupt())
        with pytest.raises(KeyboardInterrupt):
            train(tmp_path)
    come = log_of(tmp_path)["episodes"]
    assert log_of(tmp_path)["validations"][-1][0] < come
    assert "validation after" in train(tmp_path, episodes=come, resume=True)[-1]
    assert log_of(tmp_path)["validations"][-1][0] == come


def test_resuming_what_is_done_changes_nothing(tmp_path):
    train(tmp_path, episodes=4)
    before = everything(tmp_path)
    assert train(tmp_path, episodes=4, resume=True) == ["graph-stnn, seed 0: going on after 4 episodes"]
    after = everything(tmp_path)
    assert before == after


# Refusals


def test_a_training_is_not_overwritten(refused, tmp_path):
    train(tmp_path, episodes=4)
    before = everything(tmp_path)
    line = refused("graph-stnn")
    assert f"'{tmp_path / 'graph-stnn-0.last'}' holds a training already; add --resume" in line
    assert everything(tmp_path) == before


@pytest.mark.parametrize("resume", [(), ("--resume",)])
def test_weights_without_a_checkpoint_are_not_overwritten(refused, tmp_path, resume):
    """As where --out is the folder of the shipped weights, or the checkpoint was lost."""
    train(tmp_path, episodes=4)
    (tmp_path / "graph-stnn-0.last").unlink()
    before = everything(tmp_path)
    line = refused("graph-stnn", *resume)
    assert f"'{tmp_path / 'graph-stnn-0.safetensors'}' holds weights but no checkpoint lies beside it" in line
    assert everything(tmp_path) == before


def test_a_checkpoint_without_its_best_weights_is_refused(refused, tmp_path):
    """Else the best of later validations might be none, and weights named that do not exist."""
    train(tmp_path, episodes=4)
    (tmp_path / "graph-stnn-0.safetensors").unlink()
    line = refused("graph-stnn", "--resume")
    assert f"the best weights '{tmp_path / 'graph-stnn-0.safetensors'}', which are missing" in line


def truncated(path):
    path.write_bytes(path.read_bytes()[:-100])


def emptied(path):
    path.write_bytes(b"")


def scrawled(path):
    path.write_bytes(b"this is no checkpoint" * 10)


@pytest.mark.parametrize("damage", [truncated, emptied, scrawled])
def test_a_damaged_checkpoint(refused, tmp_path, damage):
    train(tmp_path, episodes=4)
    damage(tmp_path / "graph-stnn-0.last")
    line = refused("graph-stnn", "--resume")
    assert f"'{tmp_path / 'graph-stnn-0.last'}' cannot be read" in line


def test_weights_are_no_checkpoint(refused, tmp_path):
    train(tmp_path, episodes=4)
    shutil.copy(tmp_path / "graph-stnn-0.safetensors", tmp_path / "graph-stnn-0.last")
    assert "is no checkpoint of a training" in refused("graph-stnn", "--resume")


def test_the_checkpoint_of_another_network(refused, tmp_path):
    train(tmp_path, episodes=4)
    shutil.copy(tmp_path / "graph-stnn-0.last", tmp_path / "no-state-0.last")
    assert "is of another network or other settings; train without --resume" in refused("no-state", "--resume")


def test_a_checkpoint_of_other_settings(refused, tmp_path, monkeypatch):
    train(tmp_path, episodes=4)
    module = "baselines.learned.graph_stnn"
    recipe = training.RECIPES[module]
    for changed in (
        {"settings": dataclasses.replace(recipe.settings, discount=0.5)},
        {"reward": dataclasses.replace(recipe.reward, uncertainty=2.0)},
        {"scales": (1.0, 1.5)},
    ):
        monkeypatch.setitem(training.RECIPES, module, dataclasses.replace(recipe, **changed))
        assert "is of another network or other settings" in refused("graph-stnn", "--resume")


def test_a_checkpoint_of_other_physics(refused, tmp_path, monkeypatch):
    train(tmp_path, episodes=4)
    monkeypatch.setattr(training, "PAPER", SMALL.replace(obstacle_count=1))
    assert "is of another network or other settings" in refused("graph-stnn", "--resume")


def test_an_unknown_strategy(refused, tmp_path):
    assert "strategy 'graph-stn' is unknown; did you mean 'graph-stnn'?" in refused("graph-stn")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["nearest", "clairvoyant"])
def test_a_strategy_that_is_not_learned(refused, tmp_path, name):
    assert f"strategy '{name}' is not learned" in refused(name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("options", [("--seed", "-1"), ("--episodes", "0"), ("--seed", "one"), ("--episodes", "1.5")])
def test_numbers_out_of_range(refused, tmp_path, options):
    assert options[0] in refused("graph-stnn", *options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("written", ["foo=1", "layers=0", "spatial=false,head='text'"])
def test_parameters_that_the_network_does_not_take(refused, tmp_path, written):
    assert "' cannot be made (" in refused(f"graph-stnn[{written}]")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be(refused, tmp_path):
    (tmp_path / "file").write_text("")
    line = refused("graph-stnn", out=tmp_path / "file")
    assert "graph-stnn-0.last' cannot be written" in line
    line = refused("graph-stnn", out=tmp_path / "file" / "below")
    assert "graph-stnn-0.last' cannot be written" in line


@pytest.mark.parametrize("writes", [0, 1, 2])
def test_a_full_disk(refused, tmp_path, monkeypatch, writes):
    """At the first checkpoint, at the first weights, or at the checkpoint after them; what was written stays whole."""
    save, done = checkpoint.save_file, []

    def full(tensors, path, metadata):
        if len(done) == writes:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        done.append(path)
        save(tensors, path, metadata)

    monkeypatch.setattr(checkpoint, "save_file", full)
    line = refused("graph-stnn")
    name = ("graph-stnn-0.last", "graph-stnn-0.safetensors", "graph-stnn-0.last")[writes]
    assert f"'{tmp_path / name}' cannot be written (No space left on device)" in line
    if writes:
        assert log_of(tmp_path)["episodes"] == 0
    if writes == 2:
        load_weights(network_of("graph-stnn"), tmp_path / "graph-stnn-0.safetensors")


def test_a_full_disk_for_the_curve(refused, tmp_path, monkeypatch):
    (tmp_path / "graph-stnn-0.curve.csv").mkdir()
    assert "graph-stnn-0.curve.csv' cannot be written" in refused("graph-stnn")


def test_a_full_disk_leaves_the_old_curve(refused, tmp_path, monkeypatch):
    """The disk fills up amid the curve of a training that goes on."""
    train(tmp_path, episodes=8)
    before = (tmp_path / "graph-stnn-0.curve.csv").read_text()
    write = Path.write_text

    def full(path, text, **options):
        if ".curve.csv" not in path.name:
            return write(path, text, **options)
        write(path, text[:20], **options)
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(Path, "write_text", full)
    line = refused("graph-stnn", "--resume", "--episodes", 12)
    assert "graph-stnn-0.curve.csv' cannot be written (No space left on device)" in line
    assert (tmp_path / "graph-stnn-0.curve.csv").read_text() == before
    assert not list(tmp_path.glob("*.part"))


def test_a_training_that_diverges_says_where_and_keeps_the_best_weights(refused, tmp_path, monkeypatch):
    improve = ReturnsLearner.improve

    def poisoned(self, numbers):
        if numbers[0] >= 6:
            with torch.no_grad():
                self.network.value.weight[0, 0] = math.nan
        return improve(self, numbers)

    monkeypatch.setattr(ReturnsLearner, "improve", poisoned)
    line = refused("graph-stnn")
    assert "training of 'graph-stnn' diverged at episode 6 (the loss is nan" in line
    network = network_of("graph-stnn")
    card = load_weights(network, tmp_path / "graph-stnn-0.safetensors")
    assert card["episodes"] == 4
    assert all(torch.isfinite(tensor).all() for tensor in network.state_dict().values())
    tensors, facts = load_state(tmp_path / "graph-stnn-0.last")
    assert facts["log"]["episodes"] == 4
    assert all(torch.isfinite(tensor).all() for tensor in tensors.values())


def test_the_refusals_are_those_of_the_function(tmp_path):
    """Who trains without the command line gets the same sentences as a RequestError."""
    train(tmp_path, episodes=4)
    with pytest.raises(RequestError, match="holds a training already"):
        train(tmp_path)


def test_a_checkpoint_with_scrawled_facts(refused, tmp_path):
    train(tmp_path, episodes=4)
    path = tmp_path / "graph-stnn-0.last"
    data = path.read_bytes()
    i = data.index(b"design")
    path.write_bytes(data[: i - 2] + b"##" + data[i:])
    refused("graph-stnn", "--resume")


@pytest.mark.parametrize("damage", ["log", "tensor"])
def test_a_checkpoint_that_lacks_something(refused, tmp_path, damage):
    train(tmp_path, episodes=4)
    tensors, facts = load_state(tmp_path / "graph-stnn-0.last")
    if damage == "log":
        facts["log"]["foo"] = 1
    else:
        tensors.pop("network.value.weight")
    checkpoint.save_state(tmp_path / "graph-stnn-0.last", tensors, facts)
    refused("graph-stnn", "--resume")


def test_what_an_interrupted_training_says_holds(call, monkeypatch):
    with monkeypatch.context() as patch:
        stop_after(patch, 2, KeyboardInterrupt())
        code, _, err = call("graph-stnn")
    assert code == 130
    assert "--resume" in err


def test_best_weights_exist_where_they_are_named(call, tmp_path, monkeypatch):
    monkeypatch.setattr(training, "SAVE_SECONDS", 0.0)
    with monkeypatch.context() as patch:
        stop_after(patch, 2, KeyboardInterrupt())
        call("graph-stnn")
    code, _, _ = call("graph-stnn", "--resume", "--episodes", 2)
    assert code == 0
    assert (tmp_path / "graph-stnn-0.safetensors").exists()


def test_a_training_that_diverges_at_once_says_that_there_are_no_weights(refused, tmp_path, monkeypatch):
    def diverging(self, numbers):
        raise DivergedError("the loss is inf")

    monkeypatch.setattr(ReturnsLearner, "improve", diverging)
    assert "diverged at episode 0 (the loss is inf); there are no weights yet" in refused("graph-stnn")
    assert {path.suffix for path in tmp_path.iterdir()} == {".last"}
