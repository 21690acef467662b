"""Closures beside the truth: false ones, and revisits at which none was made, each counted once."""

import math

import pytest
from lidar_worlds import SMALL, drawn, way_through

from explore_bench.geometry import between
from explore_bench.robot.lidar.pose_graph import Link
from explore_bench.trial.lidar.loops import CLOSURE_DISTANCE, PATIENCE, Loops

ROOM = SMALL.replace(size=10.0)
ROUND = ((1.0, 1.0), (9.0, 1.0), (9.0, 9.0), (1.0, 9.0), (1.0, 1.0))
LAP = len(way_through(*ROUND)) - 1


def ring(*boxes):
    """A corridor of 2 m around a block."""
    return drawn(10.0, (2.0, 8.0, 2.0, 8.0), *boxes, start=(1.0, 1.0, 0.0))


def link(earlier, later):
    return Link(earlier, later, (0.0, 0.0, 0.0), None)


def driven(world, poses, extra=()):
    """Judge of a robot that was at these true poses, joined one to the next and by `extra` links (earlier, later)."""
    loops, links, counts = Loops(ROOM, world), [], []
    for number in range(1, len(poses)):
        links += [link(number - 1, number), *(link(*own) for own in extra if own[1] == number)]
        loops.visit(poses[number], links)
        counts.append(loops.missed)
    return loops, [0, *counts]


def first_again(counts):
    return counts.index(1) - PATIENCE


def test_a_robot_that_comes_back_without_a_closure_has_missed_one_five_key_poses_later():
    _, counts = driven(ring(), way_through(*ROUND, (5.0, 1.0)))
    again = first_again(counts)
    assert LAP - 6 <= again <= LAP  # 3 m before it is back, or later where too little is seen
    assert counts[again + PATIENCE - 1 :][:2] == [0, 1]


def test_a_visit_that_goes_on_is_counted_once():
    _, counts = driven(ring(), way_through(*ROUND, *ROUND[1:]))
    assert counts[-1] == 1


def test_two_visits_count_twice():
    """A second lap: closed nowhere at first, then at every key pose for a while, and nowhere again."""
    poses = way_through(*ROUND, *ROUND[1:])
    again = first_again(driven(ring(), poses)[1])
    closed = range(again + PATIENCE + 1, LAP + 20)
    _, counts = driven(ring(), poses, [(number - LAP, number) for number in closed])
    assert counts[closed[0]] == counts[closed[-1]] == 1
    assert counts[-1] == 2


@pytest.mark.parametrize("late", [0, PATIENCE - 1, PATIENCE])
def test_a_link_within_five_key_poses_closes_it_and_a_later_one_does_not(late):
    poses = way_through(*ROUND, (5.0, 1.0))
    again = first_again(driven(ring(), poses)[1])
    _, counts = driven(ring(), poses[: again + PATIENCE + 2], [(0, again + late + 1)])
    assert counts[-1] == (1 if late == PATIENCE else 0)


def test_what_is_few_links_away_is_no_revisit():
    """To and fro within a few key poses, and a graph in which all are tied to the start."""
    assert driven(ring(), way_through((1.0, 1.0), (3.0, 1.0), (1.0, 1.0)))[1][-1] == 0
    poses = way_through(*ROUND, *ROUND[1:])
    assert driven(ring(), poses, [(0, number) for number in range(2, len(poses))])[1][-1] == 0


def test_a_place_behind_a_wall_is_no_revisit():
    """Two rooms side by side, 1 m from one another: near, but nothing of the one is seen from the other."""
    world = drawn(10.0, free=[(0.2, 4.9, 0.2, 4.9), (5.0, 9.8, 0.2, 4.9), (4.4, 5.6, 4.0, 9.8)], start=(4.4, 1.0, 0.0))
    poses = way_through((4.4, 1.0), (0.7, 1.0), (0.7, 4.0), (4.4, 4.4), (5.0, 9.5), (5.5, 4.4), (9.0, 4.0), (9.0, 1.0))
    beside = [*poses, *[(5.5, 1.0 + 0.1 * k, 0.0) for k in range(8)]]
    assert math.dist(beside[-1][:2], poses[0][:2]) < 3.0
    _, counts = driven(world, beside)
    assert counts[-1] == counts[len(poses) - 1]
    _, without = driven(drawn(10.0, start=(4.4, 1.0, 0.0)), beside)
    assert without[-1] > 0


def test_a_scan_that_meets_nothing_shows_no_place_again():
    """In the open everything is in sight, and nothing is seen."""
    open_ = ROOM.replace(size=40.0)
    world = drawn(40.0, start=(20.0, 20.0, 0.0))
    loops, links = Loops(open_, world), []
    for number, pose in enumerate(way_through((20.0, 20.0), (26.0, 20.0), (20.0, 20.0), (22.0, 20.0))[1:], 1):
        links.append(link(number - 1, number))
        loops.visit(pose, links)
    assert loops.missed == 0


def test_closures_are_false_by_their_distance_or_their_turn():
    poses = way_through((1.0, 1.0), (3.0, 1.0))
    loops, _ = driven(ring(), poses)
    x, y, turn = between(poses[0], poses[-1])
    closures = []
    for motion, false in (
        ((x + 0.01, y, turn), 0),
        ((x + CLOSURE_DISTANCE + 0.01, y, turn), 1),
        ((x, y, turn + math.radians(3.1)), 2),
        ((x, y, turn - math.radians(2.9)), 2),
    ):
        closures.append(link(0, len(poses) - 1)._replace(motion=motion))
        loops.compare(closures)
        assert loops.false == false
    loops.compare(closures)
    assert loops.false == 2, "each is judged once"
