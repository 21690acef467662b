"""Files that are written whole or not at all, whatever stops the process."""

from __future__ import annotations

import os
import uuid
from pathlib import Path

from explore_bench.errors import writing


def write_whole(path: Path, content: str | bytes) -> Path:
    """Write a file in the place of what was there, in one step, and return its path; text is UTF-8.

    Raises
    ------
    RequestError : where it cannot be written; what was there stays.
    """
    half = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    with writing(path):
        try:
            with half.open("wb") as file:
                file.write(content.encode() if isinstance(content, str) else content)
                file.flush()
                os.fsync(file.fileno())
            half.replace(path)
        finally:
            half.unlink(missing_ok=True)
    return path
