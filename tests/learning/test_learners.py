"""How the networks learn: returns, replay and policy gradient, on maps that are explored in a few decisions."""

import copy
import dataclasses
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from handmade_graphs import random_graph, random_set

from baselines.learned.belief_attention import BeliefAttention
from baselines.learned.checkpoint import load_state, save_state
from baselines.learned.gcn import GCN
from baselines.learned.graph_stnn import GraphSTNN
from baselines.training import policy_gradient, replay, returns as returns_module
from baselines.training.learner import DivergedError
from baselines.training.policy_gradient import (
    PolicyGradientLearner,
    PolicyGradientSettings,
    advantage_estimates,
    objective_changes,
)
from baselines.training.replay import ReplayLearner, ReplaySettings, Transition
from baselines.training.returns import ReturnsLearner, ReturnsSettings, cut_returns, returns
from explore_bench.trial.decision_process import Course
from explore_bench.world.scenarios import PAPER

torch.set_num_threads(1)

COURSE = Course(PAPER.replace(size=10.0, landmark_count=1, obstacle_count=2), "train", 3)
"""Episodes of one to three decisions."""

KINDS = {
    "returns": (GraphSTNN, ReturnsLearner, ReturnsSettings()),
    "replay": (GCN, ReplayLearner, ReplaySettings(batch=4, warm_up=2, decisions_per_update=2)),
    "policy gradient": (BeliefAttention, PolicyGradientLearner, PolicyGradientSettings(batch=4)),
}
each_kind = pytest.mark.parametrize("kind", KINDS)


def made(kind, seed=0, **settings):
    """Return a learner whose network depends on the seed alone."""
    network, learner, usual = KINDS[kind]
    torch.manual_seed(seed)
    return learner(network(), COURSE, dataclasses.replace(usual, **settings))


def weights(network):
    return {name: tensor.detach().clone() for name, tensor in network.state_dict().items()}


def same(one, other):
    """Whether two sets of named tensors are equal to the last bit, not-a-numbers included."""
    assert one.keys() == other.keys()
    return all(torch.equal(one[name].nan_to_num(9e9), other[name].nan_to_num(9e9)) for name in one)


def rate_of(learner):
    (group,) = learner.optimizer.param_groups
    return group["lr"]


def record_play(monkeypatch, module):
    """Record what a learner is asked in its next episodes: rounds of (waiting, observations, choices)."""
    rounds, play = [], module.play

    def recording(course, numbers, act):
        def watched(waiting, observations):
            choices = act(waiting, observations)
            rounds.append((list(waiting), list(observations), list(choices)))
            return choices

        return play(course, numbers, watched)

    monkeypatch.setattr(module, "play", recording)
    return rounds


def of_episode(rounds, i):
    """Return the observations and the choices of one of the episodes of some rounds."""
    mine = [(seen[w.index(i)], choices[w.index(i)]) for w, seen, choices in rounds if i in w]
    return [observation for observation, _ in mine], [choice for _, choice in mine]


# Sums


def test_returns_by_hand():
    """3; 2 + 3 / 2; 1 + 3.5 / 2."""
    np.testing.assert_allclose(returns([1.0, 2.0, 3.0], 0.5), [2.75, 3.5, 3.0])
    np.testing.assert_allclose(returns([1.0, 2.0, 3.0], 0.0), [1.0, 2.0, 3.0])
    np.testing.assert_allclose(returns([1.0, -2.0, 3.0], 1.0), [2.0, 1.0, 3.0])
    assert returns([], 0.9).shape == (0,)


def test_returns_that_are_cut_off_by_hand():
    """γ = 0.5, m = 2: 1 + 0.5 · 2 + 0.25 · 30, 2 + 0.5 · 3 + 0.25 · 40, 3 + 0.5 · 4, 4; m beyond the end cuts none."""
    sums = returns([1.0, 2.0, 3.0, 4.0], 0.5)
    values = np.array([10.0, 20.0, 30.0, 40.0])
    np.testing.assert_allclose(cut_returns(sums, values, 0.5, 2), [9.5, 13.5, 5.0, 4.0])
    np.testing.assert_allclose(cut_returns(sums, values, 0.5, 1), [11.0, 17.0, 23.0, 4.0])
    for reach in (4, 5, 9):
        np.testing.assert_array_equal(cut_returns(sums, values, 0.5, reach), sums)


