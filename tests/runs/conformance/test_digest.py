"""Digests of observations: alike for alike ones, and every part that is changed is named."""

import dataclasses

import numpy as np
import pytest

from explore_bench.runs.conformance.digest import changed_part, digests
from explore_bench.runs.conformance.tours import LIDAR, SMALL, observations


@pytest.fixture(scope="module")
def observation():
    return observations(SMALL)[-1]


def test_all_parts_have_one(observation):
    found = digests(observation)
    assert {"candidates", "paths", "path_lengths", "positions", "step", "decision"} <= found.keys()
    assert {"belief.poses", "belief.occupancy", "belief.known", "belief.scenario", "belief.uncertainty"} <= found.keys()
    assert {"belief.graph.elimination.corner"} <= found.keys()
    assert any(name.startswith("belief.graph.linearization.") for name in found)
    assert {"roads.grid", "roads.free", "roads.start", "robot"} <= found.keys()


def test_so_have_those_of_a_lidar_world():
    seen = observations(LIDAR)[-1]
    found = digests(seen)
    assert {f"belief.fine.{part}" for part in ("grid", "known", "occupied")} <= found.keys()
    assert {"belief.graph.links", "roads.free"} <= found.keys()
    for holder in (seen.belief.fine, seen.roads):
        for field in dataclasses.fields(holder):
            array = getattr(holder, field.name)
            if isinstance(array, np.ndarray):
                before = digests(seen)
                array.setflags(write=True)
                array[-1, -1] = not array[-1, -1]
                assert changed_part(before, seen).endswith(field.name)
                array[-1, -1] = not array[-1, -1]
                array.setflags(write=False)
                assert changed_part(before, seen) == ""


def test_reading_changes_nothing(observation):
    before = digests(observation)
    observation.belief.predict(observation.paths[0])
    assert observation.scenario.step_limit and observation.scenario.grid.columns
    assert changed_part(before, observation) == ""


def test_each_changed_array_is_named(observation):
    before = digests(observation)
    graph = observation.belief.graph
    for holder, prefix in (
        (observation, ""),
        (observation.roads, "roads."),
        (observation.belief, "belief."),
        (graph.elimination, "belief.graph.elimination."),
    ):
        for field in dataclasses.fields(holder):
            value = getattr(holder, field.name)
            if not isinstance(value, np.ndarray) or not value.size:
                continue
            other = value.copy()
            other.flat[-1] = not other.flat[-1] if other.dtype == bool else other.flat[-1] + 1
            changed = dataclasses.replace(holder, **{field.name: other})
            if holder is observation.belief:
                changed = dataclasses.replace(observation, belief=changed)
            elif holder is observation.roads:
                changed = dataclasses.replace(observation, roads=changed)
            elif holder is graph.elimination:
                other_graph = dataclasses.replace(graph, elimination=changed)
                belief = dataclasses.replace(observation.belief, graph=other_graph)
                changed = dataclasses.replace(observation, belief=belief)
            assert changed_part(before, changed) == f"{prefix}{field.name}"


def test_a_changed_path_a_shape_and_a_type_count(observation):
    before = digests(observation)
    for changes in (
        {"paths": (observation.paths[0][:-1], *observation.paths[1:])},
        {"positions": observation.positions.ravel()},
        {"candidates": observation.candidates.astype(np.int32)},
        {"step": observation.step + 1},
    ):
        assert changed_part(before, dataclasses.replace(observation, **changes)) == next(iter(changes))


def test_a_change_of_the_last_digit_inside_a_link_counts():
    """A tuple of named fields may hold arrays: they count by their bytes, not as they are printed."""
    seen = observations(LIDAR)[-1]
    before, links = digests(seen), seen.belief.graph.links
    covariance = np.nextafter(links[-1].covariance, np.inf)
    graph = dataclasses.replace(seen.belief.graph, links=(*links[:-1], links[-1]._replace(covariance=covariance)))
    changed = dataclasses.replace(seen, belief=dataclasses.replace(seen.belief, graph=graph))
    assert changed_part(before, changed) == "belief.graph.links"
