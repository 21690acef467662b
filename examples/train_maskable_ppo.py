"""Train MaskablePPO of sb3-contrib on ExploreBench and export its policy for the plugin `maskable_ppo.py`.

It needs `pip install 'explore-bench[gym]' sb3-contrib` and some two minutes of one core.
"""

import argparse
from pathlib import Path

import gymnasium
import torch
from safetensors.torch import save_file
from sb3_contrib import MaskablePPO
from stable_baselines3.common.monitor import Monitor

import explore_bench.gymnasium  # noqa: F401  (registers the ids)
from explore_bench.features import CANDIDATE_COLUMNS, STATE_COLUMNS

WEIGHTS = Path(__file__).with_name("maskable_ppo.safetensors")


def train(decisions: int, seed: int, env_id: str = "ExploreBench-20m-v0", verbose: int = 1) -> MaskablePPO:
    """Learn for a number of decisions on one core; on one machine a seed gives the same weights again."""
    torch.set_num_threads(1)
    model = MaskablePPO(
        "MultiInputPolicy",
        Monitor(gymnasium.make(env_id)),
        seed=seed,
        n_steps=512,
        batch_size=128,
        n_epochs=10,
        learning_rate=lambda remaining: 1e-3 * remaining,
        gamma=0.9,  # as the baselines learn; the reward is dense
        gae_lambda=0.9,
        ent_coef=0.01,
        verbose=verbose,
    )
    return model.learn(decisions)


def export(model: MaskablePPO, path: Path) -> None:
    """Write the network from an observation to the actions' logits: numbers only, where model.save() would pickle."""
    layers = [layer for layer in model.policy.mlp_extractor.policy_net if isinstance(layer, torch.nn.Linear)]
    layers.append(model.policy.action_net)
    tensors = {}
    for i, layer in enumerate(layers):
        tensors[f"{i}.weight"], tensors[f"{i}.bias"] = layer.weight.detach().clone(), layer.bias.detach().clone()
    save_file(tensors, path, {"candidates": " ".join(CANDIDATE_COLUMNS), "state": " ".join(STATE_COLUMNS)})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--decisions", type=int, default=12_288, help="how many to learn from")
    parser.add_argument("--seed", type=int, default=0, help="of the worlds and of the network")
    parser.add_argument("--out", type=Path, default=WEIGHTS, help="file of the exported policy")
    given = parser.parse_args()
    export(train(given.decisions, given.seed), given.out)
    print(f"policy written to {given.out}")
