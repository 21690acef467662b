"""Chains of earlier key poses near the newest one, on hand-made trajectories."""

import numpy as np
import pytest

from explore_bench.robot.lidar.closures import CHAIN, NEAR, chains


def trajectory(*pieces):
    """Poses half a metre apart along x, a piece (first x, y, count) after another."""
    return np.array([(x + 0.5 * k, y, 0.0) for x, y, count in pieces for k in range(count)])


def in_a_row(count):
    """Links of each pose with the next, shape (L, 2)."""
    return np.column_stack((np.arange(count - 1), np.arange(1, count)))


def joined(links, *more):
    """Links and some more."""
    return np.concatenate((links, more))


FAR = (0.0, 50.0, 20)
THERE_AND_BACK = trajectory((0.0, 0.0, 10), FAR, (2.0, 1.0, 1))
"""Ten poses along x, twenty far away, and one 1 m beside the fifth of the first."""


def test_an_earlier_visit_is_a_chain_that_is_not_linked():
    (chain,) = chains(THERE_AND_BACK, in_a_row(31), 10)
    assert (chain.first, chain.end, chain.closest, chain.linked) == (0, 10, 4, False)


def test_poses_to_which_near_links_lead_are_linked():
    links = joined(in_a_row(31), (7, 30))
    (chain,) = chains(THERE_AND_BACK, links, 10)
    assert (chain.first, chain.end, chain.closest, chain.linked) == (0, 10, 4, True)


def test_links_that_lead_away_link_nothing():
    """A link to a far pose, from which another leads back: it is not the same visit."""
    links = joined(in_a_row(31), (15, 30), (3, 15))
    (chain,) = chains(THERE_AND_BACK, links, 10)
    assert not chain.linked


def test_a_run_is_split_where_its_links_are():
    """Six poses are joined to the newest and six are not: two chains, the linked one first."""
    poses = trajectory((0.0, 0.0, 12), FAR, (2.5, 1.0, 1))
    links = joined(np.delete(in_a_row(33), 5, axis=0), (9, 32))
    assert [(c.first, c.end, c.closest, c.linked) for c in chains(poses, links, 12)] == [
        (6, 12, 6, True),
        (0, 6, 5, False),
    ]


@pytest.mark.parametrize("count", [CHAIN - 1, CHAIN])
def test_a_chain_shows_enough_of_a_place(count):
    poses = trajectory((0.0, 0.0, count), FAR, (1.0, 0.5, 1))
    assert len(chains(poses, in_a_row(len(poses)), count)) == (count == CHAIN)


def test_only_poses_before_the_end_take_part():
    assert chains(THERE_AND_BACK, in_a_row(31), 10)[0].end == 10
    assert chains(THERE_AND_BACK, in_a_row(31), 8)[0].end == 8
    assert chains(THERE_AND_BACK, in_a_row(31), CHAIN - 1) == []
    assert chains(THERE_AND_BACK, in_a_row(31), 0) == []


@pytest.mark.parametrize("away", [NEAR - 0.01, NEAR + 0.01])
def test_what_is_too_far_away_is_none(away):
    """Poses on an arc around the newest one are all as far from it."""
    angles = np.linspace(0.0, 0.5, 10)
    arc = np.column_stack((away * np.cos(angles), away * np.sin(angles), np.zeros(10)))
    poses = np.concatenate((arc, trajectory(FAR), [(0.0, 0.0, 2.0)]))
    assert len(chains(poses, in_a_row(31), 10)) == (away < NEAR)


def test_two_passes_are_two_chains():
    """The middle of a long drive is near, twice: there, and on the way back."""
    poses = trajectory((-10.0, 0.0, 41), (-10.0, 2.0, 41), FAR, (0.0, 1.0, 1))
    found = chains(poses, in_a_row(len(poses)), 82)
    assert [(c.closest, c.linked) for c in found] == [(20, False), (61, False)]
    for chain in found:
        inside = np.hypot(*(poses[chain.first : chain.end, :2] - (0.0, 1.0)).T)
        assert inside.max() <= NEAR
        outside = poses[[chain.first - 1, chain.end], :2]
        assert np.hypot(*(outside - (0.0, 1.0)).T).min() > NEAR
