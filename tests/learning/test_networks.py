"""The networks: padding, order, what each switch leaves out, the hidden state, noise, and whether they can learn."""

import itertools

import numpy as np
import pytest
import torch
from handmade_graphs import random_graph, random_set, reordered, reordered_set
from hypothesis import given, settings, strategies as st

from baselines import STRATEGIES
from baselines.learned.belief_attention import BeliefAttention
from baselines.learned.candidate_features import CandidateSet
from baselines.learned.gcn import GCN
from baselines.learned.graph import ExplorationGraph
from baselines.learned.graph_stnn import CHANNELS, GraphSTNN
from baselines.learned.layers import GraphBatch, Noise, normalized

torch.set_num_threads(1)

SEEDS = st.integers(0, 2**32 - 1)
VARIANTS = {
    name: dict(entry.parameters)
    for name, entry in STRATEGIES.items()
    if entry.factory == "baselines.learned.graph_stnn:strategy" and "table3" in entry.tables
}
"""Graph-STNN and its six ablations."""

NETWORKS = {
    **{name: lambda switches=switches: GraphSTNN(**switches) for name, switches in VARIANTS.items()},
    "1 layer": lambda: GraphSTNN(layers=1),
    "3 layers": lambda: GraphSTNN(layers=3),
    "text": lambda: GraphSTNN(head="text"),
    "text, no temporal": lambda: GraphSTNN(temporal=False, head="text"),
    "gcn": GCN,
    "plus": BeliefAttention,
}
each_network = pytest.mark.parametrize("name", NETWORKS)


def made(name, seed=0):
    """Return a network whose weights depend on the seed alone."""
    torch.manual_seed(seed)
    return NETWORKS[name]()


def random_items(name, seed, count, **sizes):
    """Return what a network of that name could have read of some observations."""
    rng = np.random.default_rng(seed)
    if name == "plus":
        return [random_set(rng, sizes.get("candidates")) for _ in range(count)]
    return [random_graph(rng, weighted=name == "gcn", **sizes) for _ in range(count)]


def values_of(network, items, hidden=None, noise=None):
    """Return the values of the candidates of each item, (B, C), and the hidden state after it."""
    hidden = network.start(len(items)) if hidden is None else hidden
    with torch.no_grad():
        return network(network.collate(items), hidden, noise)


def width(item):
    return len(item.candidates) if isinstance(item, CandidateSet) else item.candidates


def close(found, wanted, tolerance=1e-5):
    torch.testing.assert_close(found, wanted, atol=tolerance, rtol=tolerance)


# All of them


@each_network
@settings(max_examples=10)
@given(seed=SEEDS)
def test_padding_changes_nothing(name, seed):
    """A graph has the same values and the same next hidden state alone and beside larger ones."""
    network = made(name)
    items = random_items(name, seed, 3) + random_items(name, seed, 1, candidates=9)
    hidden = torch.randn_like(network.start(4))
    values, after = values_of(network, items, hidden)
    assert values.shape == (4, 9)
    for i, item in enumerate(items):
        alone, own = values_of(network, [item], hidden[:, i : i + 1].contiguous())
        close(values[i, : width(item)], alone[0])
        close(after[:, i], own[:, 0])
        assert torch.isneginf(values[i, width(item) :]).all()
        assert torch.isfinite(alone).all()


@each_network
@settings(max_examples=10)
@given(seed=SEEDS)
def test_values_follow_the_candidates_wherever_they_stand(name, seed):
    network = made(name)
    (item,) = random_items(name, seed, 1, candidates=6)
    order = np.random.default_rng(seed).permutation(6)
    if name == "plus":
        other = reordered_set(item, order)
    else:
        first = len(item.features) - 6
        other = reordered(item, np.concatenate((np.arange(first), first + order)))
    values, after = values_of(network, [item])
    permuted, own = values_of(network, [other])
    close(permuted[0], values[0, order])
    close(own, after)


