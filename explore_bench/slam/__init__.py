"""What the robot makes of what it senses. Never imports the simulator.

For strategies: `Belief`, `predict`, and the entropies of Eq. 5 and 6.
"""

from explore_bench.slam.belief import Belief, Elimination
from explore_bench.slam.linearization import Linearization
from explore_bench.slam.occupancy import OCCUPIED_ABOVE, renyi_entropy, shannon_entropy
from explore_bench.slam.prediction import Prediction, predict

__all__ = [
    "OCCUPIED_ABOVE",
    "Belief",
    "Elimination",
    "Linearization",
    "Prediction",
    "predict",
    "renyi_entropy",
    "shannon_entropy",
]
