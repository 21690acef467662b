"""How much `entropy` gains from cells that it has seen already, and how often that decides.

    python docs/studies/entropy_fringe.py [--worlds N]

Where the pose is certain, a free cell that was seen once or twice promises more than one never seen: Eq. 6 at a large
order takes the next look to be nearly conclusive. The study plays calibration worlds and asks at every decision which
share of the chosen candidate's gain comes from cells that are known, and whether the choice would be another one if no
known cell could promise more than an unknown one; and it plays that rule ("capped"), too. It writes entropy-fringe.csv
beside this file; docs/protocol.md has the table.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from baselines.entropy import Entropy, information_gain
from explore_bench import PAPER, Observation, Step, draw_world, rollout, stream
from explore_bench.analysis.statistics import mean_interval

WORLDS = 20
SIZES = (20.0, 40.0)
HERE = Path(__file__).parent


def gains(observation: Observation, capped: bool) -> tuple[np.ndarray, np.ndarray]:
    """Gain of each candidate, and the part of it that known cells make up, shapes (N,).

    Where `capped`, a known cell promises no more than an unknown one.
    """
    belief, scenario = observation.belief, observation.scenario
    occupancy, known = belief.occupancy.reshape(-1), belief.known.reshape(-1)
    total, of_known = np.zeros((2, len(observation.candidates)))
    for i, (path, view) in enumerate(zip(observation.paths, belief.view(observation.positions), strict=True)):
        order = 1.0 + 1.0 / float(np.trace(belief.predict(path).pose_covariances[-1]))
        each = np.array([information_gain(occupancy[[cell]], order, scenario) for cell in np.flatnonzero(view)])
        if capped:
            each = np.minimum(each, information_gain(np.array([0.5]), order, scenario))
        total[i], of_known[i] = each.sum(), each[known[view]].sum()
    return total, of_known


def chosen(observation: Observation, total: np.ndarray) -> int:
    """Index of the candidate with the largest gain, the shorter path among equals."""
    return int(np.lexsort((observation.path_lengths, -np.round(total, 9)))[0])


def play(size: float, number: int, capped: bool) -> tuple[int, list[float], list[bool]]:
    """Steps of a trial, and of every decision the share of known cells and whether the other rule differs."""
    scenario, strategy = PAPER.replace(size=size), Entropy()
    drawn, motion, sensor = (stream("calibrate", 0, size, number, role) for role in ("world", "motion", "sensor"))
    events = rollout(scenario, draw_world(scenario, drawn), motion, sensor)
    shares, others, steps, answer = [], [], 0, None
    while True:
        try:
            event = events.send(answer)
        except StopIteration:
            return steps, shares, others
        answer = None
        if isinstance(event, Step):
            steps = event.step
            continue
        total, of_known = gains(event, capped=False)
        own, other = chosen(event, total), chosen(event, gains(event, capped=True)[0])
        assert own == strategy.choose(event)
        shares.append(of_known[own] / total[own])
        others.append(own != other)
        answer = other if capped else own


def main() -> None:
    """Play and print a line a size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=WORLDS)
    worlds, rows = parser.parse_args().worlds, []
    for size in SIZES:
        played = [play(size, number, capped=False) for number in range(worlds)]
        steps = np.array([own[0] for own in played], dtype=float)
        difference = mean_interval(np.array([play(size, number, capped=True)[0] for number in range(worlds)]) - steps)
        rows.append(
            {
                "size [m]": f"{size:g}",
                "worlds": worlds,
                "decisions": sum(len(own[1]) for own in played),
                "gain from known cells": f"{np.mean(np.concatenate([own[1] for own in played])):.0%}",
                "another choice": f"{np.mean(np.concatenate([own[2] for own in played])):.0%}",
                "T": f"{steps.mean():.1f}",
                "T, capped, minus T": f"{difference.mean:.1f} [{difference.low:.1f}, {difference.high:.1f}]",
            }
        )
        print(", ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    pd.DataFrame(rows).to_csv(HERE / "entropy-fringe.csv", index=False)


if __name__ == "__main__":
    main()