@each_network
def test_candidates_are_told_apart(name):
    values, _ = values_of(made(name), random_items(name, 1, 1, candidates=5))
    assert len({round(float(value), 6) for value in values[0]}) == 5


@each_network
def test_all_parameters_matter(name):
    """Each has a gradient, but for the offsets of a softmax and the attention over a single layer."""
    network = made(name)
    items = random_items(name, 2, 5)
    rngs = [np.random.default_rng(i) for i in range(5)]
    noise = network.noise(rngs, 0.0) if isinstance(network, GraphSTNN) else None
    values, _ = network(network.collate(items), torch.randn_like(network.start(5)), noise)
    finite = values[torch.isfinite(values)]
    loss = (finite * torch.randn(len(finite))).sum()
    if name == "plus":
        loss = loss + network.preferences_and_value(network.collate(items))[1].square().sum()
    loss.backward()
    for own, parameter in network.named_parameters():
        assert parameter.grad is not None, own
        of_one_layer = name == "1 layer" and own == "spatial.attention.score.weight"
        if not (own.endswith("score.bias") or own == "key.bias" or of_one_layer):
            assert parameter.grad.any(), own


@each_network
def test_a_network_can_learn_six_values_by_heart(name):
    """The value of the best candidate of six graphs: the squared error falls under 5 % of what it was at first."""
    network = made(name)
    batch = network.collate(random_items(name, 3, 6))
    targets = torch.from_numpy(np.random.default_rng(4).normal(size=6)).float()
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-3)
    losses = []
    for _ in range(400):
        values, _ = network(batch, network.start(6))
        loss = (values.max(dim=1).values - targets).square().mean()
        losses.append(float(loss.detach()))
        if losses[-1] < 0.05 * losses[0]:
            break
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert losses[-1] < 0.05 * losses[0]


@each_network
def test_the_mean_network_answers_twice_alike(name):
    network, items = made(name), random_items(name, 5, 3)
    assert torch.equal(values_of(network, items)[0], values_of(network, items)[0])


# Switches


def test_there_are_seven_variants_of_graph_stnn():
    off = {tuple(sorted(switches)) for switches in VARIANTS.values()}
    assert VARIANTS["graph-stnn"] == {}
    assert len(off) == len(VARIANTS) == 7
    assert not any(value for switches in VARIANTS.values() for value in switches.values())


def test_the_seven_variants_have_seven_sets_of_parameters():
    shapes = [{own: tuple(p.shape) for own, p in made(name).named_parameters()} for name in VARIANTS]
    for one, other in itertools.combinations(shapes, 2):
        assert one != other


def test_the_seven_variants_are_seven_functions():
    graphs = random_items("graph-stnn", 6, 3, candidates=4)
    values = [values_of(made(name), graphs)[0] for name in VARIANTS]
    for one, other in itertools.combinations(values, 2):
        assert not torch.allclose(one, other, atol=1e-3)


def with_other_edges(graph):
    adjacency = np.ones_like(graph.adjacency) - np.eye(len(graph.adjacency), dtype=np.float32)
    return ExplorationGraph(graph.features, adjacency, graph.trajectory, graph.candidates)


def with_turned_trajectory(graph):
    """Return the same graph, but for the order in which its trajectory was driven."""
    order = np.arange(len(graph.features))
    order[: graph.trajectory] = order[: graph.trajectory][::-1]
    return reordered(graph, order)


WITH_HEADS = [
    (name, head)
    for name, head in itertools.product(VARIANTS, ("caption", "text"))
    if head == "caption" or "spatial" not in VARIANTS[name]  # the text would tell no candidates apart
]


