"""Digests of the parts of an observation, to tell whether somebody changed one."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from explore_bench.strategies.contract import Observation

Digests = dict[str, bytes]
"""Digest of each part by its dotted name."""


def digests(observation: Observation) -> Digests:
    """Digest of every part of an observation, those of the belief, its graph and the roads one by one."""
    return dict(_parts(observation, ""))


def changed_part(before: Digests, observation: Observation) -> str:
    """Name of the first part that is no longer what it was; empty where all are."""
    after = digests(observation)
    return next((name for name in before if after.get(name) != before[name]), "")


def _parts(value: Any, name: str) -> Iterator[tuple[str, bytes]]:
    if hasattr(value, "__dataclass_fields__"):
        for part in value.__dataclass_fields__:
            yield from _parts(getattr(value, part), f"{name}.{part}".lstrip("."))
        return
    digest = hashlib.blake2b(digest_size=16)
    _feed(digest, value)
    yield name, digest.digest()


def _feed(digest: hashlib.blake2b, value: Any) -> None:
    """Feed a value to a digest: arrays by their bytes, tuples item by item, anything else as it is shown."""
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, tuple):
        digest.update(f"{len(value)}".encode())
        for item in value:
            _feed(digest, item)
    else:
        digest.update(repr(value).encode())
