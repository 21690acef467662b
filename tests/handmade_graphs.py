"""Random exploration graphs and candidate sets that tests of networks and learners share; nothing here is a test."""

import dataclasses

import numpy as np

from baselines.learned.candidate_features import BLOCK_COLUMNS, CANDIDATE_COLUMNS, STATE_COLUMNS, CandidateSet
from baselines.learned.graph import ExplorationGraph


class InRange:
    """A graph behind a belief that knows no more than what is in range."""

    def view(self, scenario, places):
        return scenario.grid.in_reach(places, scenario.sensor_range)


def random_graph(rng, trajectory=None, others=None, candidates=None, columns=5, weighted=False):
    """Return a graph of random features and edges; sizes that are not given are drawn."""
    trajectory = trajectory or int(rng.integers(1, 12))
    others = int(rng.integers(0, 8)) if others is None else others
    candidates = candidates or int(rng.integers(1, 8))
    count = trajectory + others + candidates
    upper = np.triu(rng.random((count, count)) < 0.3, 1).astype(float)
    if weighted:
        upper *= rng.uniform(0.5, 10.0, upper.shape)
    features = rng.normal(size=(count, columns)).astype(np.float32)
    return ExplorationGraph(features, (upper + upper.T).astype(np.float32), trajectory, candidates)


def random_set(rng, candidates=None, blocks=None):
    """Return a set of candidates and blocks with random features and places."""
    count = candidates or int(rng.integers(1, 8))
    more = int(rng.integers(1, 6)) if blocks is None else blocks
    shapes = (count, len(CANDIDATE_COLUMNS)), (more, len(BLOCK_COLUMNS)), (count + more, 2), (len(STATE_COLUMNS),)
    return CandidateSet(*(rng.normal(size=shape).astype(np.float32) for shape in shapes))


def reordered_observation(observation, order):
    """Return the observation with its candidates in another order."""
    return dataclasses.replace(
        observation,
        candidates=observation.candidates[order],
        positions=observation.positions[order],
        paths=tuple(observation.paths[i] for i in order),
        path_lengths=observation.path_lengths[order],
    )


def reordered_set(one, order):
    """Return a set with its candidates in another order."""
    places = np.concatenate((one.places[: len(order)][order], one.places[len(order) :]))
    return CandidateSet(one.candidates[order], one.blocks, places, one.state)


def reordered(graph, order):
    """Return a graph with its nodes in another order."""
    return ExplorationGraph(graph.features[order], graph.adjacency[np.ix_(order, order)], *counts(graph))


def counts(graph):
    """Return the numbers of trajectory nodes and of candidates."""
    return graph.trajectory, graph.candidates