@pytest.mark.parametrize(("name", "head"), WITH_HEADS)
def test_a_variant_depends_on_what_its_encoders_read_and_on_nothing_else(name, head):
    """Edges are the spatial encoder's, the order of the trajectory the temporal one's, the past the state's."""
    switches = VARIANTS[name]
    torch.manual_seed(0)
    network = GraphSTNN(**switches, head=head)
    (graph,) = random_items("graph-stnn", 7, 1, trajectory=6, others=2, candidates=4)
    values, after = values_of(network, [graph])

    def changes(item, hidden=None):
        return not torch.allclose(values_of(network, [item], hidden)[0], values, atol=1e-5)

    assert changes(with_other_edges(graph)) == switches.get("spatial", True)
    assert changes(with_turned_trajectory(graph)) == switches.get("temporal", True)
    assert changes(graph, torch.ones(2, 1, CHANNELS)) == switches.get("state", True)
    assert torch.equal(after, network.start(1)) != switches.get("state", True)


@pytest.mark.parametrize("layers", [1, 2, 3])
def test_the_spatial_encoder_has_as_many_layers_as_asked_for(layers):
    """A chain: so many edges away a node still has a share in a candidate's spatial features, and none beyond."""
    torch.manual_seed(0)
    network = GraphSTNN(temporal=False, state=False, layers=layers, head="text")
    count = 8
    chain = np.eye(count, k=1, dtype=np.float32) + np.eye(count, k=-1, dtype=np.float32)
    features = np.random.default_rng(8).normal(size=(count, 5)).astype(np.float32)
    batch = GraphBatch.of([ExplorationGraph(features, chain, 1, 1)])
    original = torch.relu(network.embed(batch.features)).detach().requires_grad_()
    network.spatial(original, normalized(batch.adjacency))[0, -1].sum().backward()
    reached = original.grad[0].abs().sum(dim=1).nonzero().flatten().tolist()
    assert reached == list(range(count - 1 - layers, count))


@pytest.mark.parametrize("head", ["caption", "text"])
def test_the_head_sees_what_the_caption_or_the_text_says(head):
    """Beside the state: original and spatial features of a candidate, or its spatial ones and the temporal one."""
    torch.manual_seed(1)
    network = GraphSTNN(head=head)
    batch = GraphBatch.of([random_graph(np.random.default_rng(9), trajectory=4, others=2, candidates=2)])
    seen = []
    network.noisy.register_forward_pre_hook(lambda _, given: seen.append(given[0]))
    with torch.no_grad():
        network(batch, network.start(1))
        original = torch.relu(network.embed(batch.features))
        spatial = network.spatial(original, normalized(batch.adjacency))
        temporal = network.temporal(torch.cat((original, spatial), dim=-1), batch.trajectory)
        pooled = torch.cat((original.mean(dim=1), spatial.mean(dim=1), temporal), dim=-1)
        state, _ = network.state(pooled, network.start(1))
    both = original[0, -2:] if head == "caption" else temporal.expand(2, -1)
    shown = (both, spatial[0, -2:]) if head == "caption" else (spatial[0, -2:], both)
    close(seen[0][0], torch.cat((state.expand(2, -1), *shown), dim=-1))


def test_without_the_state_encoder_the_head_sees_the_pooled_features():
    torch.manual_seed(1)
    network = GraphSTNN(spatial=False, temporal=False, state=False)
    batch = GraphBatch.of([random_graph(np.random.default_rng(9), trajectory=4, others=2, candidates=2)])
    with torch.no_grad():
        values, _ = network(batch, network.start(1))
        original = torch.relu(network.embed(batch.features))[0]
        entered = torch.cat((original.mean(dim=0).expand(2, -1), original[-2:]), dim=-1)
        close(values[0], network.value(torch.relu(network.noisy.mean(entered)))[:, 0])


def test_the_gcn_is_worked_step_by_step():
    """Two convolutions with loops of weight 2 and biases, and a linear layer of the candidates' rows."""
    network = made("gcn")
    graph = random_graph(np.random.default_rng(10), weighted=True)
    with_loops = graph.adjacency + 2 * np.eye(len(graph.adjacency))
    scale = np.diag(with_loops.sum(axis=1) ** -0.5)
    values = graph.features
    parameters = {own: p.detach().numpy() for own, p in network.named_parameters()}
    for layer in ("first", "second"):
        mixed = scale @ with_loops @ scale @ values @ parameters[f"{layer}.linear.weight"].T
        values = np.maximum(mixed + parameters[f"{layer}.bias"], 0.0)
    wanted = values[-graph.candidates :] @ parameters["value.weight"][0] + parameters["value.bias"]
    close(values_of(network, [graph])[0][0], torch.from_numpy(wanted).float())


