"""Asking a strategy: what is noted of its answers, and what is around it meanwhile."""

import inspect
import os
import signal
import sys

import numpy as np
import pytest

from explore_bench.errors import RequestError
from explore_bench.runs.conformance.answers import ELSEWHERE, play
from explore_bench.runs.conformance.subject import Subject
from explore_bench.runs.conformance.tours import LARGE, LIDAR, SMALL, observations
from explore_bench.trial.spec import TrialSpec
from explore_bench.world.kinds import KINDS

SUBJECT = Subject.of("nearest", 60.0)
WORLD_TYPES = tuple(kind.load("world") for kind in KINDS.values())


class Asked:
    """Answers what it is told to."""

    def __init__(self, *answers):
        self.answers = list(answers)

    def reset(self, rng):
        self.rng = rng

    def choose(self, observation):
        answer = self.answers.pop(0)
        if isinstance(answer, BaseException):
            raise answer
        return answer


def ask(*answers):
    return play(SUBJECT, SMALL, Asked(*answers))


def test_indices_are_noted_as_they_are_and_anything_else_in_words():
    given = ask(0, np.int64(1), True, np.bool_(False), 1.0).given
    assert given == (0, 1, "True of type bool", "np.False_ of type bool", "1.0 of type float")
    assert [type(answer) for answer in given[:2]] == [int, int]


def test_whatever_it_raises_ends_the_tour():
    for raised, words in ((ValueError("no"), "ValueError: no"), (SystemExit(3), "SystemExit: 3")):
        answers = ask(0, 0, raised)
        assert answers.given == (0, 0)
        assert answers.error == f"it raised {words}"
        assert not answers.late


def test_a_request_error_before_the_first_answer_is_a_refusal_and_later_an_error_like_any():
    answers = ask(RequestError("no maps of  Mars."))
    assert answers.refused == "no maps of Mars"
    assert answers.error == "it raised RequestError: no maps of  Mars."
    assert ask(0, RequestError("no more.")).refused == ""
    assert ask(ValueError("no")).refused == ""


def test_an_interruption_by_the_user_is_not_the_strategy_s():
    """One that it raises itself is, like any other error."""
    assert ask(0, KeyboardInterrupt()).error == "it raised KeyboardInterrupt"

    class Interrupted(Asked):
        def choose(self, observation):
            os.kill(os.getpid(), signal.SIGINT)
            return 0

    previous = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            play(SUBJECT, SMALL, Interrupted())
    finally:
        signal.signal(signal.SIGINT, previous)


def test_the_numbers_of_candidates_are_noted():
    assert ask(0, 0, 0, 0, 0).counts == tuple(len(seen.candidates) for seen in observations(SMALL))


def test_a_tour_that_was_changed_is_made_anew():
    class Vandal(Asked):
        def choose(self, observation):
            observation.path_lengths.setflags(write=True)
            observation.path_lengths[:] = -1.0
            return 0

    answers = play(SUBJECT, SMALL, Vandal())
    assert answers.modified == "path_lengths"
    assert (observations(SMALL)[0].path_lengths > 0).all()


class LooksAround(Asked):
    def choose(self, observation):
        frame, found = sys._getframe(1), []
        while frame is not None:
            found += [value for value in frame.f_locals.values() if isinstance(value, (*WORLD_TYPES, TrialSpec))]
            frame = frame.f_back
        generator = sys._getframe(1).f_locals["events"]
        self.found = [*found, inspect.getgeneratorlocals(generator)["world"]]
        return 0


@pytest.mark.parametrize("tour", [LARGE, SMALL, LIDAR], ids=lambda tour: tour.name)
def test_around_it_is_a_trial_in_another_world_of_the_same_scenario(tour):
    spy = LooksAround()
    play(SUBJECT, tour, spy)
    worlds = {found.digest for found in spy.found if isinstance(found, WORLD_TYPES)}
    specs = [found for found in spy.found if isinstance(found, TrialSpec)]
    assert len(worlds) == 1
    assert tour.world().digest not in worlds
    assert [spec.trial for spec in specs] == [tour.trial + ELSEWHERE]
    assert {spec.scenario for spec in specs} == {tour.scenario}


def test_a_reference_is_told_the_world_of_the_tour():
    class Reference(Asked):
        def reset_with_world(self, rng, world):
            self.digest = world.digest

    spy = Reference(*[0] * 5)
    play(Subject.of("clairvoyant", 60.0), SMALL, spy)
    assert spy.digest == SMALL.world().digest
