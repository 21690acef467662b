"""Train MaskablePPO of sb3-contrib on maps of 20 m, and export its policy for `maskable_ppo.py`.

    pip install 'explore-bench[gym]' sb3-contrib
    python train_maskable_ppo.py

One core for under two minutes. The worlds come from the streams of purpose `train`: none is one of the benchmark's.
"""

import argparse
from pathlib import Path

import gymnasium
import torch
from maskable_ppo import COLUMNS
from safetensors.torch import save_file
from sb3_contrib import MaskablePPO
from stable_baselines3.common.monitor import Monitor

import explore_bench.gymnasium  # registers the environments

gymnasium.register_envs(explore_bench.gymnasium)


def train(decisions: int, seed: int, verbose: int = 1) -> MaskablePPO:
    """Learn from a number of decisions; the same seed gives the same policy again on the same machine."""
    torch.set_num_threads(1)
    model = MaskablePPO(
        "MultiInputPolicy",
        Monitor(gymnasium.make("ExploreBench-20m-v0")),
        seed=seed,
        n_steps=512,
        batch_size=128,
        learning_rate=lambda remaining: 1e-3 * remaining,
        gamma=0.9,  # most of what a decision is worth shows in the next few
        gae_lambda=0.9,
        ent_coef=0.01,
        verbose=verbose,
    )
    return model.learn(decisions)


def export(model: MaskablePPO, path: Path) -> None:
    """Write the layers from an observation to the logits of the actions: numbers only, where `save` would pickle."""
    hidden = [layer for layer in model.policy.mlp_extractor.policy_net if isinstance(layer, torch.nn.Linear)]
    tensors = {
        f"{i}.{name}": values.detach().clone()
        for i, layer in enumerate([*hidden, model.policy.action_net])
        for name, values in layer.named_parameters()
    }
    save_file(tensors, path, COLUMNS)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--decisions", type=int, default=12_288, help="how many to learn from")
    parser.add_argument("--seed", type=int, default=0, help="of worlds, network and exploration")
    parser.add_argument("--output", type=Path, default=Path("maskable_ppo.safetensors"), help="file to write")
    given = parser.parse_args()
    export(train(given.decisions, given.seed), given.output)
    print(f"the policy is in {given.output}")
