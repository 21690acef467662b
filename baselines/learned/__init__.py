"""Strategies that are learned: the exploration graph, the networks, and what turns their values into choices."""
