"""The references with a small part of their budget: for tests of what has nothing to do with how good their tours are.

`check` and workers import it as a file, so no module of the references is changed but while one of these chooses.
"""

from unittest.mock import patch

from baselines.reference import clairvoyant, tour
from baselines.reference.accurate import accurate_tour

CHANGES = 50
"""Changes that each annealing tries, instead of 60,000, 12,000 and 5,000."""


def hasty_tour(site, rng, changes=CHANGES):
    """Return the best tour found with few changes of a single greedy one."""
    with patch.object(tour, "GREED", tour.GREED[-1:]):
        return tour.best_tour(site, rng, CHANGES)


def hasty_accurate_tour(site, belief, views, rng):
    return accurate_tour(site, belief, views, rng, CHANGES)


class Hasty(clairvoyant.Clairvoyant):
    """A clairvoyant that plans in a hurry, the same whoever asks, and drives as any."""

    def choose(self, observation):
        with patch.multiple(clairvoyant, best_tour=hasty_tour, accurate_tour=hasty_accurate_tour):
            return super().choose(observation)