def test_the_loss_with_a_reach_is_that_of_equation_21(monkeypatch):
    learner = made("returns", reach=1, dropout=0.0, discount=0.8)
    before = copy.deepcopy(learner.network)
    rounds = record_play(monkeypatch, returns_module)
    (episode,), loss = learner.improve([0])
    noise, hidden, values = before.noise([COURSE.generator(0, "learning")], 0.0), before.start(1), []
    for observation in of_episode(rounds, 0)[0]:
        with torch.no_grad():
            own, hidden = before(before.collate([before.read(observation)]), hidden, noise)
        values.append(float(own.max()))
    assert len(values) > 1
    wanted = [gain + 0.8 * value for gain, value in zip(episode.rewards, [*values[1:], 0.0], strict=True)]
    assert loss == pytest.approx(0.5 * np.mean((np.array(values) - wanted) ** 2), rel=1e-4)


def test_advantages_by_hand():
    """δ = 1 + 0.5·4 − 2 = 1, 0 + 0.5·2 − 4 = −3, 5 − 2 = 3; then the sums with γ λ = 0.5 · 0.4."""
    found = advantage_estimates(np.array([1.0, 0.0, 5.0]), [2.0, 4.0, 2.0], 0.5, 0.4)
    np.testing.assert_allclose(found, [1.0 + 0.2 * (-3.0 + 0.2 * 3.0), -3.0 + 0.2 * 3.0, 3.0])


def test_advantages_with_a_trace_of_one_are_returns_less_values():
    rng = np.random.default_rng(0)
    rewards, values = rng.normal(size=6), rng.normal(size=6)
    found = advantage_estimates(rewards, values.tolist(), 0.9, 1.0)
    np.testing.assert_allclose(found, returns(rewards.tolist(), 0.9) - values)


def test_changes_of_the_objective_by_hand():
    """25 cells; decisions at steps 0 and 5 with the largest traces 1 and e², the end at step 15 with e⁶."""
    episode = SimpleNamespace(number=1, last=SimpleNamespace(step=15, peak_trace=math.exp(6)))
    marks = [(0, 0.0), (5, 1.0)]
    np.testing.assert_allclose(objective_changes(episode, marks, COURSE), [-2 * 5 / 25 - 1.0, -2 * 10 / 25 - 2.0])
    by_turns = dataclasses.replace(COURSE, scales=(1.0, 1.2))
    np.testing.assert_allclose(objective_changes(episode, marks, by_turns), [-2 * 5 / 36 - 1.0, -2 * 10 / 36 - 2.0])


# All learners


@each_kind
@pytest.mark.parametrize("count", [2, 3])
def test_as_many_episodes_as_asked_for(kind, count):
    learner = made(kind)
    before = weights(learner.network)
    learner.improve(range(4))  # replay learns only from what it remembers
    episodes, loss = learner.improve(range(4, 4 + count))
    assert [episode.number for episode in episodes] == list(range(4, 4 + count))
    assert all(len(episode.rewards) >= 1 and episode.last is not None for episode in episodes)
    assert math.isfinite(loss)
    assert not same(before, weights(learner.network))


@each_kind
def test_learning_is_reproducible(kind):
    one, other = made(kind), made(kind)
    for first in (0, 3):
        torch.manual_seed(first)  # nothing may depend on what others drew
        found, loss = one.improve(range(first, first + 3))
        torch.manual_seed(99)
        again, other_loss = other.improve(range(first, first + 3))
        assert [episode.rewards for episode in found] == [episode.rewards for episode in again]
        assert loss == other_loss or (math.isnan(loss) and math.isnan(other_loss))
    assert same(weights(one.network), weights(other.network))


def test_episodes_at_once_are_those_of_the_settings():
    assert made("returns", episodes_per_update=5).episodes_at_once == 5
    assert made("replay", episodes_at_once=5).episodes_at_once == 5
    assert made("policy gradient", episodes_per_update=5).episodes_at_once == 5


@each_kind
def test_a_loss_that_is_no_number_changes_nothing(kind):
    learner = made(kind)
    learner.improve(range(3))
    learner.improve(range(3, 6))
    with torch.no_grad():
        next(learner.network.parameters())[0] = math.nan
    before = copy.deepcopy(learner.tensors())
    assert any(name.startswith("optimizer.") for name in before)
    with pytest.raises(DivergedError, match="nan"):
        learner.improve(range(6, 9))
    assert same(before, learner.tensors())


