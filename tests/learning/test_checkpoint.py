"""Weights and their cards: what is read is what was written, and whatever else is refused; the policy on top."""

import errno
import hashlib
import json
import os
import pickle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from safetensors import SafetensorError
from torch import nn

from baselines.learned import checkpoint
from baselines.learned.belief_attention import BeliefAttention
from baselines.learned.checkpoint import (
    describe,
    load_json,
    load_state,
    load_tensors,
    load_weights,
    read_card,
    save_json,
    save_state,
    save_tensors,
    save_weights,
)
from baselines.learned.gcn import GCN
from baselines.learned.graph_stnn import GraphSTNN
from baselines.learned.policy import Policy, evaluate
from explore_bench.errors import RequestError
from explore_bench.strategies.contract import Observation
from explore_bench.trial.loop import rollout
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenario import Scenario

SMALL = Scenario(size=10.0)
FACTS = {"name": "graph-stnn", "seed": 3, "episodes": 6000, "rate": 5e-4, "note": "η ± σ₀", "curve": [1.5, 2.25]}

NETWORKS = {
    "Graph-STNN": (GraphSTNN, {}, "baselines.learned.graph_stnn:strategy"),
    "one layer": (GraphSTNN, {"layers": 1}, "baselines.learned.graph_stnn:strategy"),
    "no state": (GraphSTNN, {"state": False}, "baselines.learned.graph_stnn:strategy"),
    "GCN-obs": (GCN, {}, "baselines.learned.gcn:strategy"),
    "GCN-no_obs": (GCN, {"obstacles": False}, "baselines.learned.gcn:strategy"),
    "Belief attention (ours)": (BeliefAttention, {}, "baselines.learned.belief_attention:strategy"),
}


def made(kind, seed=0):
    """Make a network of a kind with random weights."""
    network, switches, _ = NETWORKS[kind]
    torch.manual_seed(seed)
    return network(**switches)


def values_of(network):
    return {name: tensor.clone() for name, tensor in network.state_dict().items()}


def equal(one, other):
    return one.keys() == other.keys() and all(
        one[name].dtype == other[name].dtype and torch.equal(one[name], other[name]) for name in one
    )


def files(folder):
    return sorted(file.name for file in folder.iterdir())


@pytest.fixture
def saved(tmp_path):
    """Weights of a Graph-STNN with two layers, its card beside them."""
    path = tmp_path / "weights" / "graph-stnn-3.safetensors"
    save_weights(made("Graph-STNN"), path, FACTS)
    return path


def refusal(path, network=None):
    """Return the sentence with which weights are refused, and prove that the network is as before."""
    network = network or made("Graph-STNN", 1)
    before = values_of(network)
    with pytest.raises(RequestError) as refused:
        load_weights(network, path)
    assert equal(values_of(network), before)
    return sentence(refused)


def sentence(refused):
    text = str(refused.value)
    assert "\n" not in text
    assert text.endswith(".")
    return text


def edit_card(path, **changes):
    card = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    path.with_suffix(".json").write_text(json.dumps({**card, **changes}), encoding="utf-8")


@pytest.fixture(scope="module")
def seen():
    """Observations of a calibration world of 20 m."""
    spec = TrialSpec("none", "none:none", Scenario(), 0, purpose="calibrate")
    world = draw_world(spec.scenario, spec.generator("world"))
    events, choice, found = rollout(spec.scenario, world, spec.generator("motion"), spec.generator("sensor")), None, []
    while len(found) < 6:
        event = events.send(choice)
        choice = None
        if isinstance(event, Observation):
            found.append(event)
            choice = int(event.path_lengths.argmin())
    return found


# What is written


@pytest.mark.parametrize("kind", NETWORKS)
def test_what_is_loaded_is_what_was_saved(kind, seen, tmp_path):
    network, other, path = made(kind, 0), made(kind, 1), tmp_path / "some.safetensors"
    before = values_of(network)
    save_weights(network, path, FACTS)
    assert equal(values_of(network), before)
    assert not equal(values_of(other), before)
    load_weights(other, str(path))
    assert equal(values_of(other), before)
    with torch.inference_mode():
        first, second = (evaluate(one.eval(), seen[-1:], one.start(1))[0] for one in (network, other))
    assert torch.equal(first, second)
    assert first.shape == (1, len(seen[-1].candidates))


