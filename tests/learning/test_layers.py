"""The layers of the networks, each against its equation worked by hand or against another implementation."""

import math

import numpy as np
import pytest
import torch
from handmade_graphs import random_graph
from hypothesis import given, settings, strategies as st
from torch import nn

from baselines.learned.graph import ExplorationGraph
from baselines.learned.layers import (
    CausalConvolution,
    GraphBatch,
    GraphConvolution,
    LayerAttention,
    Noise,
    NoisyLinear,
    SpatialEncoder,
    StateEncoder,
    TemporalEncoder,
    normalized,
)

torch.set_num_threads(1)

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture(autouse=True)
def _seeded():
    torch.manual_seed(0)


def close(found, wanted, tolerance=1e-6):
    torch.testing.assert_close(found, torch.as_tensor(wanted, dtype=found.dtype), atol=tolerance, rtol=tolerance)


def put(parameter, values):
    """Set a parameter to given numbers."""
    with torch.no_grad():
        parameter.copy_(torch.as_tensor(values))


def sigmoid(x):
    return 1.0 / (1.0 + np.exp(-x))


# Padding


@pytest.fixture
def padded():
    """Three graphs of different sizes, the largest in the middle, and their batch."""
    rng = np.random.default_rng(1)
    graphs = [random_graph(rng, *sizes) for sizes in ((2, 1, 1), (5, 3, 4), (3, 0, 2))]
    return graphs, GraphBatch.of(graphs)


def test_a_batch_holds_each_graph_and_zeros(padded):
    graphs, batch = padded
    assert batch.features.shape == (3, 12, 5)
    assert batch.adjacency.shape == (3, 12, 12)
    for i, graph in enumerate(graphs):
        own = len(graph.features)
        np.testing.assert_array_equal(batch.features[i, :own], graph.features)
        np.testing.assert_array_equal(batch.adjacency[i, :own, :own], graph.adjacency)
        assert not batch.features[i, own:].any()
        assert not batch.adjacency[i, own:].any()
        assert not batch.adjacency[i, :, own:].any()
        assert batch.nodes[i].tolist() == [True] * own + [False] * (12 - own)
    assert batch.trajectory.tolist() == [2, 5, 3]


def test_candidates_are_the_last_rows_of_each_graph(padded):
    graphs, batch = padded
    rows = batch.of_candidates(batch.features)
    assert rows.shape == (3, 4, 5)
    assert batch.choices.sum(dim=1).tolist() == [1, 4, 2]
    for i, graph in enumerate(graphs):
        np.testing.assert_array_equal(rows[i, : graph.candidates], graph.features[-graph.candidates :])


def test_the_mean_ignores_padding(padded):
    graphs, batch = padded
    values = batch.features.clone()
    values[~batch.nodes] = 1e6
    close(batch.mean(values), np.stack([graph.features.mean(axis=0) for graph in graphs]))


def test_what_is_no_candidate_has_the_value_minus_infinity(padded):
    _, batch = padded
    values = batch.masked(torch.zeros(3, 4))
    assert torch.equal(values == 0.0, batch.choices)
    assert torch.equal(torch.isneginf(values), ~batch.choices)


# Graph convolutions (Eq. 8)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("improved", [False, True])
@settings(max_examples=15)
@given(seed=SEEDS)
def test_a_graph_convolution_is_that_of_pytorch_geometric(weighted, improved, seed):
    """DenseGCNConv; `improved` is the loop of weight 2 of [8]."""
    theirs = pytest.importorskip("torch_geometric.nn").DenseGCNConv(5, 7, improved=improved)
    graphs = [random_graph(np.random.default_rng(seed + i), weighted=weighted) for i in range(3)]
    batch = GraphBatch.of(graphs)
    ours = GraphConvolution(5, 7, bias=True)
    put(theirs.bias, torch.randn(7))
    put(ours.linear.weight, theirs.lin.weight)
    put(ours.bias, theirs.bias)
    found = ours(batch.features, normalized(batch.adjacency, 2.0 if improved else 1.0))
    close(found, torch.relu(theirs(batch.features, batch.adjacency)), 1e-5)


def test_the_normalized_adjacency_of_a_chain_by_hand():
    """Degrees with loops are 2, 3 and 2."""
    chain = torch.tensor([[[0.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 0.0]]])
    a, b = 1 / 2, 1 / math.sqrt(6)
    close(normalized(chain), [[[a, b, 0], [b, 1 / 3, b], [0, b, a]]])


def test_the_normalized_adjacency_with_a_weight_and_a_heavier_loop_by_hand():
    edge = torch.tensor([[[0.0, 3.0], [3.0, 0.0]]])
    close(normalized(edge), [[[0.25, 0.75], [0.75, 0.25]]])
    close(normalized(edge, 2.0), [[[0.4, 0.6], [0.6, 0.4]]])