@each_kind
def test_a_gradient_that_is_infinite_changes_nothing(kind):
    """Even where the loss is finite."""
    learner = made(kind, clip=1.0)
    learner.improve(range(3))
    before = copy.deepcopy(learner.tensors())
    for parameter in learner.network.parameters():
        parameter.register_hook(lambda gradient: torch.full_like(gradient, math.inf))
    with pytest.raises(DivergedError, match="gradient"):
        learner.improve(range(3, 6))
    assert same(before, learner.tensors())


@each_kind
def test_gradients_are_clipped(kind):
    """Norms of what the optimizer steps with."""
    learner, norms = made(kind, clip=1e-3), []
    step = learner.optimizer.step

    def watched():
        norms.append(math.sqrt(sum(float(p.grad.square().sum()) for p in learner.network.parameters())))
        return step()

    learner.optimizer.step = watched
    learner.improve(range(3))
    learner.improve(range(3, 6))
    assert norms
    assert max(norms) <= 1e-3 * 1.001


@pytest.mark.parametrize("kind", ["returns", "policy gradient"])
def test_learning_goes_on_from_a_checkpoint_as_if_it_had_never_stopped(kind, tmp_path):
    through = made(kind)
    through.improve(range(3))
    save_state(tmp_path / "state", through.tensors(), {"counters": through.counters()})
    wanted = [through.improve(range(first, first + 3))[1] for first in (3, 6)]
    resumed = made(kind, seed=77)
    tensors, facts = load_state(tmp_path / "state")
    resumed.restore(tensors, facts["counters"])
    found = [resumed.improve(range(first, first + 3))[1] for first in (3, 6)]
    assert found == wanted
    assert same(through.tensors(), resumed.tensors())


def test_the_replay_learner_restores_all_but_its_memory(tmp_path):
    through = made("replay", target_every=2)
    for first in (0, 3, 6):
        through.improve(range(first, first + 3))
    assert through.updates > 2
    save_state(tmp_path / "state", through.tensors(), {"counters": through.counters()})
    resumed = made("replay", seed=77, target_every=2)
    tensors, facts = load_state(tmp_path / "state")
    resumed.restore(tensors, facts["counters"])
    assert (resumed.decisions, resumed.updates) == (through.decisions, through.updates)
    assert same(through.tensors(), resumed.tensors())
    assert same(weights(through.target), weights(resumed.target))
    assert resumed.exploration() == through.exploration()
    resumed.improve(range(9, 12))
    resumed.improve(range(12, 15))
    assert resumed.updates > through.updates


# Returns (Eq. 21–24)


def test_the_loss_of_an_update_is_equation_23(monkeypatch):
    """A second pass, one episode after another, with the noise of each and the values of the actions taken."""
    numbers, settings = range(2, 6), ReturnsSettings(dropout=0.4, final_dropout=0.1, discount=0.8, decay=10)
    learner = made("returns", **vars(settings))
    before = copy.deepcopy(learner.network)
    rounds = record_play(monkeypatch, returns_module)
    episodes, loss = learner.improve(numbers)
    rate = 0.4 - 0.2 * (0.4 - 0.1)
    losses = []
    for i, (number, episode) in enumerate(zip(numbers, episodes, strict=True)):
        noise = before.noise([COURSE.generator(number, "learning")], rate)
        hidden, squares = before.start(1), []
        observations, choices = of_episode(rounds, i)
        assert len(choices) == len(episode.rewards)
        gains = returns(episode.rewards, 0.8)
        for observation, choice, gain in zip(observations, choices, gains, strict=True):
            with torch.no_grad():
                values, hidden = before(before.collate([before.read(observation)]), hidden, noise)
            assert int(values[0].argmax()) == choice
            squares.append((float(values[0, choice]) - gain) ** 2)
        losses.append(0.5 * np.mean(squares))
    assert max(len(episode.rewards) for episode in episodes) > 1
    assert loss == pytest.approx(np.mean(losses), rel=1e-4)


def test_the_gradient_goes_through_the_hidden_state(monkeypatch):
    """The step taken is that of the whole loss: the gradient of a second pass over the episode, clipped."""
    learner = made("returns", clip=1e9, dropout=0.2, discount=0.9)
    before = copy.deepcopy(learner.network)
    rounds = record_play(monkeypatch, returns_module)
    (episode,), _ = learner.improve([0])
    observations, choices = of_episode(rounds, 0)
    assert len(choices) > 1
    noise = before.noise([COURSE.generator(0, "learning")], 0.2)
    hidden, squares = before.start(1), []
    for observation, choice, gain in zip(observations, choices, returns(episode.rewards, 0.9), strict=True):
        values, hidden = before(before.collate([before.read(observation)]), hidden, noise)
        squares.append((values[0, choice] - float(gain)) ** 2)
    (0.5 * torch.stack(squares).mean()).backward()
    assert before.state.gru.weight_hh_l0.grad.any()
    for (name, own), wanted in zip(learner.network.named_parameters(), before.parameters(), strict=True):
        torch.testing.assert_close(own.grad, wanted.grad, atol=1e-5, rtol=1e-3, msg=name)


