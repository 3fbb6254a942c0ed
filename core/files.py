"""Files are written whole or not at all: a temporary neighbour first, then one rename.

A full disk, a lost network drive or Ctrl-C never leaves half a file in the place of a good one.
"""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from .errors import OutputError

#: Bytes of JSON that are read; a hundred times the largest of ours, and what a parser makes of it still fits in memory.
LARGEST_JSON = 2**25
#: Whole numbers beyond it are no counts, sizes or seeds, and no array takes them.
LARGEST_INTEGER = 2**64

_WAYS_OUT = {
    errno.ENOSPC: "Free some space on that disk or choose another folder",
    errno.EDQUOT: "Your disk quota is used up; free some space or choose another folder",
    errno.EFBIG: "The file system allows no file of this size; choose another folder",
    errno.EACCES: "Choose a folder that you may write to",
    errno.EPERM: "Choose a folder that you may write to",
    errno.EROFS: "The disk is read-only; choose another folder",
    errno.ENOTDIR: "A part of this path is a file; choose another folder",
    errno.EEXIST: "A file of this name is in the way; choose another folder",
    errno.EISDIR: "A folder of this name is in the way; move it or choose another folder",
    errno.ENAMETOOLONG: "Choose a shorter name",
}


def output_error(path: Path, error: OSError) -> OutputError:
    """Says in one line why `path` cannot be written, and what to do."""
    reason = (error.strerror or str(error)).lower()
    return OutputError(
        f"Cannot write '{path}': {reason}", _WAYS_OUT.get(error.errno or 0, "Check the disk or choose another folder")
    )


@contextmanager
def explaining(folder: Path) -> Iterator[None]:
    """Around what writes scratch files into a folder by other means than these: raises OutputError for OSError."""
    try:
        yield
    except OSError as error:
        if error.errno is None:  # (numpy's, where a file took only a part of an array)
            error = OSError(errno.ENOSPC, f"No room ({error})")
        raise output_error(folder, error) from error


def make_folder(path: Path) -> Path:
    """Makes a folder and its parents.

    Raises:
        OutputError: it cannot be made, or a file stands in its place.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise output_error(path, error) from error
    return path


def check_writable(folder: Path) -> None:
    """Finds out now, rather than after an hour of work, that a folder takes no files.

    Raises:
        OutputError: nothing can be written into `folder`.
    """
    probe = make_folder(folder) / f".probe-{os.getpid()}"
    try:
        probe.write_bytes(b"\0" * 4096)
    except OSError as error:
        raise output_error(folder, error) from error
    finally:
        _forget(probe)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary path to write to; it takes the place of `path` when the block ends well.

    The temporary keeps the suffix, because image libraries choose the format by it. It is synced to
    the disk before the rename, so that a power cut leaves the old file or the new one.

    Raises:
        OutputError: the disk is full, or the place cannot be written to.
    """
    make_folder(path.parent)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield temporary
        sync_file(temporary)
        os.replace(temporary, path)
        sync_folder(path.parent)
    except OSError as error:
        raise output_error(path, error) from error
    finally:
        _forget(temporary)


def _forget(file: Path) -> None:
    """Removes a file that may not be there; a disk that is read-only refuses even that."""
    with suppress(OSError):
        file.unlink(missing_ok=True)


def sync_file(path: Path) -> None:
    """A file's content is on the disk, not only in its cache; raises OSError."""
    with open(path, "rb" if os.name == "posix" else "rb+") as file:  # (elsewhere only files that are open for writing)
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Makes a rename last; Windows has no such call and needs none."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_bytes(path: Path, data: bytes) -> None:
    """Writes a whole file; raises OutputError (see `replacing`)."""
    with replacing(path) as temporary:
        temporary.write_bytes(data)


def write_text(path: Path, text: str) -> None:
    """Writes a whole UTF-8 file; raises OutputError (see `replacing`)."""
    write_bytes(path, text.encode("utf-8"))


def write_json(path: Path, value: Any) -> None:
    """Writes JSON that every parser reads: NaN and infinity are refused (ValueError)."""
    write_text(path, json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def read_json(path: Path, largest: int = LARGEST_JSON) -> Any:
    """What a JSON file holds, whoever wrote it; its types are the caller's to check.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no file (a pipe would be waited for), larger than `largest` bytes, no JSON, or what
            `parse_json` refuses.
    """
    if stat.S_IFMT(path.stat().st_mode) not in (stat.S_IFREG, stat.S_IFDIR):  # (opening a folder says it better)
        raise ValueError("no file that ends")
    with path.open("rb") as file:
        data = file.read(largest + 1)
    if len(data) > largest:
        raise ValueError(f"larger than {largest // 2**20} MiB")
    return parse_json(data)


def parse_json(data: bytes) -> Any:
    """UTF-8 JSON from anybody.

    Raises:
        ValueError: no JSON, brackets in brackets without end, whole numbers that no array takes, or text that is no
            Unicode.
    """
    try:
        value = json.loads(data.decode("utf-8-sig"), parse_int=_integer)
        if b"\\u" in data:  # half a pair of surrogates is valid JSON, but no file takes it
            json.dumps(value, ensure_ascii=False).encode("utf-8")
    except RecursionError:
        raise ValueError("too many brackets in brackets") from None
    except MemoryError:
        raise ValueError("too large for the memory") from None
    return value


def _integer(text: str) -> int:
    value = int(text) if len(text) <= 21 else LARGEST_INTEGER
    if not -LARGEST_INTEGER < value < LARGEST_INTEGER:
        raise ValueError(f"the number {text[:8]}... has {len(text)} digits")
    return value


def file_digest(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits; raises OSError."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def plain(value: Any) -> Any:
    """Values that JSON holds: dataclasses as objects, numpy's numbers as Python's, NaN as null."""
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, (str, bool, int)) or value is None:
        return value
    if hasattr(value, "item"):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value)
