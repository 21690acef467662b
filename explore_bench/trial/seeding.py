"""The only place where a random generator is born.

Every stream is named by (purpose, root seed, size, trial, role, robot) and by nothing else: all strategies, and all
noise levels, meet the same worlds and the same noise, so that their differences are paired.
"""

from __future__ import annotations

import hashlib
from typing import Literal, get_args

import numpy as np

from explore_bench.errors import unknown

Purpose = Literal["evaluate", "validate", "train", "calibrate"]
Role = Literal["world", "motion", "sensor", "strategy", "statistics", "learning"]

PURPOSES: tuple[Purpose, ...] = get_args(Purpose)
ROLES: tuple[Role, ...] = get_args(Role)


def stream(purpose: Purpose, root: int, size: float, trial: int, role: Role, robot: int = 0) -> np.random.Generator:
    """Generator of the stream with this name; two calls with one name give the same numbers.

    Parameters
    ----------
    purpose : what the numbers are for; streams of different purposes share nothing.
    root : root seed (≥ 0); 0 is the benchmark's own.
    size : edge of the map [m], told apart to the millimetre.
    trial : number of the trial (≥ 0).
    role : which part of the trial draws from it.
    robot : number of the robot whose part it is.

    Raises
    ------
    RequestError : for an unknown purpose or role.
    """
    if purpose not in PURPOSES:
        raise unknown("purpose", purpose, PURPOSES)
    if role not in ROLES:
        raise unknown("role", role, ROLES)
    key: list[int] = [PURPOSES.index(purpose), root, round(size * 1000), trial, ROLES.index(role)]
    key += [robot] if robot else []  # the first robot's streams are those of a trial with one robot
    if role == "strategy":  # a generator shows its seed, and this key would lead a strategy to its world
        key = [int.from_bytes(hashlib.sha256(repr(key).encode()).digest())]
    return np.random.Generator(np.random.PCG64DXSM(np.random.SeedSequence(key)))