def test_the_noise_is_one_for_all_decisions_of_an_episode(monkeypatch):
    learner, seen = made("returns"), []
    learner.network.register_forward_pre_hook(lambda _, given: seen.append(given[2]))
    rounds = record_play(monkeypatch, returns_module)
    learner.improve(range(4))
    assert len(seen) == len(rounds) > 1
    for name in ("inputs", "outputs", "kept"):
        own = [[] for _ in range(4)]
        for noise, (waiting, _, _) in zip(seen, rounds, strict=True):
            for row, i in enumerate(waiting):
                own[i].append(getattr(noise, name)[row])
        for of_decisions in own:
            assert all(torch.equal(of_decisions[0], later) for later in of_decisions)
        for one, other in itertools.combinations(own, 2):
            assert not torch.equal(one[0], other[0])


def test_the_noise_of_an_episode_is_that_of_its_number():
    """Whatever episodes are played beside it, and other noise in the next update."""
    drawn = {}
    for numbers in (range(2), range(1, 3), range(2, 4)):
        learner = made("returns")
        seen = []
        learner.network.register_forward_pre_hook(lambda _, given, seen=seen: seen.append(given[2]))
        learner.improve(numbers)
        for row, number in enumerate(numbers):
            drawn.setdefault(number, []).append(seen[0].inputs[row])
    assert torch.equal(*drawn[1])
    assert torch.equal(*drawn[2])
    assert not torch.equal(drawn[0][0], drawn[3][0])


@pytest.mark.parametrize(("number", "share"), [(0, 0.0), (5, 0.5), (9, 0.9), (40, 1.0)])
def test_the_rates_of_returns_fall_linearly(number, share):
    learner = made("returns", rate=1e-3, final_rate=1e-4, dropout=0.4, final_dropout=0.1, decay=10)
    rates, noise = [], learner.network.noise
    learner.network.noise = lambda rngs, rate: rates.append(rate) or noise(rngs, rate)
    learner.improve([number])
    assert rate_of(learner) == pytest.approx(1e-3 - share * 9e-4)
    assert rates == [pytest.approx(0.4 - share * 0.3)]
    assert f"dropout {0.4 - share * 0.3:.2f}" in learner.exploration()


@pytest.mark.parametrize(
    ("episode", "rate"),
    [(0, 1.0), (50, 0.55), (99, 0.109), (100, 0.5), (125, 0.3), (150, 0.25), (175, 0.125), (190, 0.1), (10_000, 0.1)],
)
def test_the_rate_of_returns_falls_again_from_half_as_high_and_half_as_long(episode, rate):
    settings = ReturnsSettings(rate=1.0, final_rate=0.1, restart=0.5, decay=100)
    assert settings.rate_at(episode) == pytest.approx(rate)
    once = dataclasses.replace(settings, restart=0.0)
    assert once.rate_at(episode) == pytest.approx(rate if episode < 100 else 0.1)


# Replay ([8])


def replaying(**settings):
    """Return a learner without dropout, whose target network is another one than the acting network."""
    learner = made("replay", dropout=0.0, discount=0.5, **settings)
    with torch.no_grad():
        for parameter in learner.target.parameters():
            parameter.add_(0.1 * torch.randn_like(parameter))
    return learner


def q_values(network, graph):
    with torch.no_grad():
        return network(network.collate([graph]), network.start(1))[0][0]


class Each:
    """A generator that draws each of the transitions once."""

    def integers(self, high, size):
        assert size == high
        return np.arange(high)


def squared_error(learner, transition):
    wanted = transition.reward
    if transition.then is not None:
        wanted += 0.5 * float(q_values(learner.target, transition.then).max())
    return (float(q_values(learner.network, transition.graph)[transition.choice]) - wanted) ** 2