@pytest.mark.parametrize(
    ("loop", "wanted"), [(1.0, [[2.5, 0.0], [2.5, 0.0]]), (2.0, [[2.0, 0.0], [3.0, 0.0]])], ids=["loop 1", "loop 2"]
)
def test_a_graph_convolution_of_two_nodes_by_hand(loop, wanted):
    """F W = [[1, −1], [4, −6]], mixed in halves, or in thirds with the heavier loop; the ReLU cuts what is negative."""
    layer = GraphConvolution(2, 2)
    put(layer.linear.weight, [[1.0, 2.0], [-1.0, -3.0]])
    features = torch.tensor([[[1.0, 0.0], [0.0, 2.0]]])
    adjacency = torch.tensor([[[0.0, 1.0], [1.0, 0.0]]])
    close(layer(features, normalized(adjacency, loop)), [wanted])


def test_only_the_bias_that_was_asked_for():
    assert dict(GraphConvolution(3, 2).named_parameters()).keys() == {"linear.weight"}
    assert dict(GraphConvolution(3, 2, bias=True).named_parameters()).keys() == {"linear.weight", "bias"}


# Attention over layers (Eq. 9–10)


def test_attention_by_hand():
    """Two layers, two nodes: the scores of the first are 1 and −1, of the second equal, so that it has the mean."""
    attention = LayerAttention(2)
    put(attention.score.weight, [[1.0, -1.0]])
    put(attention.score.bias, [0.5])
    layers = torch.tensor([[[1.0, 0.0], [4.0, 2.0]], [[0.0, 1.0], [2.0, 0.0]]])
    alpha = 1 / (1 + math.exp(-2))
    close(attention(layers), [[alpha, 1 - alpha], [3.0, 1.0]])


def test_attention_gives_one_number_a_layer_to_each_node():
    """All channels of a node are mixed alike, and the numbers add up to one."""
    attention = LayerAttention(4)
    put(attention.score.weight, torch.randn(1, 4))
    layers = torch.randn(3, 2, 5, 4)
    scores = np.exp((layers @ attention.score.weight[0] + attention.score.bias).detach().numpy())
    wanted = np.einsum("lbn,lbnf->bnf", scores / scores.sum(axis=0), layers.numpy())
    close(attention(layers), wanted, 1e-5)
    close(attention(torch.ones(3, 2, 5, 4)), np.ones((2, 5, 4)))


def test_a_spatial_encoder_of_one_layer_is_the_convolution():
    encoder = SpatialEncoder(5, 1)
    batch = GraphBatch.of([random_graph(np.random.default_rng(2))])
    adjacency = normalized(batch.adjacency)
    assert torch.equal(encoder(batch.features, adjacency), encoder.layers[0](batch.features, adjacency))


def test_a_spatial_encoder_joins_one_convolution_after_another():
    encoder = SpatialEncoder(5, 3)
    batch = GraphBatch.of([random_graph(np.random.default_rng(3))])
    adjacency = normalized(batch.adjacency)
    outputs, values = [], batch.features
    for layer in encoder.layers:
        values = torch.relu(adjacency @ values @ layer.linear.weight.T)
        outputs.append(values)
    close(encoder(batch.features, adjacency), encoder.attention(torch.stack(outputs)), 1e-5)


# Causal convolutions (Eq. 11–13)


def outputs(convolution, values):
    """Output at every node of a series, (inputs, T) → (channels, T), each as the last one of its own beginning."""
    series = values.T
    reach, found = convolution.reach, []
    for t in range(1, len(series) + 1):
        last = nn.functional.pad(series[:t], (0, 0, reach, 0))[-reach:]
        present = torch.arange(t - reach, t) >= 0
        found.append(convolution(last[None], present[None, :, None])[0])
    return torch.stack(found, dim=1)


def test_one_causal_convolution_is_equation_12():
    """P_t = b + Σ_k f_k p_(t − (K − k) d) with k from 1 to K and nothing before the first node."""
    convolution = CausalConvolution(3, 4, 1, 3)
    values = torch.randn(3, 6)
    kernel, bias = (parameter.detach().numpy() for parameter in convolution.layers[0].parameters())
    wanted = np.tile(bias[:, None], (1, 6))
    for t in range(6):
        for k in (1, 2, 3):
            if t - (3 - k) >= 0:
                wanted[:, t] += kernel[:, :, k - 1] @ values[:, t - (3 - k)].numpy()
    close(outputs(convolution, values), wanted)


