"""Processes of this machine: how many do jobs, for whom, and that none is left."""

import os

import pytest
from handmade import alive

from explore_bench.runs.workers.local import results_of
from explore_bench.runs.workers.process import READY, Answer, Job


def tell_pid(folder, last=False):
    yield READY
    yield Answer(os.getpid(), last)


def tell_pid_and_end(folder):
    yield from tell_pid(folder, last=True)


def pids(owners=("",), workers=1, function=tell_pid):
    """Process of each job, in the order of the owners."""
    found = dict(results_of([Job(function, (), 60.0, owner) for owner in owners], workers))
    return [found[number] for number in range(len(owners))]


@pytest.mark.parametrize("owner", ["", "Plugin"])
def test_a_process_does_all_jobs_of_its_owner_and_ends_with_the_last(owner):
    first, *others = pids([owner] * 3)
    assert set(others) == {first} != {os.getpid()}
    assert not alive(first)


def test_no_process_works_for_two_owners():
    found = pids(["", "One", "Two", "One", ""])
    assert len(set(found)) == 3
    assert found[0] == found[4]
    assert found[1] == found[3]


def test_one_that_is_not_fit_for_more_is_followed_by_another():
    assert len(set(pids([""] * 3, function=tell_pid_and_end))) == 3


def test_those_of_a_call_that_is_broken_off_end():
    results = results_of([Job(tell_pid, (), 60.0)] * 3, 1)
    _, pid = next(results)
    assert alive(pid)
    results.close()
    assert not alive(pid)
