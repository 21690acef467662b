"""The file of a submission: a zip archive that is not compressed, so that nobody reads more than was sent."""

from __future__ import annotations

import io
import re
import stat
import zipfile
from collections.abc import Mapping
from pathlib import Path

from explore_bench.errors import RequestError, one_line
from explore_bench.files import require_file

MANIFEST = "submission.json"
MOST_BYTES = 512 * 2**20
"""Size of a submission."""

MOST_FILES = 10_000
_NAME = r"[A-Za-z0-9_][A-Za-z0-9_=+.-]{0,199}"
_PLACES = re.compile(
    rf"submission\.json|trials/[0-9a-f]{{20}}\.parquet|source/{_NAME}\.py|weights/\d{{1,9}}/{_NAME}\.(safetensors|json)"
)
_TIME = (1980, 1, 1, 0, 0, 0)


def write_archive(files: Mapping[str, bytes]) -> bytes:
    """Bytes of an archive of some files: the same for the same files.

    Raises
    ------
    RequestError : where they are too many or too large, or one has a name that no archive may hold.
    """
    for name in files:
        if not _PLACES.fullmatch(name):
            raise RequestError(f"'{name}' is no name of a file in a submission; rename it with letters, digits and _.")
    size = sum(map(len, files.values()))
    if len(files) > MOST_FILES or size > MOST_BYTES:
        raise RequestError(
            f"the submission would have {len(files):,} files of {_mebibytes(size)} together, and at most "
            f"{MOST_FILES:,} of {_mebibytes(MOST_BYTES)} are taken; submit a smaller suite, or fewer training seeds."
        )
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(files):
            about = zipfile.ZipInfo(name, _TIME)
            about.external_attr = (stat.S_IFREG | 0o644) << 16
            about.create_system = 3
            archive.writestr(about, files[name])
    return sink.getvalue()


def read_archive(path: Path) -> dict[str, bytes]:
    """Files of an archive by name; nothing of it is written anywhere.

    Raises
    ------
    RequestError : where it is no such archive: too large, compressed, encrypted, damaged, with another name than those
        of a submission (a path that leads out of it, say) or one name twice, a link, or without submission.json.
    """

    def refusal(what: str) -> RequestError:
        return RequestError(f"submission '{path}': {what}; ask for one packed with 'explore-bench submit'.")

    try:
        require_file(path, MOST_BYTES + 2**20)
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            if wrong := _wrong(entries, path.stat().st_size):
                raise refusal(wrong)
            files = {entry.filename: archive.read(entry) for entry in entries}
    except RequestError:
        raise
    except OSError as error:
        raise RequestError(f"submission '{path}' cannot be read ({error.strerror or error}); check the path.") from None
    except (zipfile.BadZipFile, ValueError, RuntimeError, NotImplementedError, EOFError) as error:
        raise refusal(f"it is no whole archive ({one_line(str(error), 200)})") from None
    if MANIFEST not in files:
        raise refusal(f"it has no {MANIFEST}")
    return files


def _wrong(entries: list[zipfile.ZipInfo], size: int) -> str:
    """What is wrong with the entries of an archive of a size [bytes], in words; empty where nothing is."""
    if len(entries) > MOST_FILES:
        return f"it has {len(entries):,} files, and at most {MOST_FILES:,} are read"
    seen: set[str] = set()
    for entry in entries:
        shown = one_line(entry.filename, 100)
        if not _PLACES.fullmatch(entry.filename):
            return f"'{shown}' is no file of a submission"
        if entry.filename in seen:
            return f"'{shown}' is in it twice"
        if entry.create_system == 3 and stat.S_IFMT(entry.external_attr >> 16) not in (0, stat.S_IFREG):
            return f"'{shown}' is no regular file"
        if entry.flag_bits & 1:
            return f"'{shown}' is encrypted"
        if entry.compress_type != zipfile.ZIP_STORED or entry.compress_size != entry.file_size:
            return f"'{shown}' is compressed"
        seen.add(entry.filename)
    total = sum(entry.file_size for entry in entries)
    return f"its files claim {total:,} bytes, and it has {size:,}" if total > size else ""


def _mebibytes(size: int) -> str:
    return f"{size / 2**20:.1f} MiB"