def test_the_second_layer_looks_twice_as_far_and_sees_a_relu():
    convolution = CausalConvolution(2, 3, 2, 2)
    values = torch.randn(2, 7)
    first, second = convolution.layers
    below = torch.relu(nn.functional.conv1d(nn.functional.pad(values, (1, 0)), first.weight, first.bias))
    wanted = torch.empty(3, 7)
    for t in range(7):
        earlier = below[:, t - 2] if t >= 2 else torch.zeros(3)
        wanted[:, t] = second.bias + second.weight[:, :, 0] @ earlier + second.weight[:, :, 1] @ below[:, t]
    close(outputs(convolution, values), wanted.detach())


@pytest.mark.parametrize(("layers", "kernel"), [(1, 1), (1, 4), (2, 2), (2, 3), (3, 3), (4, 2), (4, 3)])
def test_the_last_output_alone_is_that_of_all_of_them(layers, kernel):
    """The slow way: every layer at every node, by torch's own dilated convolution."""
    convolution = CausalConvolution(3, 5, layers, kernel)
    values = torch.randn(3, 40)
    every = values
    for i, layer in enumerate(convolution.layers):
        every = torch.relu(every) if i else every
        every = layer(nn.functional.pad(every, ((kernel - 1) * 2**i, 0)))
    close(outputs(convolution, values), every.detach(), 1e-5)


def test_three_layers_with_kernel_three_look_fourteen_nodes_back():
    """(K − 1)(1 + 2 + 4) = 14; all weights positive, so that no ReLU hides an input."""
    convolution = CausalConvolution(1, 2, 3, 3)
    assert convolution.reach == 15
    for layer in convolution.layers:
        put(layer.weight, layer.weight.abs())
        put(layer.bias, torch.ones(2))
    values = torch.rand(1, 15, 1, requires_grad=True)
    convolution(values, torch.ones(1, 15, 1)).sum().backward()
    assert (values.grad > 0).all()


def test_the_temporal_feature_is_the_gated_last_output():
    encoder = TemporalEncoder(3, 4, 2, 3)
    values = torch.randn(1, 9, 3)
    series = values[0, :6].T
    wanted = torch.tanh(outputs(encoder.content, series)[:, -1]) * torch.sigmoid(outputs(encoder.gate, series)[:, -1])
    close(encoder(values, torch.tensor([6]))[0], wanted.detach())


def test_padded_trajectories_have_the_same_last_output():
    """What follows the trajectory, here the features of other nodes, does not matter, nor do longer trajectories."""
    encoder = TemporalEncoder(3, 4, 3, 3)
    values, lengths = torch.randn(4, 15, 3), torch.tensor([1, 7, 15, 2])
    together = encoder(values, lengths)
    assert together.shape == (4, 4)
    for i, length in enumerate(lengths.tolist()):
        close(together[i], encoder(values[i : i + 1, :length], lengths[i : i + 1])[0].detach())


# The state (Eq. 15–20)


def gru_step(x, h, of_input, of_hidden):
    """Eq. 15–18 for one layer; the weights are stacked as r, z, h."""
    wr, wz, wh = np.split(of_input, 3)
    ur, uz, uh = np.split(of_hidden, 3)
    z = sigmoid(wz @ x + uz @ h)
    r = sigmoid(wr @ x + ur @ h)
    new = np.tanh(wh @ x + r * (uh @ h))
    return z * h + (1 - z) * new


def test_the_state_is_equations_15_to_20():
    """Three decisions in a row: two layers of the cell by hand, then the attention over the two."""
    encoder = StateEncoder(5, 4)
    weights = {name: parameter.detach().numpy().astype(float) for name, parameter in encoder.named_parameters()}
    assert {name for name in weights if name.startswith("gru.")} == {
        f"gru.weight_{kind}_l{layer}" for kind in ("ih", "hh") for layer in (0, 1)
    }  # no bias
    hidden = 0.5 * torch.randn(2, 1, 4)
    own = hidden[:, 0].numpy().astype(float)
    for _ in range(3):
        pooled = torch.randn(1, 5)
        state, hidden = encoder(pooled, hidden)
        below = pooled[0].numpy().astype(float)
        for layer in (0, 1):
            own[layer] = gru_step(
                below, own[layer], weights[f"gru.weight_ih_l{layer}"], weights[f"gru.weight_hh_l{layer}"]
            )
            below = own[layer]
        scores = np.exp(own @ weights["attention.score.weight"][0] + weights["attention.score.bias"][0])
        close(hidden[:, 0].detach(), own, 1e-5)
        close(state[0].detach(), scores @ own / scores.sum(), 1e-5)


