"""The only importer of numba: one set of compile options and one cache folder for every hot loop."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import platformdirs

F = TypeVar("F", bound=Callable[..., Any])


@cache
def cache_folder() -> Path:
    """Folder of the compiled kernels in the user's cache.

    It is named by the sources of all kernels, because numba's own check sees only the file of the function that
    it loads and would keep a kernel whose callees in other files have changed.
    """
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        source = file.read_bytes() if file.is_file() else b""  # editors leave links to nothing
        if b"@jit" in source:
            digest.update(source)
    name = digest.hexdigest()[:16]
    folder = platformdirs.user_cache_path("explore-bench") / "numba" / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.gettempdir()) / f"explore-bench-numba-{name}"
    return folder


os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_folder()))

import numba  # noqa: E402  (reads the folder when it is first imported)

if not numba.config.CACHE_DIR:
    numba.config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"]


def jit(function: F) -> F:
    """Compile `function` in nopython mode at its first call and cache it; division by zero follows IEEE 754."""
    return numba.njit(cache=True, error_model="numpy")(function)