# The state


def with_a_strong_state(name):
    """Return a network in which the state weighs more than at the start of a training."""
    network = made(name)
    with torch.no_grad():
        for weight in network.state.gru.parameters():
            weight.mul_(4.0)
        network.noisy.mean.weight[:, :CHANNELS].mul_(4.0)
    return network


@pytest.mark.parametrize("of", ["hidden", "pooled"])
def test_the_state_that_all_candidates_share_can_change_the_choice(of):
    """The same candidates, one past or another, one trajectory or another: not always the same one is best."""
    rng = np.random.default_rng(11)
    network = with_a_strong_state("no-spatial")  # a candidate's features are its own
    chosen = []
    for _ in range(10):
        graph, choices = random_graph(rng, trajectory=5, others=0, candidates=6), set()
        for _ in range(15):
            hidden = None
            if of == "hidden":
                hidden = torch.from_numpy(rng.uniform(-1, 1, (2, 1, CHANNELS))).float()
            else:
                graph.features[:5] = 6.0 * rng.normal(size=(5, 5))
            choices.add(int(values_of(network, [graph], hidden)[0].argmax()))
        chosen.append(choices)
    assert max(map(len, chosen)) > 1


@pytest.mark.parametrize("name", ["graph-stnn", "no-spatial", "no-temporal", "no-spatial-temporal", "text"])
def test_the_past_of_an_episode_can_change_the_choice(name):
    """First decisions that differ, then the same second one."""
    network, rng = with_a_strong_state(name), np.random.default_rng(12)
    seconds = [random_graph(rng, candidates=7) for _ in range(10)]
    chosen = set()
    for _ in range(20):
        _, after = values_of(network, [random_graph(rng)])
        chosen.add(tuple(int(values_of(network, [graph], after)[0].argmax()) for graph in seconds))
    assert len(chosen) > 1


@each_network
def test_the_second_decision_depends_on_the_first_one_only_through_the_state_encoder(name):
    network = made(name)
    remembers = isinstance(network, GraphSTNN) and network.switches["state"]
    one, other, second = random_items(name, 13, 3)
    after = [values_of(network, [first])[1] for first in (one, other)]
    values = [values_of(network, [second], hidden)[0] for hidden in after]
    assert torch.equal(*values) != remembers
    assert torch.equal(*after) != remembers
    if not remembers:
        assert torch.equal(after[0], network.start(1))


def test_networks_without_a_state_encoder_keep_nothing():
    assert GCN().start(3).shape == BeliefAttention().start(3).shape == (0, 3)
    assert GraphSTNN().start(3).shape == (2, 3, CHANNELS)
    assert not GraphSTNN().start(3).any()


# Noise


def noise_of(network, *seeds, rate=0.3):
    return network.noise([np.random.default_rng(seed) for seed in seeds], rate)


of_graph_stnn = pytest.mark.parametrize("name", [*VARIANTS, "text"])


@of_graph_stnn
def test_values_repeat_with_the_same_noise_and_change_with_other_noise(name):
    network, items = made(name), random_items(name, 14, 2, candidates=4)
    with_noise = [values_of(network, items, noise=noise_of(network, *seeds))[0] for seeds in ((1, 2), (1, 2), (1, 3))]
    assert torch.equal(with_noise[0], with_noise[1])
    assert torch.equal(with_noise[0][0], with_noise[2][0])
    assert not torch.allclose(with_noise[0][1], with_noise[2][1], atol=1e-4)
    assert not torch.allclose(with_noise[0], values_of(network, items)[0], atol=1e-4)