@pytest.mark.parametrize("ends", [(True,), (False,), (True, False, False, True), (False, True, False)])
def test_the_target_of_a_transition_is_its_reward_and_the_best_value_of_the_target_network(ends):
    """At the end of an episode r alone, else r + γ max Q_target."""
    learner, rng = replaying(batch=len(ends)), np.random.default_rng(1)
    for end in ends:
        graph, then = (random_graph(rng, weighted=True) for _ in range(2))
        choice = int(rng.integers(graph.candidates))
        learner._memory.append(Transition(graph, choice, float(rng.normal()), None if end else then))
    wanted = np.mean([squared_error(learner, transition) for transition in learner._memory])
    assert learner._update(Each()) == pytest.approx(wanted, rel=1e-4)
    assert learner.updates == 1


def test_the_target_network_learns_nothing_itself_and_is_copied_now_and_then():
    learner, rng = replaying(batch=1, target_every=3), np.random.default_rng(2)
    learner._memory.append(Transition(random_graph(rng), 0, 1.0, random_graph(rng)))
    before = weights(learner.target)
    for updates in range(1, 7):
        learner._update(Each())
        if updates < 3:
            assert same(weights(learner.target), before)
        elif updates == 3:
            assert same(weights(learner.target), weights(learner.network))
            before = weights(learner.target)
        elif updates < 6:
            assert same(weights(learner.target), before)
    assert same(weights(learner.target), weights(learner.network))


def test_the_memory_holds_what_was_seen_done_and_earned(monkeypatch):
    learner = made("replay", warm_up=10_000)
    rounds = record_play(monkeypatch, replay)
    episodes, loss = learner.improve(range(3))
    assert math.isnan(loss)
    assert learner.updates == 0
    remembered = list(learner._memory)
    assert len(remembered) == learner.decisions == sum(len(episode.rewards) for episode in episodes)
    for i, episode in enumerate(episodes):
        own, remembered = remembered[: len(episode.rewards)], remembered[len(episode.rewards) :]
        observations, choices = of_episode(rounds, i)
        assert [transition.choice for transition in own] == choices
        assert [transition.reward for transition in own] == episode.rewards
        for transition, observation in zip(own, observations, strict=True):
            np.testing.assert_array_equal(transition.graph.features, learner.network.read(observation).features)
        assert [transition.then for transition in own] == [*(later.graph for later in own[1:]), None]


def test_the_memory_forgets_the_oldest():
    learner = made("replay", memory=4, warm_up=10_000)
    learner.improve(range(2))
    first = list(learner._memory)
    learner.improve(range(2, 6))
    assert len(learner._memory) == 4
    assert not set(map(id, first)) & set(map(id, learner._memory))


def test_gradient_steps_come_with_decisions_after_the_warm_up():
    """A step for every two decisions, from the first one on that finds two transitions."""
    learner = made("replay", decisions_per_update=2, warm_up=1)
    learner.improve(range(2))
    assert learner.updates == 0  # episodes are remembered when they have ended
    before = learner.decisions
    learner.improve(range(2, 5))
    assert learner.updates == (learner.decisions - before) // 2


@pytest.mark.parametrize(("decisions", "share"), [(0, 0.0), (50, 0.5), (100, 1.0), (400, 1.0)])
def test_the_rates_of_replay_fall_linearly_with_the_decisions(decisions, share):
    learner = made("replay", rate=1e-3, final_rate=1e-4, exploration=0.8, decay=100)
    learner._memory.append(Transition(random_graph(np.random.default_rng(3)), 0, 1.0, None))
    learner.decisions = decisions
    learner._update(np.random.default_rng(4))
    assert rate_of(learner) == pytest.approx(1e-3 - share * 9e-4)
    assert learner.exploration() == f"dropout {0.8 * (1 - share):.2f}"


def test_the_acting_network_drops_out_as_long_as_it_explores():
    """The noise that it acts with, and none at the end."""
    for decisions, rate in ((0, 0.8), (50, 0.4), (200, 0.0)):
        learner, rates = made("replay", warm_up=10_000, exploration=0.8, decay=100), []
        learner.network.register_forward_pre_hook(lambda _, given, rates=rates: rates.append(given[2]))
        learner.decisions = decisions
        learner.improve([0])
        assert rates[0] == pytest.approx(rate)


# Policy gradient


