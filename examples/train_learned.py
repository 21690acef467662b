"""Train `learned.py`'s network by policy gradient on training worlds, in under a minute on one core.

    python examples/train_learned.py --output learned.safetensors

REINFORCE (Williams 1992): candidates are drawn by the softmax of their scores; an episode is worth its exploration
efficiency η, less the mean of the batch. Worlds and noise come from the streams of purpose `train`, which no trial of
the benchmark shares, so nothing of what is measured later has been seen.
"""

import argparse
from pathlib import Path

import numpy as np
import torch
from learned import Network, features
from safetensors.torch import save_file

from explore_bench import Scenario, Step, draw_world, rollout, stream

BATCH = 8
RATE = 0.02


def play(network: Network, scenario: Scenario, seed: int, episode: int) -> tuple[torch.Tensor, float]:
    """Log-probability of the choices of an episode, and η, what it was worth [m²/step]."""

    def generator(role: str) -> np.random.Generator:
        return stream("train", seed, scenario.size, episode, role)

    draws = torch.Generator().manual_seed(int(generator("learning").integers(2**62)))
    events = rollout(scenario, draw_world(scenario, generator("world")), generator("motion"), generator("sensor"))
    log_probability, last, event = torch.zeros(()), None, next(events)
    while event is not None:
        if isinstance(event, Step):
            last, choice = event, None
        else:
            log_probabilities = torch.log_softmax(network(features(event)), dim=0)
            choice = int(torch.multinomial(log_probabilities.detach().exp(), 1, generator=draws))
            log_probability = log_probability + log_probabilities[choice]
        try:
            event = events.send(choice)
        except StopIteration:
            event = None
    return log_probability, (scenario.prior_uncertainty - last.uncertainty) / max(last.step, 1)


def train(output: Path, batches: int, seed: int, size: float) -> None:
    """Train a network and write its weights."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    network, scenario = Network(), Scenario(size=size)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    for batch in range(batches):
        episodes = [play(network, scenario, seed, batch * BATCH + i) for i in range(BATCH)]
        worth = torch.tensor([value for _, value in episodes])
        advantage = (worth - worth.mean()) / (worth.std() + 1e-6)
        loss = -(torch.stack([log_probability for log_probability, _ in episodes]) * advantage).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        print(f"{(batch + 1) * BATCH:4d} episodes: mean efficiency {worth.mean():.3f} m²/step", flush=True)
    save_file(network.state_dict(), output, {"command": f"train_learned.py --batches {batches} --seed {seed}"})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("learned.safetensors"))
    parser.add_argument("--batches", type=int, default=60, help=f"of {BATCH} episodes each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=float, default=20.0, help="edge of the map [m]")
    options = parser.parse_args()
    train(options.output, options.batches, options.seed, options.size)
