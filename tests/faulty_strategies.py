"""Strategies that break the contract, one rule each; nothing here is a test."""

import contextlib
import gc
import multiprocessing
import os
import random
import sys
import time

import numpy as np

from explore_bench.errors import RequestError
from explore_bench.world.kinds import KINDS

WORLD_TYPES = tuple(kind.load("world") for kind in KINDS.values())


class Sound:
    """Takes a random one of the nearer half; the others differ from it by one fault."""

    def reset(self, rng):
        self.rng = rng

    def choose(self, observation):
        order = np.argsort(observation.path_lengths, kind="stable")
        return int(order[self.rng.integers((len(order) + 1) // 2)])


class CannotBeMade(Sound):
    def __init__(self):
        raise ValueError("no map of Mars")


class NoReset:
    def choose(self, observation):
        return 0


class DiesOnImport(Sound):
    def __init__(self):
        os._exit(3)


class Sleeps(Sound):
    def choose(self, observation):
        time.sleep(60 if observation.decision == 2 else 0)
        return super().choose(observation)


class Hangs(Sound):
    def choose(self, observation):
        while True:
            with contextlib.suppress(BaseException):
                time.sleep(60)


class Raises(Sound):
    def choose(self, observation):
        if observation.decision == 3:
            raise KeyError("no such frontier")
        return super().choose(observation)


class Dies(Sound):
    def choose(self, observation):
        os._exit(5)


class AnswersFloat(Sound):
    def choose(self, observation):
        return observation.path_lengths.argmin() * 1.0


class AnswersNone(Sound):
    def choose(self, observation):
        super().choose(observation)


class AnswersBool(Sound):
    def choose(self, observation):
        return bool(super().choose(observation))


class CountsFromOne(Sound):
    def choose(self, observation):
        return int(observation.path_lengths.argmax()) + 1


class CountsBackwards(Sound):
    def choose(self, observation):
        return -1


class NeedsTwoCandidates(Sound):
    def choose(self, observation):
        return int(np.argsort(observation.path_lengths)[1])


class HasRoomForFifty(Sound):
    def choose(self, observation):
        scores = np.full(50, np.inf)
        scores[: len(observation.candidates)] = observation.path_lengths
        return int(scores.argmin())


class NeedsNeighbours(Sound):
    """A cell at an edge has five neighbours; one in a corner has three."""

    def choose(self, observation):
        n, size = observation.scenario.grid.columns, observation.scenario.cell_size
        column, row = (int(np.clip(value // size, 0, n - 1)) for value in observation.pose[:2])
        around = observation.belief.known[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        assert around.size >= 6, "too few neighbours"
        return super().choose(observation)


class NeedsLandmark(Sound):
    """It knows that a lidar sees none."""

    def choose(self, observation):
        if observation.belief.fine is not None:
            return super().choose(observation)
        return int(np.abs(observation.positions - observation.belief.landmarks[0]).sum(axis=1).argmin())


class FailsLate(Sound):
    """After more steps than the longest tour has; by the longest paths its own trials do."""

    def choose(self, observation):
        if observation.step > 200:
            raise RuntimeError("nearly done")
        return int(observation.path_lengths.argmax())


class UsesGlobalNumpy(Sound):
    def choose(self, observation):
        return int(np.random.randint(len(observation.candidates)))  # noqa: NPY002


class UsesGlobalRandom(Sound):
    def choose(self, observation):
        return random.randrange(len(observation.candidates))


class Unseeded(Sound):
    def reset(self, rng):
        self.rng = np.random.default_rng()


class GoesByHash(Sound):
    def choose(self, observation):
        return hash(f"decision {observation.decision}") % len(observation.candidates)


class Remembers(Sound):
    def __init__(self):
        self.chosen = []

    def choose(self, observation):
        self.chosen.append(observation.step)
        return len(self.chosen) % len(observation.candidates)


class KeepsItsFirstStream(Sound):
    def __init__(self):
        self.rng = None

    def reset(self, rng):
        self.rng = self.rng or rng


class ChangesAnArray(Sound):
    def choose(self, observation):
        lengths = observation.path_lengths
        lengths.setflags(write=True)
        lengths += 1.0
        return super().choose(observation)


class ChangesTheBelief(Sound):
    """Read-only views may be opened through the array that they look at."""

    def choose(self, observation):
        choice = super().choose(observation)
        known = observation.belief.known
        if known.base is not None:
            known.base.setflags(write=True)
            known.setflags(write=True)
            known[0, 0] = not known[0, 0]
        return choice


class ChangesTheFineMap(Sound):
    """Where there is one."""

    def choose(self, observation):
        choice, fine = super().choose(observation), observation.belief.fine
        if fine is not None:
            fine.occupied.setflags(write=True)
            fine.occupied[-1, -1] = not fine.occupied[-1, -1]
        return choice


class ChangesTheRoads(Sound):
    """Opens all of them, once what it answers is decided."""

    def choose(self, observation):
        choice, roads = super().choose(observation), observation.roads
        roads.free.setflags(write=True)
        roads.free[:] = True
        return choice


class ChangesAField(Sound):
    def choose(self, observation):
        object.__setattr__(observation, "decision", -1)
        return super().choose(observation)


def towards(world, observation):
    """Return the candidate that is nearest to a true landmark, or to the true start where there is none."""
    point = (*world.landmarks, world.start[:2])[0]
    return int(np.hypot(*(observation.positions - point).T).argmin())


class PeeksThroughTheStack(Sound):
    """Any frame that holds a world."""

    def choose(self, observation):
        frame = sys._getframe(1)
        while frame is not None:
            for value in frame.f_locals.values():
                if isinstance(value, WORLD_TYPES):
                    return towards(value, observation)
            frame = frame.f_back
        return 0


class PeeksAtTheRollout(Sound):
    """The true pose, in the generator that waits for the choice."""

    def choose(self, observation):
        frame = sys._getframe(1)
        while "events" not in frame.f_locals:
            frame = frame.f_back
        explorer = frame.f_locals["events"].gi_frame.f_locals["explorer"]
        body = explorer._robot if observation.belief.fine is None else explorer._vehicle
        x, y, _ = body.pose
        return int(np.hypot(*(observation.positions - [x, y]).T).argmin())


class PeeksThroughTheCollector(Sound):
    def reset(self, rng):
        gc.collect()  # lest it meet the world of a trial that is over
        super().reset(rng)

    def choose(self, observation):
        size = observation.scenario.size
        worlds = [value for value in gc.get_objects() if isinstance(value, WORLD_TYPES)]
        worlds = [world for world in worlds if np.isclose(world.grid.columns * world.grid.resolution, size)]
        return towards(worlds[-1], observation) if worlds else 0


class PeeksAtTheSpecification(Sound):
    """The true map is drawn again from the streams that the trial's specification names."""

    def choose(self, observation):
        from explore_bench.trial.spec import TrialSpec
        from explore_bench.world.kinds import draw_world

        frame = sys._getframe(1)
        while frame is not None:
            for value in frame.f_locals.values():
                if isinstance(value, TrialSpec):
                    return towards(draw_world(value.scenario, value.generator("world")), observation)
            frame = frame.f_back
        return 0


WORLDS = {}


class LearnsMapsByHeart(Sound):
    """Keeps every world it ever found under what it observed there first, and uses it when it is there again."""

    def choose(self, observation):
        if observation.decision == 0:
            self.key = observation.pose
        frame = sys._getframe(1)
        while frame is not None and self.key not in WORLDS:
            for value in frame.f_locals.values():
                if isinstance(value, WORLD_TYPES):
                    WORLDS.setdefault(self.key, value)
            frame = frame.f_back
        return towards(WORLDS[self.key], observation)


class WorksInTheMainProcessOnly(Sound):
    def reset(self, rng):
        assert multiprocessing.current_process().name == "MainProcess", "not in the main process"
        super().reset(rng)


class ChoosesOtherwiseInWorkers(Sound):
    def choose(self, observation):
        if multiprocessing.current_process().name != "MainProcess":
            return len(observation.candidates) - 1
        return 0


class DiesInWorkers(Sound):
    def reset(self, rng):
        if multiprocessing.current_process().name != "MainProcess":
            os._exit(7)
        super().reset(rng)


class RefusesAll(Sound):
    def reset(self, rng):
        raise RequestError("it waits for worlds to come.")


class RefusesLate(Sound):
    """A refusal after the first answer is none."""

    def choose(self, observation):
        if observation.belief.fine is not None and observation.decision == 2:
            raise RequestError("it is tired of lidars.")
        return super().choose(observation)


class Refuses(Sound):
    """No fault: it refuses the worlds of one kind, each time."""

    def __init__(self, kind):
        self.kind = kind

    def choose(self, observation):
        if observation.scenario.kind == self.kind:
            raise RequestError(f"it does not run in kind '{self.kind}'; leave it out.")
        return super().choose(observation)


class ByLidar(Sound):
    """Has the fault of another one in lidar worlds, and none elsewhere."""

    def __init__(self, fault):
        self.faulty = globals()[fault]()

    def reset(self, rng):
        super().reset(rng)
        self.faulty.reset(rng)

    def choose(self, observation):
        return super().choose(observation) if observation.belief.fine is None else self.faulty.choose(observation)
