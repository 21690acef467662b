"""Where files of weights lie."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path


def weights_file(weights: str) -> Path:
    """File that `Entry.weights` names: a path, or "package:path" below an importable top-level package.

    The second form stays true in a checkout that is moved, and on another machine.
    """
    package, colon, below = weights.partition(":")
    if colon and re.fullmatch(r"\w{2,}", package) and (spec := find_spec(package)) and spec.submodule_search_locations:
        return Path(spec.submodule_search_locations[0]) / below
    return Path(weights)
