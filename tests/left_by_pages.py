"""What is to be true of the files that the commands of some pages leave: measurements and trainings of minutes.

The slow test of a page asks it, lest another one make them a second time.
"""

import statistics

import numpy as np
import pandas as pd
from handmade import record

from explore_bench.analysis.metrics import METRICS
from explore_bench.analysis.statistics import paired_difference
from explore_bench.runs.perf import read_json
from explore_bench.trial.run import run_trial
from explore_bench.trial.spec import Status, TrialSpec
from explore_bench.trial.steps import step_columns
from explore_bench.world.scenarios import PAPER

WORLDS = 30


def costs_are_no_blunder(folder):
    """The goals at 20 m are 4 and 4; a busy machine and the mix of steps swing both."""
    numbers = read_json(folder / "perf.json")
    assert numbers.step_to_isam2_ratio["20"] < 8.0
    assert numbers.step_growth_1000_over_100["20"] < 20.0
    assert all(times.times_real_time > 1.0 for times in numbers.scenes)
    assert statistics.median(by_size["20"] for by_size in numbers.decision_ms.values()) > 0.0


def graph_stnn_has_learned(folder):
    """On maps of 20 m, against the network as it begins; the best rule on Eq. 4 without learning has −1.07.

    The last digits of a machine's arithmetic make another training of it: −1.05 was seen on one, less on another.
    """
    from baselines import STRATEGIES
    from baselines.learned.checkpoint import load_state
    from baselines.training.train import Training

    beginner = Training("graph-stnn", STRATEGIES["graph-stnn"], 0, folder / "before")
    beginner.validate()
    [before] = beginner.log.validations
    [after] = load_state(folder / "results" / "training" / "graph-stnn-0.last")[1]["log"]["validations"]
    assert after[0] == 300
    assert after[1] < before[1] - 0.2
    assert after[1] < -0.7


def efficiencies(factory, weights=None):
    """η of a strategy in each validation world."""
    found = {}
    for trial in range(WORLDS):
        result = run_trial(TrialSpec("any", factory, PAPER, trial, purpose="validate", weights=weights))
        assert result.status is not Status.FAILED, result.reason
        columns = {name: [getattr(step, name) for step in result.steps] for name in step_columns("landmark")}
        found[trial] = METRICS["exploration_efficiency"].value(record(result.status.value, PAPER, **columns))
    return found


def maskable_ppo_beats_chance(folder):
    """In worlds that it has not seen; and it entered the benchmark beside the others."""
    plugin = f"{folder / 'examples' / 'maskable_ppo.py'}:MaskablePPO"
    policy = efficiencies(plugin, str(folder / "maskable_ppo.safetensors"))
    difference = paired_difference(policy, efficiencies("baselines.random_walk:Random"))
    assert difference.n == WORLDS
    assert difference.low > 0.0, difference
    assert np.mean(list(policy.values())) > 1.4
    rows = pd.read_csv(folder / "ppo" / "trials.csv")
    assert set(rows["strategy"]) == {'MaskablePPO[weights="maskable_ppo.safetensors"]', "random", "nearest"}
    assert (rows["status"] == "explored").all()


LEFT = {
    "docs/gymnasium.md": maskable_ppo_beats_chance,
    "docs/learning.md": graph_stnn_has_learned,
    "docs/performance.md": costs_are_no_blunder,
}
"""What asks it, by the page."""