def test_the_card_says_what_the_network_is_and_what_the_training_gave(saved):
    card = json.loads(saved.with_suffix(".json").read_text(encoding="utf-8"))
    assert card == read_card(saved) == load_weights(made("Graph-STNN", 1), saved)
    digest = hashlib.sha256(saved.read_bytes()).hexdigest()
    assert card == {**describe(made("Graph-STNN")), "sha256": digest, **FACTS}


def test_a_card_worked_by_hand():
    """5 · 128 + 128 and 128 · 128 + 128 of the convolutions, 128 + 1 of the linear layer."""
    assert describe(made("GCN-no_obs")) == {
        "format": 1,
        "network": "GCN",
        "switches": {"obstacles": False},
        "columns": ["trace", "distance", "bearing", "occupancy", "flag"],
        "parameter_count": 640 + 128 + 16_384 + 128 + 129,
    }


def test_weights_and_card_are_all_that_is_left_in_the_folder(saved):
    assert files(saved.parent) == ["graph-stnn-3.json", "graph-stnn-3.safetensors"]


def test_saving_again_replaces_both(saved):
    save_weights(made("one layer", 5), saved, {"seed": 9})
    assert files(saved.parent) == ["graph-stnn-3.json", "graph-stnn-3.safetensors"]
    network = made("one layer", 1)
    assert load_weights(network, saved)["seed"] == 9
    assert equal(values_of(network), values_of(made("one layer", 5)))


def test_the_same_weights_are_the_same_bytes(saved, tmp_path):
    again = tmp_path / "again.safetensors"
    save_weights(made("Graph-STNN"), again, FACTS)
    assert again.read_bytes() == saved.read_bytes()
    assert again.with_suffix(".json").read_bytes() == saved.with_suffix(".json").read_bytes()


# What is refused


def test_missing_weights_are_named(saved):
    saved.unlink()
    assert refusal(saved) == f"there are no weights '{saved}'; make them with 'explore-bench train'."


def test_where_there_is_nothing_at_all_a_file_is_named(tmp_path):
    assert str(tmp_path / "none.") in refusal(tmp_path / "none.safetensors")


def test_a_folder_is_no_weights(saved):
    saved.unlink()
    saved.mkdir()
    assert str(saved) in refusal(saved)


