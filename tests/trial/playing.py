"""A strategy, and rollouts played with a function of the observation; nothing here is a test."""

import contextlib
import dataclasses
import gc
import signal
import types

import numpy as np

from explore_bench.strategies.contract import Observation
from explore_bench.trial.loop import rollout
from explore_bench.trial.spec import TrialSpec
from explore_bench.trial.steps import Step
from explore_bench.world.kinds import draw_world
from explore_bench.world.scenario import Scenario

SMALL = Scenario(size=12.0)
PAPER = Scenario()


@contextlib.contextmanager
def interruptible():
    """Raise KeyboardInterrupt at SIGINT and SIGTERM, as on a terminal; in the background of a script one is ignored."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, signal.default_int_handler) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)


class Nearest:
    """Takes the shortest path; subclasses do so for three decisions and go on as `later` says."""

    def reset(self, rng):
        self.decisions = 0

    def choose(self, observation):
        self.decisions += 1
        if self.decisions > 3:
            return self.later(observation)
        return int(observation.path_lengths.argmin())

    def later(self, observation):
        return int(observation.path_lengths.argmin())


def begin(scenario, trial=0, world=None):
    spec = TrialSpec("none", "none:none", scenario, trial)
    world = world or draw_world(scenario, spec.generator("world"))
    return rollout(scenario, world, spec.generator("motion"), spec.generator("sensor"))


def play(scenario, chooser, trial=0, world=None):
    """Play to the end; returns all events (Steps and pairs of an Observation and the choice) and the Ending."""
    events, found, choice = begin(scenario, trial, world), [], None
    while True:
        try:
            event = events.send(choice)
        except StopIteration as stop:
            return found, stop.value
        choice = chooser(event) if isinstance(event, Observation) else None
        found.append(event if choice is None else (event, choice))


def nearest(observation):
    return int(observation.path_lengths.argmin())


def farthest(observation):
    return int(observation.path_lengths.argmax())


def at_random(seed):
    rng = np.random.default_rng(seed)
    return lambda observation: int(rng.integers(len(observation.candidates)))


def steps_of(events):
    return [event for event in events if isinstance(event, Step)]


def decisions_of(events):
    """Pairs of an Observation and the Steps that followed its choice."""
    found = []
    for event in events:
        if isinstance(event, Step):
            if found:
                found[-1][1].append(event)
        else:
            found.append((event[0], []))
    return found


def first_observation(scenario=PAPER, trial=0, after=0):
    """Return the observation after so many decisions for the nearest, with the last row and the rollout."""
    events = begin(scenario, trial)
    choice, row = None, None
    while True:
        event = events.send(choice)
        choice = None
        if isinstance(event, Step):
            row = event
        elif event.decision == after:
            return event, row, events
        else:
            choice = nearest(event)


def reachable_from(root, bases=True):
    """All objects that can be reached from one, without those of modules, classes and code."""
    seen, found, queue = {id(root)}, [root], [root]
    while queue:
        item = queue.pop()
        parts = gc.get_referents(item)
        if isinstance(item, np.ndarray) and bases:
            parts = [*parts, item.base]
        elif dataclasses.is_dataclass(item):
            parts = [*parts, *(getattr(item, field.name) for field in dataclasses.fields(item))]
        for part in parts:
            if id(part) in seen or isinstance(part, type | types.ModuleType | types.FunctionType | types.CodeType):
                continue
            seen.add(id(part))
            found.append(part)
            queue.append(part)
    return found


def arrays_in(root, bases=True):
    return [item for item in reachable_from(root, bases) if isinstance(item, np.ndarray)]
