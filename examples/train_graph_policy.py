"""Train `graph_policy.py`'s network by behaviour cloning on training worlds, in a minute or two on one core.

    python examples/train_graph_policy.py --output graph_policy.safetensors

It imitates a rule on the same graph: of the promising nodes, the one with the most utility per metre of drive, a few
metres added. The rule is told the lengths of the drives, which the network has to gather from places and edges. Worlds
and noise come from the streams of purpose `train`, which no trial of the benchmark shares.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from graph_policy import Graph, Network, graph_of
from safetensors.torch import save_file

from explore_bench import Course, Scenario, Target

BATCH, RATE = 16, 2e-3
ADDED = 4.0
"""Metres added to every drive: the nearest node is not always worth most."""

Example = tuple[Graph, int]


def rule(graph: Graph) -> int:
    """Return the promising node with the most utility per metre."""
    worth = graph.nodes[:, 2] / (graph.lengths + ADDED)
    return int(np.where(graph.promising, worth, -np.inf).argmax())


def demonstrations(course: Course, episodes: int) -> list[Example]:
    """Graphs that the rule met, driving, and the nodes that it took."""
    found: list[Example] = []
    for episode in range(episodes):
        process = course.begin(episode)
        while process.observation is not None:
            observation = process.observation
            graph = graph_of(observation)
            if graph.promising.any():
                node = rule(graph)
                found.append((graph, node))
                process.decide(Target(tuple(graph.places[node].tolist())))
            else:
                process.decide(int(observation.path_lengths.argmin()))
    return found


def train(output: Path, episodes: int, epochs: int, seed: int, size: float) -> None:
    """Train a network and write its weights."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    examples = demonstrations(Course(Scenario(size=size), "train", seed), episodes)
    print(f"{episodes} episodes: {len(examples)} choices of the rule", flush=True)
    network, rng = Network(), np.random.default_rng(seed)
    steps = epochs * -(-len(examples) // BATCH)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    rates = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for epoch in range(epochs):
        order, right, total = rng.permutation(len(examples)), 0, 0.0
        for begin in range(0, len(order), BATCH):
            losses = []
            for graph, node in (examples[i] for i in order[begin : begin + BATCH]):
                logits = network.of(graph)
                losses.append(-torch.log_softmax(logits, dim=0)[node])
                right += int(logits.argmax()) == node
            loss = torch.stack(losses).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            rates.step()
            total += float(loss.detach()) * len(losses)
        share = right / len(examples)
        print(f"epoch {epoch + 1}: cross entropy {total / len(examples):.3f}, {share:.0%} as the rule", flush=True)
    command = f"train_graph_policy.py --episodes {episodes} --epochs {epochs} --seed {seed}"
    save_file(network.state_dict(), output, {"command": command})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("graph_policy.safetensors"))
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--epochs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=float, default=20.0, help="edge of the map [m]")
    options = parser.parse_args()
    train(options.output, options.episodes, options.epochs, options.seed, options.size)
