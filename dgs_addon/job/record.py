"""job.json beside the results: what a later Blender needs to know of a job. Knows no Blender."""

from __future__ import annotations

import os
import sys
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, cast

from ...core.errors import FormatError
from ...core.files import read_json, write_json
from ...core.json_shape import anything, check_shape, count, text

NAME = "job.json"
LOG = "job.log"


@dataclass
class Record:
    """A job as it was asked for, and how it ended.

    Attributes:
        kind: 'cameras' or 'reconstruct'.
        photos: folder of the photos.
        count: photos in it when the job began.
        arguments: of the engine, without the resumption.
        selection: names of the photos that count, one a line; '' for all of the folder.
        phase: as in `JobState`; one that says 'running' while no process does was interrupted.
        pid: of the engine's process.
        error, result: as in `JobState`.
    """

    kind: str
    photos: str
    count: int
    arguments: list[str]
    phase: str = "running"
    selection: str = ""
    pid: int | None = None
    error: str = ""
    result: dict[str, Any] = field(default_factory=dict)

    def save(self, out: Path) -> None:
        """Writes OUT/job.json; raises OutputError."""
        write_json(out / NAME, asdict(self))

    @property
    def interrupted(self) -> bool:
        """Whether its process ended and nothing says how: Blender was closed, killed, or lost power."""
        return self.phase in ("running", "paused", "cancelling") and not _lives(self.pid)


def _process(value: object) -> bool:
    """A number that a process can have."""
    return count(value) and cast(int, value) < 2**31


#: What job.json holds.
_SHAPE = {
    "kind": text,
    "photos": text,
    "count": count,
    "arguments": [text],
    "phase?": text,
    "selection?": text,
    "pid?": (_process,),
    "error?": text,
    "result?": {"*": anything},
}
#: What was read last, by file and time of its last change: a panel asks at every redraw.
_cache: dict[tuple[Path, int], Record] = {}


def read_record(out: Path) -> Record | None:
    """What OUT/job.json says; None if there is none.

    Raises:
        FormatError: the file is damaged.
    """
    try:
        key = (out, (out / NAME).stat().st_mtime_ns)
        if key not in _cache:
            value = read_json(out / NAME)
            check_shape(value, _SHAPE)
            names = {f.name for f in fields(Record)}
            record = Record(**{name: item for name, item in value.items() if name in names})
            _cache.clear()
            _cache[key] = record
        return _cache[key]
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise FormatError(f"'{out / NAME}' is damaged ({error})", "Delete it") from error


def _lives(pid: int | None) -> bool:
    # Windows has no harmless signal; there, a job that is not ours counts as ended.
    if pid is None or sys.platform == "win32":
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return not _zombie(pid)


def _zombie(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text("ascii", "replace").rpartition(")")[2].split()[0] in ("Z", "X")
    except (OSError, IndexError):
        return False