DAMAGES = {
    "empty": lambda content: b"",
    "cut within the length of its header": lambda content: content[:5],
    "cut within its header": lambda content: content[:100],
    "half": lambda content: content[: len(content) // 2],
    "a byte short": lambda content: content[:-1],
    "a byte too long": lambda content: content + b"x",
    "random": lambda content: np.random.default_rng(0).bytes(5000),
    "zeros": lambda content: bytes(5000),
    "text": lambda content: b"These are no weights at all, but a text.\n" * 20,
    "another header": lambda content: content[:8] + b"[" * (len(content) - 8),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_and_foreign_files_are_refused(damage, saved):
    saved.write_bytes(DAMAGES[damage](saved.read_bytes()))
    text = refusal(saved)
    assert text.startswith(f"weights '{saved}' cannot be read (")
    assert text.endswith("); restore or train them anew.")


def test_a_file_of_torch_save_is_refused(saved):
    torch.save(made("Graph-STNN").state_dict(), saved)
    assert f"weights '{saved}' cannot be read" in refusal(saved)


class Intruder:
    """What a pickle may do to whoever loads it."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return Path.touch, (self.file,)


def test_a_pickle_is_refused_and_never_run(saved, tmp_path):
    torch.save(Intruder(tmp_path / "intruded"), saved)
    assert "cannot be read" in refusal(saved)
    saved.write_bytes(pickle.dumps(Intruder(tmp_path / "intruded")))
    assert "cannot be read" in refusal(saved)
    assert not (tmp_path / "intruded").exists()


def test_a_missing_card_is_named(saved):
    saved.with_suffix(".json").unlink()
    text = refusal(saved)
    assert text.startswith(f"'{saved.with_suffix('.json')}' cannot be read (")
    assert text.endswith("restore it or train anew.")


@pytest.mark.parametrize("content", [b"", b"{", b'{"format": 1', b"\xff\xfe\x00", b"no card", b"{'format': 1}"])
def test_a_damaged_card_is_named(content, saved):
    saved.with_suffix(".json").write_bytes(content)
    assert refusal(saved).startswith(f"'{saved.with_suffix('.json')}' cannot be read (")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b'{"format": ' + b"[" * 30 + b"]" * 30 + b"}", "its values lie more than 20 deep"),
        (b'{"format": ' + b"[" * 100_000, "its values lie more than 20 deep"),
        (b'{"format": 1' + b" " * 1_000_000 + b"}", "it has 1,000,013 bytes, and at most 1,000,000 are read"),
        (b'{"format": ' + b"9" * 50 + b"}", "it holds an integer of 167 bits"),
    ],
)
def test_a_card_beyond_the_limits_of_a_file_of_others_is_refused(content, said, saved):
    saved.with_suffix(".json").write_bytes(content)
    assert said in refusal(saved)


def test_a_card_that_is_a_pipe_is_refused_at_once(saved):
    card = saved.with_suffix(".json")
    card.unlink()
    os.mkfifo(card)
    assert refusal(saved).startswith(f"'{card}' cannot be read (it is no regular file")


@pytest.mark.parametrize("content", ["[1]", '"text"', "null", "7", "NaN"])
def test_a_card_that_is_no_table_is_named(content, saved):
    saved.with_suffix(".json").write_text(content)
    assert refusal(saved) == f"'{saved.with_suffix('.json')}' is no card of weights; restore it or train anew."


@pytest.mark.parametrize("key", ["format", "network", "switches", "columns", "parameter_count"])
def test_a_card_that_lacks_something_is_refused(key, saved):
    card = {name: value for name, value in read_card(saved).items() if name != key}
    saved.with_suffix(".json").write_text(json.dumps(card))
    assert f"weights '{saved.name}' were made for {key} None" in refusal(saved)


def test_weights_of_another_network_are_refused(saved):
    save_weights(made("GCN-obs"), saved, FACTS)
    assert refusal(saved) == (
        f"weights '{saved.name}' were made for network 'GCN', not 'GraphSTNN'; "
        "train them anew with 'explore-bench train'."
    )
    save_weights(made("Graph-STNN"), saved, FACTS)
    assert "network 'GraphSTNN', not 'GCN'" in refusal(saved, made("GCN-obs"))


@pytest.mark.parametrize(
    ("stored", "wanted", "switch"),
    [
        ("one layer", "Graph-STNN", "'layers': 1"),
        ("Graph-STNN", "one layer", "'layers': 2"),
        ("no state", "Graph-STNN", "'state': False"),
        ("GCN-obs", "GCN-no_obs", "'obstacles': True"),
    ],
)
def test_weights_made_with_other_switches_are_refused(stored, wanted, switch, saved):
    """Also where the tensors would fit, as with and without obstacles."""
    save_weights(made(stored), saved, FACTS)
    text = refusal(saved, made(wanted, 1))
    assert text.startswith(f"weights '{saved.name}' were made for switches {{")
    assert switch in text.split(", not ")[0]
    assert switch not in text.split(", not ")[1]


def test_weights_made_for_other_columns_are_refused(saved):
    """The same ones in another order, so that all tensors fit."""
    network = made("Graph-STNN", 1)
    network.columns = network.columns[::-1]
    assert f"weights '{saved.name}' were made for columns ['distance', 'bearing'" in refusal(saved, network)


@pytest.mark.parametrize(("key", "value"), [("parameter_count", 17), ("format", 2), ("format", "1"), ("columns", [])])
def test_a_card_that_disagrees_is_refused(key, value, saved):
    wanted = read_card(saved)[key]
    edit_card(saved, **{key: value})
    assert f"weights '{saved.name}' were made for {key} {value!r}, not {wanted!r}; " in refusal(saved)


def test_what_else_a_card_says_is_free(saved):
    edit_card(saved, seed=77, remark="none")
    assert load_weights(made("Graph-STNN", 1), saved)["remark"] == "none"


@pytest.mark.parametrize("shape", [(64, 6), (5, 64), (64,), (320,), ()])
def test_a_tensor_of_another_shape_is_refused(shape, saved):
    tensors = load_tensors(saved)
    assert tuple(tensors["embed.weight"].shape) == (64, 5)
    save_tensors(saved, {**tensors, "embed.weight": torch.zeros(shape)})
    text = refusal(saved)
    assert text.startswith(
        f"weights '{saved.name}' hold 'embed.weight' as {shape} of float32, the network wants (64, 5) "
    )


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16, torch.int64, torch.complex64])
def test_a_tensor_of_another_type_is_refused(dtype, saved):
    tensors = load_tensors(saved)
    save_tensors(saved, {**tensors, "embed.weight": tensors["embed.weight"].to(dtype)})
    name = str(dtype).removeprefix("torch.")
    assert f"'embed.weight' as (64, 5) of {name}, the network wants (64, 5) of float32;" in refusal(saved)


def test_the_card_of_other_weights_of_the_same_network_is_refused(saved, tmp_path):
    other = tmp_path / "other.safetensors"
    save_weights(made("Graph-STNN", 1), other, FACTS)
    other.replace(saved)
    assert refusal(saved).startswith(
        f"weights '{saved.name}' are not those of their card '{saved.stem}.json'; restore "
    )


def test_a_tensor_too_many_is_refused(saved):
    save_tensors(saved, {**load_tensors(saved), "stray": torch.zeros(3)})
    assert f"weights '{saved.name}' hold 'stray' as (3,) of float32, the network wants nothing;" in refusal(saved)


def test_a_tensor_too_few_is_refused(saved):
    tensors = load_tensors(saved)
    del tensors["value.bias"]
    save_tensors(saved, tensors)
    assert f"weights '{saved.name}' hold 'value.bias' as nothing, the network wants (1,) of float32;" in refusal(saved)


# What cannot be written


def full(*arguments, **options):
    raise OSError(errno.ENOSPC, "No space left on device")


def broken(*arguments, **options):
    raise SafetensorError("I/O error: No space left on device (os error 28)")


def half_written(tensors, file, metadata=None):
    Path(file).write_bytes(b"the first few bytes")
    full()


@pytest.mark.parametrize("failing", [full, broken, half_written])
def test_on_a_full_disk_the_old_weights_stay_as_they_were(failing, saved, monkeypatch):
    before = {file: file.read_bytes() for file in (saved, saved.with_suffix(".json"))}
    monkeypatch.setattr(checkpoint, "save_file", failing)
    with pytest.raises(RequestError) as refused:
        save_weights(made("Graph-STNN", 9), saved, {"seed": 9})
    assert sentence(refused).startswith(f"'{saved}' cannot be written (")
    assert {file: file.read_bytes() for file in before} == before
    network = made("Graph-STNN", 1)
    assert load_weights(network, saved)["seed"] == 3
    assert equal(values_of(network), values_of(made("Graph-STNN")))


def test_a_full_disk_is_said_in_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "save_file", full)
    path = tmp_path / "weights.safetensors"
    with pytest.raises(RequestError) as refused:
        save_tensors(path, {"a": torch.zeros(2)})
    reason = "(No space left on device); make room or give another place."
    assert sentence(refused) == f"'{path}' cannot be written {reason}"
    assert files(tmp_path) == []


def test_a_full_disk_at_the_last_moment_leaves_the_old_weights(saved, monkeypatch):
    """The new file is whole, but cannot take the place of the old one."""
    before = saved.read_bytes()
    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(RequestError, match="No space left on device"):
        save_weights(made("Graph-STNN", 9), saved, FACTS)
    assert saved.read_bytes() == before


def test_an_interrupted_save_leaves_the_old_weights(saved, monkeypatch):
    def interrupted(tensors, file, metadata=None):
        Path(file).write_bytes(b"the first few bytes")
        raise KeyboardInterrupt

    before = saved.read_bytes()
    monkeypatch.setattr(checkpoint, "save_file", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_weights(made("Graph-STNN", 9), saved, FACTS)
    assert saved.read_bytes() == before


def test_on_a_full_disk_the_old_card_stays_as_it_was(saved, monkeypatch):
    card = saved.with_suffix(".json")
    before = card.read_bytes()
    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(RequestError) as refused:
        save_json(card, {"seed": 9})
    assert sentence(refused).startswith(f"'{card}' cannot be written (No space left on device)")
    assert card.read_bytes() == before


@pytest.mark.parametrize("save", [lambda path: save_tensors(path, {}), lambda path: save_json(path, {})])
def test_a_place_that_is_no_folder_is_named(save, tmp_path):
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "weights.safetensors"
    with pytest.raises(RequestError) as refused:
        save(path)
    assert sentence(refused).startswith(f"'{path}' cannot be written (")


# Plain values and the state of a training


def test_plain_values_come_back(tmp_path):
    path = tmp_path / "deep" / "down" / "card.json"
    save_json(path, FACTS)
    assert load_json(path) == FACTS
    assert files(path.parent) == ["card.json"]
    assert "η ± σ₀" in path.read_text(encoding="utf-8"), "readable as it is"


TENSORS = {
    "network.weight": torch.arange(12.0).reshape(3, 4) / 7,
    "network.turned": torch.arange(12.0).reshape(3, 4).T,
    "network.every_other": torch.arange(10.0)[::2],
    "optimizer.0.step": torch.tensor(17.0),
    "counts": torch.tensor([1, 2**40], dtype=torch.int64),
    "mask": torch.tensor([True, False]),
    "precise": torch.tensor([0.1, -0.0, torch.inf], dtype=torch.float64),
    "empty": torch.zeros(0, 5),
}
STATE = {"episodes": 640, "seed": 3, "name": "graph-stnn", "nested": {"rate": 0.1, "list": [1, None, True, "σ₀"]}}


def test_the_state_of_a_training_comes_back(tmp_path):
    path = tmp_path / "run" / "state.safetensors"
    save_state(path, TENSORS, STATE)
    tensors, facts = load_state(path)
    assert equal(tensors, TENSORS)
    assert facts == STATE
    assert files(path.parent) == ["state.safetensors"]


def test_a_later_state_replaces_an_earlier_one(tmp_path):
    path = tmp_path / "state.safetensors"
    save_state(path, TENSORS, STATE)
    save_state(path, {"a": torch.ones(2)}, {"episodes": 641})
    tensors, facts = load_state(path)
    assert equal(tensors, {"a": torch.ones(2)})
    assert facts == {"episodes": 641}


def test_the_state_of_an_optimizer_goes_on_as_if_nothing_had_been(tmp_path):
    """Two steps in one go, or one, stored, and another."""
    from baselines.training.learner import optimizer_tensors, part, restore_optimizer, with_prefix

    def begin():
        torch.manual_seed(0)
        network = nn.Linear(3, 2)
        return network, torch.optim.Adam(network.parameters(), lr=0.1)

    def step(network, optimizer):
        optimizer.zero_grad()
        network(torch.tensor([[1.0, 2.0, 3.0]])).square().sum().backward()
        optimizer.step()

    whole, optimizer = begin()
    step(whole, optimizer)
    path = tmp_path / "state.safetensors"
    save_state(path, with_prefix("network.", whole.state_dict()) | optimizer_tensors(optimizer), {})
    step(whole, optimizer)
    resumed, optimizer = begin()
    tensors, _ = load_state(path)
    resumed.load_state_dict(part(tensors, "network."))
    restore_optimizer(optimizer, tensors)
    step(resumed, optimizer)
    assert equal(values_of(resumed), values_of(whole))


def test_weights_are_no_state_of_a_training(saved):
    with pytest.raises(RequestError) as refused:
        load_state(saved)
    assert sentence(refused) == f"'{saved}' is no checkpoint of a training; remove it and train without --resume."


@pytest.mark.parametrize("facts", ["", "{", "{'episodes': 640}"])
def test_a_state_with_damaged_facts_is_refused(facts, tmp_path):
    path = tmp_path / "state.safetensors"
    save_tensors(path, TENSORS, {"facts": facts})
    with pytest.raises(RequestError) as refused:
        load_state(path)
    assert sentence(refused).startswith(f"'{path}' is no checkpoint of a training;")


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_state_is_refused(damage, tmp_path):
    path = tmp_path / "state.safetensors"
    save_state(path, TENSORS, STATE)
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    with pytest.raises(RequestError) as refused:
        load_state(path)
    assert str(path) in sentence(refused)


def test_a_missing_state_is_named(tmp_path):
    with pytest.raises(RequestError) as refused:
        load_state(tmp_path / "state.safetensors")
    assert str(tmp_path / "state.safetensors") in sentence(refused)


def test_on_a_full_disk_the_old_state_stays_as_it_was(tmp_path, monkeypatch):
    path = tmp_path / "state.safetensors"
    save_state(path, TENSORS, STATE)
    monkeypatch.setattr(checkpoint, "save_file", half_written)
    with pytest.raises(RequestError) as refused:
        save_state(path, {"a": torch.ones(2)}, {})
    assert sentence(refused).startswith(f"'{path}' cannot be written (No space left on device)")
    assert load_state(path)[1] == STATE


# The policy, on a network whose values are written by hand


class Scripted(nn.Module):
    """Values are the lengths of the paths times a weight; the one of the n-th decision gets 100 more."""

    columns = ("length",)

    def __init__(self, weight=0.0):
        super().__init__()
        self.switches = {}
        self.weight = nn.Parameter(torch.tensor([weight]))
        self.calls = []

    def read(self, observation):
        return torch.tensor(observation.path_lengths, dtype=torch.float32)

    def collate(self, items):
        return torch.stack(items)

    def start(self, count):
        return torch.zeros(1, count, 1)

    def forward(self, batch, hidden, noise=None):
        self.calls.append((self.training, noise, torch.is_grad_enabled()))
        due = torch.arange(batch.shape[1]).unsqueeze(0) == hidden[0]
        return self.weight * batch + 100.0 * due * (self.weight < 2.0), hidden + 1


def scripted(tmp_path, weight):
    save_weights(Scripted(weight), tmp_path / "scripted.safetensors", {})
    return Policy(Scripted(), str(tmp_path / "scripted.safetensors"))


def lengths_of(*values):
    return SimpleNamespace(path_lengths=np.array(values, dtype=float))


def test_the_policy_chooses_the_candidate_of_the_largest_value(tmp_path):
    """A weight of 2: the longest path, whatever its place, and the first among equals."""
    policy = scripted(tmp_path, 2.0)
    policy.reset(np.random.default_rng(0))
    seen = [(3, 9, 1), (9, 3, 1), (1, 3, 9), (4,), (4, 7, 7), (-5, -3, -4)]
    choices = [policy.choose(lengths_of(*values)) for values in seen]
    assert choices == [1, 0, 2, 0, 1, 1]
    assert all(type(choice) is int for choice in choices)


def test_the_hidden_state_runs_through_a_trial_and_ends_with_it(tmp_path):
    policy = scripted(tmp_path, 1.0)
    for _ in range(2):
        policy.reset(np.random.default_rng(0))
        assert [policy.choose(lengths_of(*[1.0] * 5)) for _ in range(4)] == [0, 1, 2, 3]


def test_the_policy_begins_empty_without_a_reset_too(tmp_path):
    assert scripted(tmp_path, 1.0).choose(lengths_of(1, 1, 1)) == 0


def test_the_policy_plays_without_dropout_noise_and_gradients(tmp_path):
    policy = scripted(tmp_path, 1.0)
    policy.choose(lengths_of(1, 2))
    assert policy.network.calls == [(False, None, False)]


def test_the_policy_draws_nothing(tmp_path):
    policy, rng = scripted(tmp_path, 1.0), np.random.default_rng(3)
    before = torch.get_rng_state()
    policy.reset(rng)
    policy.choose(lengths_of(1, 2))
    assert rng.integers(10**9) == np.random.default_rng(3).integers(10**9)
    assert torch.equal(torch.get_rng_state(), before)


def test_the_policy_follows_the_weights_of_its_file(tmp_path):
    """The same network, made with a weight of 0, plays by that of the file."""
    assert scripted(tmp_path, 2.0).choose(lengths_of(1, 2)) == 1
    assert scripted(tmp_path, -2.0).choose(lengths_of(200, 2)) == 1


# The policy, on real networks


def save_random(kind, folder, seed=0):
    path = folder / "random-0.safetensors"
    save_weights(made(kind, seed), path, {"seed": seed})
    return path


@pytest.mark.parametrize("kind", NETWORKS)
def test_the_policy_of_a_network_decides_alike_in_two_trials(kind, seen, tmp_path):
    """And as the network's values say, with the hidden state handed on from decision to decision."""
    network = made(kind)
    policy = Policy(made(kind, 1), str(save_random(kind, tmp_path)))
    hidden, expected = network.eval().start(1), []
    with torch.inference_mode():
        for observation in seen:
            values, hidden = evaluate(network, [observation], hidden)
            expected.append(int(values.argmax()))
    for seed in (0, 1):
        policy.reset(np.random.default_rng(seed))
        assert [policy.choose(observation) for observation in seen] == expected


def trial_of(kind, path, **fields):
    _, switches, factory = NETWORKS[kind]
    return TrialSpec(kind, factory, SMALL, 0, switches, purpose="calibrate", training_seed=4, weights=path, **fields)


@pytest.mark.parametrize("kind", NETWORKS)
def test_a_learned_strategy_runs_trials_and_the_same_one_twice(kind, tmp_path):
    spec = trial_of(kind, str(save_random(kind, tmp_path)))
    first, second = run_trial(spec), run_trial(spec)
    assert first.status is not Status.FAILED, first.reason
    assert first.spec.training_seed == 4
    assert first.steps == second.steps
    assert first.snapshots == second.snapshots
    assert len(first.decision_seconds) == first.steps[-1].decisions > 0


def test_a_trial_is_what_the_policy_chooses_in_a_rollout(tmp_path):
    path = str(save_random("Graph-STNN", tmp_path))
    spec = trial_of("Graph-STNN", path)
    policy, rows, choice = Policy(made("Graph-STNN", 1), path), [], None
    policy.reset(spec.generator("strategy"))
    world = draw_world(SMALL, spec.generator("world"))
    events = rollout(SMALL, world, spec.generator("motion"), spec.generator("sensor"))
    while True:
        try:
            event = events.send(choice)
        except StopIteration:
            break
        choice = None
        if isinstance(event, Observation):
            choice = policy.choose(event)
        else:
            rows.append(event)
    assert rows == run_trial(spec).steps


def test_a_trial_with_bad_weights_fails_with_their_sentence(saved):
    missing = str(saved.with_name("none.safetensors"))
    assert "none." in run_trial(trial_of("Graph-STNN", missing)).reason
    result = run_trial(trial_of("one layer", str(saved)))
    assert result.status is Status.FAILED
    assert f"weights '{saved.name}' were made for switches" in result.reason
    assert not result.steps


def test_a_write_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "save_file", half_written)
    with pytest.raises(RequestError):
        save_tensors(tmp_path / "w.safetensors", {"a": torch.zeros(2)})
    assert files(tmp_path) == []


def test_a_card_that_cannot_take_its_place_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(RequestError):
        save_json(tmp_path / "w.json", {})
    assert files(tmp_path) == []


def test_the_reason_of_safetensors_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "save_file", broken)
    with pytest.raises(RequestError, match="No space left on device"):
        save_tensors(tmp_path / "w.safetensors", {"a": torch.zeros(2)})


def test_where_there_is_nothing_the_weights_are_missed(tmp_path):
    with pytest.raises(RequestError, match="there are no weights"):
        load_weights(made("Graph-STNN"), tmp_path / "none.safetensors")


def test_weights_that_are_no_numbers_are_refused(saved):
    network = made("Graph-STNN")
    network.value.bias.data.fill_(float("nan"))
    save_weights(network, saved, FACTS)
    with pytest.raises(RequestError, match=r"'value\.bias' that are not finite"):
        load_weights(made("Graph-STNN", 1), saved)


def test_a_card_without_end_is_refused(saved):
    saved.with_suffix(".json").write_text("[" * 100_000)
    with pytest.raises(RequestError, match="cannot be read"):
        load_weights(made("Graph-STNN"), saved)


def test_a_card_of_before_its_network_was_renamed_is_read(tmp_path):
    network, path = BeliefAttention(), tmp_path / "old.safetensors"
    save_weights(network, path, {})
    card = json.loads(path.with_suffix(".json").read_text())
    path.with_suffix(".json").write_text(json.dumps({**card, "network": "GraphSTNNPlus"}))
    load_weights(BeliefAttention(), path)