def test_the_first_loss_of_the_policy_gradient_by_hand(monkeypatch):
    """Half the squared error of the values, less the entropy; ratios are 1, so that normalized advantages cancel."""
    learner = made(
        "policy gradient", passes=1, batch=1000, discount=0.9, entropy=0.3, final_entropy=0.1, decay=100, trace=0.7
    )
    before = copy.deepcopy(learner.network)
    rounds = record_play(monkeypatch, policy_gradient)
    episodes, loss = learner.improve(range(20, 24))
    squares, entropies = [], []
    for i, episode in enumerate(episodes):
        observations, choices = of_episode(rounds, i)
        assert len(choices) == len(episode.rewards)
        with torch.no_grad():
            read = [before.preferences_and_value(before.collate([before.read(seen)])) for seen in observations]
        values = [float(value) for _, value in read]
        peaks = [float(np.trace(seen.belief.pose_covariances, axis1=1, axis2=2).max()) for seen in observations]
        logs = np.log(np.sqrt([*peaks, episode.last.peak_trace]))
        steps = [*(seen.step for seen in observations), episode.last.step]
        rewards = -2 * np.diff(steps) / 25 - np.diff(logs)
        gains = advantage_estimates(rewards, values, 0.9, 0.7)
        squares += (gains**2).tolist()  # the target is the value and the advantage
        entropies += [float(torch.distributions.Categorical(logits=logits[0]).entropy()) for logits, _ in read]
    weight = 0.3 - 0.2 * (0.3 - 0.1)
    assert loss == pytest.approx(0.5 * np.mean(squares) - weight * np.mean(entropies), rel=1e-3, abs=1e-5)
    assert learner.exploration() == f"entropy {np.mean(entropies):.2f}"


def test_choices_are_drawn_from_the_policy(monkeypatch):
    """How often the first candidate is taken, within four standard deviations of what the policy says."""
    learner = made("policy gradient", rate=0.0, final_rate=0.0, passes=1, batch=1000)
    rounds = record_play(monkeypatch, policy_gradient)
    taken, wanted, variance = 0.0, 0.0, 0.0
    for first in range(0, 120, 40):
        rounds.clear()
        learner.improve(range(first, first + 40))
        for _, observations, choices in rounds:
            for observation, choice in zip(observations, choices, strict=True):
                with torch.no_grad():
                    logits, _ = learner.network.preferences_and_value(
                        learner.network.collate([learner.network.read(observation)])
                    )
                share = float(torch.softmax(logits[0], dim=0)[0])
                taken, wanted, variance = taken + (choice == 0), wanted + share, variance + share * (1 - share)
    assert abs(taken - wanted) < 4 * math.sqrt(variance)


def test_a_ratio_beyond_the_clip_range_has_no_gradient():
    """Only where the policy has moved in the direction of the advantage; where it has moved away it is drawn back."""
    learner = made("policy gradient", passes=1, entropy=0.0, final_entropy=0.0, batch=1000)
    rng = np.random.default_rng(5)
    sets = [random_set(rng) for _ in range(2)]
    preferences, value = learner.network.preferences_and_value(learner.network.collate(sets))
    logs = torch.log_softmax(preferences, dim=1)[:, 0].detach()
    choices, targets = torch.zeros(2, dtype=torch.long), value.detach()

    def gradient_of_preferences(shift):
        learner.optimizer.zero_grad()
        learner._learn(rng, sets, choices, logs + shift, torch.tensor([1.0, -1.0]), targets, 0)
        return learner.network.preference[2].weight.grad

    before = weights(learner.network)
    assert gradient_of_preferences(torch.zeros(2)).any()
    learner.network.load_state_dict(before)
    assert not gradient_of_preferences(torch.tensor([-1.0, 1.0])).any()  # good and likelier, bad and unlikelier
    learner.network.load_state_dict(before)
    assert gradient_of_preferences(torch.tensor([1.0, -1.0])).any()  # good and unlikelier, bad and likelier


@pytest.mark.parametrize(("number", "share"), [(0, 0.0), (5, 0.5), (10, 1.0), (40, 1.0)])
def test_the_rate_of_the_policy_gradient_falls_linearly(number, share):
    learner = made("policy gradient", rate=1e-3, final_rate=1e-4, decay=10)
    learner.improve(range(number, number + 3))
    assert rate_of(learner) == pytest.approx(1e-3 - share * 9e-4)


def test_a_single_decision_can_be_learned_from():
    learner = made("policy gradient")
    assert all(math.isfinite(learner.improve([number])[1]) for number in range(8))


@pytest.mark.parametrize("kind", ["returns", "policy gradient"])
def test_episodes_without_a_decision_teach_nothing(kind):
    network, learner, settings = KINDS[kind]
    course = Course(PAPER.replace(size=4.0, landmark_count=0, obstacle_count=0), "train", 0)
    episodes, loss = learner(network(), course, settings).improve([0, 1])
    assert [episode.rewards for episode in episodes] == [[], []]
    assert math.isnan(loss)