@of_graph_stnn
def test_no_noise_is_that_of_size_zero_with_all_channels_kept(name):
    network, items = made(name), random_items(name, 15, 2)
    noise = noise_of(network, 1, 2)
    none = Noise(torch.zeros_like(noise.inputs), torch.zeros_like(noise.outputs), torch.ones_like(noise.kept))
    close(values_of(network, items, noise=none)[0], values_of(network, items)[0], 1e-6)


def test_each_part_of_the_noise_matters():
    network, items = made("graph-stnn"), random_items("graph-stnn", 16, 1, candidates=4)
    noise, other = noise_of(network, 1), noise_of(network, 2)
    values = values_of(network, items, noise=noise)[0]
    for changed in (
        Noise(other.inputs, noise.outputs, noise.kept),
        Noise(noise.inputs, other.outputs, noise.kept),
        Noise(noise.inputs, noise.outputs, other.kept),
    ):
        assert not torch.allclose(values_of(network, items, noise=changed)[0], values, atol=1e-5)


def test_noise_leaves_the_hidden_state_alone():
    """It sways the head; the state is of what was observed."""
    network, items = made("graph-stnn"), random_items("graph-stnn", 17, 2)
    assert torch.equal(values_of(network, items, noise=noise_of(network, 1, 2))[1], values_of(network, items)[1])


def test_the_gcn_explores_by_dropout():
    """None is no dropout; at the rate 0.999 hardly a channel is left, so that values are mostly those of the bias."""
    network, items = made("gcn"), random_items("gcn", 18, 1, candidates=5)
    mean = values_of(network, items)[0]

    def dropped(seed, rate):
        torch.manual_seed(seed)
        return values_of(network, items, noise=rate)[0]

    assert torch.equal(dropped(1, 0.5), dropped(1, 0.5))
    assert not torch.equal(dropped(1, 0.5), dropped(2, 0.5))
    assert torch.equal(dropped(1, 0.0), mean)
    average = torch.stack([dropped(seed, 0.5) for seed in range(500)]).mean(dim=0)
    close(average, mean, 0.03)
    bias = network.value.bias.detach()
    share = torch.stack([dropped(seed, 0.999) == bias for seed in range(50)]).float().mean()
    assert share > 0.8


def test_evaluation_and_training_mode_are_alike_without_noise():
    for name in NETWORKS:
        network, items = made(name), random_items(name, 19, 2)
        assert torch.equal(values_of(network.train(), items)[0], values_of(network.eval(), items)[0]), name


# Our extension


def test_preferences_compare_the_candidates_with_each_other():
    """The order of two candidates can turn when a third one changes."""
    network, rng = made("plus"), np.random.default_rng(20)
    turned = 0
    for _ in range(50):
        one, orders = random_set(rng, 3), set()
        for _ in range(10):
            one.candidates[2] = 3.0 * rng.normal(size=one.candidates.shape[1])
            values = values_of(network, [one])[0][0]
            orders.add(bool(values[0] > values[1]))
        turned += len(orders) == 2
    assert turned > 0


def test_the_value_of_the_state_ignores_padding_and_order():
    network = made("plus")
    one, wide = random_items("plus", 21, 1)[0], random_items("plus", 22, 1, candidates=9)[0]
    turned = reordered_set(one, np.arange(len(one.candidates))[::-1])
    with torch.no_grad():
        alone = network.preferences_and_value(network.collate([one]))[1]
        together = network.preferences_and_value(network.collate([one, wide, turned]))[1]
    assert together.shape == (3,)
    close(together[0], alone[0])
    close(together[2], alone[0])
    assert not torch.isclose(together[1], together[0])


def test_the_text_head_is_refused_where_it_could_tell_no_candidates_apart():
    with pytest.raises(ValueError, match="spatial=True"):
        GraphSTNN(spatial=False, head="text")


@pytest.mark.parametrize("switch", [{"layers": 0}, {"layers": 4}, {"head": "x"}, {"distance": "long"}])
def test_an_unknown_switch_is_refused_with_those_that_there_are(switch):
    ((key, value),) = switch.items()
    with pytest.raises(ValueError, match=f"there is no {key} {value!r}; choose one of "):
        GraphSTNN(**switch)