def test_states_of_a_batch_do_not_mix():
    encoder = StateEncoder(5, 4)
    pooled, hidden = torch.randn(3, 5), torch.randn(2, 3, 4)
    state, after = encoder(pooled, hidden)
    for i in range(3):
        alone, own = encoder(pooled[i : i + 1], hidden[:, i : i + 1].contiguous())
        close(state[i], alone[0].detach())
        close(after[:, i], own[:, 0].detach())


# Noise


def generators(*seeds):
    return [np.random.default_rng(seed) for seed in seeds]


def test_the_noisy_layer_without_noise_is_that_of_the_means():
    layer, values = NoisyLinear(3, 4), torch.randn(2, 5, 3)
    wanted = nn.functional.linear(values, layer.mean.weight, layer.mean.bias)
    assert torch.equal(layer(values), wanted)


def test_the_noisy_layer_has_explicitly_swayed_weights():
    """W = μ + σ ⊙ (ε_out ε_inᵀ) and b = μ_b + σ_b ⊙ ε_out, for each graph its own."""
    layer, values = NoisyLinear(3, 4), torch.randn(2, 5, 3)
    put(layer.sigma_weight, torch.rand(4, 3))
    put(layer.sigma_bias, torch.rand(4))
    noise = Noise.draw(generators(1, 2), 3, 4, 0.0)
    found = layer(values, noise)
    for i in range(2):
        weight = layer.mean.weight + layer.sigma_weight * torch.outer(noise.outputs[i], noise.inputs[i])
        bias = layer.mean.bias + layer.sigma_bias * noise.outputs[i]
        close(found[i], (values[i] @ weight.T + bias).detach())


def test_the_noise_starts_with_the_published_size():
    """σ₀ / √p with σ₀ = 0.5 (Fortunato et al. 2018)."""
    layer = NoisyLinear(16, 3)
    close(layer.sigma_weight, np.full((3, 16), 0.125))
    close(layer.sigma_bias, np.full(3, 0.125))


def test_noise_is_reproducible_and_one_generator_serves_one_episode():
    first, again = Noise.draw(generators(1, 2, 3), 6, 4, 0.5), Noise.draw(generators(1, 2, 3), 6, 4, 0.5)
    other = Noise.draw(generators(9, 2), 6, 4, 0.5)
    for name in ("inputs", "outputs", "kept"):
        assert torch.equal(getattr(first, name), getattr(again, name))
        assert torch.equal(getattr(first, name)[1], getattr(other, name)[1])
    assert not torch.equal(first.inputs[0], other.inputs[0])
    assert not torch.equal(first.inputs[0], first.inputs[1])
    assert not torch.equal(first.outputs[0], first.outputs[1])
    assert (first.inputs.shape, first.outputs.shape, first.kept.shape) == ((3, 6), (3, 4), (3, 6))


def test_noise_of_some_episodes():
    noise = Noise.draw(generators(1, 2, 3), 6, 4, 0.5)
    some = noise[[2, 0]]
    for name in ("inputs", "outputs", "kept"):
        assert torch.equal(getattr(some, name), getattr(noise, name)[[2, 0]])


def test_factors_are_signed_roots_of_normals():
    """Both signs alike, E ε² = E |x| = √(2 / π), and E ε⁴ = E x² = 1."""
    noise = Noise.draw(generators(*range(100)), 200, 200, 0.0)
    for factors in (noise.inputs, noise.outputs):
        assert abs(float(factors.mean())) < 0.03
        assert float(factors.square().mean()) == pytest.approx(math.sqrt(2 / math.pi), abs=0.03)
        assert float(factors.pow(4).mean()) == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("rate", [0.0, 0.2, 0.7])
def test_dropout_masks_drop_about_the_rate_and_keep_the_mean(rate):
    kept = Noise.draw(generators(*range(200)), 200, 1, rate).kept
    dropped = float((kept == 0).float().mean())
    assert dropped == pytest.approx(rate, abs=5 * math.sqrt(rate * (1 - rate) / kept.numel()))
    close(kept[kept != 0], np.full(int((kept != 0).sum()), 1 / (1 - rate)))
    if rate:  # channels are dropped one by one, not episodes as a whole nor the same ones in all
        assert 0 < float((kept[0] == 0).float().mean()) < 1
        assert not torch.equal(kept[0], kept[1])


def test_a_graph_of_one_node_has_its_own_features_as_mean():
    graph = ExplorationGraph(np.ones((1, 5), np.float32), np.zeros((1, 1), np.float32), 1, 1)
    batch = GraphBatch.of([graph])
    close(batch.mean(batch.features), np.ones((1, 5)))
    close(normalized(batch.adjacency), [[[1.0]]])
